"""The package as colcon builds and installs it."""

import os
import shlex
import shutil
import stat
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from running import DEADLINE_S, Running
from setup_file import COMMANDS

ROOT = Path(__file__).parents[2]
NAME = 'impact_damper_ros'
NOT_SOURCES = ('.git', '.venv', '.*_cache', '__pycache__', 'build', 'dist', 'install', 'log')
NOT_SOURCES += ('_build', 'made', 'demo_run', '.pythons', 'node_modules', '*.egg-info')

COLCON = 'from colcon_core.command import main; raise SystemExit(main())'


def need(module: str) -> None:
    """Skip a test that needs a module which is not here; in CI, where all is, that is a fault."""
    if find_spec(module) is None:
        missing = pytest.fail if os.environ.get('CI') else pytest.skip
        missing(f'{module} is not installed')


def build(workspace: Path, *options: str) -> Path:
    """Build a copy of the tree in a workspace; return the prefix that it was installed to."""
    need('colcon_core')
    shutil.copytree(ROOT, workspace / 'src' / NAME, ignore=shutil.ignore_patterns(*NOT_SOURCES))
    done = subprocess.run(
        [sys.executable, '-c', COLCON, 'build', '--event-handlers', 'console_direct+', *options],
        cwd=workspace,
        env={**os.environ, 'COLCON_HOME': str(workspace), 'COLCON_LOG_PATH': 'log'},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stdout
    return workspace / 'install' / NAME


@pytest.fixture(scope='module')
def prefix(tmp_path_factory):
    return build(tmp_path_factory.mktemp('workspace'))


def installed(prefix: Path, *command: str) -> Running:
    """Start a command in the environment that the installed setup file makes."""
    if ' ' in sys.executable:
        pytest.skip('the setup files of colcon do not stand a space in the path of Python')
    script = f'. {shlex.quote(str(prefix.parent / "setup.sh"))} && exec {shlex.join(command)}'
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONPATH'}
    return Running(prefix, '/bin/sh', '-c', script, environment=environment)


def output_of(process: Running) -> str:
    assert process.wait() == 0, process.output
    return process.output


def test_built_as_an_ament_package(prefix):
    """As anything else it would not be in the index, by which ros2 run finds it."""
    marker = prefix / 'share' / 'ament_index' / 'resource_index' / 'packages' / NAME
    assert marker.is_file()


def test_share_holds_what_users_start_from(prefix):
    share = prefix / 'share' / NAME
    wanted = ['package.xml', 'launch/rig.launch.py', 'rviz/rig.rviz']
    wanted += ['config/paper.yaml', 'config/bench_rig.yaml']
    wanted += ['layouts/lichtblick.json']
    wanted += ['examples/output.py', 'examples/paper/claims.py', 'examples/gap_control/study.py']
    for path in wanted:
        assert (share / path).read_bytes() == (ROOT / path).read_bytes()


def test_commands_are_where_ros2_run_looks(prefix):
    folder = prefix / 'lib' / NAME
    assert sorted(path.name for path in folder.iterdir()) == COMMANDS
    for path in folder.iterdir():
        assert path.stat().st_mode & stat.S_IXUSR


def test_package_data_is_installed(prefix):
    """Every file that the sources have beside the modules is installed with them."""
    (site_package,) = prefix.glob(f'lib/python*/*-packages/{NAME}')
    sources = {path.relative_to(ROOT) for path in (ROOT / NAME).rglob('*') if path.is_file()}
    sources = {path for path in sources if '__pycache__' not in path.parts}
    assert any(path.suffix == '.msg' for path in sources)
    for path in sources:
        assert (site_package.parent / path).is_file(), path


def test_installed_modules_are_used(prefix):
    code = f'import {NAME}.rig as rig; print(rig.__file__)'
    output = output_of(installed(prefix, sys.executable, '-c', code))
    assert Path(output.strip()).is_relative_to(prefix)


def test_symlink_install_runs_the_sources(tmp_path):
    """Colcon then builds in a folder that has only the files which setup.py names."""
    prefix = build(tmp_path, '--symlink-install')
    assert sorted(path.name for path in (prefix / 'lib' / NAME).iterdir()) == COMMANDS
    code = f'import {NAME}.rig as rig; print(rig.__file__)'
    output = output_of(installed(prefix, sys.executable, '-c', code))
    assert Path(output.strip()).resolve() == tmp_path / 'src' / NAME / NAME / 'rig/__init__.py'


def test_installed_simulate_rig_runs(prefix, tmp_path):
    impacts = tmp_path / 'impacts.csv'
    command = [
        str(prefix / 'lib' / NAME / 'simulate_rig'),
        str(prefix / 'share' / NAME / 'config' / 'paper.yaml'),
        '--duration',
        '60',
        '--impacts',
        str(impacts),
    ]
    output_of(installed(prefix, *command))
    first = impacts.read_text(encoding='utf-8').splitlines()[1].split(',')
    assert float(first[0]) == pytest.approx(43.62266009691099, rel=1e-11)
    assert int(first[1]) == 1


def test_installed_node_runs_and_stops(prefix):
    """Another installed command sets one of its parameters, over DDS."""
    need('rclpy')
    params = prefix / 'share' / NAME / 'config' / 'bench_rig.yaml'
    command = str(prefix / 'lib' / NAME / 'sim_node')
    client = str(prefix / 'lib' / NAME / 'set_rig')
    words = ('--ros-args', '--params-file', str(params), '-r', '__ns:=/b')
    with installed(prefix, command, *words) as node:

        def answered():
            asked = installed(prefix, client, '--node', '/b/sim_node', 'gap=0.02')
            return asked if asked.wait() == 0 else None

        assert 'gap' in node.until(answered).output
        assert node.stop() == 0, node.output
        assert 'Traceback' not in node.output
