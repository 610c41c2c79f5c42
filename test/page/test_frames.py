"""Frames: nothing of a motion is lost by decimation, nothing is sent twice, sizes are bounded."""

import math

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.page.frames import GHOST, PAUSED, REPLACE, REPLACE_GHOST, View
from impact_damper_ros.page.measures import RigNumbers, slow_motion, state_at
from impact_damper_ros.page.motion import ForcePhase, MotionHistory, impact_rows
from impact_damper_ros.rig import EventKind, RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .browser import taken_apart

RATE = 200.0


def force_phase(simulator):
    return ForcePhase(Snapshot.from_dict(simulator.snapshot()))


def recorded(rig, seconds, rate=RATE):
    """Return the motion of a rig from rest, as a recording of it would hold it."""
    simulator = Rig(rig)
    phase = force_phase(simulator)
    motion = MotionHistory(100_000, 10_000)
    samples, impacts = [], []
    for k in range(round(seconds * rate) + 1):
        events = simulator.advance(k / rate)
        for event in events:
            if event.kind is EventKind.IMPACT:
                sign = 1.0 if event.stop == 1 else -1.0
                impacts.append(
                    (
                        *(event.time, event.stop, event.x, event.x + event.y),
                        *(event.primary_velocity_after, event.damper_velocity_after),
                        *(sign * event.impulse, -sign * event.impulse),
                    )
                )
        s = simulator.sample()
        samples.append(
            (
                *(s.time, s.x, s.primary_velocity, s.z, s.damper_velocity),
                *(s.stop_1, s.stop_1_velocity, s.stop_2, s.stop_2_velocity, rig.angle, 0.0),
            )
        )
    rows = np.array(samples)
    rows[:, -1] = phase.at(rows[:, 0])
    motion.add_samples(rows)
    if impacts:
        hits = np.array(impacts)
        motion.add_impacts(impact_rows(hits, rig, phase.at(hits[:, 0]), 0.0))
    return motion


@pytest.fixture(scope='module')
def rig():
    """5 Hz, with impacts from the first second on."""
    return RigParameters(
        primary_mass=1.0,
        stiffness=1000.0,
        damping=0.6,
        damper_mass=0.1,
        gap=0.01,
        force_amplitudes=(10.0,),
        force_frequencies=(31.6,),
    )


@pytest.fixture(scope='module')
def motion(rig):
    return recorded(rig, 12.0)


def frames_of(motion, view, instants):
    return [taken_apart(view.frame(motion, instant, 0.0)) for instant in instants]


@pytest.mark.parametrize('width', [50, 300, 4000])
def test_increments_tile_the_motion(motion, width):
    """All frames together have each sample, each impact and each column once."""
    instants = np.arange(0.5, 10.0, 1 / 60)
    frames = frames_of(motion, View(window=5.0, width=width), instants)
    assert frames[0].flags == REPLACE
    assert all(frame.flags == 0 for frame in frames[1:])
    column = 5.0 / width
    starts = np.concatenate([f.columns[:, 6] + f.end for f in frames])
    numbers = np.round(starts / column)
    assert np.allclose(starts, numbers * column, atol=2e-5)
    assert (np.diff(numbers) >= 1).all()
    impacts = np.concatenate([f.impacts[:, 0] + f.end for f in frames])
    expected = motion.impacts[motion.impacts[:, 0] <= instants[-1], 0]
    assert impacts == pytest.approx(expected, abs=1e-5)
    samples = np.concatenate([f.samples[:, 0] + f.end for f in frames])
    times = motion.samples[:, 0]
    assert samples == pytest.approx(times[times <= instants[-1]], abs=1e-5)
    # The columns hold the extremes of the samples in them.
    low, high = (np.concatenate([f.columns[:, i] for f in frames]) for i in (0, 1))
    cells = np.floor(motion.samples[:, 0] / column)
    for number, least, most in zip(numbers, low, high, strict=True):
        x = motion.samples[cells == number, 1]
        assert (least, most) == pytest.approx((x.min(), x.max()), rel=1e-6)


def test_columns_lie_within_the_window_and_stops_ride_on_the_mass(motion, rig):
    (frame,) = frames_of(motion, View(window=5.0, width=100), [10.0])
    assert len(frame.columns) == pytest.approx(100, abs=1)
    assert frame.columns[0, 6] == pytest.approx(frame.start - frame.end, abs=1e-5)
    assert frame.columns[0, 6] >= -5.0
    assert frame.columns[-1, 7] <= 1e-6
    assert frame.columns[:, 4] == pytest.approx(0.5 * rig.gap, rel=1e-5)
    assert frame.columns[:, 5] == pytest.approx(-0.5 * rig.gap, rel=1e-5)


def test_an_impact_that_comes_late_is_sent(motion):
    """Its topic may be slower than that of the samples."""
    late, view = MotionHistory(10_000, 100), View(window=2.0)
    late.add_samples(motion.samples[:1000])
    end = float(motion.samples[900, 0])
    view.frame(late, end, 0.0)
    late.add_impacts(motion.impacts[motion.impacts[:, 0] < end][-1:])
    frame = taken_apart(view.frame(late, float(motion.samples[905, 0]), 0.0))
    assert len(frame.impacts) == 1
    assert len(taken_apart(view.frame(late, float(motion.samples[910, 0]), 0.0)).impacts) == 0


def test_a_jump_replaces_all(motion):
    view = View(window=2.0, width=100)
    first, on, back, again = frames_of(motion, view, [5.0, 5.1, 3.0, 9.5])
    assert [f.flags & REPLACE for f in (first, on, back, again)] == [REPLACE, 0, REPLACE, REPLACE]
    assert back.impacts[:, 0].min() >= -2.0
    assert len(again.columns) == pytest.approx(100, abs=1)
    view.begin_again()
    assert frames_of(motion, view, [9.5])[0].flags == REPLACE


def test_flags_and_state(motion):
    frame = taken_apart(View().frame(motion, 6.0, 12.5, PAUSED))
    assert frame.flags == PAUSED | REPLACE
    assert frame.ghost is None
    assert frame.epoch == 12.5
    row = motion.samples[motion.samples[:, 0] <= 6.0][-1]
    assert frame.state == pytest.approx(row[1:], rel=1e-6)


def test_a_ghost_that_comes_to_be_known(motion, rig):
    """Its columns and samples are those of its own motion, each once, as far as it is known."""
    whole = recorded(rig.replace(gap=0.006), 12.0)
    alone = taken_apart(View(window=5.0, width=300).frame(whole, 9.0, 0.0))
    ghost, view = MotionHistory(10_000, 1), View(window=5.0, width=300)
    view.frame(motion, 9.0, 0.0)
    assert not view.wants(9.0)
    # While nothing moves it is computed.
    frames = []
    for until in (2.0, 5.5, 7.3, 8.95, 12.0):
        assert view.wants(9.0, ghost) == (until != 5.5)
        frames.append(taken_apart(view.frame(motion, 9.0, 0.0, 0, ghost)))
        assert not view.wants(9.0, ghost)
        ghost.add_samples(whole.samples_between(ghost.end if frames[1:] else -1.0, until))
    frames.append(taken_apart(view.frame(motion, 9.0, 0.0, 0, ghost)))
    assert [f.flags for f in frames] == [REPLACE_GHOST, 0, 0, 0, GHOST, GHOST]
    assert all(not len(f.columns) and not len(f.samples) for f in frames)
    columns = np.concatenate([f.ghost_columns for f in frames])
    assert np.array_equal(columns, alone.columns)
    samples = np.concatenate([f.ghost_samples for f in frames])
    assert np.array_equal(samples[-512:], alone.samples)
    assert frames[-1].ghost == pytest.approx(alone.state, rel=1e-6)
    # It goes on with the rig, and ends with a frame that says so.
    on = [taken_apart(view.frame(motion, 9.0 + k / 60, 0.0, 0, ghost)) for k in range(1, 60)]
    starts = np.concatenate([f.ghost_columns[:, 6] + f.end for f in (frames[-1], *on)])
    assert np.allclose(np.diff(starts), 5.0 / 300, atol=1e-4)
    # After a jump it has as many samples as the rig itself, forwards too.
    far = View(window=1.0, width=300)
    far.frame(motion, 3.0, 0.0, 0, ghost)
    ahead = taken_apart(far.frame(motion, 8.0, 0.0, 0, ghost))
    assert ahead.flags == REPLACE | GHOST
    assert len(ahead.ghost_samples) == len(ahead.samples) > 100
    back = taken_apart(view.frame(motion, 6.0, 0.0, 0, ghost))
    assert back.flags == REPLACE | GHOST
    assert len(back.ghost_columns) == len(back.columns)
    assert view.wants(6.0)
    gone = taken_apart(view.frame(motion, 6.0, 0.0))
    assert (gone.flags, gone.ghost, len(gone.ghost_columns)) == (REPLACE_GHOST, None, 0)


@pytest.mark.parametrize(('window', 'width'), [(1e9, 10**9), (-1.0, -5), (0.0, 0)])
def test_no_view_is_without_bounds(motion, window, width):
    content = View(window, width).frame(motion, 11.0, 0.0)
    assert len(content) < 600_000
    frame = taken_apart(content)
    assert len(frame.columns) <= 4097
    assert len(frame.samples) <= 512


def test_fast_samples_are_thinned_out(rig):
    motion = recorded(rig.replace(stiffness=100.0), 1.5, 2000.0)
    view = View(window=1.0)
    view.frame(motion, 1.0, 0.0)
    frame = taken_apart(view.frame(motion, 1.5, 0.0))
    assert 30 <= len(frame.samples) <= 64
    # The newest is among them, and they are evenly spaced.
    assert frame.samples[-1, 0] == pytest.approx(0.0, abs=1e-6)
    assert np.diff(frame.samples[:, 0]).std() < 1e-6


def test_the_newest_rows_are_kept():
    motion = MotionHistory(1000, 10)
    for k in range(300):
        rows = np.zeros((37, 11))
        rows[:, 0] = 37 * k + np.arange(37)
        motion.add_samples(rows)
    assert motion.samples[:, 0].tolist() == list(range(300 * 37 - 1000, 300 * 37))
    assert motion.end == 300 * 37 - 1
    for count in (999, 1000, 1001, 5000):
        rows = np.zeros((count, 11))
        rows[:, 0] = motion.end + 1 + np.arange(count)
        motion.add_samples(rows)
        assert (np.diff(motion.samples[:, 0]) == 1.0).all()
        assert len(motion.samples) == 1000
        assert motion.end == rows[-1, 0]
    assert math.isnan(MotionHistory(10, 10).end)


def test_phase_of_the_force(rig):
    phase = force_phase(Rig(rig.replace(force_phases=(0.3,))))
    time = np.array([0.0, 0.1, 7.3])
    assert phase.at(time) == pytest.approx((31.6 * time + 0.3) / math.tau % 1.0)
    still = force_phase(Rig(rig.replace(force_amplitudes=(0.0,))))
    assert np.isnan(still.at(time)).all()


def test_phase_of_a_stepped_sine_is_that_of_the_rig(rig):
    """Against the angle that the simulator keeps."""
    swept = rig.replace(
        sweep_mode='up_down', sweep_low=20.0, sweep_high=22.0, sweep_step=0.7, sweep_dwell=0.9
    )
    simulator = Rig(swept)
    phase = force_phase(simulator)
    for time in (0.5, 1.0, 2.5, 4.1, 9.0):
        simulator.advance(time)
        later = force_phase(simulator)
        one, other = (float(p.at(np.array([time]))[0]) for p in (phase, later))
        assert math.remainder(one - other, 1.0) == pytest.approx(0.0, abs=1e-9)


def test_slow_motion_goes_through_the_impacts(rig, motion):
    """The motion between samples is that of the rig, impacts included."""
    slow = slow_motion(motion, 4, 11.0)
    t, x, z = (np.array(slow[name]) for name in ('t', 'x', 'z'))
    assert [hit['stop'] for hit in slow['impacts']] == motion.impacts[
        motion.impacts[:, 0] <= 11.0
    ][-4:, 1].tolist()
    simulator = Rig(rig)
    exact = []
    for time in t:
        simulator.advance(time)
        exact.append((simulator.sample().x, simulator.sample().z))
    exact_x, exact_z = np.array(exact).T
    assert np.abs(x - exact_x).max() < 1e-3 * np.abs(exact_x).max()
    assert np.abs(z - exact_z).max() < 1e-3 * np.abs(exact_z).max()
    assert np.diff(t).max() < 1 / 1000
    gap = np.array(slow['stop_1']) - np.array(slow['stop_2'])
    assert gap == pytest.approx(rig.gap)
    assert slow_motion(MotionHistory(10, 10), 5, 1.0)['t'] == []


def test_state_between_samples(rig, motion):
    simulator = Rig(rig)
    for time in np.arange(9.0, 9.5, 0.0013):
        simulator.advance(time)
        s, row = simulator.sample(), state_at(motion, time)
        assert row[[0, 2, 4]] == pytest.approx([s.x, s.z, s.stop_1], abs=2e-5)
        assert row[[1, 3]] == pytest.approx([s.primary_velocity, s.damper_velocity], abs=1e-2)
        assert math.remainder(row[9] - 31.6 * time / math.tau, 1.0) == pytest.approx(0, abs=1e-6)


def test_numbers(rig, motion):
    numbers = RigNumbers(rig, motion, 12.0).as_dict(0.2, 0.02)
    assert numbers['natural_frequency_hz'] == pytest.approx(math.sqrt(1000.0) / math.tau)
    assert numbers['damping_ratio'] == pytest.approx(0.6 / (2 * math.sqrt(1000.0)))
    assert numbers['frequency_ratio'] == pytest.approx(31.6 / math.sqrt(1000.0))
    assert numbers['static_amplitude'] == rig.response_amplitude
    assert numbers['mass_ratio'] == 0.1
    assert (numbers['gap'], numbers['optimal_gap'], numbers['gap_ratio']) == (0.01, 0.02, 0.5)
    assert numbers['optimal_gap_basis'] == 'curve'
    cycle = math.tau / 31.6
    hits = motion.impacts_between(12.0 - 20 * cycle, 12.0)
    assert numbers['impacts_per_cycle'] == len(hits) / 20
    # What the impacts take from M: impulse times the mean of its velocities before and after
    sign = np.where(hits[:, 1] == 1.0, 1.0, -1.0)
    taken = -(sign * hits[:, 5] * 0.5 * (hits[:, 3] + hits[:, 8])).sum() / 20
    assert numbers['energy_per_cycle'] == pytest.approx(taken)
    x = motion.samples_between(12.0 - 20 * cycle, 12.0)[:, 1]
    assert numbers['amplitude_measured'] == pytest.approx(np.abs(x).max())
    assert numbers['x_max_ratio_predicted'] == 0.2
    undamped = RigNumbers(rig.replace(damping=0.0, force_frequencies=(rig.omega,)), motion, 1.0)
    assert undamped.as_dict(None, None)['static_amplitude'] is None
