"""Branches of motions: their points, special and best ones, and where others leave them."""

import math
import pickle
from functools import partial

import numpy as np
import pytest
from rigs import FRICTION, HORIZONTAL, OFF_RESONANCE, TABLE, VERTICAL

from impact_damper_ros import (
    EventKind,
    OrbitError,
    SpecialKind,
    find_orbits,
    follow,
    settle,
    switch_branch,
    value_of,
)
from impact_damper_ros.orbits.varied_parameter import with_value
from orbits.begun_rigs import begun_on

#: A W^2/g of the vertical rig for a force of 1 N
LOUDNESS = 100.0 * VERTICAL.response_amplitude / 0.8


def stable_orbit(rig, stops=(1, 2)):
    return next(o for o in find_orbits(rig, stops).orbits if o.stable and o.viable)


def nearest_at(orbit, rig, stops=(1, 2), **options):
    """Return the motion of a rig, as the search finds it, that is nearest to one of another."""
    found = find_orbits(rig, stops, **options).orbits
    return min(found, key=orbit.distance)


def around(special, name, step=1e-3, **options):
    """Return the motions nearest to a special point that the search finds on both sides of it."""
    orbit, rig = special.orbit, special.orbit.parameters
    rigs = (with_value(rig, name, special.value + move) for move in (-step, step))
    return [nearest_at(orbit, rig, orbit.stops, **options) for rig in rigs]


def only(branch, kind):
    (special,) = (special for special in branch.special if special.kind is kind)
    return special


@pytest.fixture(scope='module')
def gaps():
    """Follow the level rig's symmetric motion at resonance in the gap."""
    return follow(stable_orbit(HORIZONTAL), 'gap', 20.0, 70.0)


@pytest.fixture(scope='module')
def detuned():
    """Follow that beside the resonance."""
    return follow(stable_orbit(OFF_RESONANCE), 'gap', 10.0, 60.0)


@pytest.fixture(scope='module')
def vertical():
    """Follow the vertical rig's motion over the force, around the fold."""
    return follow(stable_orbit(VERTICAL, (1,)), 'force_amplitudes', 0.2, 2.0)


@pytest.mark.parametrize(
    ('name', 'low', 'high'),
    [
        ('gap', 25.0, 60.0),
        ('friction', 0.0, 3.0),
        ('angle', -0.5, 1.5),
        ('restitution', 0.5, 0.95),
        ('force_frequencies', 0.95, 1.15),
        ('air_force', 0.0, 0.05),
    ],
)
def test_every_point_is_a_motion_of_its_rig(name, low, high):
    orbit = stable_orbit(FRICTION)
    branch = follow(orbit, name, low, high, most_points=30)
    for end, values in ((branch.began, branch.values[0]), (branch.ended, branch.values[-1])):
        assert 'corrector' not in end
        assert 'range' not in end or values in (pytest.approx(low, abs=1e-12), pytest.approx(high))
    assert all(low <= value <= high for value in branch.values)
    places = np.linspace(0, len(branch.points) - 1, 3).astype(int)
    for value, orbit in (branch.points[i] for i in places):
        assert value_of(orbit.parameters, name) == value
        assert orbit.residual < 1e-11
        assert orbit.parameters == with_value(FRICTION, name, value)
        assert nearest_at(orbit, orbit.parameters, simulate=False).distance(orbit) < 1e-8


def test_a_branch_that_another_process_sent(gaps):
    along = partial(with_value, HORIZONTAL, 'gap')
    sent = pickle.loads(pickle.dumps(follow(gaps.at(30.0)[0], along, 29.0, 40.0, start=30.0)))
    (here,), (there,) = gaps.at(37.0), sent.at(37.0)
    assert there.x_max == pytest.approx(here.x_max, rel=1e-9)


def test_fold_of_the_vertical_rig(vertical):
    fold = only(vertical, SpecialKind.FOLD)
    assert fold.converged
    # The paper's lower limit, 0.45, and the design's, 0.454
    assert fold.value * LOUDNESS == pytest.approx(0.453620, abs=1e-6)
    assert min(abs(m - 1.0) for m in fold.orbit.multipliers) < 1e-5
    # No motion below, two above
    assert min(vertical.values) >= fold.value
    assert fold.bracket == pytest.approx((fold.value, fold.value), rel=1e-9)
    below = VERTICAL.replace(force_amplitudes=(fold.value * (1 - 1e-6),))
    above = VERTICAL.replace(force_amplitudes=(fold.value * (1 + 1e-6),))
    assert find_orbits(below, (1,)).orbits == ()
    assert len(find_orbits(above, (1,)).orbits) == 2
    for value in (fold.value * (1.0 + 1e-7), 0.6):
        (pair,) = vertical.at([value])
        assert [orbit.stable for orbit in pair] == [False, True]
        rig = VERTICAL.replace(force_amplitudes=value)
        for orbit in pair:
            assert nearest_at(orbit, rig, (1,)).distance(orbit) < 1e-7
    assert vertical.at([fold.value * (1.0 - 1e-7)]) == [()]


def test_period_doubling_of_the_vertical_rig(vertical):
    doubling = only(vertical, SpecialKind.PERIOD_DOUBLING)
    assert doubling.converged
    assert doubling.value * LOUDNESS == pytest.approx(1.126731, abs=1e-6)
    assert min(abs(m + 1.0) for m in doubling.orbit.multipliers) < 1e-7
    low, high = sorted(doubling.bracket)
    assert high - low < 1e-8
    assert [o.stable for o in around(doubling, 'force_amplitudes', 1e-4)] == [True, False]


def test_branch_of_twice_the_period(vertical):
    doubling = only(vertical, SpecialKind.PERIOD_DOUBLING)
    branch = switch_branch(doubling, 'force_amplitudes', 0.2, 1.3)
    assert branch.values[0] == pytest.approx(doubling.value, rel=1e-4)
    orbit = branch.orbits[len(branch.orbits) // 3]
    assert (orbit.stops, orbit.cycles) == ((1, 1), 2)
    assert not orbit.repeats(1e-3)
    # What the rig does there
    assert orbit.stable
    assert orbit.viable
    moved = {'initial_primary_position': 0.01 * orbit.x[0]}
    reached = settle(begun_on(orbit, **moved), tolerance=1e-11)
    assert (reached.rhythm.stops, reached.rhythm.cycles) == ((1, 1), 2)
    assert sorted(reached.rhythm.x) == pytest.approx(sorted(orbit.x), rel=1e-8)


def test_twice_the_period_with_reversals():
    """The events of two periods, where the motion is beyond the impact equations."""
    branch = follow(stable_orbit(FRICTION.replace(gap=16.0), (1, 1, 2)), 'gap', 12.9, 16.0)
    turning, sticking = (s for s in branch.special if s.kind is SpecialKind.GRAZING)
    assert sticking.value == pytest.approx(13.5309, abs=1e-4)
    assert sticking.reason == '1 more stick, 1 more release'
    # The sticking phase ends as short as it began, now before a flight the other way.
    assert turning.value == pytest.approx(13.4904169, abs=1e-6)
    assert turning.reason == '1 more reversal, 1 less stick, 1 less release'
    kinds = [{event.kind for event in orbit.events} for orbit in around(turning, 'gap')]
    assert [EventKind.STICK in found for found in kinds] == [False, True]
    doubling = only(branch, SpecialKind.PERIOD_DOUBLING)
    assert doubling.converged
    assert doubling.value == pytest.approx(13.1245463, abs=1e-6)
    twice = switch_branch(doubling, 'gap', 12.5, 14.0, most_points=25).orbits[-1]
    assert sorted(twice.stops) == [1, 1, 1, 1, 2, 2]
    assert twice.cycles == 2
    assert twice.residual < 1e-11
    assert len(twice.events) >= 2
    assert not twice.repeats(1e-3)


def test_loss_of_symmetry(detuned):
    point = only(detuned, SpecialKind.BRANCH_POINT)
    assert point.converged
    assert point.value == pytest.approx(24.2826432, abs=1e-6)
    assert min(abs(m - 1.0) for m in point.orbit.multipliers) < 1e-6
    # Motions that are each other's mirror image leave it
    first = switch_branch(point, 'gap', 20.0, 60.0)
    second = switch_branch(point, 'gap', 20.0, 60.0, mirrored=True)
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


def test_neimark_sacker(detuned):
    point = only(detuned, SpecialKind.NEIMARK_SACKER)
    assert point.converged
    assert point.value == pytest.approx(56.9469910, abs=1e-6)
    assert abs(point.orbit.multipliers[0]) == pytest.approx(1.0, abs=1e-9)
    assert point.orbit.multipliers[0].imag > 0.1
    assert [orbit.stable for orbit in around(point, 'gap')] == [True, False]


def test_loss_of_viability():
    branch = follow(stable_orbit(FRICTION), 'gap', 20.0, 40.0)
    point = only(branch, SpecialKind.GRAZING)
    assert point.converged
    assert point.orbit.viable
    assert 'friction changes sign' in point.reason
    assert point.value == pytest.approx(23.3097876, abs=1e-6)
    nearest = around(point, 'gap', 1e-4, simulate=False)
    assert [orbit.viable for orbit in nearest] == [False, True]
    assert max(orbit.distance(point.orbit) for orbit in nearest) < 1e-3
    least = branch.best(lambda orbit: orbit.parameters.gap)
    assert branch.change_at(least.orbit) == f'grazing: {point.reason}'


def test_motions_with_reversals_are_followed():
    rig = FRICTION.replace(gap=16.0)
    orbit = stable_orbit(rig, (1, 1, 2))
    branch = follow(orbit, 'friction', 0.0, 0.5)
    assert branch.began == 'friction = 0, the end of the range'
    level = stable_orbit(rig.replace(friction=0.0), (1, 1, 2))
    assert branch.orbits[0].x_max == pytest.approx(level.x_max, rel=1e-9)
    wider = follow(orbit, 'gap', 16.0, 20.6)
    point = only(wider, SpecialKind.NEIMARK_SACKER)
    assert point.value == pytest.approx(20.3677203, abs=1e-6)
    assert [orbit.stable for orbit in around(point, 'gap')] == [True, False]


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
        assert nearest_at(orbit, orbit.parameters, simulate=False).distance(orbit) < 1e-9


def test_the_best_gap_is_a_minimum(gaps):
    """The symmetric flight at resonance; no gap nearby is better."""
    wide = follow(stable_orbit(HORIZONTAL.replace(gap=55.0)), 'gap', 50.0, 65.0)
    best = wide.best()
    assert wide.change_at(best.orbit) == ''
    assert best.value == pytest.approx(58.128195, abs=1e-4)
    near = [o.x_max for (o,) in wide.at(best.value * np.linspace(0.99, 1.01, 21))]
    assert best.orbit.x_max <= min(near) * (1.0 + 1e-14)
    # The damping that two impacts in a cycle are equivalent to, for the heavy limit
    equivalent = 2.0 / math.pi * HORIZONTAL.mass_ratio / (1.0 + HORIZONTAL.mass_ratio) * 7.0
    ratio = HORIZONTAL.zeta / (HORIZONTAL.zeta + equivalent)
    assert best.orbit.x_max_ratio == pytest.approx(ratio, rel=3e-3)
    loudest = wide.best(lambda orbit: -orbit.x_max)
    assert wide.change_at(loudest.orbit) == 'gap = 50, the end of the range'
    assert loudest.value == 50.0
    assert gaps.best('x_max').value == pytest.approx(best.value, abs=1e-4)


def test_edges_are_named(vertical):
    hanging = HORIZONTAL.replace(gravity=9.81, angle=0.5 * math.pi, gap=59.3)
    branch = follow(stable_orbit(hanging), 'gap', 50.0, 65.0)
    best = branch.best()
    assert branch.change_at(best.orbit) == 'period doubling'
    assert best.value == pytest.approx(59.2426, abs=1e-3)
    assert vertical.change_at(vertical.best().orbit) == 'fold'


def test_any_path_through_the_parameters():
    """Gap and damping together, and its end against the motions there."""

    def wider(share):
        return HORIZONTAL.replace(gap=37.0 + 8.0 * share, damping=0.01 * (1.0 + share))

    branch = follow(stable_orbit(HORIZONTAL), wider, 0.0, 1.0)
    assert branch.name == 'wider'
    assert branch.ended == 'wider = 1, the end of the range'
    end = branch.orbits[-1]
    assert end.parameters == wider(1.0)
    assert nearest_at(end, wider(1.0), simulate=False).distance(end) < 1e-9
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
    assert only(branch, SpecialKind.FOLD).value / amplitude == pytest.approx(expected, abs=1e-6)


def test_friction_comes_and_goes_along_a_branch():
    """Without friction the nodes are those with it, so that a branch may begin there."""
    branch = follow(stable_orbit(FRICTION.replace(friction=0.0)), 'friction', 0.0, 0.5)
    assert branch.values[0] == 0.0 < branch.values[1]
    assert branch.special == ()
    assert all(orbit.viable for orbit in branch.orbits)
    for value, (orbit,) in zip((0.2, 0.5), branch.at([0.2, 0.5]), strict=True):
        rig = FRICTION.replace(friction=value)
        assert nearest_at(orbit, rig, simulate=False).distance(orbit) < 1e-9


def test_a_window_narrower_than_a_step():
    """Two special points in one step, between which alone the motion is stable."""
    rig = OFF_RESONANCE.replace(gravity=1.0, angle=0.25 * math.pi, gap=12.6)
    found = find_orbits(rig, (1, 2, 2, 2), simulate=False).orbits
    orbit = min((o for o in found if o.viable), key=lambda orbit: orbit.x_max)
    branch = follow(orbit, 'gap', 12.5, 12.83, largest_step=0.3)
    (window,) = (branch.values[part] for status, part in branch.parts() if status == 'stable')
    assert (window[0], window[-1]) == pytest.approx((12.7705036, 12.7900414), abs=1e-6)
    for special, stable in zip(branch.special, ([False, True], [True, False]), strict=True):
        assert [o.stable for o in around(special, 'gap', 1e-4, simulate=False)] == stable


def test_nonsmooth_fold():
    """The motion with sticking meets the one without where the time of sticking tends to zero."""
    rig = FRICTION.replace(gravity=2.0)
    start = stable_orbit(rig.replace(gap=20.0))
    assert start.events
    branch = follow(start, 'gap', 19.0, 64.0)
    fold = only(branch, SpecialKind.FOLD)
    assert fold.reason == '1 less stick, 1 less release'
    below, above = branch.at([fold.value - 1e-3, fold.value + 1e-3])
    assert [orbit.stability for orbit in below] == ['stable', 'unstable']
    assert [len(orbit.events) for orbit in below] == [2, 0]
    assert below[0].distance(below[1]) < 1e-2
    assert above == ()
    # As the search finds them, and no others nearby
    for move, count in ((-1e-3, 2), (1e-3, 0)):
        found = find_orbits(rig.replace(gap=fold.value + move), (1, 2)).orbits
        near = [o for o in found if o.viable and o.distance(fold.orbit) < 0.05]
        assert len(near) == count
        assert all(o.distance(there) < 1e-7 for o, there in zip(near, below, strict=False))
    # The branch is not followed twice
    values = [value for value in branch.values if value > 20.0]
    assert values.index(max(values)) > len(values) // 3
    assert all(0 < len(row) < 3 for row in branch.at(np.linspace(20.5, 21.2, 7)))
    assert branch.orbits[-1].events == ()


def test_a_pole_of_a_multiplier_is_no_branch_point():
    """Next to grazing a multiplier grows without bound, and round-off of it hides the others."""
    rig = OFF_RESONANCE.replace(angle=math.pi / 4, gravity=2.0, gap=61.0)
    grazing = next(o for o in find_orbits(rig, (1, 2)).orbits if o.viable and o.x_max > 20.0)
    branch = follow(grazing, 'gap', 4.0, 64.0)
    assert [special.kind for special in branch.special] == [SpecialKind.GRAZING]


def test_plastic_stops_are_the_end_of_a_branch():
    """The equations of a stop that takes all speed are those of a small restitution."""
    branch = follow(stable_orbit(OFF_RESONANCE), 'restitution', 0.0, 1.0)
    assert (min(branch.values), max(branch.values)) == (0.0, 1.0)
    (plastic,), (nearly,) = branch.at([0.0, 1e-6])
    assert plastic.x_max == pytest.approx(nearly.x_max, rel=1e-4)
    expected = find_orbits(plastic.parameters, (1, 2)).orbits
    assert min(map(plastic.distance, expected)) < 1e-9


def test_friction_that_begins_at_zero():
    """A flight back to the stop it came from reverses then, and friction with it."""
    rig = HORIZONTAL.replace(
        one_sided=True,
        angle=0.3,
        gravity=9.81,
        gap=15.7,
        damper_mass=0.0724,
        restitution_1=0.485,
        force_frequencies=0.993,
    )
    branch = follow(find_orbits(rig, (1,)).orbits[0], 'friction', 0.0, 0.1)
    assert max(branch.values) == 0.1
    (orbit,) = branch.at([0.05])[0]
    assert orbit.viable
    assert [event.kind for event in orbit.events] == [EventKind.REVERSAL]
    expected = find_orbits(rig.replace(friction=0.05), (1,)).orbits
    assert min(map(orbit.distance, expected)) < 1e-9


SEVERAL = HORIZONTAL.replace(
    force_amplitudes=(1.0, 0.1), force_frequencies=(1.0, 2.0), force_phases=(0.0, 0.3)
)
UNLIKE = HORIZONTAL.replace(restitution_1=0.6, restitution_2=0.8)


def with_multisine(level):
    return HORIZONTAL.replace(multisine_level=level)


@pytest.mark.parametrize(
    ('rig', 'path', 'low', 'high', 'words'),
    [
        (
            HORIZONTAL,
            'gap',
            40.0,
            30.0,
            'gap from 40 to 30 is no range: give two numbers, the low',
        ),
        (HORIZONTAL, 'gap', math.nan, 40.0, 'gap from nan to 40 is no range'),
        (HORIZONTAL, 'gap', 20.0, math.inf, 'give two numbers, the low end first'),
        (HORIZONTAL, 'gap', 50.0, 60.0, 'gap is 37 where the branch begins: give a range around'),
        (HORIZONTAL, 'angle', -2.0, 2.0, 'angle from -2 to 2 is beyond what is admissible: give'),
        (HORIZONTAL, 'one_sided', 0.0, 1.0, 'cannot be varied: give one of primary_mass'),
        (HORIZONTAL, 'colour', 0.0, 1.0, 'cannot be varied: give one of primary_mass'),
        (HORIZONTAL, 'multisine_lines', 0.0, 1.0, 'cannot be varied: give one of primary_mass'),
        (HORIZONTAL, with_multisine, 0.0, 0.5, 'multisine_level'),
        (SEVERAL, 'force_frequencies', 0.9, 1.2, 'the others do not follow it'),
        (UNLIKE, 'restitution', 0.4, 0.9, r'restitution_1 is 0\.6 and restitution_2 0\.8'),
    ],
)
def test_what_cannot_be_followed(rig, path, low, high, words):
    """Such a range once ended in a message of a root finder, or at an end that was not reached."""
    with pytest.raises(OrbitError, match=words):
        follow(find_orbits(rig, (1, 2)).orbits[0], path, low, high)


def test_a_path_of_two_different_restitutions():
    points = follow(
        find_orbits(UNLIKE, (1, 2)).orbits[0],
        lambda s: UNLIKE.replace(restitution_1=0.6 * s, restitution_2=0.8 * s),
        0.9,
        1.1,
        start=1.0,
        most_points=4,
    ).points
    for point in points[:: len(points) - 1]:
        found = find_orbits(point.orbit.parameters, (1, 2)).orbits
        assert min(map(point.orbit.distance, found)) < 1e-9


def test_a_point_is_left_along_the_parameter_of_its_branch(vertical):
    doubling = only(vertical, SpecialKind.PERIOD_DOUBLING)
    with pytest.raises(OrbitError, match=r'of its own branch, where damping is 0\.1'):
        switch_branch(doubling, 'damping', 0.0, 1.0)


def test_a_branch_that_closes_and_the_range_of_its_motions():
    """Two mirror images meet at both ends of their range, and turn into one another there."""
    rig = TABLE.replace(gap=0.02, base_frequencies=19.0 * math.pi)
    orbit = stable_orbit(rig)
    here = rig.first_harmonic[1]
    branch = follow(orbit, 'base_frequencies', 0.5 * here, 1.5 * here, largest_step=0.1)
    assert branch.ended == 'the branch closes'
    assert branch.points[-1] == branch.points[0]
    folds = [point for point in branch.special if point.kind is SpecialKind.FOLD]
    low, high = sorted(point.value for point in folds)
    for point in folds:
        assert point.orbit.distance(point.orbit.mirror_image()) < 1e-4
    span = branch.span(here, orbit)
    assert (span.low, span.high) == pytest.approx((low, high), rel=1e-12)
    assert (span.low_reason, span.high_reason) == ('fold', 'fold')
    assert low < here < high
