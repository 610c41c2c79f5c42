"""Every command says its version and names the option in its help."""

from importlib import import_module

import pytest

from impact_damper_ros import __version__, entry_points

COMMANDS = [name for name in entry_points.__all__ if not name.startswith(('begin', 'run'))]


@pytest.mark.parametrize('command', [*COMMANDS, 'demo'])
def test_version(command, capsys):
    if command in ('sim_node', 'demo'):
        pytest.importorskip('rclpy')
    folder = 'nodes' if command == 'sim_node' else 'commands'
    main = import_module(f'impact_damper_ros.{folder}.{command}').main
    said = []
    for option in ('--version', '--help'):
        try:
            code = main([command, option] if command == 'sim_node' else [option])
        except SystemExit as end:
            code = end.code
        assert code == 0
        said.append(capsys.readouterr().out)
    assert said[0] == f'{command} (impact_damper_ros) {__version__}\n'
    assert '--version' in said[1]
