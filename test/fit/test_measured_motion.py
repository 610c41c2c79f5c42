"""Measured motions: what is read from files, what is masked, and where impacts are found."""

import numpy as np
import pytest
from rigs import BENCH
from scipy.io import wavfile

from impact_damper_ros import Rig
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.fit.measured_motion import (
    NO_OPTIONS,
    ReadingOptions,
    read_table_motion,
    saturation_of,
)
from impact_damper_ros.measured.impacts import read_impacts, spike_times
from impact_damper_ros.measured.table import TableError


@pytest.fixture
def written(tmp_path):
    def write(text, name='run.csv'):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def columns(head, *values):
    rows = np.column_stack(values).tolist()
    return head + '\n' + '\n'.join(','.join(f'{v:.9g}' for v in row) for row in rows) + '\n'


TIME = np.arange(400) / 200.0
MOTION = 3.0 * np.sin(31.0 * TIME)


def test_a_motion_of_each_quantity(written):
    for head, quantity, factor in (
        ('t [s],x [mm]', 'displacement', 1e-3),
        ('Zeit [s],Geschwindigkeit [mm/s]', 'velocity', 1e-3),
        ('t [s],accel [g]', 'acceleration', 9.80665),
    ):
        data = read_table_motion(written(columns(head, TIME, MOTION)))
        assert data.quantity == quantity
        assert data.motion == pytest.approx(factor * MOTION, abs=1e-7)
        assert data.time == pytest.approx(TIME)
        assert data.used.all()
        assert data.force is data.base is data.impact_times is None


def test_force_base_and_a_column_of_impacts(written):
    hit = np.zeros(len(TIME))
    hit[50:53] = hit[120:121] = 5.0
    head = 't [s],x [mm],force [N],base acceleration [g],impact'
    text = columns(head, TIME, MOTION, np.cos(TIME), np.sin(TIME), hit)
    data = read_table_motion(written(text))
    assert data.force == pytest.approx(np.cos(TIME))
    assert data.base_quantity == 'acceleration'
    assert data.base == pytest.approx(9.80665 * np.sin(TIME), abs=1e-7)
    assert data.impact_times == pytest.approx([TIME[50] - 0.0025, TIME[120] - 0.0025])
    assert data.impact_deviation == pytest.approx(0.005 / np.sqrt(12.0))


def test_the_column_that_is_named(written):
    text = columns('t [s],Ch 1 [mm],Ch 2 [g]', TIME, MOTION, 2.0 * MOTION)
    # By its unit alone a displacement is one, and nothing says what the acceleration is of
    data = read_table_motion(written(text))
    assert (data.quantity, data.impact_times) == ('displacement', None)
    assert data.columns.endswith("motion 'Ch 1 [mm]'; not used: 'Ch 2 [g]'")
    data = read_table_motion(written(text), ReadingOptions(column='ch 2'))
    assert data.quantity == 'acceleration'
    assert data.motion == pytest.approx(2.0 * 9.80665 * MOTION, abs=1e-6)


def test_what_simulate_rig_writes_is_read(tmp_path):
    states, impacts = tmp_path / 'states.csv', tmp_path / 'impacts.csv'
    arguments = ['bench_rig', '--duration', '3', '--states', str(states), '--rate', '200']
    assert simulate_rig([*arguments, '--impacts', str(impacts)]) == 0
    data = read_table_motion(states, ReadingOptions(impacts=impacts, impact_deviation=1e-3))
    assert data.quantity == 'displacement'
    assert data.base is None
    assert len(data.impact_times) > 10
    assert data.impact_deviation == 1e-3
    hits = np.genfromtxt(impacts, delimiter=',', names=True, usecols=range(7))
    assert data.impact_times == pytest.approx(hits['time'])


def test_saturated_samples_are_not_used(written):
    cut = np.clip(MOTION, -2.0, 2.5)
    data = read_table_motion(written(columns('t [s],v [m/s]', TIME, cut)))
    assert (data.used == ((MOTION < 2.5) & (MOTION > -2.0))).all()
    assert 'saturated samples not used' in data.source
    # A crest that is read with a coarse resolution is none
    coarse = np.round(MOTION, 1)
    assert (np.diff(np.flatnonzero(coarse == coarse.max())) == 1).any()
    assert not saturation_of(coarse).any()
    assert not saturation_of(MOTION).any()
    data = read_table_motion(
        written(columns('t [s],v [m/s]', TIME, MOTION)), ReadingOptions(saturation=2.9)
    )
    assert (data.used == (np.abs(MOTION) < 2.9)).all()


def test_gaps_in_time_are_filled_and_not_used(written):
    left = np.ones(len(TIME), bool)
    left[100:103] = left[200:201] = False
    data = read_table_motion(written(columns('t [s],x [mm]', TIME[left], MOTION[left])))
    assert data.time == pytest.approx(TIME)
    assert (data.used == left).all()
    empty = (
        columns('t [s],x [mm]', TIME, MOTION)
        .replace('\n0.5,', '\n0.5, #')
        .replace(' #' + f'{MOTION[100]:.9g}', '')
    )
    data = read_table_motion(written(empty))
    assert np.flatnonzero(~data.used).tolist() == [100]


@pytest.mark.parametrize(
    ('text', 'problem'),
    [
        (columns('t [s],x [mm]', TIME, 0.0 * TIME + 3.0), r"'?x \[mm\] is 0.003 throughout"),
        (columns('t [s],x [mm]', TIME[:9], MOTION[:9]), '9 samples: give at least 20'),
        (
            columns('t [s],x [mm]', TIME[::-1], MOTION),
            r"line 3, column 't \[s\]': 1.99 after 1.995: the times go back: export",
        ),
        (
            columns('t [s],x [mm]', np.r_[TIME[:90], TIME[90:] + 50.0], MOTION),
            r"line 92, column 't \[s\]': a step of 50.*cut the record there, with --from or --to",
        ),
        (
            columns('t [s],x [mm]', np.r_[TIME[:90], TIME[90:] + 1.4e-3 - 5e-3], MOTION),
            'line 92.*a step of 0.0014 s.*equal intervals',
        ),
        (columns('t [s],x [V]', TIME, MOTION), r"'x \[V\]' has the unit 'V'"),
        (columns('t [s],x [mm],force [mm]', TIME, MOTION, MOTION), r"'force \[mm\]' has the unit"),
    ],
)
def test_refusals(written, text, problem):
    with pytest.raises(ValueError, match=problem):
        read_table_motion(written(text), NO_OPTIONS)


def test_times_with_few_digits_are_at_equal_intervals(written):
    """A logger of 400 Hz writes whole milliseconds: steps of 2 and 3 ms."""
    rows = '\n'.join(f'{t:.3f},{x:.6f}' for t, x in zip(0.5 * TIME, MOTION, strict=True))
    data = read_table_motion(written(f't [s],x [mm]\n{rows}\n'))
    assert np.diff(data.time) == pytest.approx(0.0025, abs=1e-6)
    assert data.time == pytest.approx(0.5 * TIME, abs=6e-4)
    # A sample that is twice there is none of these
    twice = np.insert(TIME, 200, TIME[200])
    with pytest.raises(TableError, match=r'line 203.* 1 after 1: the column must'):
        read_table_motion(written(columns('t [s],x [mm]', twice, np.insert(MOTION, 200, 0.0))))


def test_a_column_that_is_not_found_is_named_by_an_option(written):
    for head in ('t [s],laser [mm],probe [mm]', 't [s],x1 [mm],x2 [mm]'):
        with pytest.raises(TableError, match='--column gives that of M'):
            read_table_motion(written(columns(head, TIME, MOTION, MOTION)))


def test_impacts_of_a_contact_or_a_sound(written, tmp_path):
    """A signal beside its times is not taken for times of impacts."""
    hits = np.array([0.3, 0.7, 1.2, 1.85])
    level = np.where(np.abs(TIME[:, None] - hits - 0.006).min(axis=1) < 0.006, 5.0, 0.0)
    found, _ = read_impacts(written(columns('t [s],contact [V]', TIME, level)))
    assert found == pytest.approx(hits + 0.0025)
    with pytest.raises(TableError, match='400 times at equal intervals, which are no impacts'):
        read_impacts(written(columns('t [s],x [mm]', TIME, MOTION)))
    found, deviation = read_impacts(sounded(tmp_path / 'hits.wav', hits))
    assert found == pytest.approx(hits, abs=6e-4)
    assert deviation < 5e-4
    (tmp_path / 'no.wav').write_text('no sound')
    with pytest.raises(TableError, match=r'no\.wav: no sound that can be read'):
        read_impacts(tmp_path / 'no.wav')


def sounded(path, hits, rate=44100):
    """Write clicks that ring, and echo in a room, over the noise of a microphone."""
    rng = np.random.default_rng(3)
    sound = rng.normal(0.0, 1e-3, int(rate * (hits[-1] + 0.5)))
    for hit in hits:
        start = int(hit * rate)
        later = np.arange(len(sound) - start) / rate
        ring = np.exp(-later / 1.5e-3) * np.sin(2.0 * np.pi * 3500.0 * later)
        echo = 0.08 * np.exp(-later / 0.08) * rng.normal(0.0, 1.0, len(later))
        sound[start:] += 0.5 * (ring + echo)
    wavfile.write(path, rate, (32767.0 * sound).astype(np.int16))
    return path


def test_impacts_of_another_clock(written):
    motion = written(columns('t [s],x [mm]', TIME, MOTION))
    impacts = written('time\n1700000000.5\n1700000001.5\n', 'impacts.csv')
    with pytest.raises(ValueError, match=r'none of 2 impact times .* give both the same clock'):
        read_table_motion(motion, ReadingOptions(impacts=impacts))


@pytest.mark.parametrize('rate', [1000.0, 4000.0])
def test_spikes_of_an_accelerometer_are_impacts(rate):
    """Each impact shakes the mounted sensor at 900 Hz, which dies out in some milliseconds."""
    rng = np.random.default_rng(7)
    times = np.arange(int(8.0 * rate)) / rate
    run = Rig(BENCH).run(8.0, times)
    hits = run.events[run.events['kind'] == 1]
    hits = hits[hits['time'] > 0.0]
    acceleration = np.gradient(run.samples['primary_velocity'], times)
    for hit in hits:
        later = times - hit['time']
        size = 400.0 * abs(hit['primary_velocity_after'] - hit['primary_velocity_before'])
        ring = np.cos(2.0 * np.pi * 400.0 * later) * np.exp(-np.maximum(later, 0.0) / 1.5e-3)
        acceleration += size * ring * (later > 0.0)
    acceleration += rng.normal(0.0, 0.02, len(times))
    found = spike_times(times, acceleration)
    off = np.abs(found[:, None] - hits['time']).min(axis=1)
    missed = np.abs(found[:, None] - hits['time']).min(axis=0) > 2.0 / rate
    assert (off < 2.0 / rate).mean() > 0.97  # false ones
    assert missed.mean() < 0.1  # of which some are weaker than the noise


def test_a_missing_sample_is_no_spike():
    """Of a sensor that has gravity as an offset."""
    acceleration = 9.81 + np.random.default_rng(5).normal(0.0, 0.01, 400)
    acceleration[100] = np.nan
    assert len(spike_times(TIME, acceleration)) == 0
    acceleration[200] += 5.0
    assert spike_times(TIME, acceleration) == pytest.approx([TIME[200] - 0.0025])
    assert len(spike_times(TIME, np.nan * TIME)) == 0


def test_an_acceleration_is_not_used_where_its_sensor_rings(written):
    rate, times = 2000.0, np.arange(4000) / 2000.0
    acceleration = 3.0 * np.sin(31.0 * times)
    for hit in (0.5003, 1.2001):
        later = times - hit
        acceleration += 60.0 * np.exp(-np.maximum(later, 0.0) / 1e-3) * (later > 0.0)
    data = read_table_motion(written(columns('t [s],a [m/s^2]', times, acceleration)))
    assert data.impact_times == pytest.approx([0.5003, 1.2001], abs=1.0 / rate)
    unused = times[~data.used]
    assert len(unused) == pytest.approx(2 * 11, abs=3)
    assert all(
        -6e-4 < min(unused[k] - h for h in (0.5003, 1.2001) if unused[k] - h > -6e-4) < 6e-3
        for k in range(len(unused))
    )
