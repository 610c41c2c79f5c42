"""What all commands share: exit codes, messages, the rig that is given."""

import logging
import os
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from tqdm import tqdm

import impact_damper_ros
from impact_damper_ros import __version__, entry_points
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.cli import command_line
from impact_damper_ros.cli.command_line import CommandError, outcome
from impact_damper_ros.cli.rig_options import given_rig
from impact_damper_ros.rig import ALL_SPECS
from impact_damper_ros.rig.event_budget import RunawayError

ROOT = Path(impact_damper_ros.__file__).parents[1]


@pytest.mark.parametrize(
    ('error', 'code', 'message'),
    [
        (CommandError('no such thing'), 2, 'no such thing'),
        (CommandError('not done', 4), 4, 'not done'),
        (ValueError('gap is wrong'), 2, 'gap is wrong'),
        (RecordingError('read', Path('b'), 'it is empty'), 2, "cannot read 'b': it is empty"),
        (KeyboardInterrupt(), 130, 'interrupted; all is kept'),
        (KeyboardInterrupt(15), 143, 'interrupted; all is kept'),
        (RunawayError(10_000, 0.1), 1, 'the rig has more than 10000 events at once, at 0.1 s'),
        (OSError(28, 'No space left on device', 'f'), 1, 'cannot write f: No space left'),
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
    rig, initial, control = given_rig(params, settings)
    assert (rig.gap, rig.angle, initial.initial_damper_offset) == (12.0, 0.1, 2.0)
    assert (control.gap_control, control.gap_max) == ('timed', 20.0)
    # Where the control is not used, that of the file is left aside, and none can be set
    given = given_rig(params, ['angle=1e-1'], with_control=False)
    assert not given.control.active
    with pytest.raises(ValueError, match='there is no parameter gap_max to set'):
        given_rig(params, ['gap_max=20'], with_control=False)


def test_what_the_library_logs_is_said_once(capsys):
    """With the command's name, on stderr whatever it is."""
    logger = logging.getLogger('impact_damper_ros.rig')

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


@pytest.mark.parametrize('command', [c for c in entry_points.__all__ if c != 'sim_node'])
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
    """As a process: the node takes the signals of its own for good."""
    pytest.importorskip('rclpy')
    said = [
        subprocess.run(
            [sys.executable, '-m', 'impact_damper_ros.node.sim_node', option],
            env={**os.environ, 'PYTHONPATH': str(ROOT)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for option in ('--version', '--help')
    ]
    assert said[0] == f'sim_node (impact_damper_ros) {__version__}\n'
    assert '--version' in said[1]


def test_an_option_of_other_commands_is_a_parameter_of_the_node(capsys):
    pytest.importorskip('rclpy')
    from impact_damper_ros.node.sim_node import IN_PLACE_OF, answer_foreign

    for option, setting in IN_PLACE_OF.items():
        assert setting.partition(':=')[0] in ALL_SPECS
        for words in ([option, 'my_laws:catch'], [f'{option}=my_laws:catch']):
            assert answer_foreign(words) == 2
            said = capsys.readouterr().err
            assert said.startswith(f'sim_node: {option} is an option of other commands')
            assert said.endswith(f'sim_node --ros-args -p {setting}\n')
