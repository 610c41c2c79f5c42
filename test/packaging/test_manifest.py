"""What the package says of itself: package.xml, setup.py and the changelog agree."""

import ast
import re
import sys
from importlib.metadata import packages_distributions
from modulefinder import ModuleFinder
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml
from package_trees import PACKAGE, trees
from setup_file import requirements, setup_says

import impact_damper_ros

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope='module')
def manifest():
    catkin_package = pytest.importorskip('catkin_pkg.package')
    warnings: list[str] = []
    package = catkin_package.parse_package(ROOT / 'package.xml', warnings=warnings)
    assert warnings == []
    return package


def third_party_imports() -> set[str]:
    """Return the top-level packages that the modules of the package import."""
    found = set()
    for tree in trees().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                found |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                found.add(node.module.split('.')[0])
    return found - set(sys.stdlib_module_names) - {'impact_damper_ros'}


def test_manifest_is_an_ament_python_package(manifest):
    manifest.validate()
    assert manifest.package_format == 3
    assert manifest.name == 'impact_damper_ros'
    assert manifest.get_build_type() == 'ament_python'
    assert [str(text) for text in manifest.licenses] == ['Apache-2.0']
    assert manifest.licenses[0].file == 'LICENSE'
    assert 'Apache License' in (ROOT / 'LICENSE').read_text(encoding='utf-8')


def test_the_version_is_the_same_everywhere(manifest):
    """And that of the newest release in the changelog, with its date, where there is one."""
    cited = yaml.safe_load((ROOT / 'CITATION.cff').read_text(encoding='utf-8'))
    assert manifest.version == setup_says('version') == impact_damper_ros.__version__
    # Nobody has to raise it there
    assert not {'version', 'date-released'} & cited.keys()
    assert setup_says('license') == 'Apache-2.0' == cited['license']
    changelog = pytest.importorskip('catkin_pkg.changelog').get_changelog_from_path(ROOT)
    releases = list(changelog.foreach_version())
    if releases:
        newest, _, entries = releases[0]
        assert newest == manifest.version
        assert entries
    else:
        text = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
        assert re.search(r'^Forthcoming\n-{11}\n\* ', text, re.MULTILINE)


SCREEN = {'ros2bag', 'rosbag2_storage_mcap', 'rviz2'}
SCREEN |= {f'python3-{name}' for name in ('jinja2', 'matplotlib', 'tornado')}


@pytest.mark.filterwarnings('ignore:.*parseAll:DeprecationWarning')
@pytest.mark.parametrize(('headless', 'left_out'), [('', set()), ('1', SCREEN)])
def test_a_machine_without_a_screen_needs_less(headless, left_out):
    package = pytest.importorskip('catkin_pkg.package').parse_package(ROOT / 'package.xml')
    package.evaluate_conditions({'IMPACT_DAMPER_HEADLESS': headless})
    assert {d.name for d in package.exec_depends if not d.evaluated_condition} == left_out


def test_addresses(manifest):
    """Of a ROS package and of one of PyPI."""
    assert {url.type for url in manifest.urls} == {'website', 'repository', 'bugtracker'}
    assert set(setup_says('project_urls').values()) == {url.url for url in manifest.urls}


def test_files_of_xml_are_well_formed():
    """What ament_xmllint asks, but for the schema of package.xml: catkin_pkg checks that."""
    for path in (ROOT / 'package.xml', ROOT / 'docs' / 'start' / 'rig.svg'):
        ElementTree.parse(path)


def test_every_import_is_declared(manifest):
    """Modules come from an exec_depend, by its rosdep key, and for pip from setup.py."""
    with_mcap = 'mcap-ros2-support'
    key_of = {'mcap': with_mcap, 'lz4': with_mcap, 'zstandard': with_mcap}
    # It is a part of jinja2.
    optional = {'markupsafe'}
    optional |= {
        'distributed',
        'llvmlite',
        'numba',
        'pandas',
    }  # rosdep knows no key for some of them
    declared = {dependency.name for dependency in manifest.exec_depends}
    distribution_of = packages_distributions()
    for_pip = requirements(setup_says('install_requires'), *setup_says('extras_require').values())
    ros_wheels = {'ament_index_python', 'rclpy'}
    for module in sorted(third_party_imports() - optional):
        assert declared & {module, f'python3-{module}', key_of.get(module)}, module
        if module in ros_wheels or module.endswith(('_msgs', '_srvs', '_interfaces')):
            continue
        assert for_pip & {n.lower() for n in distribution_of.get(module, [module])}, module


def test_extra_of_the_peers_is_what_their_benchmark_imports():
    """`pip install '.[peers]'` is all that benchmarks/peers.py needs."""
    finder = ModuleFinder([str(ROOT / 'benchmarks'), str(ROOT / 'test')])
    finder.run_script(str(ROOT / 'benchmarks' / 'peers.py'))
    needed = {name.split('.')[0] for name in finder.badmodules} - set(sys.stdlib_module_names)
    extra = requirements(setup_says('install_requires'), setup_says('extras_require')['peers'])
    assert 'mpmath' in needed
    # Its figure is asked for with --docs, and needs the extra [plot]
    assert needed <= {*extra, 'impact_damper_ros', 'matplotlib'}


def test_every_file_of_the_package_names_its_licence(manifest):
    (licence,) = manifest.licenses
    files = [*PACKAGE.rglob('*.py'), *(PACKAGE / 'page' / 'static').glob('*.js')]
    assert len(files) > 100
    for path in [*files, *(ROOT / 'launch').glob('*.py')]:
        first = path.read_text(encoding='utf-8').partition('\n')[0]
        assert first[2:].strip().split(': ') == ['SPDX-License-Identifier', str(licence)], path
