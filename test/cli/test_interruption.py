"""Signals in a command: while it imports, while it runs, and where they are ignored."""

import os
import signal
import subprocess
import sys
import time

import pytest
from running import SOURCE as ROOT, Running

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.command_line import outcome
from impact_damper_ros.report.csv_tables import IMPACT_COLUMNS

# A real signal, at an instant that does not depend on how fast the machine is.
SIGNAL_AT_IMPORT = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.{before})

class Signalling:
    def find_spec(self, name, path=None, target=None):
        if name in ('argparse', 'rclpy'):
            os.kill(os.getpid(), signal.SIGINT)

sys.meta_path.insert(0, Signalling())
"""


@pytest.fixture
def signal_at_import(tmp_path):
    """Return a folder in which Python finds what sends the signal before it runs anything."""

    def written(before):
        (tmp_path / 'sitecustomize.py').write_text(SIGNAL_AT_IMPORT.format(before=before))
        return tmp_path

    return written


def started(directory, command, *words, path=(), module=False):
    """Start a command as its console script does, or as a module."""
    script = f'import sys; sys.argv[0] = {command!r}; '
    script += f'from impact_damper_ros.cli.{command} import main; sys.exit(main())'
    start = ['-m', f'impact_damper_ros.cli.{command}'] if module else ['-c', script]
    return Running(directory, *start, *words, path=path)


@pytest.mark.parametrize('module', [False, True])
@pytest.mark.parametrize('command', ['recover_run', 'sim_node'])
def test_a_command_that_still_imports_ends_without_a_traceback(command, module, signal_at_import):
    path = signal_at_import('default_int_handler')
    with started(path, command, '--version', path=[path], module=module) as process:
        assert (process.wait(), process.output) == (-signal.SIGINT, '')


def test_an_ignored_ctrl_c_stays_ignored(signal_at_import):
    """As in a background job of a shell script."""
    words = ['paper', '--duration', 1, '--quiet']
    path = signal_at_import('SIG_IGN')
    with started(path, 'simulate_rig', *words, path=[path]) as process:
        assert (process.wait(), process.output) == (0, '')


def test_to_import_a_command_leaves_the_signals_of_a_program_alone():
    code = (
        'import signal; from impact_damper_ros.cli import simulate_rig; '
        'assert signal.getsignal(signal.SIGINT) is signal.default_int_handler'
    )
    subprocess.run(
        [sys.executable, '-c', code], env={**os.environ, 'PYTHONPATH': ROOT}, check=True
    )


def test_a_run_that_is_stopped_keeps_what_it_has_and_what_was_there(tmp_path):
    """As by `timeout`: SIGTERM once left a bag to be recovered and a table that ended in a row."""
    bag, table, part = (tmp_path / name for name in ('bag', 'impacts.csv', 'impacts.csv.part'))
    table.write_text('older, and complete\n')
    words = ['paper', '--duration', 1e6, '--bag', bag, '--impacts', table, '--quiet']
    with started(tmp_path, 'simulate_rig', *words) as process:
        process.until(lambda: part.is_file() and part.stat().st_size > 10_000)
        code = process.stop(signal.SIGTERM)
    assert (code, process.output) == (
        128 + signal.SIGTERM,
        f'simulate_rig: interrupted; the output so far is in {part} and {bag}\n',
    )
    assert RunReader(bag).complete
    assert table.read_text() == 'older, and complete\n'
    assert part.read_text().endswith('\n')
    rows = [row.split(',') for row in part.read_text().splitlines()]
    assert {len(row) for row in rows} == {len(IMPACT_COLUMNS)}
    assert (
        float(rows[50][0]) == Rig(RigParameters(gravity=1.0)).advance(float(rows[50][0]))[-1].time
    )


def test_an_interruption_in_a_destructor_is_not_lost(capsys):
    class Destroyed:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    def work():
        Destroyed()
        time.sleep(100.0)
        return 0

    assert outcome('sweep_rig', work) == 128 + signal.SIGTERM
    assert capsys.readouterr().err == 'sweep_rig: interrupted\n'
