"""Motions, and frames of them: nothing is lost, nothing is sent twice, sizes are bounded."""

import math

import numpy as np
import pytest
from rigs import LIVELY

from impact_damper_ros import EventKind, Rig, load_parameters
from impact_damper_ros.orbits.settled_motion import settle
from impact_damper_ros.page.frames import PAUSED, REPLACE, REPLACE_GHOST, PageView
from impact_damper_ros.page.motion import (
    ACT_COLUMNS,
    IMPACT_COLUMNS,
    SAMPLE_COLUMNS,
    MotionHistory,
    between,
)
from impact_damper_ros.page.numbers import numbers_of

from .moving_rig import force_phase, motion_of
from .served import taken_apart


@pytest.fixture(scope='module')
def motion():
    return motion_of(LIVELY, 12.0)


@pytest.fixture(scope='module')
def other():
    return motion_of(LIVELY.replace(gap=0.006), 12.0)


def frames_of(motion, view, instants, ghost=None):
    frames = (view.frame(motion, instant, 0.0, 0, ghost) for instant in instants)
    return [taken_apart(frame) for frame in frames if frame is not None]


def times(frames, name):
    return np.concatenate([getattr(frame, name)[:, 0] + frame.end for frame in frames])


def test_frames_together_have_each_sample_and_impact_once(motion):
    instants = np.arange(0.5, 10.0, 1 / 60)
    frames = frames_of(motion, PageView(window=5.0), instants)
    assert frames[0].flags == REPLACE | REPLACE_GHOST
    assert all(frame.flags == 0 for frame in frames[1:])
    end = instants[-1]
    # One sample beyond the end: the page draws between two.
    rows = motion.samples[: np.searchsorted(motion.samples[:, 0], end, side='right') + 1]
    assert times(frames, 'samples') == pytest.approx(rows[:, 0], abs=1e-5)
    columns = np.concatenate([frame.samples for frame in frames])[:, 1:]
    assert np.allclose(columns, rows[:, 1:], rtol=1e-6)
    hits = motion.impacts[motion.impacts[:, 0] <= rows[-1, 0]]
    assert times(frames, 'impacts') == pytest.approx(hits[:, 0], abs=1e-5)
    assert np.allclose(np.concatenate([f.impacts for f in frames])[:, 1:], hits[:, 1:], rtol=1e-6)


def test_columns_are_those_of_the_rig(motion):
    rig = Rig(LIVELY)
    events = [event for event in rig.advance(9.0) if event.kind.name == 'IMPACT']
    sample = rig.sample()
    row = dict(
        zip(
            SAMPLE_COLUMNS, motion.samples[np.searchsorted(motion.samples[:, 0], 9.0)], strict=True
        )
    )
    for name in ('x', 'primary_velocity', 'z', 'damper_velocity', 'stop_1', 'stop_2'):
        assert row[name] == pytest.approx(getattr(sample, name), rel=1e-9)
    hits = motion.impacts[: len(events)]
    for hit, event in zip(hits, events, strict=True):
        named = dict(zip(IMPACT_COLUMNS, hit, strict=True))
        phase = named.pop('phase')
        assert {n: getattr(event, n) for n in named} == pytest.approx(named)
        assert math.remainder(phase - 31.6 * event.time / math.tau, 1.0) == pytest.approx(0.0)


def test_an_impact_that_comes_late_is_sent(motion):
    """Its topic may be slower than that of the samples."""
    late, view = MotionHistory(10_000, 100), PageView(window=2.0)
    late.add_samples(motion.samples[:1000])
    end = float(motion.samples[900, 0])
    view.frame(late, end, 0.0)
    late.add_impacts(motion.impacts[motion.impacts[:, 0] < end][-1:])
    frames = frames_of(late, view, motion.samples[[905, 910], 0])
    assert [len(frame.impacts) for frame in frames] == [1, 0]


def test_a_jump_replaces_all(motion):
    view = PageView(window=2.0)
    first, on, back, again = frames_of(motion, view, [5.0, 5.1, 3.0, 9.5])
    assert [bool(f.flags & REPLACE) for f in (first, on, back, again)] == [True, False, True, True]
    assert [len(f.samples) for f in (first, on, back, again)] == pytest.approx(
        [400, 20, 400, 400], abs=2
    )
    assert back.impacts[:, 0].min() >= -2.0
    assert view.frame(motion, 9.5, 0.0) is None
    view.begin_again()
    assert frames_of(motion, view, [9.5])[0].flags & REPLACE


def test_what_is_measured_and_commanded_is_sent_and_scored(motion):
    """Late measurements too; the energy of a reset rig counts from 0 again."""
    known, view = MotionHistory(10_000, 10_000), PageView(window=20.0)
    known.add_samples(motion.samples)
    seen = np.column_stack([np.arange(0.0, 12.0, 0.1)] * 3)
    acts = np.zeros((12, len(ACT_COLUMNS)))
    acts[:, 0], acts[:, 1], acts[:, -1] = (
        np.arange(12.0),
        1.0,
        [0, 1, 3, 6, 0, 0, 2, 2, 4, 4, 5, 5],
    )
    acts[:, 2:4] = np.nan
    known.add_acts(acts)
    frames = []
    for instant, late in ((4.0, 3.5), (8.0, 8.0), (12.0, 12.0)):
        known.add_measured(between(seen, known.measured[-1, 0] if frames else -1.0, late))
        frames += frames_of(known, view, [instant])
    assert times(frames, 'measured') == pytest.approx(seen[:, 0], abs=1e-5)
    assert times(frames, 'acts') == pytest.approx(acts[:, 0])
    assert np.isnan(np.concatenate([frame.acts for frame in frames])[:, 2:4]).all()
    x = motion.samples[motion.samples[:, 0] > -48.0, 1]
    score = numbers_of(LIVELY, known, 12.0)['score']
    assert score == {
        'seconds': pytest.approx(12.0),
        'x_rms': pytest.approx(np.sqrt((x**2).mean())),
        'x_max': np.abs(x).max(),
        'impacts': 0,
        'actuator_energy': 11.0,
    }
    # Of the last minute alone
    later = motion.samples + np.array([60.0, *[0.0] * (len(SAMPLE_COLUMNS) - 1)])
    known.add_samples(later[later[:, 0] > 60.5])
    known.add_impacts(motion.impacts)
    score = numbers_of(LIVELY, known, 68.5)['score']
    assert score['seconds'] == pytest.approx(60.0, abs=0.01)
    assert score['actuator_energy'] == 1.0
    assert score['impacts'] == (motion.impacts[:, 0] > 8.5).sum()


def test_flags_alone_are_news(motion):
    view = PageView()
    view.frame(motion, 6.0, 12.5)
    frame = taken_apart(view.frame(motion, 6.0, 12.5, PAUSED))
    assert (frame.flags, frame.epoch, len(frame.samples)) == (PAUSED, 12.5, 0)
    assert view.frame(motion, 6.0, 12.5, PAUSED) is None


def test_a_ghost_that_comes_to_be_known(motion, other):
    """Each of its rows comes once, as far as it is known, while nothing else moves."""
    alone = taken_apart(PageView(window=5.0).frame(other, 9.0, 0.0))
    ghost, view, frames = MotionHistory(10_000, 10_000), PageView(window=5.0), []
    view.frame(motion, 9.0, 0.0)
    for until in (2.0, 5.5, 7.3, 8.95, 12.0):
        frames += frames_of(motion, view, [9.0], ghost)
        ghost.add_impacts(between(other.impacts, ghost.end if frames[1:] else -1.0, until))
        ghost.add_samples(between(other.samples, ghost.end if frames[1:] else -1.0, until))
    frames += frames_of(motion, view, [9.0], ghost)
    assert [frame.flags for frame in frames] == [REPLACE_GHOST, *[0] * (len(frames) - 1)]
    for name in ('samples', 'impacts'):
        assert all(not len(getattr(frame, name)) for frame in frames)
        rows = np.concatenate([getattr(frame, f'ghost_{name}') for frame in frames])
        assert np.array_equal(rows, getattr(alone, name), equal_nan=True)
    # After a jump it has as many samples as the rig itself.
    for instant in (3.0, 11.0):
        (frame,) = frames_of(motion, view, [instant], ghost)
        assert frame.flags == REPLACE | REPLACE_GHOST
        assert len(frame.ghost_samples) == len(frame.samples) > 500
    (gone,) = frames_of(motion, view, [11.0])
    assert (gone.flags, len(gone.ghost_samples)) == (REPLACE_GHOST, 0)


@pytest.mark.parametrize('window', [1e9, -1.0, 0.0])
def test_no_view_is_without_bounds(window):
    assert 0.05 <= PageView(window).window <= 300.0
    motion = MotionHistory(100_000, 10)
    rows = np.zeros((100_000, len(SAMPLE_COLUMNS)))
    rows[:, 0] = np.arange(100_000) / 1000.0
    motion.add_samples(rows)
    assert len(taken_apart(PageView(window).frame(motion, 99.0, 0.0)).samples) <= 60_000


def test_a_motion_keeps_the_newest_rows_and_leaves_out_what_is_none():
    motion, width = MotionHistory(1000, 10), len(SAMPLE_COLUMNS)
    for k in range(300):
        rows = np.zeros((37, width))
        rows[:, 0] = 37 * k + np.arange(37)
        motion.add_samples(rows)
    assert motion.samples[:, 0].tolist() == list(range(300 * 37 - 1000, 300 * 37))
    for count in (999, 1000, 1001, 5000):
        rows = np.zeros((count, width))
        rows[:, 0] = motion.end + 1 + np.arange(count)
        motion.add_samples(rows)
        assert (np.diff(motion.samples[:, 0]) == 1.0).all()
        assert len(motion.samples) == 1000
        assert motion.end == rows[-1, 0]
    motion = MotionHistory(10, 10)
    assert math.isnan(motion.end)
    rows = np.zeros((6, width))
    rows[:, 0] = 1.0, 2.0, 2.0, 1.5, 3.0, 4.0
    rows[4, 1] = np.nan
    motion.add_samples(rows)
    motion.add_samples(rows)
    assert motion.samples[:, 0].tolist() == [1.0, 2.0, 4.0]
    hits = np.zeros((3, len(IMPACT_COLUMNS)))
    hits[:, 0] = 2.0, 1.0, np.inf
    motion.add_impacts(hits)
    assert motion.impacts[:, 0].tolist() == [1.0, 2.0]


def test_phases_are_those_of_orbits_whatever_the_phase_of_the_force_is():
    rig = Rig(load_parameters('bench_rig')[0].replace(force_phases=(0.3,)))
    phase = force_phase(rig)
    hits = [event for event in rig.advance(60.0) if event.kind is EventKind.IMPACT][-2:]
    orbit = settle(rig).orbit
    there = sorted(float(phase.at(np.array([hit.time]))[0]) for hit in hits)
    assert there == pytest.approx(sorted(orbit.phases), abs=1e-4)
    still = force_phase(Rig(LIVELY.replace(force_amplitudes=(0.0,))))
    assert np.isnan(still.at(np.array([0.0, 7.3]))).all()


@pytest.mark.parametrize('shaken', [{}, {'force_amplitudes': 0.0, 'base_amplitudes': 2.0}])
def test_phase_of_a_stepped_sine_is_that_of_the_rig(shaken):
    """Against the angle that the simulator keeps."""
    swept = LIVELY.replace(
        sweep_mode='up_down',
        sweep_low=20.0,
        sweep_high=22.0,
        sweep_step=0.7,
        sweep_dwell=0.9,
        **shaken,
    )
    rig = Rig(swept)
    phase = force_phase(rig)
    for time in (0.5, 1.0, 2.5, 4.1, 9.0):
        rig.advance(time)
        one, other = (float(p.at(np.array([time]))[0]) for p in (phase, force_phase(rig)))
        assert math.remainder(one - other, 1.0) == pytest.approx(0.0, abs=1e-9)


def test_numbers(motion):
    numbers = numbers_of(LIVELY, motion, 12.0)
    assert numbers['natural_frequency_hz'] == pytest.approx(math.sqrt(1000.0) / math.tau)
    assert numbers['damping_ratio'] == pytest.approx(0.6 / (2 * math.sqrt(1000.0)))
    assert numbers['frequency_ratio'] == pytest.approx(31.6 / math.sqrt(1000.0))
    assert numbers['static_amplitude'] == LIVELY.response_amplitude
    assert (numbers['mass_ratio'], numbers['gap']) == (0.1, 0.01)
    start = 12.0 - 20 * math.tau / 31.6
    hits = between(motion.impacts, start, 12.0)
    assert numbers['impacts_per_cycle'] == len(hits) / 20
    # What the impacts take from M: impulse times the mean of its velocities before and after
    sign = np.where(hits[:, 1] == 1.0, 1.0, -1.0)
    taken = -(sign * hits[:, 8] * 0.5 * (hits[:, 4] + hits[:, 5])).sum() / 20
    assert numbers['energy_per_cycle'] == pytest.approx(taken)
    largest = np.abs(between(motion.samples, start, 12.0)[:, 1]).max()
    ratio = numbers['x_max_ratio']
    assert ratio == pytest.approx(largest / LIVELY.response_amplitude)
    # Without a force, whose frequency may be any, a cycle is that of the spring
    free = LIVELY.replace(force_amplitudes=(0.0,), force_frequencies=(1.0,))
    start = 12.0 - 20 * math.tau / free.omega
    hits = between(motion.impacts, start, 12.0)
    assert numbers_of(free, motion, 12.0)['impacts_per_cycle'] == len(hits) / 20
    undamped = LIVELY.replace(damping=0.0, force_frequencies=(LIVELY.omega,))
    assert numbers_of(undamped, motion, 1.0)['static_amplitude'] is None
    assert 'impacts_per_cycle' not in numbers_of(LIVELY, MotionHistory(10, 10), math.nan)
