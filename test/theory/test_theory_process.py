"""The process of the theory: asked, superseded, killed, switched off; without ROS in it."""

import itertools
import json
import os
import signal
import time
from pathlib import Path

import pytest

from impact_damper_ros import Rig, RigParameters, find_orbits
from impact_damper_ros.theory import theory_process
from impact_damper_ros.theory.child_process import decoded, encoded
from impact_damper_ros.theory.theory_process import TheoryProcess
from theory.observed import motion_on

HORIZONTAL = RigParameters(gravity=0.0)
THREE = RigParameters(gravity=0.0, gap=18.0, force_frequencies=1.02)
DEADLINE_S = 300.0


def state_of(rig):
    return Rig(rig).snapshot()


def alive(pid):
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False


def poll_until(process, condition):
    """Poll until a condition holds."""
    end = time.monotonic() + DEADLINE_S
    while not condition():
        process.poll()
        assert time.monotonic() < end, vars(process)
        time.sleep(0.005)


def answer(process):
    poll_until(process, lambda: process.done)
    return process.prediction


@pytest.fixture
def start():
    started = []

    def begin(**options):
        warnings = []
        started.append(TheoryProcess(warn=warnings.append, **options))
        return started[-1], warnings

    yield begin
    for process in started:
        pid = process.process
        process.close()
        assert process.process == 0
        assert not pid or not alive(pid)


def test_one_process_answers_all_that_is_asked(start):
    process, warnings = start()
    process.enable(False)
    process.ask(state_of(HORIZONTAL))
    assert (process.poll(), process.process) == (False, 0)
    assert 'switched off' in json.loads(process.document)['theory_failed']['text']
    process.enable(True)
    found = answer(process)
    orbit = find_orbits(HORIZONTAL, (1, 2)).orbits[0]
    assert (found.basis, found.complete, found.error) == ('run ahead', True, '')
    assert found.expected.distance(orbit) < 1e-9
    assert found.expected.multipliers == pytest.approx(orbit.multipliers, rel=1e-7)
    pid = process.process
    assert os.getpriority(os.PRIO_PROCESS, pid) >= os.getpriority(os.PRIO_PROCESS, 0) + 5
    # A Ctrl-C in the terminal is not for it.
    assert os.getpgid(pid) != os.getpgid(0)
    # No document was asked for.
    assert json.loads(process.document)['orbit'] is None
    process.want_documents(True)
    # What is known stays until as much is known again.
    poll_until(process, lambda: '"gap_curve": {' in process.document)
    assert process.prediction.expected.distance(found.expected) < 1e-9
    answer(process)
    document = json.loads(process.document)
    assert document['gap_curve']['done']
    assert document['gap_curve']['optimum']['gap'] == pytest.approx(58.3, rel=0.02)
    assert document['orbit']['x_max_ratio'] == pytest.approx(0.104644, abs=1e-6)
    # Switched off and on, they are not made again.
    for wanted in (False, True):
        process.want_documents(wanted)
        assert process.done
    assert json.loads(process.document) == document
    process.ask({'format': 99, 'time': 0.0})
    assert 'ValueError: snapshot of format 99' in answer(process).error
    failed = json.loads(process.document)['theory_failed']
    assert 'snapshot of format 99' in failed['text']
    process.want_documents(False)
    process.ask(state_of(THREE))
    assert (process.course, process.prediction) == (3, None)
    assert answer(process).expected.stops == (1, 1, 2)
    assert json.loads(process.document)['gap_curve'] is None
    process.ask_like(motion_on(find_orbits(THREE, (1, 2, 2)).orbits[0]))
    found = answer(process)
    assert (found.basis, found.expected.stops, process.course) == ('measured', (1, 2, 2), 3)
    assert (process.process, warnings) == (pid, [])
    process.enable(False)
    assert not alive(pid)
    assert (process.prediction, warnings) == (None, [])


def test_only_the_newest_rig_is_answered_and_nothing_piles_up(start):
    process, _ = start(documents=True)
    process.ask(state_of(HORIZONTAL.replace(gap=8.0)))
    poll_until(process, lambda: process.prediction is not None)
    # It answers none of them before all have been asked for.
    os.kill(process.process, signal.SIGSTOP)
    gaps = [20.0 + 0.5 * k for k in range(30)]
    for gap in gaps:
        process.ask(state_of(HORIZONTAL.replace(gap=gap)) | {'padding': 'x' * 100_000})
    assert process.prediction is None
    assert len(process._child._writing) + len(process._child._next) < 500_000
    os.kill(process.process, signal.SIGCONT)
    poll_until(process, lambda: process.prediction is not None)
    x_max = find_orbits(HORIZONTAL.replace(gap=gaps[-1]), (1, 2)).orbits[0].x_max
    assert process.prediction.orbits[0].x_max == pytest.approx(x_max, rel=1e-9)
    document = json.loads(process.document)
    assert document['gap_curve'] is None or document['gap_curve']['gap'] == gaps[-1]
    # Nor does a stopped process hold up the end.
    pid = process.process
    os.kill(pid, signal.SIGSTOP)
    process.ask({'padding': 'x' * 300_000, 'time': 0.0})
    process.poll()
    process.close()
    assert not alive(pid)


def test_a_killed_process_is_followed_by_another_one(start, monkeypatch):
    monkeypatch.setattr(theory_process, 'BACK_OFF_S', 0.05)
    process, warnings = start()
    process.enable(False)
    process.enable(True)
    process.ask(state_of(HORIZONTAL))
    first = answer(process)
    pid = process.process
    os.kill(pid, signal.SIGKILL)
    poll_until(process, lambda: process.process not in (0, pid))
    assert (process.restarts, process.trouble) == (1, '')
    (warning,) = warnings
    assert 'ended by signal 9; it is started again after 0.05 s' in warning
    # The last answer stays valid; the one still outstanding comes from the new process.
    assert process.prediction == first
    process.ask(state_of(THREE))
    os.kill(process.process, signal.SIGKILL)
    assert answer(process).expected.stops == (1, 1, 2)


def test_a_process_that_cannot_live_is_tried_ever_more_rarely(start, monkeypatch):
    monkeypatch.setattr(theory_process, 'BACK_OFF_S', 0.02)
    process, warnings = start(command=['-c', 'raise SystemExit(3)'])
    process.enable(False)
    process.enable(True)
    process.ask(state_of(HORIZONTAL))
    poll_until(process, lambda: len(warnings) >= 3)
    pauses = [float(w.split('after ')[1].split()[0]) for w in warnings[:3]]
    assert pauses == [0.02, 0.04, 0.08]
    assert 'with code 3' in warnings[0]
    monkeypatch.setattr('sys.executable', '/no/such/program')
    process, warnings = start()
    process.ask(state_of(HORIZONTAL))
    assert process.poll()
    assert 'cannot be started' in warnings[0]
    assert process.trouble


@pytest.mark.parametrize(
    ('forever', 'reason'),
    [
        ('while True: pass', 'not finished within 0.2 s'),
        ('os.kill(os.getpid(), 11)', 'the search ended by signal 11'),
    ],
)
def test_a_search_that_does_not_end_is_reported(start, forever, reason):
    program = (
        'import os\n'
        'from impact_damper_ros.theory import worker\n'
        'from impact_damper_ros.theory.prediction import Prediction\n'
        'def endless(*_, **__):\n'
        '    yield Prediction()\n'
        f'    {forever}\n'
        'worker.theory, worker._PATIENCE_S = endless, 0.2\n'
        'worker.main()\n'
    )
    process, _ = start(command=['-c', program])
    process.ask({'time': 0.0})
    assert reason in answer(process).error


def test_a_message_that_is_cut_off_is_left_out():
    line = encoded((1, {'answer': list(range(50))})).strip()
    assert decoded(line) == (1, {'answer': list(range(50))})
    assert [decoded(line[:end]) for end in itertools.chain([0], range(1, len(line) - 1))] == [
        None
    ] * (len(line) - 1)
