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
