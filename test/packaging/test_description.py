"""The files that users start from: presets, URDF, RViz set-up and launch file."""

import ast
import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from impact_damper_ros.rig import PARAMETER_SPECS, EventKind, RigParameters, Simulator
from impact_damper_ros.rig import load_parameters as load

ROOT = Path(__file__).parents[2]
PRESETS = sorted((ROOT / 'config').glob('*.yaml'))
JOINTS = ['primary', 'damper', 'stop_1', 'stop_2']


@pytest.fixture(scope='module')
def bench() -> RigParameters:
    return load(ROOT / 'config' / 'bench_rig.yaml')[0]


def impacts_and_peak(parameters: RigParameters, start: float, end: float):
    """Run from rest; return the impacts and the largest |X| between two instants."""
    simulator = Simulator(parameters)
    simulator.advance(start)
    events, peak = [], 0.0
    steps = 20_000
    for step in range(1, steps + 1):
        events += simulator.advance(start + (end - start) * step / steps)
        peak = max(peak, abs(simulator.sample().x))
    return [event for event in events if event.kind is EventKind.IMPACT], peak


@pytest.mark.parametrize('path', PRESETS, ids=lambda path: path.stem)
def test_presets_state_every_parameter_of_the_rig(path):
    document = yaml.safe_load(path.read_text(encoding='utf-8'))
    given = document['/**']['ros__parameters']
    assert set(PARAMETER_SPECS) <= set(given)
    # A parameters file is typed: 1 instead of 1.0 would be an integer to ROS.
    types = {'bool': bool, 'integer': int, 'string': str}
    for name, spec in PARAMETER_SPECS.items():
        value = given[name]
        for entry in value if isinstance(value, list) else [value]:
            assert type(entry) is types.get(spec.kind, float), name


def test_paper_preset_is_the_default_rig_with_the_gravity_of_figure_2():
    parameters, _, _ = load(ROOT / 'config' / 'paper.yaml')
    assert parameters == RigParameters(gravity=1.0)


def test_bench_rig_is_what_its_comments_say(bench):
    mu, zeta, omega = bench.mass_ratio, bench.zeta, bench.omega
    restitution = bench.restitution_1
    assert omega / (2 * math.pi) == pytest.approx(5.0, abs=5e-3)
    assert zeta == pytest.approx(0.010, abs=5e-4)
    assert mu == pytest.approx(0.05)
    alone = bench.response_amplitude
    assert alone == pytest.approx(30.3e-3, abs=5e-5)
    # The energy balance of two impacts per cycle where |X'| is largest.
    zeta_eq = (2 / math.pi) * mu / (1 + mu) * (1 + restitution) / (1 - restitution)
    best = alone * zeta / (zeta + zeta_eq)
    best_gap = math.pi * best * (1 + restitution) / ((1 - restitution) * (1 + mu))
    assert zeta_eq == pytest.approx(0.121, abs=5e-4)
    assert best == pytest.approx(2.3e-3, abs=5e-5)
    assert best_gap == pytest.approx(27.7e-3, abs=5e-5)
    assert bench.gap / best_gap == pytest.approx(0.87, abs=5e-3)


@pytest.mark.parametrize(
    ('changes', 'per_cycle', 'peak'),
    [({}, 2, 3.25e-3), ({'gap': 0.012}, 3, 7.5e-3), ({'angle': 0.1}, 2, 3.39e-3)],
    ids=['as_it_is', 'too_narrow', 'inclined'],
)
def test_bench_rig_moves_as_its_comments_say(bench, changes, per_cycle, peak):
    period = 2 * math.pi / bench.force_frequencies[0]
    impacts, x_max = impacts_and_peak(bench.replace(**changes), 150 * period, 200 * period)
    assert len(impacts) == pytest.approx(50 * per_cycle, abs=1)
    assert x_max == pytest.approx(peak, rel=0.01)


def test_bench_rig_with_a_wide_gap_loses_the_rhythm(bench):
    period = 2 * math.pi / bench.force_frequencies[0]
    _, x_max = impacts_and_peak(bench.replace(gap=0.032), 150 * period, 250 * period)
    assert x_max > 7e-3


@pytest.fixture(scope='module')
def urdf():
    xacro = pytest.importorskip('xacro')
    path = str(ROOT / 'urdf' / 'rig.urdf.xacro')
    document = xacro.process_file(path, mappings={'angle': '0.25', 'gap': '0.04'})
    return ElementTree.fromstring(document.toxml())


def test_urdf_has_the_joints_of_joint_states(urdf):
    prismatic = [joint for joint in urdf.findall('joint') if joint.get('type') == 'prismatic']
    assert [joint.get('name') for joint in prismatic] == JOINTS
    # All from the same frame, since the positions are absolute, and along the same axis.
    assert {joint.find('parent').get('link') for joint in prismatic} == {'axis'}
    assert {joint.find('axis').get('xyz') for joint in prismatic} == {'1 0 0'}
    # Frames carry the names of the joints: the topic impacts has them as frame_id.
    assert [joint.find('child').get('link') for joint in prismatic] == JOINTS


def test_urdf_axis_points_down_the_incline(urdf):
    (incline,) = urdf.findall("joint[@name='incline']")
    roll, pitch, yaw = map(float, incline.find('origin').get('rpy').split())
    assert (roll, yaw) == (0.0, 0.0)
    # The x axis turned by the pitch about y: (cos, 0, -sin).
    assert -math.sin(pitch) == pytest.approx(-math.sin(0.25))


def test_urdf_damper_touches_the_stops_at_half_the_gap(urdf):
    def extent(link: str) -> tuple[float, float]:
        visual = urdf.find(f"link[@name='{link}']/visual")
        middle = float(visual.find('origin').get('xyz').split()[0])
        half = float(visual.find('geometry/box').get('size').split()[0]) / 2
        return middle - half, middle + half

    # With the damper at the position of a stop, its face lies on the stop's.
    assert extent('damper')[1] == pytest.approx(extent('stop_1')[0])
    assert extent('damper')[0] == pytest.approx(extent('stop_2')[1])


def test_rviz_shows_the_robot_from_its_base():
    setup = yaml.safe_load((ROOT / 'rviz' / 'rig.rviz').read_text(encoding='utf-8'))
    manager = setup['Visualization Manager']
    assert manager['Global Options']['Fixed Frame'] == 'base_link'
    (model,) = [d for d in manager['Displays'] if d['Class'].endswith('/RobotModel')]
    # The launch file remaps this name into the namespace.
    assert model['Description Topic']['Value'] == '/robot_description'
    assert model['Description Topic']['Durability Policy'] == 'Transient Local'


def test_launch_file_starts_what_it_says():
    pytest.importorskip('launch_ros')
    source = pytest.importorskip('launch.launch_description_sources')
    path = ROOT / 'launch' / 'rig.launch.py'
    description = source.get_launch_description_from_python_launch_file(str(path))
    assert [argument.name for argument in description.get_launch_arguments()] == [
        'params_file',
        'namespace',
        'record',
        'bag_directory',
        'use_robot_state_publisher',
        'use_rviz',
        'use_sim_time',
    ]


def test_launch_file_is_python():
    """Also where there is no launch to load it with."""
    ast.parse((ROOT / 'launch' / 'rig.launch.py').read_text(encoding='utf-8'))
