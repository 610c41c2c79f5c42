"""What all commands share: exit codes, messages, the rig that is given."""

import logging
import os
import re
import shutil
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from running import SOURCE
from setup_file import COMMANDS
from tqdm import tqdm

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.cli import command_line
from impact_damper_ros.cli.command_line import CommandError, outcome
from impact_damper_ros.cli.rig_options import given_rig
from impact_damper_ros.rig.runaway import RunawayError

CONFIG = Path(__file__).parents[2] / 'config'


@pytest.fixture(scope='module')
def short_bag(tmp_path_factory):
    bag = tmp_path_factory.mktemp('runs') / 'bag'
    words = ['bench_rig', '--duration', '1', '--bag', str(bag), '--quiet']
    assert import_module('impact_damper_ros.cli.simulate_rig').main(words) == 0
    return bag


@pytest.mark.parametrize(
    ('error', 'code', 'message'),
    [
        (CommandError('no such thing'), 2, 'no such thing'),
        (CommandError('not done', 4), 4, 'not done'),
        (ValueError('gap is wrong'), 2, 'gap is wrong'),
        (RecordingError('read', Path('b'), 'it is empty'), 2, "cannot read 'b': it is empty"),
        (KeyboardInterrupt(), 130, 'interrupted; all is kept'),
        (KeyboardInterrupt(15), 143, 'interrupted; all is kept'),
        (RunawayError('the rig had too many events'), 1, 'the rig had too many events'),
        (OSError(28, 'No space left on device', 'f'), 1, 'cannot write f: the disk is full'),
    ],
)
def test_errors_are_exit_codes_and_a_line(error, code, message, capsys):
    def work():
        raise error

    assert outcome('compare_run', work, 'interrupted; all is kept') == code
    said = capsys.readouterr().err
    assert said.startswith(f'compare_run: {message}')
    assert said.count('\n') == 1


def test_other_errors_are_not_hidden():
    def work():
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        outcome('compare_run', work)


def test_the_rig_that_is_given(tmp_path):
    params = tmp_path / 'rig.yaml'
    params.write_text('/**:\n  ros__parameters:\n    gap: 12.0\n    gap_control: timed\n')
    settings = ['gap_max=20', 'angle=1e-1', 'initial_damper_offset=2']
    rig, initial, control, _ = given_rig(params, settings)
    assert (rig.gap, rig.angle, initial.initial_damper_offset) == (12.0, 0.1, 2.0)
    assert (control.gap_control, control.gap_max) == ('timed', 20.0)
    # Where it cannot act, it is refused
    with pytest.raises(ValueError, match='gap_control is timed: this command is for stops that'):
        given_rig(params, with_control=False)
    assert not given_rig(params, ['gap_control=off'], with_control=False).control.active
    with pytest.raises(ValueError, match='there is no parameter gap_max to set'):
        given_rig(params, ['gap_max=20'], with_control=False)


def test_what_the_library_logs_is_said_once(capsys):
    """With the command's name, on stderr whatever it is."""
    logger = logging.getLogger('impact_damper_ros.motion')

    def work():
        for _ in range(2):
            logger.warning('compiling the simulator')
        logger.warning('another')
        return 0

    assert command_line.outcome('simulate_rig', work) == 0
    said = capsys.readouterr()
    assert said.out == ''
    compiling, another = said.err.splitlines()
    assert compiling == 'simulate_rig: compiling the simulator'
    assert another == 'simulate_rig: another'
    assert logger.parent is not None
    assert not any(isinstance(h, command_line._Notices) for h in logger.parent.handlers)


def test_messages_are_above_a_progress_bar(capsys):
    with tqdm(total=9, desc='rigs', file=sys.stderr, ascii=True) as bar:
        bar.update()
        bar.refresh()
        command_line.say('sweep_rig', 'compiling')
    # The bar is erased, and drawn again below
    assert re.search(r'rigs[^\n]*\r +\rsweep_rig: compiling\n\rrigs', capsys.readouterr().err)


#: Each line is a command, given as by a shell.
NARROW = """
simulate_rig ζ.yaml --duration 1 --figure a.png --bag γ
simulate_rig --parameters
sweep_rig ζ.yaml --vary gap=0.01,0.02 --cycles 2 --watch 21 -o a.csv --figure b.png
solve_periodic ζ.yaml --impacts 2 --json a.json
ring_down ζ.yaml --from 9mm --releases 1 --figure c.png
design_damper --check ζ.yaml
compare_run bag --report α
replay_run bag --set gap=0.02 --figure d.png
recover_run bag --output β
rig_page --help
set_rig --help
fit_rig --help
"""
RUN_EACH = """
import sys
from importlib import import_module

_, *lines = sys.argv
sys.argv = ['simulate_rig']
for line in lines:
    command, *words = line.split()
    try:
        code = import_module(f'impact_damper_ros.cli.{command}').main(words)
    except SystemExit as end:
        code = end.code
    assert not code, (line, code)
"""


def test_narrow_surroundings_cost_no_result(short_bag):
    """A locale of ASCII alone, which Python is not to widen, and a backend of a notebook."""
    place = short_bag.parent
    shutil.copy(CONFIG / 'bench_rig.yaml', place / 'ζ.yaml')
    narrow = {'LC_ALL': 'C', 'PYTHONUTF8': '0', 'PYTHONCOERCECLOCALE': '0'}
    backend = {'MPLBACKEND': 'module://matplotlib_inline.backend_inline'}
    ended = subprocess.run(
        [sys.executable, '-c', RUN_EACH, *NARROW.strip().splitlines()],
        cwd=place,
        env={**os.environ, 'PYTHONPATH': str(SOURCE), **narrow, **backend},
        capture_output=True,
        check=False,
    )
    assert (ended.returncode, b'Traceback' in ended.stderr) == (0, False), ended.stderr
    for name in ('a.png', 'a.csv', 'b.png', 'a.json', 'c.png', 'α', 'd.png'):
        assert (place / name).exists(), name
    for name in 'βγ':
        assert import_module('impact_damper_ros.cli.replay_run').main([str(place / name)]) == 0


LONG = 32_000 * 'x'


@pytest.mark.parametrize(
    'words',
    [
        ['simulate_rig', LONG, '--duration', '1'],
        ['simulate_rig', 'paper', '--duration', LONG],
        ['simulate_rig', 'paper', '--duration', '1', '--impacts', LONG],
        ['simulate_rig', 'paper', '--duration', '1', '--law', f'{LONG}:law'],
        ['simulate_rig', 'paper', '--duration', '1', '--set', f'gap={LONG}'],
        ['solve_periodic', 'paper', '--impacts', LONG],
        ['sweep_rig', 'paper', '--vary', f'{LONG}=1:2:3', '-o', 'table.csv'],
        ['replay_run', LONG],
        ['compare_run', LONG],
        ['recover_run', LONG],
        ['rig_page', '--bag', LONG],
    ],
    ids=lambda words: f'{words[0]}-{[len(word) > 9 for word in words].index(True)}',
)
def test_long_names_are_shortened(words, capsys):
    command, *rest = words
    try:
        code = import_module(f'impact_damper_ros.cli.{command}').main(rest)
    except SystemExit as error:
        code = error.code
    last = capsys.readouterr().err.splitlines()[-1]
    assert code
    assert last.startswith(f'{command}: ')
    assert 'characters) ... xxxx' in last
    assert len(last) < 1500


@pytest.mark.parametrize('command', [c for c in COMMANDS if c != 'sim_node'])
def test_version(command, capsys):
    main = import_module(f'impact_damper_ros.cli.{command}').main
    said = []
    for option in ('--version', '--help'):
        with pytest.raises(SystemExit) as ended:
            main([option])
        assert ended.value.code == 0
        said.append(capsys.readouterr().out)
    assert said[0] == f'{command} (impact_damper_ros) {__version__}\n'
    assert '--version' in said[1]


def test_version_of_the_node():
    """In a process of its own, since the node replaces the signal handlers permanently."""
    pytest.importorskip('rclpy')
    code = 'import sys; from impact_damper_ros.node.sim_node import main; '
    code += 'sys.exit(main(["", "--version"]) or main(["", "--help"]))'
    words = [sys.executable, '-c', code]
    environment = {**os.environ, 'PYTHONPATH': str(SOURCE)}
    said = subprocess.run(words, env=environment, capture_output=True, text=True, check=True)
    assert said.stdout.startswith(f'sim_node (impact_damper_ros) {__version__}\nusage: sim_node')
    assert '--version]' in said.stdout
