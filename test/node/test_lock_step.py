"""What ends a run in lock-step; `examples/test_controllers.py` has the runs."""

import pytest
from running import SOURCE

from impact_damper_ros.node.lock_step import PATIENCE_S, Progress, run_in_lock_step


def test_a_run_may_be_slow_but_not_stand_still():
    now = [0.0]
    progress = Progress(lambda: now[0])
    for step in range(1, 20):
        now[0] += 0.9 * PATIENCE_S
        progress.look(1e-3 * step)
    now[0] += 0.9 * PATIENCE_S
    progress.look(0.019)
    now[0] += 0.2 * PATIENCE_S
    with pytest.raises(RuntimeError, match=r'has stood still at 0\.019 s for 300 s'):
        progress.look(0.019)


def test_a_second_run_into_a_directory_is_refused_before_it_starts(tmp_path):
    (tmp_path / 'run').mkdir()
    with pytest.raises(
        FileExistsError, match='is not empty: give each run a directory of its own'
    ):
        run_in_lock_step('no controller', 1.0, tmp_path, {})


def test_commands_on_another_topic_end_a_run(tmp_path):
    """The rig would wait `lock_step_timeout` for each."""
    controller = SOURCE / 'examples' / 'controllers' / 'skyhook.py'
    words = 'waits for stop_commands only: start with lock_step:=force_command, or lock_step:=both'
    with pytest.raises(RuntimeError, match=words):
        run_in_lock_step(controller, 1.0, tmp_path, {'record': False})
