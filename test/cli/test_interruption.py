"""Ctrl-C in every command, while it imports and while it runs: an exit code, and no traceback."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros import entry_points
from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.command_line import outcome
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.rig.event_budget import RunawayError

ROOT = Path(impact_damper_ros.__file__).parents[1]
BENCH = ROOT / 'config' / 'bench_rig.yaml'
COMMANDS = [name for name in entry_points.__all__ if not name.startswith(('begin', 'run'))]
MODULES = [f'node.{name}' if name == 'sim_node' else f'cli.{name}' for name in COMMANDS]

# A real signal, at an instant that does not depend on how fast the machine is.
SIGNAL_AT_IMPORT = """
import os, sys

class Signalling:
    def find_spec(self, name, path=None, target=None):
        if name in ('argparse', 'rclpy'):
            os.kill(os.getpid(), {number:d})

sys.meta_path.insert(0, Signalling())
"""
SIGNAL_AT_OPENING = """
import os, sys

def look(event, arguments):
    if event == 'open' and str(arguments[0]).endswith({name!r}):
        os.kill(os.getpid(), {number:d})

sys.addaudithook(look)
"""
RUN = """
from impact_damper_ros.entry_points import {command}
sys.exit({command}())
"""


def ended(*words: object, search: Path = ROOT) -> subprocess.CompletedProcess:
    """Run Python; return its exit code and what it said."""
    return subprocess.run(
        [sys.executable, *map(str, words)],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(search), str(ROOT)])},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=60,
        check=False,
    )


def check_ended(done: subprocess.CompletedProcess, command: str, number: signal.Signals) -> None:
    if command == 'sim_node':
        assert (done.returncode, done.stdout) == (0, '')
    elif number == signal.SIGINT:
        assert (done.returncode, done.stdout) == (130, f'{command}: interrupted\n')
    else:
        assert (done.returncode, done.stdout) == (-signal.SIGTERM, '')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize('command', COMMANDS)
def test_a_console_script_that_still_imports(command, number):
    code = SIGNAL_AT_IMPORT.format(number=number) + RUN.format(command=command)
    check_ended(ended('-c', code), command, number)


@pytest.mark.parametrize('module', [*MODULES, 'cli.demo'])
def test_a_module_that_still_imports(module, tmp_path):
    """As `python -m`, with what Python loads at its start sending the signal."""
    code = SIGNAL_AT_IMPORT.format(number=signal.SIGINT)
    (tmp_path / 'sitecustomize.py').write_text(code, encoding='utf-8')
    done = ended('-m', f'impact_damper_ros.{module}', '--help', search=tmp_path)
    check_ended(done, module.split('.')[1], signal.SIGINT)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    bag = tmp_path_factory.mktemp('runs') / 'bag'
    assert simulate_rig([str(BENCH), '--duration', '20', '--bag', str(bag), '--quiet']) == 0
    return bag


def test_a_command_that_runs(bag, tmp_path):
    """`recover_run` leaves it to its entry point to say that it is interrupted."""
    code = SIGNAL_AT_OPENING.format(name='.mcap', number=signal.SIGINT)
    code += RUN.format(command='recover_run')
    done = ended('-c', code, bag, '--output', tmp_path / 'recovered')
    check_ended(done, 'recover_run', signal.SIGINT)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_a_run_that_is_stopped_is_whole(tmp_path, number):
    """As by `timeout`: SIGTERM once left a bag to be recovered and a table that ended in a row."""
    bag, table = tmp_path / 'bag', tmp_path / 'impacts.csv'
    code = 'import sys' + RUN.format(command='simulate_rig')
    words = [str(BENCH), '--duration', '1e6', '--bag', str(bag), '--impacts', str(table)]
    process = subprocess.Popen(
        [sys.executable, '-c', code, *words, '--quiet'],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )
    try:
        deadline = time.monotonic() + 100.0
        while not table.is_file() or not table.stat().st_size:
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
    assert {row.count(',') for row in table.read_text().splitlines()} == {6}


def test_an_ignored_ctrl_c_stays_ignored(bag, tmp_path):
    """As in a background job of a shell script."""
    code = 'import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)'
    code += SIGNAL_AT_IMPORT.format(number=signal.SIGINT)
    code += SIGNAL_AT_OPENING.format(name='.mcap', number=signal.SIGINT)
    code += RUN.format(command='recover_run')
    done = ended('-c', code, bag, '--output', tmp_path / 'recovered')
    assert done.returncode == 0, done.stdout
    assert (tmp_path / 'recovered' / 'metadata.yaml').is_file()


IN_COMPILED_CODE = """
import hashlib, os, sys, threading
from impact_damper_ros import entry_points

def main():
    threading.Timer(0.2, os.kill, (os.getpid(), {number:d})).start()
    # Minutes without a look at signals
    hashlib.pbkdf2_hmac('sha256', b'', b'', 10**9)

entry_points._PATIENCE = 0.5
sys.exit(entry_points.run('sweep_rig', main))
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_code_that_does_not_look_at_signals(number):
    done = ended('-c', IN_COMPILED_CODE.format(number=number))
    assert (done.returncode, done.stdout) == (128 + number, 'sweep_rig: interrupted\n')


AN_ERROR_THAT_CTRL_C_LEADS_TO = """
import os, signal, sys
from impact_damper_ros.entry_points import run

def main():
    try:
        {interruption}
    except KeyboardInterrupt:
        raise ImportError('numpy failed to import') from None
    raise ImportError('numpy is not there')

sys.exit(run('simulate_rig', main))
"""


def test_an_error_that_ctrl_c_leads_to():
    code = AN_ERROR_THAT_CTRL_C_LEADS_TO
    done = ended('-c', code.format(interruption='os.kill(os.getpid(), signal.SIGINT)'))
    check_ended(done, 'simulate_rig', signal.SIGINT)
    done = ended('-c', code.format(interruption='pass'))
    assert done.returncode == 1
    assert 'ImportError: numpy is not there' in done.stdout


def test_a_rig_that_cannot_be_followed_is_no_traceback_in_any_command(capsys):
    def main():
        raise RunawayError(10_000, 0.1)

    assert outcome('replay_run', main) == 1
    said = capsys.readouterr().err
    assert said.count('\n') == 1
    assert said.startswith('replay_run: the rig has more than 10000 events at once, at 0.1 s')
