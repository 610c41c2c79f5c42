"""Times of any kind, tiny and huge; motions that die away, and m that sticks for ever."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest
from rigs import BENCH, HORIZONTAL

from impact_damper_ros import GapControlParameters, InitialConditions, Mode, Rig, RigParameters

TIMED = GapControlParameters(gap_control='timed', gap_control_rate=5.0)


@pytest.mark.parametrize('kind', [np.float32, np.float16, np.int64, np.array, int, Fraction])
def test_any_kind_of_number_gives_all_digits(kind):
    """A float32 once left its seven digits in all that was computed with it."""
    exact, rig = Rig(HORIZONTAL), Rig(HORIZONTAL)
    exact.advance(50.0, 100.0)
    rig.advance(kind(50), kind(100))
    assert type(rig.time) is float
    assert rig.advance(kind(100)) == exact.advance(100.0)
    assert rig.sample() == exact.sample()
    assert json.dumps(rig.snapshot()) == json.dumps(exact.snapshot())
    assert type(Rig(HORIZONTAL, time=kind(3)).time) is float
    run = Rig(HORIZONTAL, compiled=False)
    run.run(kind(100))
    assert json.dumps(run.snapshot()) == json.dumps(exact.snapshot())


@pytest.mark.parametrize('exponent', [-323, -300, -170, -160, -155, -100])
def test_times_whose_squares_are_no_floats(exponent):
    """The least of them once ended in a division by zero."""
    time = 10.0**exponent
    rig, run = Rig(HORIZONTAL), Rig(HORIZONTAL)
    rig.advance(time)
    assert tuple(rig.sample()) == tuple(run.run(1.0, [time]).samples[0])
    rig.move_stops(15.0, -15.0, 1.0)
    assert abs(rig.sample().primary_velocity) <= time
    rig.advance(1.0)


def test_samples_closer_than_the_spacing_of_floats():
    """Samples 10 us apart where floats are 2 ms apart: the time goes on."""
    rig = Rig(HORIZONTAL, control=TIMED.replace(gap_control_rate=1e5), time=1e13 - 1.0)
    rig.advance(1e13 - 0.99)
    assert rig.time == 1e13 - 0.99


SOFT = BENCH.replace(damping=100.0, friction=0.0, gravity=0.0, force_amplitudes=0.0)


def test_a_vibration_that_dies_away_has_no_passages_for_ever():
    """Below 1e-160 m the squares of X once gave steps of nothing: the search had no end."""
    control = GapControlParameters(gap_control='amplitude', gap_min=0.001, gap_max=0.05)
    rig = Rig(SOFT, InitialConditions(initial_primary_position=0.005), control=control)
    rig.advance(40.0)
    assert rig.time == 40.0
    assert abs(rig.sample().x) < 1e-300


STICKING = RigParameters(
    friction=0.5,
    force_amplitudes=(1.0, -0.2),
    force_frequencies=(0.7, 3.1),
    force_phases=(0.0, 0.4),
)


def largest_acceleration(rig):
    """Return the largest X'' of the steady vibration with m held, m/s^2."""
    mass = rig.primary_mass + rig.damper_mass
    return sum(
        abs(force) * w**2 / math.hypot(rig.stiffness - mass * w**2, rig.damping * w)
        for force, w in zip(rig.force_amplitudes, rig.force_frequencies, strict=True)
    )


@pytest.mark.parametrize(('share', 'holds'), [(1.001, True), (0.97, False)])
def test_m_that_sticks_for_a_long_time(share, holds):
    """Where M's acceleration stays below what friction can give, m is known to stick for ever."""
    rig = Rig(STICKING)
    rig.advance(3000.0)
    assert rig.mode is Mode.STICK
    grip = share * largest_acceleration(STICKING)
    rig.change(STICKING.replace(friction=grip / STICKING.gravity))
    assert bool(rig.run(4000.0, most_events=1).event_count) is not holds
    if holds:
        # A thousand years later nothing has to be searched anew.
        assert rig.advance(3e10) == []
        restored = Rig.restore(json.loads(json.dumps(rig.snapshot())))
        assert restored.advance(3e10 + 1.0) == []
