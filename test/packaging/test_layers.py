"""The layers of the package: imports point one way, and the lower layers need no ROS."""

import ast
import os
import subprocess
import sys
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest
from package_trees import PACKAGE, trees

# A module may import from its own subpackage and from those with a smaller number.
LEVEL = {
    'parameters': 0,
    # Beside motion, which knows nothing of it
    'measured': 1,
    'motion': 1,
    'control': 2,
    'rig': 3,
    'orbits': 4,
    'bag': 4,
    'theory': 5,
    'replay': 5,
    'compare': 6,
    'design': 7,
    'fit': 7,
    'report': 8,
    'sweep': 9,
    'node': 10,
    # The page is a client of the node
    'page': 11,
    'cli': 12,
}
WITHOUT_ROS = [name for name in LEVEL if LEVEL[name] < LEVEL['node'] and (PACKAGE / name).is_dir()]
ROS = (
    'builtin_interfaces',
    'diagnostic_msgs',
    'rcl_interfaces',
    'rclpy',
    'rosgraph_msgs',
    'rosidl_runtime_py',
    'sensor_msgs',
    'std_msgs',
    'std_srvs',
)


def imports(path: Path, tree: ast.Module) -> Iterator[str]:
    """Yield the full name of every module or object that a file imports, at any depth."""
    package = ('impact_damper_ros', *path.parent.parts)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom):
            parts = list(package[: len(package) - node.level + 1]) if node.level else []
            parts += node.module.split('.') if node.module else []
            for alias in node.names:
                yield '.'.join([*parts, alias.name])


def test_every_subpackage_has_a_layer():
    found = {path.parent.name for path in PACKAGE.glob('*/__init__.py')}
    assert found <= set(LEVEL)
    assert {'parameters', 'rig', 'bag', 'node', 'cli'} <= found


@cache
def imported() -> dict[Path, list[str]]:
    """Return what each module imports."""
    return {path: list(imports(path, t)) for path, t in trees().items() if path.parts[0] in LEVEL}


@pytest.mark.parametrize('own', sorted(name for name in LEVEL if (PACKAGE / name).is_dir()))
def test_imports_point_downwards(own):
    for path, names in imported().items():
        for name in names if path.parts[0] == own else ():
            package, _, rest = name.partition('.')
            other = rest.partition('.')[0]
            if package == 'impact_damper_ros' and other in LEVEL:
                assert other == own or LEVEL[other] < LEVEL[own], f'{path} imports {name}'


@pytest.mark.parametrize('own', sorted(LEVEL))
def test_modules_of_a_folder_do_not_import_each_other_in_a_circle(own):
    names = {
        path: f'impact_damper_ros.{own}.{path.stem}' for path in imported() if path.parts[0] == own
    }
    below = {
        names[path]: {
            other
            for other in names.values()
            if other != names[path]
            and any(name == other or name.startswith(f'{other}.') for name in imported()[path])
        }
        for path in names
    }
    TopologicalSorter(below).prepare()  # raises CycleError


def test_only_nodes_and_their_clients_import_ros():
    """`set_rig` and the page are clients of the node; the page is one in a single module."""
    users = {
        path
        for path, names in imported().items()
        if any(name.split('.')[0] in ROS for name in names)
    }
    clients = {Path('cli', 'set_rig.py'), Path('page', 'ros_client.py')}
    assert {path for path in users if path.parts[0] != 'node'} == clients


IMPORT_WITHOUT_ROS = """
import importlib, pkgutil, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in {ros!r}:
            raise ModuleNotFoundError(f'{{name}} is blocked', name=name)

sys.meta_path.insert(0, Blocked())
for name in {names!r}:
    package = importlib.import_module(f'impact_damper_ros.{{name}}')
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + '.'):
        importlib.import_module(module.name)
        print(module.name)
assert not set({ros!r}) & set(sys.modules)
"""


#: What must not be loaded by an import, so that a start stays short, or works where it is missing.
LEAN = {
    'import impact_damper_ros.cli.simulate_rig': (*ROS, 'matplotlib', 'scipy'),
    'import impact_damper_ros.node.sim_node': (
        *('matplotlib', 'mcap', 'numba', 'scipy', 'tqdm', 'zstandard'),
    ),
    'import impact_damper_ros.theory.documents': ROS,
    'from impact_damper_ros.theory.expected_motion import predictions': (
        'impact_damper_ros.bag',
        'mcap',
    ),
    'from impact_damper_ros.cli import recover_run': (*ROS, 'rosbags', 'scipy'),
    'import impact_damper_ros.report': ('impact_damper_ros.compare', 'matplotlib', 'numpy'),
}


@pytest.mark.parametrize('statement', LEAN)
def test_what_is_not_needed_is_not_loaded(statement):
    done = subprocess.run(
        [sys.executable, '-c', f'import sys; {statement}; print(*sys.modules)'],
        env={**os.environ, 'PYTHONPATH': str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = done.stdout.split()
    assert 'impact_damper_ros' in loaded
    unwanted = tuple(f'{name}.' for name in LEAN[statement])
    assert [name for name in loaded if f'{name}.'.startswith(unwanted)] == []


def test_imports_without_ros():
    done = subprocess.run(
        [sys.executable, '-c', IMPORT_WITHOUT_ROS.format(ros=ROS, names=WITHOUT_ROS)],
        env={**os.environ, 'PYTHONPATH': str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    for name in WITHOUT_ROS:
        assert f'impact_damper_ros.{name}.' in done.stdout
