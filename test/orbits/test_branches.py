"""Whole branches: followed both ways, read at values, and their best points."""

import math

import numpy as np
import pytest
from rigs import FRICTION, HORIZONTAL, VERTICAL

from impact_damper_ros.orbits import OrbitError, SpecialKind, find_orbits, follow
from impact_damper_ros.orbits.branch import Limit


def stable_orbit(rig, stops=(1, 2)):
    return next(o for o in find_orbits(rig, stops).orbits if o.stable and o.viable)


@pytest.fixture(scope='module')
def gaps():
    """Follow the level rig's symmetric motion at resonance in the gap."""
    return follow(stable_orbit(HORIZONTAL), 'gap', 20.0, 70.0)


def test_both_directions_are_one_branch(gaps):
    assert (gaps.began, gaps.ended) == (
        'gap = 20, the end of the range',
        'gap = 70, the end of the range',
    )
    assert gaps.values[0] == 20.0
    assert gaps.values[-1] == 70.0
    assert np.all(np.diff(gaps.values) > 0.0)
    assert HORIZONTAL.gap in gaps.values
    # Special points are among them, so that stability changes at a point
    for special in gaps.special:
        point = next(p for p in gaps.points if p.value == special.value)
        assert point.orbit is special.orbit
    kinds = [special.kind for special in gaps.special]
    assert kinds == [SpecialKind.BRANCH_POINT, SpecialKind.NEIMARK_SACKER]
    flips = [
        right
        for (_, left), (right, other) in zip(gaps.points, gaps.points[1:], strict=False)
        if left.unstable != other.unstable
    ]
    assert len(flips) == 2


def test_the_motions_at_some_values(gaps):
    found = gaps.at([25.0, 37.0, gaps.special[0].value, 71.0])
    assert [len(orbits) for orbits in found] == [1, 1, 1, 0]
    for value, (orbit,) in zip((25.0, 37.0), found, strict=False):
        assert orbit.parameters == HORIZONTAL.replace(gap=value)
        others = find_orbits(orbit.parameters, (1, 2), simulate=False).orbits
        assert min(orbit.distance(other) for other in others) < 1e-9


def test_a_branch_that_turns_has_two_motions_at_a_value():
    branch = follow(stable_orbit(VERTICAL, (1,)), 'force_amplitudes', 0.2, 2.0)
    (fold,) = (s for s in branch.special if s.kind is SpecialKind.FOLD)
    for value in (fold.value * (1.0 + 1e-7), 0.6):
        (pair,) = branch.at([value])
        assert [orbit.stable for orbit in pair] == [False, True]
        rig = VERTICAL.replace(force_amplitudes=value)
        for orbit in pair:
            others = find_orbits(rig, (1,)).orbits
            assert min(orbit.distance(other) for other in others) < 1e-7
    assert branch.at([fold.value * (1.0 - 1e-7)]) == [()]


def test_the_best_gap_is_a_minimum(gaps):
    """The symmetric flight at resonance; no gap nearby is better."""
    wide = follow(stable_orbit(HORIZONTAL.replace(gap=55.0)), 'gap', 50.0, 65.0)
    best = wide.best()
    assert (best.limit, best.beyond) == (Limit.MINIMUM, '')
    assert best.value == pytest.approx(58.128195, abs=1e-4)
    near = [o.x_max for (o,) in wide.at(best.value * np.linspace(0.99, 1.01, 21))]
    assert best.orbit.x_max <= min(near) * (1.0 + 1e-14)
    # The damping that two impacts in a cycle are equivalent to, for the heavy limit
    equivalent = 2.0 / math.pi * HORIZONTAL.mass_ratio / (1.0 + HORIZONTAL.mass_ratio) * 7.0
    ratio = HORIZONTAL.zeta / (HORIZONTAL.zeta + equivalent)
    assert best.orbit.amplitude_ratio == pytest.approx(ratio, rel=3e-3)
    loudest = wide.best(lambda orbit: -orbit.x_max)
    assert loudest.limit is Limit.RANGE
    assert loudest.value == 50.0
    assert gaps.best('x_max').value == pytest.approx(best.value, abs=1e-4)


def test_edges_are_named():
    hanging = HORIZONTAL.replace(gravity=9.81, angle=0.5 * math.pi, gap=59.3)
    best = follow(stable_orbit(hanging), 'gap', 50.0, 65.0).best()
    assert (best.limit, best.beyond) == (Limit.STABILITY, 'period doubling')
    assert best.value == pytest.approx(59.2426, abs=1e-3)
    branch = follow(stable_orbit(VERTICAL, (1,)), 'force_amplitudes', 0.2, 2.0)
    assert branch.best().limit is Limit.FOLD
    least = follow(stable_orbit(FRICTION), 'gap', 20.0, 40.0).best(lambda o: o.parameters.gap)
    assert least.limit is Limit.VIABILITY
    assert 'friction changes sign' in least.beyond


def test_any_path_through_the_parameters():
    """Gap and damping together, and its end against the motions there."""

    def wider(share):
        return HORIZONTAL.replace(gap=37.0 + 8.0 * share, damping=0.01 * (1.0 + share))

    branch = follow(stable_orbit(HORIZONTAL), wider, 0.0, 1.0)
    assert branch.name == 'wider'
    assert branch.ended == 'wider = 1, the end of the range'
    end = branch.orbits[-1]
    assert end.parameters == wider(1.0)
    found = find_orbits(wider(1.0), (1, 2), simulate=False).orbits
    assert min(end.distance(other) for other in found) < 1e-9
    assert branch.at([0.5])[0][0].parameters == wider(0.5)
    middle = follow(stable_orbit(wider(0.5)), wider, 0.0, 1.0, start=0.5)
    assert middle.values[0] == 0.0
    assert middle.orbits[-1].distance(end) < 1e-9
    with pytest.raises(OrbitError, match='give start'):
        follow(stable_orbit(wider(0.5)), wider, 0.0, 1.0)


@pytest.mark.parametrize(
    ('restitution', 'ratio'), [(0.5, 9.6346), (0.6, 12.7245), (0.65, 14.9448), (0.75, 22.0819)]
)
def test_the_fold_of_a_vanishing_damper_mass(restitution, ratio):
    """
    Where M moves as without m, the two-impact motion ends at d/A = sqrt(pi^2 + 4 s^2)/s.

    s = (1 - R)/(1 + R): the slow manifold of a vibro-impact nonlinear energy sink.
    """
    rig = HORIZONTAL.replace(
        damper_mass=1e-9,
        restitution_1=restitution,
        restitution_2=restitution,
        damping=0.1,
        force_frequencies=0.5,
    )
    sigma = (1.0 - restitution) / (1.0 + restitution)
    expected = math.sqrt(math.pi**2 + 4.0 * sigma**2) / sigma
    assert expected == pytest.approx(ratio, abs=5e-5)
    amplitude = rig.response_amplitude
    start = rig.replace(gap=0.9 * expected * amplitude)
    orbit = stable_orbit(start)
    branch = follow(orbit, 'gap', start.gap, 1.1 * expected * amplitude)
    (fold,) = (s for s in branch.special if s.kind is SpecialKind.FOLD)
    assert fold.value / amplitude == pytest.approx(expected, abs=1e-6)


def test_friction_comes_and_goes_along_a_branch():
    """Without friction the nodes are those with it, so that a branch may begin there."""
    branch = follow(stable_orbit(FRICTION.replace(friction=0.0)), 'friction', 0.0, 0.5)
    assert branch.special == ()
    assert all(orbit.viable for orbit in branch.orbits)
    for value, (orbit,) in zip((0.2, 0.5), branch.at([0.2, 0.5]), strict=True):
        others = find_orbits(FRICTION.replace(friction=value), (1, 2), simulate=False).orbits
        assert min(orbit.distance(other) for other in others) < 1e-9
