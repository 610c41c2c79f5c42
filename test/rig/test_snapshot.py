"""What no rig can run from, or to, is refused at once; any kind of number gives all digits."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.rig import (
    GapControlParameters,
    InitialConditions,
    Mode,
    RigParameters,
)

LEVEL = RigParameters(gravity=0.0)
TIMED = GapControlParameters(gap_control='timed', gap_control_rate=5.0)


@pytest.mark.parametrize('kind', [np.float32, np.float16, np.int64, np.array, int, Fraction])
def test_any_kind_of_number_gives_all_digits(kind):
    """A float32 once left its seven digits in all that was computed with it."""
    exact, rig = Rig(LEVEL), Rig(LEVEL)
    exact.advance(50.0, 100.0)
    rig.advance(kind(50), kind(100))
    assert type(rig.time) is float
    assert rig.preview([kind(51)]) == exact.preview([51.0])
    assert rig.advance(kind(100)) == exact.advance(100.0)
    assert rig.sample() == exact.sample()
    assert json.dumps(rig.snapshot()) == json.dumps(exact.snapshot())
    assert type(Rig(LEVEL, time=kind(3)).time) is float
    run = Rig(LEVEL, compiled=False)
    run.run(kind(100))
    assert json.dumps(run.snapshot()) == json.dumps(exact.snapshot())


@pytest.mark.parametrize('exponent', [-323, -300, -170, -160, -155, -100])
def test_times_whose_squares_are_no_floats(exponent):
    """The least of them once ended in a division by zero."""
    time = 10.0**exponent
    rig, run = Rig(LEVEL), Rig(LEVEL)
    (foreseen,) = rig.preview([time])
    rig.advance(time)
    assert tuple(foreseen) == tuple(rig.sample()) == tuple(run.run(1.0, [time]).samples[0])
    rig.move_stops(15.0, -15.0, 1.0)
    assert abs(foreseen.primary_velocity) <= time
    rig.advance(1.0)


@pytest.mark.parametrize(
    'time', [math.nan, math.inf, -math.inf, 1e300, 1.1e13, 10**400, None, 'x', 3 + 0j, [1.0]]
)
def test_times(time):
    """A control that was begun at 1e300 s once sought its next sample for ever."""
    with pytest.raises(
        ValueError, match=r'cannot start at .* give a number from -1e\+13 to 1e\+13'
    ):
        Rig(LEVEL, time=time)
    rig = Rig(LEVEL)
    before = rig.snapshot()
    with pytest.raises(ValueError, match=r'cannot advance to .* give a'):
        rig.advance(time)
    with pytest.raises(ValueError, match=r'cannot advance to .* give a'):
        rig.run(time)
    assert rig.snapshot() == before


def test_samples_closer_than_the_spacing_of_floats():
    """Samples 10 us apart where floats are 2 ms apart: the time goes on."""
    rig = Rig(LEVEL, control=TIMED.replace(gap_control_rate=1e5), time=1e13 - 1.0)
    rig.advance(1e13 - 0.99)
    assert rig.time == 1e13 - 0.99


SNAPSHOT = {
    'parameters': LEVEL.replace(sweep_mode='up', multisine_level=0.1, multisine_lines=3),
    'control': TIMED.replace(actuator_speed=1.0, actuator_delay=0.3),
}


@pytest.fixture(scope='module')
def snapshot():
    rig = Rig(SNAPSHOT['parameters'], control=SNAPSHOT['control'])
    rig.advance(137.3)
    return json.dumps(rig.snapshot())


@pytest.mark.parametrize(
    ('path', 'value', 'words'),
    [
        ('time', math.nan, 'time is nan: give a number from'),
        ('time', 1e300, r'time is 1e\+300: give a number from -1e\+13 to 1e\+13'),
        ('origin', None, 'snapshot is not complete'),
        ('origin.time', -1e18, 'origin.time is -1e'),
        ('origin.time', 1e9, r'origin.time is 1000000000.0 s, after time, 137.3 s'),
        ('origin.time_low', math.nan, 'origin.time_low is nan: give a number from -1 to 1'),
        ('origin.time_low', -1e18, 'origin.time_low is -1e'),
        ('origin.x', None, 'origin.x is None'),
        ('origin.x', 1e300, r'origin.x is 1e\+300: give a number from -1e\+100 to 1e\+100'),
        ('origin.velocity', math.inf, 'origin.velocity is inf: give a number from'),
        ('origin.clearance_1', -1e-9, r'origin.clearance_1 is -1e-09: give a number from 0 to'),
        ('origin.side', math.nan, 'origin.side is nan: give a whole number from -1 to 1'),
        ('origin.mode', 99, 'origin.mode is 99: give a whole number from 0 to'),
        ('origin.angles', [], 'origin.angles has 0 entries, the force has 4 harmonics'),
        ('sweep.start', math.nan, 'sweep.start is nan: give a number from'),
        ('sweep.start', -1e9, r'sweep.step is 1, from -999999900.0 s to -999999800.0 s'),
        (
            'sweep.step',
            -(2**62),
            'sweep.step is -4611686018427387904: give a whole number from 0 to 100',
        ),
        ('sweep.step', 1.5, 'sweep.step is 1.5: give a whole number'),
        ('gap_control.state.sample_index', -(2**62), 'sample_index is -4611686018427387904, a'),
        ('gap_control.state.sample_index', 2**64, 'sample_index is 18446744073709551616: give'),
        ('gap_control.state.sample_index', math.nan, 'sample_index is nan: give a whole'),
    ],
)
def test_a_state_that_no_rig_can_have(snapshot, path, value, words):
    """Some of them once kept a rig busy for ever, at its first advance."""
    held = part = json.loads(snapshot)
    *names, last = path.split('.')
    for name in names:
        part = part[name]
    part[last] = value
    with pytest.raises(ValueError, match=words):
        Rig.restore(held)


@pytest.mark.parametrize('held', [None, [], 'x', 5, {}])
def test_what_is_no_snapshot(held):
    with pytest.raises(ValueError, match='snapshot'):
        Rig.restore(held)


SOFT = RigParameters(
    primary_mass=2.0,
    stiffness=1974.0,
    damping=100.0,
    damper_mass=0.1,
    gap=0.024,
    force_amplitudes=[0.0],
    gravity=0.0,
)


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
    assert bool(rig.advance(4000.0, 1)) is not holds
    if holds:
        # A thousand years later nothing has to be searched anew.
        assert rig.advance(3e10) == []
        restored = Rig.restore(json.loads(json.dumps(rig.snapshot())))
        assert restored.advance(3e10 + 1.0) == []


BEYOND_FLOATS = 10**400
REFUSED = {
    'move_stops(far)': lambda: Rig(LEVEL).move_stops(BEYOND_FLOATS, None),
    'move_stops(speed)': lambda: Rig(LEVEL).move_stops(1.0, None, None),
    'instants': lambda: Rig(LEVEL).run(1.0, BEYOND_FLOATS),
}


@pytest.mark.parametrize('call', REFUSED.values(), ids=REFUSED)
def test_what_is_out_of_range_is_named_and_refused(call):
    with pytest.raises(ValueError, match=r'\w+ (is|are) .*: give'):
        call()
