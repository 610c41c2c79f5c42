"""Every command says its version and names the option in its help."""

import os
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros import __version__, entry_points

ROOT = Path(impact_damper_ros.__file__).parents[1]
COMMANDS = [name for name in entry_points.__all__ if not name.startswith(('begin', 'run'))]


@pytest.mark.parametrize('command', [c for c in (*COMMANDS, 'demo') if c != 'sim_node'])
def test_version(command, capsys):
    if command == 'demo':
        pytest.importorskip('rclpy')
    main = import_module(f'impact_damper_ros.cli.{command}').main
    said = []
    for option in ('--version', '--help'):
        with pytest.raises(SystemExit) as ended:
            main([option])
        assert ended.value.code == 0
        said.append(capsys.readouterr().out)
    assert said[0] == f'{command} (impact_damper_ros) {__version__}\n'
    assert '--version' in said[1]


@pytest.mark.parametrize(
    ('command', 'unbuffered'),
    [*((command, '') for command in COMMANDS), ('simulate_rig', '1'), ('sim_node', '1')],
)
def test_an_output_that_is_full(command, unbuffered):
    """The failure is a line and an exit code, whether it comes at once or at the end."""
    room = 'cli'
    if command == 'sim_node':
        pytest.importorskip('rclpy')
        room = 'node'
    with Path('/dev/full').open('w') as full:
        done = subprocess.run(
            [sys.executable, '-m', f'impact_damper_ros.{room}.{command}', '--version'],
            env={**os.environ, 'PYTHONPATH': str(ROOT), 'PYTHONUNBUFFERED': unbuffered},
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    assert done.stderr == f'{command}: cannot write output: No space left on device\n'


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
