"""What no rig can run from, or to, is refused at once; any kind of number gives all digits."""

import json
import math
from fractions import Fraction

import numpy as np
import pytest

from impact_damper_ros.control import ControlledRig
from impact_damper_ros.rig import GapControlParameters, RigParameters, Simulator
from impact_damper_ros.rig.long_run import LongRun

LEVEL = RigParameters(gravity=0.0)
TIMED = GapControlParameters(gap_control='timed', gap_control_rate=5.0)


@pytest.mark.parametrize('kind', [np.float32, np.float16, np.int64, np.array, int, Fraction])
def test_any_kind_of_number_gives_all_digits(kind):
    """A float32 once left its seven digits in all that was computed with it."""
    exact, rig = Simulator(LEVEL), Simulator(LEVEL)
    exact.advance(50.0, 100.0)
    rig.advance(kind(50), kind(100))
    assert type(rig.time) is float
    assert rig.preview([kind(51)]) == exact.preview([51.0])
    assert rig.advance(kind(100)) == exact.advance(100.0)
    assert rig.sample() == exact.sample()
    assert json.dumps(rig.snapshot()) == json.dumps(exact.snapshot())
    assert type(Simulator(LEVEL, time=kind(3)).time) is float
    run = LongRun(LEVEL, compiled=False)
    run.advance(kind(100))
    assert json.dumps(run.snapshot()) == json.dumps(exact.snapshot())


@pytest.mark.parametrize('exponent', [-323, -300, -170, -160, -155, -100])
def test_times_whose_squares_are_no_floats(exponent):
    """The least of them once ended in a division by zero."""
    time = 10.0**exponent
    rig, run = Simulator(LEVEL), LongRun(LEVEL, compiled=False)
    (foreseen,) = rig.preview([time])
    rig.advance(time)
    assert tuple(foreseen) == tuple(rig.sample()) == tuple(run.advance(1.0, [time]).samples[0])
    rig.move_stops(15.0, -15.0, 1.0)
    assert abs(foreseen.primary_velocity) <= time
    rig.advance(1.0)


def long_run(rig, time=0.0):
    return LongRun(rig, time=time, compiled=False)


@pytest.mark.parametrize('make', [Simulator, ControlledRig, long_run])
@pytest.mark.parametrize(
    'time', [math.nan, math.inf, -math.inf, 1e300, 1.1e13, 10**400, None, 'x', 3 + 0j, [1.0]]
)
def test_times(make, time):
    """A control that was begun at 1e300 s once sought its next sample for ever."""
    with pytest.raises(
        ValueError, match=r'cannot start at .* give a number from -1e\+13 to 1e\+13'
    ):
        make(LEVEL, time=time)
    rig = make(LEVEL)
    before = rig.snapshot()
    with pytest.raises(ValueError, match=r'cannot advance to .* give a'):
        rig.advance(time)
    assert rig.snapshot() == before


def test_samples_closer_than_the_spacing_of_floats():
    """Samples 10 us apart where floats are 2 ms apart: the time goes on."""
    rig = ControlledRig(LEVEL, control=TIMED.replace(gap_control_rate=1e5), time=1e13 - 1.0)
    rig.advance(1e13 - 0.99)
    assert rig.time == 1e13 - 0.99


SNAPSHOT = {
    'parameters': LEVEL.replace(sweep_mode='up', multisine_level=0.1, multisine_lines=3),
    'control': TIMED.replace(actuator_speed=1.0, actuator_delay=0.3),
}


@pytest.fixture(scope='module')
def snapshot():
    rig = ControlledRig(SNAPSHOT['parameters'], control=SNAPSHOT['control'])
    rig.advance(137.3)
    return json.dumps(rig.snapshot())


@pytest.mark.parametrize(
    ('path', 'value', 'words'),
    [
        ('time', math.nan, 'time is nan: it must be a finite number'),
        ('time', 1e300, r'time is 1e\+300: it must be a number from -1e\+13 to 1e\+13'),
        ('origin', None, 'snapshot is not complete'),
        ('origin.time', -1e18, 'origin.time is -1e'),
        ('origin.time', 1e9, r'origin.time is 1000000000.0 s, after time, 137.3 s'),
        ('origin.time_low', math.nan, 'origin.time_low is nan: it must be a finite'),
        ('origin.time_low', -1e18, 'origin.time_low is -1e'),
        ('origin.x', None, 'origin.x is None'),
        ('origin.x', 1e300, r'origin.x is 1e\+300: it must be a number from -1e\+100 to 1e\+100'),
        ('origin.velocity', math.inf, 'origin.velocity is inf: it must be a finite number'),
        ('origin.side', math.nan, 'origin.side is nan: it must be one of -1, 0, 1'),
        ('origin.mode', 99, 'origin.mode is 99: it must be one of 0, 1'),
        ('origin.angles', [], 'origin.angles has 0 entries, the force has 4 harmonics'),
        ('sweep.start', math.nan, 'sweep.start is nan: it must be a finite number'),
        ('sweep.start', -1e9, r'sweep.step is 1, from -999999900.0 s to -999999800.0 s'),
        ('sweep.step', -(2**62), 'sweep.step is -4611686018427387904: it must be from 0 to 100'),
        ('sweep.step', 1.5, 'sweep.step is 1.5: it must be a whole number'),
        ('gap_control.state.sample_index', -(2**62), 'sample_index is -4611686018427387904, a'),
        ('gap_control.state.sample_index', 2**64, 'sample_index is 18446744073709551616: it must'),
        ('gap_control.state.sample_index', math.nan, 'sample_index is nan: it must be a whole'),
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
        ControlledRig.restore(held)


@pytest.mark.parametrize('held', [None, [], 'x', 5, {}])
def test_what_is_no_snapshot(held):
    with pytest.raises(ValueError, match='snapshot'):
        ControlledRig.restore(held)
