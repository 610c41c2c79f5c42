"""Stability multipliers: against the determinant rule and against the simulator's own map."""

import math

import numpy as np
import pytest
from rigs import FRICTION, HORIZONTAL, INCLINED, VERTICAL

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.orbits.multipliers import multipliers_of
from impact_damper_ros.orbits.segments import Segments
from impact_damper_ros.orbits.solved_orbits import guess_on
from impact_damper_ros.rig import EventKind, InitialConditions

CASES = {
    'horizontal': (HORIZONTAL, (1, 2), 1),
    'inclined': (INCLINED, (1, 2), 1),
    'friction': (FRICTION, (1, 2), 1),
    'air and restitutions': (
        INCLINED.replace(air_force=0.02, restitution_1=0.6, restitution_2=0.85, friction=0.2),
        (1, 2),
        1,
    ),
    'three impacts': (INCLINED.replace(gap=18.0, angle=0.0), (1, 1, 2), 1),
    'four impacts': (INCLINED.replace(gap=8.0, angle=0.0), (1, 1, 2, 2), 1),
    'vertical': (VERTICAL, (1,), 1),
}


def monodromy(orbit):
    """Return the derivative of (X, X', Y, Y') a period after the first impact by the same."""
    guess = guess_on(orbit)
    segments = Segments(orbit.parameters, guess.nodes, orbit.cycles)
    return segments.monodromy(segments.flights(*guess[1:]))


def expected_determinant(parameters, stops, period):
    """Return exp(-2 zeta omega T) times the product of all R^2."""
    product = math.exp(-2.0 * parameters.zeta * parameters.omega * period)
    for stop in stops:
        product *= (parameters.restitution_1 if stop == 1 else parameters.restitution_2) ** 2
    return product


def section_monodromy(orbit):
    """Return the derivative of the map of (X, X', Z', t) just after the first impact."""
    guess = guess_on(orbit)
    segments = Segments(orbit.parameters, guess.nodes, orbit.cycles)
    rate = segments.flights(*guess[1:]).rate_start[0]
    # A section deviation, seen at the instant of the undisturbed impact
    into = np.zeros((4, 4))
    into[0, 0] = into[1, 1] = into[3, 2] = 1.0
    into[3, 1] = -1.0
    into[:, 3] = -rate
    return np.linalg.solve(into, monodromy(orbit) @ into)


def section_map(rig, orbit, state):
    """Return (X, X', Z', t) one period of the simulator after those just after impact 1."""
    x, velocity, damper_velocity, time = state
    half = 0.5 * rig.gap if orbit.stops[0] == 1 else -0.5 * rig.gap
    shifted = rig.replace(force_phases=(rig.force_phases[0] + rig.force_frequencies[0] * time,))
    start = InitialConditions(
        initial_primary_position=x,
        initial_primary_velocity=velocity,
        initial_damper_offset=half,
        initial_damper_velocity=damper_velocity,
    )
    events = Rig(shifted, start).advance(1.05 * orbit.period)
    impacts = [event for event in events if event.kind is EventKind.IMPACT]
    last = impacts[orbit.impacts - 1]
    assert tuple(e.stop for e in impacts[: orbit.impacts]) == orbit.stops[1:] + orbit.stops[:1]
    return np.array(
        [last.x, last.primary_velocity_after, last.damper_velocity_after, time + last.time]
    )


@pytest.mark.parametrize('case', CASES)
def test_determinant(case):
    rig, stops, cycles = CASES[case]
    for orbit in find_orbits(rig, stops, cycles).orbits:
        expected = expected_determinant(rig, stops, orbit.period)
        for matrix in (monodromy(orbit), section_monodromy(orbit)):
            assert np.linalg.det(matrix) == pytest.approx(expected, rel=1e-8)
        assert np.prod(orbit.multipliers) == pytest.approx(expected, rel=1e-8)


@pytest.mark.parametrize('case', CASES)
def test_section_and_fixed_instant_have_the_same_multipliers(case):
    rig, stops, cycles = CASES[case]
    orbit = find_orbits(rig, stops, cycles).orbits[0]
    section = multipliers_of(section_monodromy(orbit))
    assert section == pytest.approx(orbit.multipliers, abs=1e-9)


@pytest.mark.parametrize('case', [name for name in CASES if 'air' not in name])
def test_finite_differences_of_the_simulator(case):
    rig, stops, cycles = CASES[case]
    orbit = find_orbits(rig, stops, cycles).orbits[0]
    assert orbit.viable
    state = np.array(
        [
            orbit.x[0],
            orbit.primary_velocity_after[0],
            orbit.damper_velocity_after[0],
            orbit.instants[0],
        ]
    )
    after = section_map(rig, orbit, state)
    assert after - [0.0, 0.0, 0.0, orbit.period] == pytest.approx(state, rel=1e-10, abs=1e-12)
    steps = (
        1e-5 * np.array([rig.response_amplitude, 1.0, 1.0, 0.1]) * (0.1 if rig.one_sided else 1.0)
    )
    steps[0] = min(steps[0], 1e-5)
    columns = []
    for j in range(4):
        move = np.zeros(4)
        move[j] = steps[j]
        ahead = section_map(rig, orbit, state + move)
        behind = section_map(rig, orbit, state - move)
        columns.append((ahead - behind) / (2.0 * steps[j]))
    by_differences = np.array(columns).T
    exact = section_monodromy(orbit)
    assert exact == pytest.approx(by_differences, abs=2e-7 * np.abs(exact).max())
    # The eigenvalues themselves, to the 1e-8 that the differences allow
    assert multipliers_of(by_differences) == pytest.approx(orbit.multipliers, abs=1e-6)


def test_air_force_against_the_simulator():
    """The simulator settles on the motion as fast as its largest multiplier says."""
    rig = INCLINED.replace(air_force=0.02, friction=0.2)
    orbit = find_orbits(rig, (1, 2)).orbits[0]
    assert orbit.viable
    assert orbit.stable
    impacts = [
        event
        for event in Rig(rig).advance(500 * orbit.period)
        if event.kind is EventKind.IMPACT and event.stop == 1
    ]
    away = np.array([abs(event.x - orbit.x[0]) for event in impacts])
    # A complex pair: the rate of the envelope, over many of its turns
    periods = np.arange(len(away))
    kept = (away < 1e-3) & (away > 1e-10)
    slope = np.polyfit(periods[kept], np.log(away[kept]), 1)[0]
    assert math.exp(slope) == pytest.approx(abs(orbit.multipliers[0]), rel=5e-3)


def test_multipliers_are_ordered():
    matrix = np.diag([0.1, -0.9, 0.0, 0.0])
    matrix[2:, 2:] = [[0.3, -0.4], [0.4, 0.3]]
    assert multipliers_of(matrix) == pytest.approx((-0.9, 0.3 + 0.4j, 0.3 - 0.4j, 0.1))
