"""Files as loggers, phones and programs of measurement write them: the same motion from each."""

from datetime import datetime, timedelta

import numpy as np
import pytest
from scipy.io import wavfile

from impact_damper_ros.fit.measured_motion import ReadingOptions, read_table_motion
from impact_damper_ros.measured.impacts import read_impacts, spike_times
from impact_damper_ros.measured.record import read_record
from impact_damper_ros.measured.sheet import TableError

RATE, ROWS = 200.0, 60
TIME = np.arange(ROWS) / RATE
#: What each file says of M, in its own unit.
MOTION = 12.0 * np.exp(-0.3 * TIME) * np.cos(31.0 * TIME)
G = 9.80665


def rows(form, times=TIME, values=MOTION):
    """Return a line for each sample, with its time t, s, or ms or ns, and its value x."""
    return ''.join(
        form.format(t=t, ms=round(1000 * t), ns=round(1e9 * t), s=f'{t:06.3f}', x=x) + '\n'
        for t, x in zip(times, values, strict=True)
    )


METAWEAR = 'epoc (ms),timestamp (+0100),elapsed (s),x-axis (g),y-axis (g)\n' + rows(
    '1700000000{ms:03d},2021-03-01T10.00.{s},{t:.3f},{x:.4f},1.0'
)
SENSORLOGGER = 'time,seconds_elapsed,z,x\n' + rows('1700000000{ns:09d},{t:.6f},{x:.5f},1.0')
LATE = datetime(2026, 11, 28, 23, 59, 59, 850_000)
CHANNELS = 't [s],force [N],t [s],x [mm]\n'
#: Text, options, quantity, and the factor from MOTION to SI.
CASES = {
    'gcdc': (
        ';Title, logger\n;SampleRate, 200,Hz\n;Headers, time [s],Ax [mg],Ay [mg]\n'
        + rows('{t:.3f},{x:.4f},1000.0')
        + ';shutdown: switched off\n',
        {'column': 'ax'},
        'acceleration',
        1e-3 * G,
    ),
    'savetxt': ('# t [s],x [mm]\n' + rows('{t:.4f},{x:.4f}'), {}, 'displacement', 1e-3),
    'matlab': ('% t [s]\tx [mm]\n' + rows('{t:.4f}\t{x:.4f}'), {}, 'displacement', 1e-3),
    'pasco': (
        '"Time (s) Run #1","Position (m) Run #1"\n' + rows('{t:.4f},{x:.4f}'),
        {},
        'displacement',
        1.0,
    ),
    'vernier': (
        'Latest: Time (s),Latest: Position (m)\n' + rows('{t:.4f},{x:.4f}'),
        {},
        'displacement',
        1.0,
    ),
    'metawear': (METAWEAR, {'column': 'x-axis'}, 'acceleration', G),
    'by date': (
        METAWEAR,
        {'column': '4', 'time_column': 'timestamp (+0100)'},
        'acceleration',
        G,
    ),
    'by epoch': (METAWEAR, {'column': 'x-axis', 'time_column': '1'}, 'acceleration', G),
    'sensorlogger': (SENSORLOGGER, {'column': 'z', 'unit': 'm/s^2'}, 'acceleration', 1.0),
    'ns since 1970': (
        'time,z [m/s^2]\n' + rows('1700000000{ns:09d},{x:.5f}'),
        {},
        'acceleration',
        1.0,
    ),
    'end of file': ('t [ms],x [mm]\n' + rows('{ms},{x:.4f}') + 'EOF\n', {}, 'displacement', 1e-3),
    'three rows': (
        'Zeit;Weg\nSeit Start;Laser\ns;mm\n' + rows('{t:.4f};{x:.4f}').replace('.', ','),
        {},
        'displacement',
        1e-3,
    ),
    'durations': (
        'time,x [mm]\n' + rows('0 days 00:00:{s}000,{x:.4f}'),
        {},
        'displacement',
        1e-3,
    ),
    'dates': (
        'Zeit;Weg [mm]\n' + rows('28.11.2026 10:00:{s};{x:.4f}'),
        {},
        'displacement',
        1e-3,
    ),
    'midnight': (
        'Time,x [mm]\n'
        + ''.join(
            f'{LATE + timedelta(seconds=t):%Y-%m-%d %H:%M:%S.%f},{x:.4f}\n'
            for t, x in zip(TIME, MOTION, strict=True)
        ),
        {},
        'displacement',
        1e-3,
    ),
    'noon': ('Time,x [mm]\n' + rows('11/28/2026 12:59:{s} PM,{x:.4f}'), {}, 'displacement', 1e-3),
    'minutes': ('Time,x [mm]\n' + rows('00:{s},{x:.4f}'), {}, 'displacement', 1e-3),
    'columns of one name': (
        't [s],x [mm],x [mm]\n' + rows('{t:.4f},1.0,{x:.4f}'),
        {'column': '3'},
        'displacement',
        1e-3,
    ),
    'a clock for each channel': (
        CHANNELS + rows('{ms},0.0,{t:.4f},{x:.4f}'),
        {},
        'displacement',
        1e-3,
    ),
    'arduino': ('millis,a [g]\n' + rows('{ms},{x:.4f}'), {}, 'acceleration', G),
    **{
        unit: (f'{time},{name} [{unit}]\n' + rows('{t:.4f},{x:.6f}'), {}, quantity, factor)
        for time, name, unit, quantity, factor in (
            ('time [Seconds]', 'x', 'mm', 'displacement', 1e-3),
            ('t [s]', 'velocity', 'in/s', 'velocity', 0.0254),
            ('t [sec]', 'v', 'ips', 'velocity', 0.0254),
            ('t [s]', 'Schwinggeschwindigkeit', 'MM/S', 'velocity', 1e-3),
            ('t [s]', 'acceleration', 'mG', 'acceleration', 1e-3 * G),
            ('t [s]', 'displacement', 'mil', 'displacement', 2.54e-5),
            ('t [s]', 'acceleration', 'm/s/s', 'acceleration', 1.0),
            ('t [s]', 'probe', 'gal', 'acceleration', 0.01),
        )
    },
}


@pytest.fixture
def written(tmp_path):
    def write(text, name='run.csv'):
        path = tmp_path / name
        path.write_text(text, encoding='utf-8')
        return path

    return write


@pytest.mark.parametrize('case', CASES)
def test_a_motion(written, case):
    text, options, quantity, factor = CASES[case]
    data = read_table_motion(written(text), ReadingOptions(**options))
    assert data.quantity == quantity
    assert data.motion == pytest.approx(factor * MOTION, abs=1e-4 * factor)
    assert data.time - data.time[0] == pytest.approx(TIME, abs=1e-6)
    assert data.used.all()


def sampled(rate, digits, count=2000, start=0.0):
    """Return instants that a logger writes with few digits, and a motion at the exact ones."""
    exact = start + np.arange(count) / rate
    return np.round(exact, digits), np.sin(31.0 * (exact - start))


@pytest.mark.parametrize(
    ('rate', 'digits', 'start'),
    [(512.0, 3, 0.0), (400.0, 3, 5.0), (2000.0, 3, 0.0), (102.4, 2, 0.0), (512.0, 3, 1.7e9)],
)
def test_few_digits_in_time(written, rate, digits, start):
    times, values = sampled(rate, digits, start=start)
    text = 't [s],x [mm]\n' + rows(f'{{t:.{digits}f}},{{x:.5f}}', times, values)
    data = read_table_motion(written(text))
    assert np.diff(data.time) == pytest.approx(1.0 / rate, rel=2e-4, abs=3e-7)
    assert data.time[0] == pytest.approx(start, abs=0.55 * 10.0**-digits)


@pytest.mark.parametrize(
    ('rate', 'digits', 'start', 'hole'),
    [
        (200.0, 3, 0.0, 10),
        (200.0, 3, 1.7e9, 10),
        (200.0, 6, 1e3, 1),
        (512.0, 3, 0.0, 40),
        (1000.0, 3, 0.0, 1),
    ],
)
def test_a_hole(written, rate, digits, start, hole):
    """It is seen and has its length whatever the clock counts from, and of how few digits."""
    times, values = sampled(rate, digits, start=start)
    left = np.ones(len(times), bool)
    left[800 : 800 + hole] = left[1500:1501] = False
    text = 't [s],x [mm]\n' + rows(f'{{t:.{digits}f}},{{x:.5f}}', times[left], values[left])
    data = read_table_motion(written(text))
    assert (data.used == left).all()
    record = text.replace('x [mm]', 'force [N]')
    with pytest.raises(TableError, match=r"line 802, column 't \[s\]': a step of .* fill the gap"):
        read_record(written(record), 'force')


UNIVERSAL = """\
    -1
   164
         5   mm (milli-newton)         2
   1.0000000000000000D+03   1.0000000000000000D+03   1.0000000000000000D+00
   0.0000000000000000D+00
    -1
"""


def function(values, direction, kind=8, unit='NONE', spacing=1, exponents=(0, 0)):
    """Return a function of time of a universal file; of uneven spacing it ends with a pad."""
    lines = [
        '    -1',
        '    58',
        *['NONE'] * 5,
        f'    1         0    0         0       NONE         1{direction:4d}       NONE'
        '         0   0',
        f'         2{len(values):10d}{spacing:10d}  0.00000E+00  5.00000E-03  0.00000E+00',
        '        17    0    0    0 Time                 s',
        f'{kind:10d}{exponents[0]:5d}{exponents[1]:5d}    0 NONE                 {unit:20s}',
        *['         0    0    0    0 NONE                 NONE'] * 2,
    ]
    cells = [f'{number:13.5E}' for number in values]
    if spacing == 0:
        pairs = zip(TIME, values, strict=False)
        cells = [f'{t:13.5E}{x:13.5E}' for t, x in pairs] + [f'{0.0:13.5E}{0.0:13.5E}']
    wide = 6 if spacing else 3
    lines += [''.join(cells[n : n + wide]) for n in range(0, len(cells), wide)]
    return '\n'.join([*lines, '    -1', ''])


def test_universal_files(written):
    pytest.importorskip('pyuff')
    # Of which dataset 164 says that they are in mm
    for text in (UNIVERSAL + function(MOTION, 3), function(MOTION, 3) + UNIVERSAL):
        data = read_table_motion(written(text, 'a.uff'))
        assert data.motion == pytest.approx(1e-3 * MOTION, abs=1e-7)
    data = read_table_motion(written(UNIVERSAL + function(MOTION, 3, unit='um'), 'b.uff'))
    assert data.motion == pytest.approx(1e-6 * MOTION, abs=1e-10)
    # A general quantity has its powers of length and force; a velocity has none of time
    general = function(MOTION, 3, kind=1, exponents=(1, 0))
    options = ReadingOptions(column='channel 1 +Z', unit='m/s')
    data = read_table_motion(written(UNIVERSAL + general, 'general.uff'), options)
    assert data.quantity == 'velocity'
    assert data.motion == pytest.approx(1e-3 * MOTION, abs=1e-7)
    push = function(MOTION, 3, kind=1, exponents=(0, 1))
    data = read_table_motion(written(UNIVERSAL + function(MOTION, 3) + push, 'force.uff'))
    assert data.force == pytest.approx(1e-3 * MOTION, abs=1e-7)
    # The pad behind the last value is none
    data = read_table_motion(written(function(MOTION[:59], 3, spacing=0), 'c.uff'))
    assert data.motion == pytest.approx(MOTION[:59], abs=1e-4)
    # Directions have names of their own
    three = written(''.join(function(n * MOTION, n) for n in (1, 2, 3)), 'd.uff')
    with pytest.raises(TableError, match=r"'displacement 1 \+X \[m\]' and 'displacement 1 \+Y"):
        read_table_motion(three)
    data = read_table_motion(three, ReadingOptions(column='displacement 1 +Y'))
    assert data.motion == pytest.approx(2.0 * MOTION, abs=1e-3)
    with pytest.raises(TableError, match=r'no universal file|no function of time'):
        read_table_motion(written('no universal file', 'e.uff'))


LABVIEW = """\
LabVIEW Measurement
Separator\tTab
Decimal_Separator\t.
X_Columns\t{columns}
***End_of_Header***

"""
SEGMENT = """\
Channels\t{count}
Y_Unit_Label\t{units}
X0\t{start}\t\t{start}
Delta_X\t0.005\t\t0.005
***End_of_Header***
X_Value\t{names}\tComment
"""


def test_labview_files(written):
    head = SEGMENT.format(count=2, units='N\t\tmm', start=0.0, names='Kraft\tX_Value\tWeg')
    several = LABVIEW.format(columns='Multi') + head + rows('{ms}\t0.0\t{t:.3f}\t{x:.4f}')
    data = read_table_motion(written(several, 'a.lvm'))
    assert data.time == pytest.approx(TIME)
    assert data.motion == pytest.approx(1e-3 * MOTION, abs=1e-7)
    assert (
        "not used, since it is constant and has another clock: force 'Kraft [N]'" in data.columns
    )
    with pytest.raises(TableError, match='its clock is not that of the motion: export force'):
        read_table_motion(written(several.replace('5\t0.0\t', '5\t2.0\t', 1), 'b.lvm'))
    # Two segments are one record
    text = LABVIEW.format(columns='One')
    for half in (slice(0, 30), slice(30, 60)):
        text += SEGMENT.format(count=1, units='mm', start=TIME[half][0], names='Weg')
        text += rows('{t:.3f}\t{x:.4f}', TIME[half], MOTION[half]) + '\n'
    data = read_table_motion(written(text, 'c.lvm'))
    assert data.time == pytest.approx(TIME)
    assert data.motion == pytest.approx(1e-3 * MOTION, abs=1e-7)


def test_strong_motion(written):
    lines = ['STRONG MOTION RECORD', 'EVENT', 'ACCELERATION TIME SERIES IN UNITS OF G']
    lines += [f'NPTS=   {ROWS}, DT=   .0050 SEC']
    lines += [' '.join(f'{x:15.7E}' for x in MOTION[n : n + 5]) for n in range(0, ROWS, 5)]
    record = read_record(written('\n'.join(lines), 'a.AT2'), 'base')
    assert record.times == pytest.approx(TIME)
    assert record.values == pytest.approx(G * MOTION, abs=1e-5)
    other = written('Time (s),Acceleration (gal)\n' + rows('{t:.3f},{x:.5f}'))
    assert read_record(other, 'base').values == pytest.approx(0.01 * MOTION, abs=1e-7)
    with pytest.raises(TableError, match=r'no PEER record that can be read: 59 values of 60'):
        read_record(written('\n'.join([*lines[:-1], lines[-1][:63]]), 'b.at2'), 'base')


@pytest.mark.parametrize(
    'name',
    ['Shaker acc', 'table', 'Tisch', 'Anregung', 'excitation', 'input', 'base acceleration'],
)
def test_the_column_of_what_shakes_is_not_that_of_m(written, name):
    """Without its base a sweep would be a ring-down."""
    text = f't [s],{name} [g],Ch 2 [g],note\n' + rows('{t:.4f},{t:.4f},{x:.4f},')
    data = read_table_motion(written(text))
    assert data.motion == pytest.approx(G * MOTION, abs=1e-3)
    assert (data.base_quantity, data.base) == ('acceleration', pytest.approx(G * TIME))
    assert data.columns == (
        f"reads time 't [s]', base '{name} [g]', motion 'Ch 2 [g]'; not used: 'note'"
    )


def test_columns_that_are_named(written):
    text = written('t [s],p [g],q [g],r [kN],s [N]\n' + rows('{t:.4f},{t},{x},{x},1'))
    with pytest.raises(TableError, match=r"'r \[kN\]' and 's \[N\]' may each be the force"):
        read_table_motion(text, ReadingOptions(column='q'))
    options = ReadingOptions(column='q', base_column='p', force_column='r [kN]')
    data = read_table_motion(text, options)
    assert data.base == pytest.approx(G * TIME)
    assert data.force == pytest.approx(1e3 * MOTION)
    for options, problem in (
        ({'column': 'u'}, "no column 'u' for the motion among 't "),
        ({'column': '9'}, "no column '9' for the motion"),
        ({'column': 't'}, r"column 't \[s\]' has the unit 's'"),
        ({'column': 'q', 'unit': 'bar'}, r"column 'q \[g\]' has the unit"),
        ({'column': 'q', 'force_column': 'p'}, r"column 'p \[g\]' has the unit 'g'"),
        ({'first': 9.0, 'column': 'q', 'force_column': 's'}, 'no samples from 9 to inf s: give a'),
    ):
        with pytest.raises(TableError, match=problem):
            read_table_motion(text, ReadingOptions(**options))
    same = written('t [s],x [mm],x [mm]\n' + rows('{t:.4f},1.0,{x:.4f}'))
    with pytest.raises(TableError, match=r'several columns .*: give the number of the column, 2'):
        read_table_motion(same, ReadingOptions(column='x [mm]'))


@pytest.mark.parametrize(
    ('times', 'problem'),
    [
        (np.r_[2**32 / 1e6 - 0.1 + TIME[:20], TIME[:40]], 'a counter begins anew: add 4294967296'),
        (np.r_[TIME[:40], TIME[:20]], 'the times go back: a second run begins there; cut the'),
        (np.where(np.arange(ROWS) == 9, 0.036, TIME), 'the times go back: export the samples in'),
        (np.where(np.arange(ROWS) == 9, 0.04, TIME), 'must rise: leave out rows that repeat'),
    ],
)
def test_times_that_do_not_rise(written, times, problem):
    text = 't [us],a [g]\n' + ''.join(
        f'{round(t * 1e6)},{x:.4f}\n' for t, x in zip(times, MOTION, strict=True)
    )
    with pytest.raises(TableError, match=problem):
        read_table_motion(written(text))


def test_a_record_is_cut_before_it_is_judged(written):
    times = np.where(TIME < 0.2, TIME, TIME + 50.0)
    path = written('t [s],x [mm]\n' + rows('{t:.4f},{x:.4f}', times))
    with pytest.raises(ValueError, match=r'a step of 50.* cut the record there, with --from'):
        read_table_motion(path)
    data = read_table_motion(path, ReadingOptions(last=0.2))
    assert data.motion == pytest.approx(1e-3 * MOTION[:40], abs=1e-7)


def test_what_is_no_sample(written):
    """Numbers of nines, NaN in any channel, and values that are written twice."""
    cut = np.clip(MOTION, -8.0, 8.0)
    cut[[10, 11, 30]] = 999.0, 999.0, -9999.0
    force = rows('{t:.4f},{x:.4f},1', TIME, cut).splitlines()
    force[20] = force[20].removesuffix('1') + 'NaN'
    data = read_table_motion(written('t [s],x [mm],force [N]\n' + '\n'.join(force)))
    real = np.abs(MOTION) < 8.0
    real[[10, 11, 20, 30]] = False
    assert (data.used == real).all()
    assert '(3 samples of -9999 and 999 taken for missing)' in data.source
    twice = np.repeat(MOTION[::2], 2)
    data = read_table_motion(written('t [s],x [mm]\n' + rows('{t:.4f},{x:.4f}', TIME, twice)))
    assert data.time == pytest.approx(TIME[::2])
    assert data.motion == pytest.approx(1e-3 * MOTION[::2], abs=1e-7)
    # A coarse resolution repeats values too, in no rhythm
    coarse = np.round(MOTION / 4.0) * 4.0
    data = read_table_motion(written('t [s],x [mm]\n' + rows('{t:.4f},{x:.4f}', TIME, coarse)))
    assert len(data.time) == ROWS


HITS = np.array([0.3, 0.7, 1.2, 1.85])


@pytest.mark.parametrize(
    'text',
    [
        't [s]\n0.3\n0.7\n1.2\n1.85\n',
        'hits\n0.3\n0.7\n1.2\n1.85\n',
        '0.3\n0.7\n1.2\n1.85\n',
        'Stöße [ms]\n300\n700\n1200\n1850\n',
        'number,time\n1,0.3\n2,0.7\n3,1.2\n4,1.85\n',
        'Aufprall\n00:00:00.3\n00:00:00.7\n00:00:01.2\n00:00:01.85\n',
    ],
)
def test_impact_times_in_one_column(written, text):
    assert read_impacts(written(text))[0] == pytest.approx(HITS)


def test_how_many_make_a_clock_or_a_sound(written, tmp_path):
    """20 times at equal intervals are a clock; 10 ms of sound are 20 blocks."""
    times = [f't [s]\n{rows("{t:.4f}", TIME[:n], MOTION[:n])}' for n in (19, 20)]
    assert len(read_impacts(written(times[0]))[0]) == 19
    with pytest.raises(TableError, match='20 times at equal intervals, which are no impacts'):
        read_impacts(written(times[1]))
    path = tmp_path / 'short.wav'
    for count, problem in ((80, None), (79, '0.00988 s of sound: record more')):
        wavfile.write(path, 8000, np.zeros(count, np.int16))
        if problem is None:
            assert len(read_impacts(path)[0]) == 0
        else:
            with pytest.raises(TableError, match=problem):
                read_impacts(path)


def test_impacts_three_samples_apart_are_two():
    acceleration = np.random.default_rng(2).normal(0.0, 1e-3, 60)
    acceleration[[20, 23]] = 1.0, 9.0
    time = np.arange(60) * 0.01
    found = spike_times(time, acceleration, ringing=0.02)
    assert found == pytest.approx([0.195, 0.225])


def test_a_record_of_four_samples(written):
    text = 't [s],force [N]\n' + rows('{t:.4f},{x:.4f}', TIME[:4], MOTION[:4])
    assert read_record(written(text), 'force').values == pytest.approx(MOTION[:4], abs=1e-4)


@pytest.mark.parametrize('kind', [np.uint8, np.int16, np.int32, np.float32])
def test_a_gate_writes_silence_between_impacts(tmp_path, kind):
    """10 ms before each impact and 60 ms after it are recorded, and zeros else."""
    rng = np.random.default_rng(3)
    rate = 8000
    sound = np.zeros(int(2.2 * rate))
    for hit in HITS:
        begin, start = int((hit - 0.01) * rate), int(hit * rate)
        later = np.arange(480) / rate
        sound[begin:start] = rng.normal(0.0, 0.01, start - begin)
        ring = np.exp(-later / 3e-3) * np.cos(2.0 * np.pi * 900.0 * later)
        sound[start : start + 480] = 0.7 * ring + rng.normal(0.0, 0.01, 480)
    whole = {np.uint8: 127.0, np.int16: 32767.0, np.int32: 2.0**31 - 1.0}.get(kind, 1.0)
    rest = 128.0 if kind is np.uint8 else 0.0
    path = tmp_path / 'hits.wav'
    wavfile.write(path, rate, (whole * sound + rest).astype(kind))
    found, _ = read_impacts(path)
    assert found == pytest.approx(HITS, abs=1e-3)
