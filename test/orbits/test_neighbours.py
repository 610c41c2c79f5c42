"""How motions under control part from their neighbours, against what is known without these."""

import cmath
import math

import numpy as np
import pytest
from control.controlled_rigs import TRIAL, control

from impact_damper_ros.control import Rig
from impact_damper_ros.control.nearby_rig import NearbyRig
from impact_damper_ros.orbits import MotionKind, find_orbits, settle
from impact_damper_ros.orbits import lyapunov as neighbours
from impact_damper_ros.rig import InitialConditions, RigParameters

START = InitialConditions(initial_primary_position=1.0)
LEVEL = RigParameters(gravity=0.0, force_frequencies=1.02)
INCLINED = RigParameters(angle=0.6, gravity=1.0, friction=0.4)
#: Sixteen samples in each cycle of the force, whose frequency is 1 rad/s.
IN_STEP = 16 / math.tau


def held(gap):
    """Return a control that is on, and may not move the stops by more than a thousandth."""
    return control('amplitude', gap_control_stops='symmetric', gap_min=gap, gap_max=gap * 1.001)


def near(x, velocity, offset, relative):
    """Return a start close to a motion: the last digit decides where a chaotic way to it ends."""
    return InitialConditions(
        initial_primary_position=x,
        initial_primary_velocity=velocity,
        initial_damper_offset=offset,
        initial_damper_velocity=velocity + relative,
    )


def settled(rig, law, start=START, cycles=600, watch=25):
    """Return what a rig settles into, and the rig in it."""
    run = Rig(rig, start, control=law, compiled=None)
    return settle(run, cycles=cycles, watch=watch), run


@pytest.mark.parametrize(
    ('rig', 'start', 'stops'),
    [
        (TRIAL, START, '1,2'),
        (LEVEL.replace(gap=16.0), near(-2.01, -9.17, 5.76, -3.96), '1,1,2'),
        (
            INCLINED.replace(gap=20.0),
            near(-5.710, -16.609, 8.366, 0.066),
            '1,1,1,2,1,1,2,1,1,1,2,1,1,2',
        ),
        (LEVEL.replace(gap=300.0), START, ''),
    ],
    ids=['resonance', 'three impacts', 'four cycles', 'no impacts'],
)
def test_a_control_that_is_held_has_the_multiplier_of_the_rig(rig, start, stops):
    """The law is on, samples, estimates, and lets the stops stand where they are."""
    state, _ = settled(rig, held(rig.gap), start=start)
    plain = settle(Rig(rig, start, compiled=None), cycles=600, watch=25)
    assert state.period.cycles == plain.period.cycles
    if stops:
        assert state.rhythm.distance(plain.rhythm) < 1e-5
        turned = (state.rhythm.begun_at(i) for i in range(state.rhythm.impacts))
        assert stops in {','.join(map(str, one.stops)) for one in turned}
    else:
        assert state.rhythm is plain.rhythm is None
    # A free m has a double multiplier of one, which is known to half of the digits
    assert state.exponent.uncertainty < (1e-5 if stops else 1e-3)
    assert state.exponent.value == pytest.approx(
        plain.exponent.value, abs=state.exponent.uncertainty
    )
    assert state.multiplier == pytest.approx(plain.multiplier, rel=1e-4 if stops else 1e-3)


def test_stops_that_have_come_to_a_stand_have_the_multiplier_of_the_periodic_solver():
    """The law has placed them, within its dead band; its samples fall elsewhere in each cycle."""
    state, run = settled(TRIAL, control('amplitude', gap_control_stops='symmetric'))
    stops = Rig.restore(run.snapshot()).stops
    gap = stops[0] - stops[1]
    assert abs(gap - TRIAL.gap) > 1.0
    (orbit,) = [
        one
        for one in find_orbits(TRIAL.replace(gap=gap), (1, 2)).orbits
        if one.stable and one.x_max == pytest.approx(state.x_max, rel=1e-6)
    ]
    largest = max(map(abs, orbit.multipliers))
    assert any(cmath.phase(one) for one in orbit.multipliers)
    assert state.exponent.value == pytest.approx(
        math.log(largest) / math.tau, abs=state.exponent.uncertainty
    )
    assert state.multiplier == pytest.approx(largest, rel=1e-7)


@pytest.mark.parametrize(
    ('rig', 'law'),
    [
        (TRIAL.replace(angle=0.4, gravity=1.0, friction=0.3), {}),
        (TRIAL, {'gap_control_park': 0.6}),
    ],
    ids=['inclined', 'parked near'],
)
def test_a_motion_with_stops_that_move_forgets_a_kick_by_its_multiplier(rig, law):
    """The force of a third of a cycle was another one; what is left of it after many cycles."""
    law = control('timed', gap_control_rate=IN_STEP, **law)
    state, run = settled(rig, law)
    assert state.kind is MotionKind.PERIODIC
    assert (state.rhythm.cycles, state.rhythm.stops) == (1, (1, 2))
    begun, cycle, first, last = run.time, state.cycle, 8, 38
    ends = begun + cycle * np.array([first, first + 1, last, last + 1])
    kicked, alone = (Rig.restore(run.snapshot(), compiled=None) for _ in range(2))
    kicked.change(rig.replace(force_amplitudes=1.001), law)
    kicked.run(begun + 0.3 * cycle)
    kicked.change(rig, law)
    samples = [one.run(ends[-1], ends).samples for one in (kicked, alone)]
    apart = np.hypot(*(samples[0][n] - samples[1][n] for n in ('x', 'primary_velocity')))
    # Of a turning pair either of two cycles in a row may show little
    left = max(apart[2:]) / max(apart[:2])
    assert math.log(left) / (last - first) == pytest.approx(
        math.log(state.multiplier), abs=1.2 / (last - first)
    )
    assert state.multiplier < 0.85


def test_where_neighbours_decide_differently_there_is_no_exponent(monkeypatch):
    """Neighbours that are far apart stand for ones whose decisions are always on the edge."""
    monkeypatch.setattr(neighbours, '_NEAR', 9e-3)
    for law in (
        control('timed', gap_control_rate=IN_STEP),
        control('timed', gap_control_noise_position=0.02),
    ):
        state, _ = settled(TRIAL, law, cycles=130, watch=48)
        assert math.isnan(state.exponent.value)
        assert math.isnan(state.exponent.uncertainty)
        assert math.isnan(state.multiplier)


def test_neighbours_are_where_m_can_be():
    rig = NearbyRig(INCLINED.replace(gap=2.0), START, control=held(2.0))
    rig.run(100.0)
    state = rig.numbers()
    same = rig.at(state, state.numbers)
    # It begins a flight here, whose first instant is known to round-off.
    assert same.numbers().numbers == pytest.approx(state.numbers, rel=1e-14, abs=1e-15)
    assert same.numbers().alike(state)
    later = [one.run(120.0, [120.0]).samples.tolist()[0] for one in (rig, same)]
    assert later[1] == pytest.approx(later[0], rel=1e-9)
    beyond = state.numbers.copy()
    beyond[state.places.index((0, 'clearance_1'))] = -1e-9
    assert same.at(state, beyond) is None
