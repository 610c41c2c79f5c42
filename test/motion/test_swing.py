"""Turning points of M between samples, and its largest displacement."""

import math

import numpy as np
import pytest
from rigs import BENCH

from impact_damper_ros import Rig, run_flights
from impact_damper_ros.motion.swing import Swing, turning_point


def test_the_turning_point_of_a_cubic():
    rng = np.random.default_rng(3)
    for _ in range(300):
        first, bend = rng.uniform(-3.0, 3.0, 2)
        curve = -math.copysign(rng.uniform(0.1, 3.0), first) - first - bend
        velocity = np.polynomial.Polynomial([first, bend, curve])
        place = 0.2 * velocity.integ() + 0.7
        (turn,) = (s.real for s in velocity.roots() if 0.0 < s.real < 1.0)
        ends = (4.0, place(0.0), velocity(0.0)), (4.2, place(1.0), velocity(1.0))
        assert turning_point(*ends[0], *ends[1]) == pytest.approx(place(turn), rel=1e-12)


@pytest.mark.parametrize('x', [1.0, math.nextafter(1.0, 2.0)])
def test_a_turning_point_where_the_primary_hardly_moves(x):
    assert turning_point(0.0, 1.0, 5e-324, 0.02, x, -1e-300) == pytest.approx(x, abs=1e-15)


def test_the_largest_displacement_is_between_samples():
    """At turning points and events, of which a look takes all since the one before."""
    rig, swing = Rig(BENCH), Swing()
    for instant in np.arange(0.013, 8.0, 0.013):
        events = rig.advance(instant)
        swing.look(rig.sample(), events)
    assert swing.largest == pytest.approx(
        run_flights(Rig(BENCH), rig.time).integrals()[1], rel=1e-6
    )
