"""The optimal gap against brute force, closed forms, and edges that end the motion."""

import math

import numpy as np
import pytest
from rigs import HORIZONTAL

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import OrbitError, find_orbits
from impact_damper_ros.orbits.optimum import Limit, _without_impacts, gap_range, optimal_gap
from impact_damper_ros.rig import InitialConditions


def brute_force(rig, gaps):
    """Return the smallest |X| over stable, viable motions at these gaps."""
    swings = [
        orbit.x_max
        for gap in gaps
        for orbit in find_orbits(rig.replace(gap=float(gap)), (1, 2), simulate=False).orbits
        if orbit.stable and orbit.viable
    ]
    return min(swings)


@pytest.mark.parametrize(('angle', 'gravity', 'rate'), [(0.0, 0.0, 1.0), (0.3, 9.81, 1.0)])
def test_no_gap_is_better(angle, gravity, rate):
    rig = HORIZONTAL.replace(angle=angle, gravity=gravity, force_frequencies=(rate,))
    best = optimal_gap(rig, gaps=(40.0, 62.0), points=12)
    assert best.limit is Limit.MINIMUM
    assert best.beyond == ''
    assert best.bracket[0] <= best.gap <= best.bracket[1]
    assert best.bracket[1] - best.bracket[0] < 2e-7 * best.gap
    near = np.linspace(0.999, 1.001, 9) * best.gap
    assert best.x_max <= brute_force(rig, [*np.linspace(40.0, 62.0, 25), *near])


def test_resonant_optimum_follows_from_equivalent_damping():
    rig = HORIZONTAL
    best = optimal_gap(rig, gaps=(50.0, 65.0), points=8)
    equivalent = 2.0 / math.pi * rig.mass_ratio / (1.0 + rig.mass_ratio) * 7.0
    ratio = rig.zeta / (rig.zeta + equivalent)
    # M's motion is nearly harmonic there; see the heavy limit of the impact damper
    assert best.orbit.amplitude_ratio == pytest.approx(ratio, rel=3e-3)
    expected_gap = math.pi * ratio * rig.response_amplitude * 7.0 / 1.042
    assert best.gap == pytest.approx(expected_gap, rel=0.03)


def test_edge_of_stability_is_named():
    best = optimal_gap(
        HORIZONTAL.replace(gravity=9.81, angle=0.5 * math.pi), gaps=(50.0, 65.0), points=12
    )
    assert best.limit is Limit.STABILITY
    assert 'period doubling' in best.beyond
    assert best.gap == pytest.approx(59.2426, abs=2e-3)
    assert abs(best.orbit.multipliers[0]) == pytest.approx(1.0, abs=1e-4)
    left, right = (
        any(
            orbit.stable and orbit.viable
            for orbit in find_orbits(
                best.orbit.parameters.replace(gap=gap), (1, 2), simulate=False
            ).orbits
        )
        for gap in best.bracket
    )
    assert left != right


def test_motion_without_impacts_at_the_same_gap_is_named():
    """On the downward branch of the paper's rig M moves nine times as much at the best gap."""
    rig = HORIZONTAL.replace(force_frequencies=1.02)
    best = optimal_gap(rig, gaps=(45.0, 60.0), points=10)
    assert best.gap > 2.0 * rig.response_amplitude
    ratio = rig.response_amplitude / best.x_max
    assert ratio == pytest.approx(9.22, abs=0.01)
    assert best.coexisting == (
        f'M can also move by {rig.response_amplitude:.6g} m without impacts, {ratio:.3g} times as '
        'much'
    )
    # At resonance it would reach the stops
    assert optimal_gap(HORIZONTAL, gaps=(50.0, 65.0), points=8).coexisting == ''


def test_vibrations_that_reach_no_stop():
    """As the simulator settles into them: m left where it is, or held by friction."""
    free = HORIZONTAL.replace(force_frequencies=1.3)
    held = free.replace(gravity=100.0, friction=0.03)
    for rig, words in ((free, 'without impacts'), (held, 'with m held by friction')):
        ((told, swing),) = _without_impacts(rig)
        assert told == words
        run = Rig(rig, InitialConditions(initial_primary_position=-0.5 * swing))
        run.advance(2000.0)
        xs = []
        for k in range(200):
            run.advance(2000.0 + 0.05 * k)
            xs.append(abs(run.sample().x))
        assert max(xs) == pytest.approx(swing, rel=2e-3)
    # Neither where m slides, nor where it leans on a stop
    assert _without_impacts(held.replace(friction=0.01)) == []
    assert _without_impacts(free.replace(angle=0.1, gravity=9.81)) == []


def test_end_of_the_range_is_named():
    best = optimal_gap(HORIZONTAL, gaps=(40.0, 45.0), points=4)
    assert best.limit is Limit.RANGE
    assert best.gap == pytest.approx(45.0, rel=1e-6)


def test_default_range_holds_the_optimum():
    low, high = gap_range(HORIZONTAL)
    assert low < 20.0
    assert high > 100.0


@pytest.mark.parametrize(
    ('rig', 'options', 'words'),
    [
        (HORIZONTAL.replace(one_sided=True), {}, 'one-sided'),
        (HORIZONTAL, {'gaps': (30.0, 20.0)}, 'low < high'),
        (HORIZONTAL, {'gaps': (1.0, 2.0), 'points': 10**12}, 'a whole number up to 100000'),
        (HORIZONTAL, {'gaps': (1.0, 2.0), 'points': float('nan')}, 'a whole number up to 100000'),
        (HORIZONTAL, {'gaps': (1.0, 2.0), 'points': 3}, 'no stable, viable motion'),
        (HORIZONTAL.replace(damping=0.0), {}, 'gaps=\\(low, high\\)'),
    ],
)
def test_errors_hold_the_remedy(rig, options, words):
    with pytest.raises(OrbitError, match=words):
        optimal_gap(rig, **options)
