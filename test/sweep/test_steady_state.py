"""What a rig settles into: golden motions, shares of time, kinds of motion."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from sweep.example_rigs import CHATTERING, ON_THE_STOP

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters, find_orbits
from impact_damper_ros.motion.event import EVENT_TYPE
from impact_damper_ros.sweep import Settling
from impact_damper_ros.sweep.steady_state import SECTION, _sequence, rig_of_row, steady_state

DISPLACED = InitialConditions(initial_primary_position=1.0)


def settled(parameters, initial=None, compiled=None, **options):
    rig = Rig(parameters, initial, compiled=compiled)
    return SimpleNamespace(**steady_state(rig, Settling(**options)))


@pytest.mark.parametrize('friction', [0.0, 0.5])
def test_a_golden_motion_is_that_of_the_theory(friction):
    rig = RigParameters(angle=math.pi / 4, gravity=1.0, friction=friction, force_frequencies=1.02)
    orbit = find_orbits(rig, (1, 2), simulate=False).orbits[0]
    state = settled(rig)
    assert (state.kind, state.stops, state.cycles) == ('periodic', '1,2', 1)
    expected = math.log(abs(orbit.multipliers[0])) / orbit.cycle
    assert state.lyapunov_exponent == pytest.approx(expected, rel=1e-8)
    assert state.lyapunov_uncertainty < 1e-9
    assert state.largest_multiplier == pytest.approx(abs(orbit.multipliers[0]), rel=1e-8)
    assert state.x_max == pytest.approx(orbit.x_max, rel=2e-9)
    assert sorted(state.impact_phase) == pytest.approx(sorted(orbit.phases), abs=1e-7)


def test_largest_and_rms_displacement_against_dense_samples():
    rig = RigParameters(gravity=0.0, force_frequencies=1.02, gap=16.0)
    state = settled(rig, DISPLACED)
    simulator = Rig(rig, DISPLACED)
    count, x = 20_000, []
    for k in range(count):
        simulator.advance((600 + (k + 0.5) / count) * state.cycle)
        x.append(simulator.sample().x)
    assert state.x_max == pytest.approx(np.abs(x).max(), rel=1e-7)
    assert state.x_rms == pytest.approx(math.sqrt(np.mean(np.square(x))), rel=1e-7)
    assert state.x_mean == pytest.approx(np.mean(x), abs=1e-7)


def test_shares_of_chatter_and_rest_against_the_event_log():
    state = settled(CHATTERING, ON_THE_STOP)
    assert state.stops == '1~'
    assert state.cycles == 1
    rig = Rig(CHATTERING, ON_THE_STOP, compiled=None)
    rig.run(700.0 * state.cycle, record=False)
    # One period, from a release on: the flight, the chatter, and the rest
    events = rig.advance(704.0 * state.cycle)
    begin, after = [e.time for e in events if e.kind is EventKind.RELEASE][:2]
    inside = [e for e in events if begin < e.time <= after]
    impacts = [e.time for e in inside if e.kind is EventKind.IMPACT]
    (rest,) = (e.time for e in inside if e.kind is EventKind.REST)
    assert after - begin == pytest.approx(state.cycle, rel=1e-7)
    assert np.all(np.diff(np.diff(impacts)) < 0.0)
    assert state.chatter_share == pytest.approx((rest - impacts[0]) / state.cycle, rel=1e-6)
    assert state.rest_share == pytest.approx((after - rest) / state.cycle, rel=1e-6)
    assert state.stick_share == 0.0
    assert len(impacts) == state.impacts


@pytest.mark.parametrize(
    ('events', 'stops'),
    [
        ('', ''),
        ('i2 i1', '1,2'),
        ('i2 i1 i1', '1,1,2'),
        ('i1 i1 i1 r1', '1~'),
        ('i2 i1 i1 r1 s1', '1~,2'),
        # The period ends during a chatter, and alone on one stop too
        ('i1 r1 i2 i1 i1', '1~,2'),
        ('i1 r1 i1', '1~'),
        ('i2 r2 i1 i1', '1,1,2~'),
    ],
)
def test_a_chatter_to_rest_is_one_entry_of_the_sequence(events, stops):
    kinds = {'i': EventKind.IMPACT, 'r': EventKind.REST, 's': EventKind.RELEASE}
    rows = np.zeros(len(events.split()), EVENT_TYPE)
    rows['kind'] = [kinds[one[0]] for one in events.split()]
    rows['stop'] = [int(one[1]) for one in events.split()]
    assert _sequence(rows) == stops


@pytest.mark.parametrize(
    ('offset', 'placed'),
    [(3.0, 3.0), (5.0 - 1e-13, 5.0), (-5.0 + 1e-13, -5.0), (-5.0 - 1e-9, -5.0), (4.999, 4.999)],
)
def test_a_rig_goes_on_from_the_last_state_of_its_row(offset, placed):
    """Round-off parts m from no stop, and puts it beyond none."""
    rig = RigParameters(gravity=0.0, gap=10.0)
    last = dict(zip(SECTION, (0.7, 0.2, offset, -0.1 * math.copysign(1.0, offset)), strict=True))
    row = SimpleNamespace(**{n: [9.0, 9.0, v] for n, v in last.items()}, impact_stop=[1, 2])
    sample = rig_of_row(row, rig).sample()
    assert (sample.x, sample.primary_velocity) == (0.7, 0.2)
    assert sample.z - sample.x == pytest.approx(placed, abs=1e-15)
    assert sample.damper_velocity == pytest.approx(0.2 + last[SECTION[3]], abs=1e-15)


def test_one_plastic_impact_is_no_chatter():
    rig = CHATTERING.replace(restitution_1=0.0)
    state = settled(rig, ON_THE_STOP)
    assert state.stops == '1~'
    assert state.impacts == 1
    assert state.chatter_share == 0.0
    assert state.rest_share > 0.2


def test_rest_for_ever_keeps_the_multipliers_of_the_joint_vibration():
    """Driven too weakly to lift m: exp(-C T / (2 (M + m)))."""
    rig = CHATTERING.replace(force_amplitudes=0.3)
    state = settled(rig, ON_THE_STOP)
    assert state.kind == 'without impacts'
    assert state.rest_share == 1.0
    # A free vibration of ten cycles must not be taken for the period
    assert state.cycles == 1
    assert state.lyapunov_exponent == pytest.approx(-0.1 / (2.0 * 1.01), rel=1e-9)


def test_period_of_several_cycles():
    """Two impacts per cycle, of which each second pair is alike."""
    state = settled(RigParameters(gravity=0.0, force_frequencies=1.02, gap=21.5))
    assert state.cycles == 2
    assert state.stops == '1,2,1,2'
    assert state.impacts == 4
    assert state.impacts_per_cycle == 2.0
    assert len(state.section_x) == 2
    assert abs(np.diff(state.section_x)) > 1e-3


def test_multisine_has_the_rms_of_its_lines():
    """Without impacts each line makes a share of X that is known."""
    rig = RigParameters(
        gravity=0.0,
        damping=0.2,
        gap=1e6,
        force_amplitudes=0.0,
        multisine_level=1.0,
        multisine_low=0.5,
        multisine_high=1.5,
        multisine_lines=11,
    )
    state = settled(rig, compiled=False, cycles=50, watch=25)
    assert state.kind == 'without impacts'
    # The lines lie 0.1 rad/s apart
    assert state.cycles == 5
    rates = np.linspace(0.5, 1.5, 11)
    gains = 1.0 / ((1.0 - rates**2) ** 2 + (0.2 * rates) ** 2)
    assert state.x_rms == pytest.approx(math.sqrt(gains.mean()), rel=1e-6)


def test_a_rig_without_force_at_rest():
    state = settled(RigParameters(force_amplitudes=0.0))
    assert (state.kind, state.x_max) == ('at rest', 0.0)


@pytest.mark.parametrize('slow', [0.1, 0.003])
def test_a_slow_force(slow):
    """M follows it; at the ends of all cycles it passes zero."""
    rig = RigParameters(gravity=0.0, gap=1e3, damping=0.2, force_frequencies=slow)
    state = settled(rig, cycles=100, watch=50)
    assert (state.kind, state.cycles) == ('without impacts', 1)
    assert state.x_max == pytest.approx(rig.response_amplitude, rel=1e-9)
    assert state.x_rms == pytest.approx(rig.response_amplitude / math.sqrt(2.0), rel=1e-9)
