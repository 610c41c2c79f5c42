"""The motion predicted for a rig is the one it comes to, and is reported with its reasons."""

import math
import re

import pytest
from rig.endless_rigs import ENDLESS
from rigs import BENCH, FRICTION, HORIZONTAL, OFF_RESONANCE, VERTICAL

from impact_damper_ros import InitialConditions, Rig, find_orbits
from impact_damper_ros.theory.expected_motion import predictions, run_ahead
from theory.observed import motion_on

THREE = OFF_RESONANCE.replace(gap=18.0)


@pytest.mark.parametrize(
    ('rig', 'stops'),
    [
        (HORIZONTAL, (1, 2)),
        (FRICTION, (1, 2)),
        (THREE, (1, 1, 2)),
        (VERTICAL.replace(gap=10.0), (1,)),
    ],
)
def test_the_predicted_motion_is_the_stable_one_of_the_theory(rig, stops):
    *_, last = predictions(Rig(rig))
    assert last.complete
    assert (last.basis, last.reason) == ('run ahead', '')
    orbit = last.expected
    (theory,) = (
        o for o in find_orbits(rig, stops).orbits if o.viable and orbit.distance(o) < 1e-9
    )
    assert orbit.stops == stops
    assert orbit.stable
    assert orbit.x_max == pytest.approx(theory.x_max, rel=1e-9)
    assert abs(orbit.multipliers[0]) == pytest.approx(abs(theory.multipliers[0]), abs=1e-7)


def test_a_motion_with_cycles_without_impacts_is_recognised():
    rig = VERTICAL.replace(force_amplitudes=1.48507)
    theory = find_orbits(rig, (1,), 3).orbits[0]
    assert abs(theory.multipliers[0]) == pytest.approx(0.927447, abs=1e-6)
    # It begins just after an impact, slightly beside the periodic motion.
    rig = rig.replace(force_phases=math.tau * theory.phases[0])
    start = InitialConditions(
        initial_primary_position=theory.x[0] + 1e-5,
        initial_primary_velocity=theory.primary_velocity_after[0],
        initial_damper_offset=0.5 * rig.gap,
        initial_damper_velocity=theory.damper_velocity_after[0],
    )
    found = next(each for each in predictions(Rig(rig, start)) if each.basis == 'run ahead')
    assert (found.expected.stops, found.expected.cycles) == ((1,), 3)
    assert found.expected.stable
    assert found.expected.x_max == pytest.approx(theory.x_max, rel=1e-9)


def test_the_motion_comes_first_and_the_rig_stays_where_it_is():
    rig = Rig(FRICTION)
    rig.advance(20.0)
    before = rig.snapshot()
    first, last = predictions(rig)
    assert (first.basis, first.complete, last.complete) == ('run ahead', False, True)
    assert last.expected is first.expected
    assert first.expected.x_max / FRICTION.response_amplitude == pytest.approx(0.2113439, abs=5e-7)
    assert rig.snapshot() == before


def test_of_coexisting_motions_the_measured_one_is_predicted():
    mirrored = find_orbits(THREE, (1, 2, 2)).orbits[0]
    assert mirrored.stable
    first = next(predictions(Rig(THREE), motion_on(mirrored)))
    assert first.basis == 'measured'
    assert first.expected.stops == (1, 2, 2)
    # From rest the rig comes to the other one; both are listed.
    *_, last = predictions(Rig(THREE))
    assert last.expected.stops == (1, 1, 2)
    assert {o.stops for o in last.orbits if o.stable} == {(1, 1, 2), (1, 2, 2)}
    # Viable ones first, of those the stable ones
    order = [(not o.viable, not o.stable, o.x_max) for o in last.orbits]
    assert order == sorted(order)
    assert {kind[:2] for kind in order} >= {(False, False), (False, True)}


@pytest.mark.parametrize(
    ('rig', 'reason'),
    [
        (HORIZONTAL.replace(force_amplitudes=0.0), 'no force acts, and the base is at rest'),
        (HORIZONTAL.replace(multisine_level=0.1), 'multisine_level is 0.1 N'),
        (HORIZONTAL.replace(sweep_mode='up'), "sweep_mode is 'up'"),
        (
            HORIZONTAL.replace(
                force_amplitudes=(1.0, 0.3), force_frequencies=(1.0, 1.234), force_phases=(0, 0)
            ),
            'needs a whole number',
        ),
    ],
)
def test_a_force_without_a_period_has_no_prediction_and_the_reason_is_given(rig, reason):
    (only,) = predictions(Rig(rig))
    assert (only.orbits, only.expected, only.complete) == ((), None, True)
    assert reason in only.reason


def test_a_harmonic_that_was_added_on_the_way_has_the_phase_of_then():
    rig = Rig(FRICTION)
    rig.advance(20.0)
    force = {'force_frequencies': (1.02, 1.7), 'force_phases': (0.1, 0.2)}
    rig.change(FRICTION.replace(force_amplitudes=(1.0, 0.1), **force))
    *_, last = predictions(rig)
    assert last.expected.cycles == 3
    assert last.expected.stable
    cycle = math.tau / 1.02
    course = run_ahead(rig)
    assert last.expected.distance(course.rhythm) < 1e-2
    rig.advance(rig.time + 300 * cycle)
    course = run_ahead(rig)
    assert last.expected.distance(course.rhythm) < 1e-8


def test_where_no_stop_is_hit_or_nothing_repeats_the_reason_is_given():
    *_, last = predictions(Rig(HORIZONTAL.replace(gap=600.0)))
    assert last.expected is None
    assert 'no more impacts' in last.reason
    search = predictions(Rig(BENCH.replace(gap=0.032)))
    first = next(search)
    assert 'does not repeat within 1500 cycles' in first.reason
    # Theory has a motion of two impacts, of which the rig moves away.
    expected = first.expected
    assert (first.basis, expected.viable, expected.stable) == ('listed', True, False)
    *_, last = search
    assert last.complete
    exponent, error = map(
        float, re.findall(r'chaotic: .* ([+-][\d.]+) ± ([\d.]+)', last.reason)[0]
    )
    # 0.288 +- 0.006 over 20,000 cycles
    assert exponent == pytest.approx(0.288, abs=4.0 * error)


def test_a_rig_with_impacts_without_end_is_not_run_ahead():
    parameters, initial = ENDLESS['tiny gap']
    first = next(predictions(Rig(parameters, initial)))
    assert (first.complete, first.expected) == (False, None)
    assert 'the rig cannot be run further: ' in first.reason
    assert 'make the stops less elastic' in first.reason
