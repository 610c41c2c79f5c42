"""The 2N equations: against their own linear form, finite differences, and the simulator."""

import math

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import ImpactEquations, OrbitError, find_orbits, plausible_stops
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters

RIG = RigParameters(
    friction=0.3,
    angle=0.4,
    gravity=1.3,
    restitution_2=0.5,
    force_frequencies=(1.02,),
    force_phases=(0.3,),
    air_force=0.02,
    damper_mass=0.1,
    damping=0.05,
)
SEQUENCES = [((1, 2), 1, 0.3), ((1, 2, 1, 2), 2, 0.3), ((1, 1, 2), 1, 0.0), ((1,), 2, 0.0)]


def anywhere(equations, seed=1):
    """Return displacements and instants that solve nothing."""
    rng = np.random.default_rng(seed)
    n = equations.impacts
    return 3.0 * rng.normal(size=n), np.sort(rng.uniform(0.0, equations.period, n))


@pytest.mark.parametrize(('stops', 'cycles', 'friction'), SEQUENCES)
def test_linear_for_fixed_instants(stops, cycles, friction):
    equations = ImpactEquations(RIG.replace(friction=friction), stops, cycles)
    x, instants = anywhere(equations)
    phase = equations.frequency * instants[0] + equations.phase
    rows = equations.linear_system(instants - instants[0])
    vector = np.concatenate([x, [math.cos(phase), math.sin(phase), 1.0]])
    residual, _ = equations.residual(x, instants)
    assert rows @ vector / equations.length == pytest.approx(residual, abs=1e-13)


@pytest.mark.parametrize(('stops', 'cycles', 'friction'), SEQUENCES)
def test_jacobian_is_the_derivative(stops, cycles, friction):
    equations = ImpactEquations(RIG.replace(friction=friction), stops, cycles)
    n = equations.impacts
    x, instants = anywhere(equations)
    _, jacobian = equations.residual(x, instants)
    step = 1e-6
    for j in range(2 * n):
        move = np.zeros(2 * n)
        move[j] = step
        x_move, t_move = move[:n] * equations.length, move[n:] / equations.rate
        ahead, _ = equations.residual(x + x_move, instants + t_move)
        behind, _ = equations.residual(x - x_move, instants - t_move)
        slope = (ahead - behind) / (2.0 * step)
        assert jacobian[:, j] == pytest.approx(slope, abs=1e-8 * np.abs(jacobian).max())


@pytest.mark.parametrize(('stops', 'cycles', 'friction'), SEQUENCES)
def test_derivative_by_the_gap(stops, cycles, friction):
    rig = RIG.replace(friction=friction, gap=30.0)
    equations = ImpactEquations(rig, stops, cycles)
    x, instants = anywhere(equations)
    sides = []
    for gap in (30.0 + 1e-3, 30.0 - 1e-3):
        other = ImpactEquations(rig.replace(gap=gap), stops, cycles)
        # Times the length, which may change with the gap
        sides.append(other.residual(x, instants)[0] * other.length)
    slope = (sides[0] - sides[1]) / 2e-3 / equations.length
    assert equations.by_gap(instants) == pytest.approx(slope, abs=1e-9)
    assert bool(np.abs(slope).max() > 1e-3) is (2 in stops)


def test_batches_are_the_single_ones():
    equations = ImpactEquations(RIG, (1, 2), 1)
    several = [anywhere(equations, seed) for seed in range(3)]
    x = np.array([x for x, _ in several])
    instants = np.array([t for _, t in several])
    value, jacobian = equations.residual(x, instants)
    for i in range(3):
        one, slope = equations.residual(x[i], instants[i])
        assert value[i] == pytest.approx(one, rel=1e-14, abs=1e-15)
        assert jacobian[i] == pytest.approx(slope, rel=1e-13, abs=1e-14)


def test_velocities_keep_momentum_and_restitution():
    equations = ImpactEquations(RIG, (1, 2), 1)
    x, instants = anywhere(equations)
    at = equations.velocities(x, instants)
    mu = RIG.mass_ratio
    assert at.primary_after + mu * at.damper_after == pytest.approx(
        at.primary_before + mu * at.damper_before, rel=1e-12
    )
    ratio = (at.primary_after - at.damper_after) / (at.damper_before - at.primary_before)
    assert ratio == pytest.approx([0.75, 0.5], rel=1e-12)


def test_simulated_flights_satisfy_the_equations():
    """Four alternating impacts in a row, whatever else the motion does."""
    rig = Rig(RIG, InitialConditions(initial_primary_position=5.0))
    events = rig.advance(400.0)
    windows = [
        events[i : i + 4]
        for i in range(len(events) - 3)
        if all(e.kind is EventKind.IMPACT for e in events[i : i + 4])
        and [e.stop for e in events[i : i + 4]] == [1, 2, 1, 2]
    ]
    assert windows
    window = windows[0]
    equations = ImpactEquations(RIG, (1, 2, 1, 2), 8)
    x = np.array([e.x for e in window])
    instants = np.array([e.time for e in window])
    residual, _ = equations.residual(x, instants)
    # Flight 2 -> 3 has its true velocities at both ends; the neighbours' belong to other flights.
    assert abs(residual[1]) < 1e-12
    assert abs(residual[5]) < 1e-12


def test_undamped_rig_at_resonance_is_finite():
    rig = RigParameters(damping=0.0, gravity=0.0)
    equations = ImpactEquations(rig, (1, 2), 1)
    rows = equations.linear_system(np.array([0.0, 2.0]))
    assert np.isfinite(rows).all()
    near = ImpactEquations(rig.replace(force_frequencies=(1.0 + 1e-9,)), (1, 2), 1)
    assert near.linear_system(np.array([0.0, 2.0])) == pytest.approx(rows, abs=1e-7)


@pytest.mark.parametrize(
    ('changes', 'stops', 'cycles', 'words'),
    [
        ({}, (1, 1, 2), 1, 'same stop'),
        ({'one_sided': True}, (1, 2), 1, 'one-sided'),
        ({}, (1, 3), 1, 'each 1'),
        ({}, (), 1, 'each 1'),
        ({}, (1, 2), 0, 'at least 1'),
        ({'force_amplitudes': (0.0,)}, (1, 2), 1, 'amplitude 0'),
        ({'force_frequencies': (0.0,)}, (1, 2), 1, 'frequency 0'),
        (
            {
                'force_amplitudes': (1.0, 0.5),
                'force_frequencies': (1.0, 2.0),
                'force_phases': (0.0, 0.0),
            },
            (1, 2),
            1,
            '2 harmonics',
        ),
    ],
)
def test_what_the_theory_excludes(changes, stops, cycles, words):
    with pytest.raises(OrbitError, match=words):
        ImpactEquations(RIG.replace(**changes), stops, cycles)


@pytest.mark.parametrize(
    ('impacts', 'expected'),
    [
        (1, []),
        (2, [(1, 2)]),
        (3, [(1, 1, 2), (1, 2, 2)]),
        (4, [(1, 2, 1, 2), (1, 1, 1, 2), (1, 1, 2, 2), (1, 2, 2, 2)]),
    ],
)
def test_plausible_stops(impacts, expected):
    level = RIG.replace(angle=0.0, friction=0.0, air_force=0.0)
    alone = [(stop,) * impacts for stop in (1, 2)]
    assert plausible_stops(level, impacts) == (expected or [(1,)])
    assert plausible_stops(level.replace(angle=0.1), impacts) == [*expected, alone[0]]
    assert plausible_stops(level.replace(angle=-0.1), impacts) == [*expected, alone[1]]
    assert plausible_stops(level.replace(friction=0.1), impacts) == [*expected, *alone]
    pushed = level.replace(angle=0.1, air_force=1.1 * level.damper_mass * level.gravity)
    assert plausible_stops(pushed, impacts) == (expected or [(1,)])
    assert plausible_stops(level.replace(one_sided=True), impacts) == [(1,) * impacts]


@pytest.mark.parametrize('impacts', [0, 7])
def test_too_few_or_too_many_sequences(impacts):
    with pytest.raises(OrbitError, match=f'{impacts} impacts'):
        plausible_stops(RIG, impacts)


@pytest.mark.parametrize('number', [0, -1, 1.5, 1001, 10**12, math.inf, math.nan])
def test_numbers_that_no_period_can_have(number):
    """10**12 impacts were once listed, and as many cycles failed deep in linear algebra."""
    with pytest.raises(OrbitError, match='a whole number up to 1000'):
        find_orbits(RigParameters(), (1, 2), number)
    for one_sided in (False, True):
        with pytest.raises(OrbitError, match='a whole number up to 1000'):
            plausible_stops(RigParameters(one_sided=one_sided), number)


@pytest.mark.parametrize('frequency', [1e-300, 1e-162, 1e-9])
def test_a_force_too_slow_for_a_vibration(frequency):
    """It once ended in a division by zero, or deep in linear algebra."""
    with pytest.raises(OrbitError, match='no vibration, give at least 1e-06 rad/s'):
        find_orbits(RigParameters(force_frequencies=frequency), (1, 2))


@pytest.mark.filterwarnings('error')
def test_free_vibration_that_dies_out_within_a_flight():
    """Its growth rate over a flight once was beyond the floats."""
    rig = RigParameters(gravity=0.0, damping=1.9, force_frequencies=1e-3)
    equations = ImpactEquations(rig, (1, 2), 1)
    system = equations.linear_system(np.array([0.0, 0.5 * equations.period]))
    assert np.all(np.isfinite(system))
    find_orbits(rig, (1, 2), simulate=False)
