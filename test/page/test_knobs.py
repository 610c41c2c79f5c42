"""Parameters as the page shows them, and the modules that need no ROS."""

import os
import subprocess
import sys
from pathlib import Path

import impact_damper_ros
from impact_damper_ros.page.knobs import as_json, knobs_of
from impact_damper_ros.parameters.all_parameters import ALL_SPECS

PACKAGE = Path(impact_damper_ros.__file__).parent


def test_what_matters_first_comes_first():
    knobs = knobs_of({name: spec.default for name, spec in ALL_SPECS.items()})
    first = sorted((k for k in knobs if k['first']), key=lambda knob: knob['first']['place'])
    assert [(k['name'], k['first']['symbol'], k['group']) for k in first] == [
        *(('gap', 'd', 'rig'), ('damper_mass', 'm', 'rig'), ('angle', 'θ', 'rig')),
        *(('force_frequencies', 'f', 'forcing'), ('force_amplitudes', 'F', 'forcing')),
        *(
            ('friction', 'γ', 'rig'),
            ('restitution_1', 'R₁', 'rig'),
            ('restitution_2', 'R₂', 'rig'),
            ('restitution_speed', 'v_c', 'rig'),
        ),
        ('gap_control', 'control', 'control'),
    ]


def test_of_a_shaker_table_the_knobs_of_the_base_come_first():
    values = {name: spec.default for name, spec in ALL_SPECS.items()}
    knobs = knobs_of(values | {'force_amplitudes': [0.0], 'base_amplitudes': [2.0]})
    places = {k['name']: k['first']['place'] for k in knobs if k['first']}
    assert (places['base_frequencies'], places['base_amplitudes']) == (3, 4)
    assert len(places) == 10
    assert 'force_amplitudes' not in places


def test_knobs_without_ros_are_those_with_values():
    knobs = knobs_of({'gap': 0.02, 'force_amplitudes': (1.0, 2.0), 'unknown': 3})
    assert [(k['name'], k['value'], k['unit'], k['group']) for k in knobs] == [
        ('gap', 0.02, 'm', 'rig'),
        ('force_amplitudes', [1.0, 2.0], 'N', 'forcing'),
    ]


def test_values_that_json_lacks_are_none():
    assert as_json({'a': [float('nan'), 1.0, (float('inf'), 'x')]}) == {
        'a': [None, 1.0, [None, 'x']]
    }


BLOCKED = """
import importlib, sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.split('.')[0] in blocked:
            raise ModuleNotFoundError(f'{{name}} is blocked', name=name)

sys.meta_path.insert(0, Blocked())
for blocked, names in {parts!r}:
    for name in names:
        importlib.import_module(name)
"""
ROS = ('rclpy', 'rcl_interfaces', 'sensor_msgs', 'std_msgs', 'std_srvs', 'diagnostic_msgs')
#: Only these need Tornado, and the command says so if it is not there.
TORNADO = {'server'}


def test_only_one_module_needs_ros_and_two_need_tornado():
    names = {path.stem for path in (PACKAGE / 'page').glob('*.py')} - {'ros_client', '__init__'}
    assert len(names) > 10
    parts = [
        ((*ROS, 'tornado'), [*(f'page.{name}' for name in names - TORNADO), 'cli.rig_page']),
        (ROS, [f'page.{name}' for name in TORNADO]),
    ]
    parts = [(blocked, [f'impact_damper_ros.{name}' for name in part]) for blocked, part in parts]
    done = subprocess.run(
        [sys.executable, '-c', BLOCKED.format(parts=parts)],
        env={**os.environ, 'PYTHONPATH': str(PACKAGE.parent)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
