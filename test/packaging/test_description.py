"""The files that users start from: presets, URDF and views of RViz."""

import math
from pathlib import Path
from xml.etree import ElementTree

import pytest
import yaml

from impact_damper_ros import Rig, RigParameters, load_parameters as load, settle
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS, JOINTS
from impact_damper_ros.bag.robot_description import picture_size, robot_description
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS

ROOT = Path(__file__).parents[2]
PRESETS = sorted((ROOT / 'config').glob('*.yaml'))


@pytest.fixture(scope='module')
def bench() -> RigParameters:
    return load(ROOT / 'config' / 'bench_rig.yaml')[0]


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
    ('changes', 'stops', 'peak'),
    [
        ({}, (1, 2), pytest.approx(3.25e-3, rel=0.01)),
        ({'gap': 0.012}, None, pytest.approx(7.53e-3, rel=0.01)),
        ({'angle': 0.1}, (1, 2), pytest.approx(3.39e-3, rel=0.01)),
        # Of 40 runs with other last bits, 200 cycles each, the largest |X| are from 7.6 to 15.0 mm
        ({'gap': 0.032}, None, pytest.approx(11.3e-3, abs=5e-3)),
    ],
    ids=['as_it_is', 'too_narrow', 'inclined', 'too_wide'],
)
def test_bench_rig_moves_as_its_comments_say(bench, changes, stops, peak):
    found = settle(Rig(bench.replace(**changes)))
    assert (found.rhythm.stops if found.period else None) == stops
    assert found.x_max == peak


#: Rigs whose pictures differ: by size, gap to swing, incline, control, and number of stops.
RIGS = {
    'bench': ({}, 0.0),
    'inclined': ({'angle': 0.25, 'gap': 0.04}, 0.0),
    'wide': ({'gap': 0.3}, 0.0),
    'narrow': ({'gap': 1e-4}, 0.0),
    'kilometres': ({'gap': 1e3, 'force_amplitudes': [1e6]}, 0.0),
    'hanging': ({'angle': math.pi / 2, 'one_sided': True, 'stiffness': 10.0}, 0.0),
    'up the incline': ({'angle': -0.5}, 0.0),
    'controlled': ({}, 0.3),
    'limited': ({'gap': 0.1}, 0.3),
    'undamped': (
        {'damping': 0.0, 'primary_mass': 1.0, 'stiffness': 900.0, 'force_frequencies': [30.0]},
        0.0,
    ),
    'swept': ({'sweep_mode': 'up', 'sweep_low': 3.0, 'sweep_high': 60.0}, 0.0),
    'broadband': ({'force_amplitudes': [0.0], 'multisine_level': 0.5}, 0.0),
}


@pytest.fixture(params=RIGS.values(), ids=RIGS)
def drawn(request, bench):
    """Return a rig, the largest gap of its control, and its URDF."""
    changes, gap_max = request.param
    rig = bench.replace(**changes)
    return rig, gap_max, ElementTree.fromstring(robot_description(rig, gap_max))


def extent(urdf, link, place=0.0):
    """Return from where to where a link's largest box reaches along the axis, its joint there."""
    boxes = []
    for visual in urdf.findall(f"link[@name='{link}']/visual"):
        middle = float(visual.find('origin').get('xyz').split()[0]) + place
        half = float(visual.find('geometry/box').get('size').split()[0]) / 2
        boxes.append((middle - half, middle + half))
    return max(boxes, key=lambda box: box[1] - box[0])


def test_urdf_has_the_joints_of_joint_states(drawn):
    rig, _, urdf = drawn
    prismatic = [joint for joint in urdf.findall('joint') if joint.get('type') == 'prismatic']
    assert [joint.get('name') for joint in prismatic] == ['base', *AXIS_JOINTS]
    assert {joint.get('name') for joint in urdf.findall('joint')} == set(JOINTS) - {'relative'}
    # All from the same frame, since the positions are absolute, and along the same axis.
    assert {joint.find('parent').get('link') for joint in prismatic} == {'axis'}
    assert {joint.find('axis').get('xyz') for joint in prismatic} == {'1 0 0'}
    # Frames carry the names of the joints: the topic impacts has them as frame_id.
    assert [joint.find('child').get('link') for joint in prismatic] == ['base', *AXIS_JOINTS]

    # One tree, as every reader of URDF asks; each name once, each material known.
    links = [link.get('name') for link in urdf.findall('link')]
    children = [joint.find('child').get('link') for joint in urdf.findall('joint')]
    parents = [joint.find('parent').get('link') for joint in urdf.findall('joint')]
    assert len(set(links)) == len(links)
    assert sorted(children) == sorted(set(links) - {'base_link'})
    assert set(parents) <= set(links)
    materials = {material.get('name') for material in urdf.findall('material')}
    assert {m.get('name') for m in urdf.iterfind('link/visual/material')} == materials
    for box in urdf.iterfind('.//box'):
        assert all(0.0 < float(side) < math.inf for side in box.get('size').split())
    for limit in urdf.iterfind('joint/limit'):
        assert float(limit.get('lower')) < 0.0 < float(limit.get('upper'))

    # The x axis is turned by the angle about y, down the incline: (cos, 0, -sin).
    (incline,) = urdf.findall("joint[@name='incline']")
    assert incline.get('type') == 'revolute'
    assert incline.find('parent').get('link') == 'base_link'
    assert incline.find('child').get('link') == 'axis'
    assert incline.find('axis').get('xyz') == '0 1 0'
    assert incline.find('origin') is None
    limit = incline.find('limit')
    assert float(limit.get('lower')) <= rig.angle <= float(limit.get('upper'))
    assert float(limit.get('upper')) == -float(limit.get('lower')) == PARAMETER_SPECS['angle'].high


def test_urdf_damper_touches_the_stops_at_half_the_gap(drawn):
    rig, _, urdf = drawn
    # With the damper at the position of a stop, its face lies on the stop's.
    assert extent(urdf, 'damper')[1] == pytest.approx(extent(urdf, 'stop_1')[0])
    if rig.one_sided:
        assert urdf.find("link[@name='stop_2']/visual") is None
    else:
        assert extent(urdf, 'damper')[0] == pytest.approx(extent(urdf, 'stop_2')[1])


def test_urdf_parts_are_on_one_another_wherever_they_move(drawn):
    """The stops stand on the deck at any gap that there may be, and the deck on the rail."""
    rig, gap_max, urdf = drawn
    swing = math.hypot(*responses(rig))
    if not rig.damping:
        # At resonance without end, of which only so much is drawn.
        swing = 100.0 * rig.force_amplitudes[0] / rig.stiffness
    for x in (-0.999 * swing, 0.0, 0.999 * swing):
        place = rig.static_deflection + x
        deck = extent(urdf, 'primary', place)
        for gap in (rig.gap, min(max(rig.gap, gap_max), 8.0 * rig.gap)):
            stop_1 = extent(urdf, 'stop_1', place + gap / 2)
            assert deck[0] < stop_1[0] < stop_1[1] < deck[1]
            damper = extent(urdf, 'damper', place + gap / 2)
            assert deck[0] < damper[0]
            assert damper[1] <= stop_1[0] + 1e-6 * (deck[1] - deck[0])
            if not rig.one_sided:
                stop_2 = extent(urdf, 'stop_2', place - gap / 2)
                assert deck[0] < stop_2[0] < stop_2[1] < deck[1]
        rail = extent(urdf, 'axis')
        assert rail[0] < deck[0] < deck[1] < rail[1]
        # Seen beside one another: no part vanishes, the damper least of all.
        assert damper[1] - damper[0] > 0.03 * (rail[1] - rail[0] - abs(rig.static_deflection))


def responses(rig):
    """Return the amplitude of each harmonic's motion, of M alone, by the transfer function."""
    for amplitude, frequency, _ in zip(*rig.harmonics, strict=True):
        stiffness = complex(rig.stiffness - rig.primary_mass * frequency**2)
        dynamic = stiffness + 1j * rig.damping * frequency
        yield abs(amplitude / dynamic) if dynamic else math.inf


def test_urdf_swing_is_that_of_the_resonance_in_a_sweep(bench):
    at = bench.replace(force_frequencies=[bench.omega])
    swept = bench.replace(
        sweep_mode='up', sweep_low=0.5 * bench.omega, sweep_high=2.0 * bench.omega
    )
    assert robot_description(swept) == robot_description(at)
    past = swept.replace(sweep_low=1.5 * bench.omega, sweep_high=3.0 * bench.omega)
    best = bench.replace(force_frequencies=[1.5 * bench.omega])
    assert robot_description(past) == robot_description(best)


def test_rviz_shows_the_robot_from_its_base(bench):
    setup = yaml.safe_load((ROOT / 'rviz' / 'rig.rviz').read_text(encoding='utf-8'))
    manager = setup['Visualization Manager']
    # The rig of the preset is in the view, and large enough: RViz opens at 45 degrees.
    seen = manager['Views']['Current']['Distance'] * math.tan(math.pi / 8)
    assert 0.15 * seen < picture_size(bench).deck < seen
    assert manager['Global Options']['Fixed Frame'] == 'base_link'
    (model,) = [d for d in manager['Displays'] if d['Class'].endswith('/RobotModel')]
    # The launch file remaps this name into the namespace.
    assert model['Description Topic']['Value'] == '/robot_description'
    assert model['Description Topic']['Durability Policy'] == 'Transient Local'


def test_a_change_that_is_not_seen_renders_no_description_anew(bench):
    before = robot_description(bench)
    assert robot_description(bench.replace(restitution_1=0.3, friction=0.2)) is before
    assert robot_description(bench.replace(gap=2.0 * bench.gap)) != before
