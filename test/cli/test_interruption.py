"""Signals in a command: while it imports, while it runs, and where they are ignored."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.command_line import outcome
from impact_damper_ros.control import Rig
from impact_damper_ros.rig import RigParameters

ROOT = Path(impact_damper_ros.__file__).parents[1]

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
RUN = """
import sys
from impact_damper_ros.entry_points import {command}
sys.exit({command}())
"""


def started(code, *words):
    return subprocess.Popen(
        [sys.executable, '-c', code, *map(str, words)],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


@pytest.mark.parametrize('command', ['recover_run', 'sim_node'])
def test_a_command_that_still_imports_ends_without_a_traceback(command):
    code = SIGNAL_AT_IMPORT.format(before='default_int_handler') + RUN.format(command=command)
    process = started(code, '--version')
    assert process.communicate(timeout=60)[0] == ''
    assert process.returncode == -signal.SIGINT


def test_an_ignored_ctrl_c_stays_ignored():
    """As in a background job of a shell script."""
    code = SIGNAL_AT_IMPORT.format(before='SIG_IGN') + RUN.format(command='simulate_rig')
    process = started(code, 'paper', '--duration', 1, '--quiet')
    assert (process.communicate(timeout=60)[0], process.returncode) == ('', 0)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_run_that_is_stopped_is_whole(tmp_path, number):
    """As by `timeout`: SIGTERM once left a bag to be recovered and a table that ended in a row."""
    bag, table = tmp_path / 'bag', tmp_path / 'impacts.csv'
    words = ['paper', '--duration', 1e6, '--bag', bag, '--impacts', table, '--quiet']
    process = started(RUN.format(command='simulate_rig'), *words)
    try:
        deadline = time.monotonic() + 100.0
        while not table.is_file() or table.stat().st_size < 10_000:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        process.send_signal(number)
        said = process.communicate(timeout=100)[0]
    finally:
        process.kill()
    assert (process.returncode, said) == (
        128 + number,
        'simulate_rig: interrupted; what was simulated is written\n',
    )
    assert RunReader(bag).complete
    assert table.read_text().endswith('\n')
    rows = [row.split(',') for row in table.read_text().splitlines()]
    assert {len(row) for row in rows} == {7}
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
