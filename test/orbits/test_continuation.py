"""Branches of motions: their points, their special points, and where others leave them."""

import math

import numpy as np
import pytest
from rigs import FRICTION, OFF_RESONANCE, VERTICAL

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import (
    Continuation,
    OrbitError,
    SpecialKind,
    continue_orbit,
    find_orbits,
    grow_branch,
    settle,
    switch_branch,
    value_of,
)
from impact_damper_ros.orbits.solution_curve import with_value
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters

#: A W^2/g of the vertical rig for a force of 1 N
LOUDNESS = 100.0 * VERTICAL.response_amplitude / 0.8


def stable_orbit(rig, stops):
    return next(o for o in find_orbits(rig, stops).orbits if o.stable and o.viable)


def of_kind(branch, kind):
    return [special for special in branch.special if special.kind is kind]


@pytest.fixture(scope='module')
def narrowing():
    """Follow the level rig's symmetric motion towards small gaps."""
    return continue_orbit(
        stable_orbit(OFF_RESONANCE, (1, 2)), Continuation('gap', 10.0, 60.0), upwards=False
    )


@pytest.fixture(scope='module')
def quieter():
    """Follow the vertical rig's motion towards weak forces and around the fold."""
    orbit = stable_orbit(VERTICAL, (1,))
    return continue_orbit(orbit, Continuation('force_amplitudes', 0.2, 2.0), upwards=False)


@pytest.fixture(scope='module')
def louder():
    """Follow the same motion towards strong forces."""
    orbit = stable_orbit(VERTICAL, (1,))
    return continue_orbit(orbit, Continuation('force_amplitudes', 0.2, 2.0))


@pytest.mark.parametrize(
    ('name', 'low', 'high'),
    [
        ('gap', 25.0, 60.0),
        ('friction', 0.0, 3.0),
        ('angle', -0.5, 1.5),
        ('damper_mass', 0.01, 0.2),
        ('restitution', 0.5, 0.95),
        ('restitution_2', 0.6, 0.95),
        ('force_amplitudes', 0.8, 2.0),
        ('force_frequencies', 0.95, 1.15),
        ('gravity', 0.0, 5.0),
        ('air_force', 0.0, 0.05),
    ],
)
@pytest.mark.parametrize('upwards', [True, False])
def test_every_point_is_a_motion_of_its_rig(name, low, high, upwards):
    branch = continue_orbit(
        stable_orbit(FRICTION, (1, 2)),
        Continuation(name, low, high, most_points=60),
        upwards=upwards,
    )
    assert 'corrector' not in branch.ended
    assert all(low <= value <= high for value in branch.values)
    if 'range' in branch.ended:
        assert branch.values[-1] in (pytest.approx(low, abs=1e-12), pytest.approx(high))
    for i in sorted({0, len(branch.values) // 2, len(branch.values) - 1}):
        orbit = branch.orbits[i]
        assert value_of(orbit.parameters, name) == branch.values[i]
        assert orbit.residual < 1e-11
        assert orbit.parameters == with_value(FRICTION, name, branch.values[i])
        found = find_orbits(orbit.parameters, (1, 2), simulate=False).orbits
        assert min(orbit.distance(other) for other in found) < 1e-8


def test_a_branch_grows_point_by_point(narrowing):
    orbit = stable_orbit(OFF_RESONANCE, (1, 2))
    *parts, last = grow_branch(orbit, Continuation('gap', 10.0, 60.0), upwards=False)
    assert last == narrowing
    counts = [len(part.orbits) for part in parts]
    assert counts == [*range(1, len(last.orbits) - len(last.special) + 1)]
    located = {special.value for special in last.special}
    plain = tuple(value for value in last.values if value not in located)
    for part in parts:
        assert part.values == plain[: len(part.values)]
        assert part.special == ()
    # The curve is there before its special points, which take as long.
    assert [bool(part.ended) for part in parts] == [*([False] * (len(parts) - 1)), True]
    assert parts[-1].ended == last.ended
    assert last.special


def test_fold_of_the_vertical_rig(quieter):
    (fold,) = of_kind(quieter, SpecialKind.FOLD)
    assert fold.converged
    # The paper's lower limit, 0.45, and the design's, 0.454
    assert fold.value * LOUDNESS == pytest.approx(0.453620, abs=1e-6)
    assert min(abs(m - 1.0) for m in fold.orbit.multipliers) < 1e-5
    # No motion below, two above
    assert min(quieter.values) >= fold.value
    assert fold.bracket == pytest.approx((fold.value, fold.value), rel=1e-9)
    below = VERTICAL.replace(force_amplitudes=(fold.value * (1 - 1e-6),))
    above = VERTICAL.replace(force_amplitudes=(fold.value * (1 + 1e-6),))
    assert find_orbits(below, (1,)).orbits == ()
    assert len(find_orbits(above, (1,)).orbits) == 2
    # The branch comes back through the unstable motion
    assert [orbit.stable for orbit in (quieter.orbits[1], quieter.orbits[-1])] == [True, False]


def test_period_doubling_of_the_vertical_rig(louder):
    (doubling,) = of_kind(louder, SpecialKind.PERIOD_DOUBLING)
    assert doubling.converged
    assert doubling.value * LOUDNESS == pytest.approx(1.126731, abs=1e-6)
    assert min(abs(m + 1.0) for m in doubling.orbit.multipliers) < 1e-7
    low, high = sorted(doubling.bracket)
    assert high - low < 1e-8
    for value, stable in ((doubling.value - 1e-4, True), (doubling.value + 1e-4, False)):
        rig = VERTICAL.replace(force_amplitudes=(value,))
        orbits = find_orbits(rig, (1,)).orbits
        assert any(orbit.stable for orbit in orbits) == stable


def test_branch_of_twice_the_period(louder):
    (doubling,) = of_kind(louder, SpecialKind.PERIOD_DOUBLING)
    branch = switch_branch(doubling, Continuation('force_amplitudes', 0.2, 1.3))
    assert branch.values[0] == pytest.approx(doubling.value, rel=1e-4)
    orbit = branch.orbits[len(branch.orbits) // 3]
    assert (orbit.stops, orbit.cycles) == ((1, 1), 2)
    assert not orbit.repeats(1e-3)
    # What the rig does there
    assert orbit.stable
    assert orbit.viable
    start = InitialConditions(
        initial_primary_position=orbit.x[0] * 1.01,
        initial_primary_velocity=orbit.primary_velocity_after[0],
        initial_damper_offset=0.5 * orbit.parameters.gap,
        initial_damper_velocity=orbit.damper_velocity_after[0],
    )
    rig = orbit.parameters.replace(force_phases=(math.tau * orbit.phases[0],))
    reached = settle(Rig(rig, start), tolerance=1e-11)
    assert (reached.rhythm.stops, reached.rhythm.cycles) == ((1, 1), 2)
    assert sorted(reached.rhythm.x) == pytest.approx(sorted(orbit.x), rel=1e-8)


def test_twice_the_period_with_reversals():
    """The events of two periods, where the motion is beyond the impact equations."""
    orbit = continue_orbit(
        stable_orbit(FRICTION.replace(gap=16.0), (1, 1, 2)),
        Continuation('gap', 12.9, 16.0),
        upwards=False,
    )
    sticking, turning = of_kind(orbit, SpecialKind.GRAZING)
    assert sticking.value == pytest.approx(13.5309, abs=1e-4)
    assert sticking.reason == '1 more stick, 1 more release'
    # The sticking phase ends as short as it began, now before a flight the other way.
    assert turning.value == pytest.approx(13.4904169, abs=1e-6)
    assert turning.reason == '1 more reversal, 1 less stick, 1 less release'
    for gap, sticks in ((turning.value + 1e-3, True), (turning.value - 1e-3, False)):
        found = find_orbits(FRICTION.replace(gap=gap), (1, 1, 2)).orbits
        nearest = min(found, key=turning.orbit.distance)
        assert (EventKind.STICK in {event.kind for event in nearest.events}) is sticks
    (doubling,) = of_kind(orbit, SpecialKind.PERIOD_DOUBLING)
    assert doubling.converged
    assert doubling.value == pytest.approx(13.1245463, abs=1e-6)
    branch = switch_branch(doubling, Continuation('gap', 12.5, 14.0, most_points=25))
    twice = branch.orbits[-1]
    assert sorted(twice.stops) == [1, 1, 1, 1, 2, 2]
    assert twice.cycles == 2
    assert twice.residual < 1e-11
    assert len(twice.events) >= 2
    assert not twice.repeats(1e-3)


def test_loss_of_symmetry(narrowing):
    special = of_kind(narrowing, SpecialKind.BRANCH_POINT)
    assert len(special) == 1
    point = special[0]
    assert point.converged
    assert point.value == pytest.approx(24.2826432, abs=1e-6)
    assert min(abs(m - 1.0) for m in point.orbit.multipliers) < 1e-6
    # Motions that are each other's mirror image leave it
    first = switch_branch(point, Continuation('gap', 20.0, 60.0))
    second = switch_branch(point, Continuation('gap', 20.0, 60.0), mirrored=True)
    for branch in (first, second):
        assert branch.values[-1] == pytest.approx(20.0)
        assert branch.orbits[10].stable
        assert branch.orbits[10].viable
        assert abs(branch.orbits[10].x[0] + branch.orbits[10].x[1]) > 1e-3
    orbit = first.orbits[-1]
    other = second.orbits[-1]
    assert orbit.x == pytest.approx([-x for x in reversed(other.x)], rel=1e-8)
    found = find_orbits(OFF_RESONANCE.replace(gap=24.0), (1, 2)).orbits
    assert sum(o.stable for o in found) == 2


def test_neimark_sacker():
    orbit = stable_orbit(OFF_RESONANCE, (1, 2))
    branch = continue_orbit(orbit, Continuation('gap', 10.0, 60.0))
    (point,) = of_kind(branch, SpecialKind.NEIMARK_SACKER)
    assert point.converged
    assert point.value == pytest.approx(56.9469910, abs=1e-6)
    assert abs(point.orbit.multipliers[0]) == pytest.approx(1.0, abs=1e-9)
    assert point.orbit.multipliers[0].imag > 0.1
    for gap, stable in ((point.value - 1e-3, True), (point.value + 1e-3, False)):
        orbits = [
            o for o in find_orbits(OFF_RESONANCE.replace(gap=gap), (1, 2)).orbits if o.viable
        ]
        assert any(o.stable for o in orbits) == stable


def test_loss_of_viability():
    branch = continue_orbit(
        stable_orbit(FRICTION, (1, 2)), Continuation('gap', 20.0, 60.0), upwards=False
    )
    (point,) = of_kind(branch, SpecialKind.GRAZING)
    assert point.converged
    assert point.orbit.viable
    assert 'friction changes sign' in point.reason
    assert point.value == pytest.approx(23.3097876, abs=1e-6)
    for gap, viable in ((point.value + 1e-4, True), (point.value - 1e-4, False)):
        orbits = find_orbits(FRICTION.replace(gap=gap), (1, 2), simulate=False).orbits
        nearest = min(orbits, key=point.orbit.distance)
        assert nearest.distance(point.orbit) < 1e-3
        assert nearest.viable == viable


def test_motions_with_reversals_are_followed():
    rig = FRICTION.replace(gap=16.0)
    orbit = stable_orbit(rig, (1, 1, 2))
    branch = continue_orbit(orbit, Continuation('friction', 0.0, 0.5), upwards=False)
    assert branch.ended == 'friction = 0, the end of the range'
    level = stable_orbit(rig.replace(friction=0.0), (1, 1, 2))
    assert branch.orbits[-1].x_max == pytest.approx(level.x_max, rel=1e-9)
    wider = continue_orbit(orbit, Continuation('gap', 16.0, 20.6))
    (point,) = of_kind(wider, SpecialKind.NEIMARK_SACKER)
    assert point.value == pytest.approx(20.3677203, abs=1e-6)
    for gap, stable in ((point.value - 1e-3, True), (point.value + 1e-3, False)):
        found = find_orbits(rig.replace(gap=gap), (1, 1, 2)).orbits
        nearest = min(found, key=point.orbit.distance)
        assert nearest.stable == stable


def test_impacts_that_lose_their_speed_are_no_special_points():
    """A multiplier runs through infinity there, and changes the sign of every product."""
    orbit = find_orbits(FRICTION, (1, 2)).orbits[-1]
    assert not orbit.viable
    branch = continue_orbit(orbit, Continuation('force_frequencies', 1.0, 1.04))
    speeds = [
        min(
            (b - a) * (1.0 if stop == 1 else -1.0)
            for a, b, stop in zip(
                o.primary_velocity_before, o.damper_velocity_before, o.stops, strict=True
            )
        )
        for o in branch.orbits
    ]
    assert min(speeds) < 0.0 < max(speeds)
    for special in branch.special:
        if special.kind in (SpecialKind.PERIOD_DOUBLING, SpecialKind.BRANCH_POINT):
            assert max(abs(m) for m in special.orbit.multipliers) < 1e6


def test_motions_under_several_harmonics_are_followed():
    rig = FRICTION.replace(
        force_amplitudes=(1.0, 0.05), force_frequencies=(1.02, 2.04), force_phases=(0.0, 1.0)
    )
    orbit = find_orbits(rig, (1, 2), simulate=False).orbits[0]
    branch = continue_orbit(orbit, Continuation('gap', 35.0, 40.0))
    assert branch.ended == 'gap = 40, the end of the range'
    again = find_orbits(rig.replace(gap=40.0), (1, 2), simulate=False).orbits[0]
    assert branch.orbits[-1].distance(again) < 1e-9


def test_what_cannot_be_varied():
    orbit = stable_orbit(FRICTION, (1, 2))
    for name in ('one_sided', 'colour'):
        with pytest.raises(OrbitError, match='cannot be varied'):
            continue_orbit(orbit, Continuation(name, 0.0, 1.0))


def test_no_branch_leaves_a_fold(quieter):
    (fold,) = of_kind(quieter, SpecialKind.FOLD)
    with pytest.raises(ValueError, match='no branch leaves at a fold'):
        switch_branch(fold, Continuation('force_amplitudes', 0.2, 1.0))


def test_values_of_parameters():
    rig = RigParameters(restitution_1=0.5, restitution_2=0.6, force_amplitudes=(3.0,))
    assert value_of(rig, 'force_amplitudes') == 3.0
    assert with_value(rig, 'force_amplitudes', 2.0).force_amplitudes == (2.0,)
    both = with_value(rig, 'restitution', 0.7)
    assert (both.restitution_1, both.restitution_2) == (0.7, 0.7)
    assert np.isclose(value_of(rig, 'restitution'), 0.5)
