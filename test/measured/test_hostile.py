"""
Damaged and hostile files: each is read, or refused in a line, in bounded time and memory.

`PYTHONPATH=test python -m measured.test_hostile COUNT [SEED]` tries as many of each format.
"""

import io
import os
import resource
import sys
import time
import warnings
import zipfile

import numpy as np
import pytest
from scipy.io import wavfile

from impact_damper_ros.fit.measured_motion import read_table_motion
from impact_damper_ros.measured.impacts import read_impacts
from impact_damper_ros.measured.random_motion import random_lines
from impact_damper_ros.measured.record import read_record
from impact_damper_ros.measured.sheet import TableError
from measured.test_laboratories import LABVIEW, MOTION, SEGMENT, TIME, UNIVERSAL, function, rows

#: Processor time of one file, s, and memory of all, bytes.
MOST_SECONDS, MOST_BYTES = 2.0, 500 * 2**20


def packed(text, method=zipfile.ZIP_DEFLATED):
    out = io.BytesIO()
    with zipfile.ZipFile(out, 'w', method) as archive:
        archive.writestr('Raw Data.csv', text)
    return out.getvalue()


def sound(kind=np.int16):
    out = io.BytesIO()
    noise = np.random.default_rng(1).normal(0.0, 0.01, 4000)
    noise[[1000, 2500]] = 0.9
    wavfile.write(out, 8000, (noise * 32767.0).astype(kind))
    return out.getvalue()


TEXT = 't [s];x [mm];force [N];note\n' + rows('{t:.4f};{x:.4f};{x:.1f};a').replace('.', ',')
CLOCK = 'time,"x [mm]",b [g]\n' + rows('2026-11-28 10:00:{s},"{x:.4f}",{x:.1f}') + 'EOF\n'
CHANNELS = SEGMENT.format(count=1, units='mm', start=0.0, names='Weg') + rows('{t:.3f}\t{x:.4f}')
STRONG = (
    'STRONG MOTION\nEVENT\nACCELERATION TIME SERIES IN UNITS OF G\nNPTS=  60, DT= .005 SEC\n'
    + '\n'.join(f'{x:15.7E}' for x in MOTION)
)
DENSITY = 'f [Hz],level [g^2/Hz],slope [dB/oct]\n3,,6\n5,1e-3,0\n5,2e-4,\n8,0,\n'
#: Suffix, content, and what reads it.
FORMATS = {
    'csv': ('csv', TEXT.encode(), read_table_motion),
    'utf-16': ('csv', TEXT.encode('utf-16'), read_table_motion),
    'dates': ('csv', CLOCK.encode(), read_table_motion),
    'record': ('csv', TEXT.encode(), lambda path: read_record(path, 'force')),
    'density': ('csv', DENSITY.encode(), random_lines),
    'times': ('csv', b'hits [ms]\n300\n700\n1200\n', read_impacts),
    'zip': ('zip', packed(TEXT), read_table_motion),
    'lzma': ('zip', packed(TEXT, zipfile.ZIP_LZMA), read_table_motion),
    'uff': ('uff', (UNIVERSAL + function(MOTION, 3)).encode(), read_table_motion),
    'lvm': ('lvm', (LABVIEW.format(columns='One') + CHANNELS).encode(), read_table_motion),
    'at2': ('at2', STRONG.encode(), lambda path: read_record(path, 'base')),
    'wav': ('wav', sound(), read_impacts),
}
#: What is put into a file.
PIECES = [
    *(
        b'"',
        b'""',
        b'\0',
        b'\n',
        b'\n\n\n',
        b';;;;',
        b',',
        b'.',
        b'nan',
        b'inf',
        b'1e999',
        b'-9999',
    ),
    *(b'[', b'(', b')]', b'\xff', b'\xe2\x88\x92', b'00:00:00', b'9999-99-99 0:0:0', b'#', b'-1'),
    *(b'99999999999', b'0', b'-', b' ', b'\t', b'1' * 400, b'x [mm],' * 50, b'g' * 300),
]


def altered(content, rng):
    """Return a content with one to four alterations."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        # Headers are short and have most that can go wrong
        end = len(content) if rng.random() < 0.6 else min(len(content), 200)
        start, long = int(rng.integers(0, end + 1)), int(rng.integers(1, 40))
        piece = bytes(content[start : start + long])
        kind = rng.integers(0, 5)
        if kind == 0:
            content[start : start + 1] = bytes([rng.integers(0, 256)])
        elif kind == 1:
            del content[start : start + long]
        elif kind == 2:
            content[start:start] = PIECES[rng.integers(0, len(PIECES))]
        elif kind == 3:
            content[start:start] = piece * int(rng.integers(1, 6))
        else:
            del content[start:]
    return bytes(content)


def judged(path, read):
    """Return what a reader says of a file: nothing, or one line; it is neither long nor large."""
    begin = time.process_time()
    try:
        # A warning would be a second line
        with warnings.catch_warnings():
            warnings.simplefilter('error')
            read(path)
        said = ''
    except ValueError as error:
        said = str(error)
        assert '\n' not in said
        assert len(said) < 3000
        assert path.name in said
    assert time.process_time() - begin < MOST_SECONDS
    return said


@pytest.mark.parametrize('name', FORMATS)
def test_altered_files(tmp_path, name):
    if name == 'uff':
        pytest.importorskip('pyuff')
    assert len(tried(tmp_path, name, 40, 1)) > 2


def tried(folder, name, count, seed):
    """Return how often each outcome came of altered files; the first word of a refusal is one."""
    suffix, content, read = FORMATS[name]
    rng = np.random.default_rng(seed)
    path = folder / f'file.{suffix}'
    path.write_bytes(content)
    assert judged(path, read) == ''
    outcomes = {'': 0}
    for _ in range(count):
        path.write_bytes(altered(content, rng))
        said = judged(path, read)
        outcomes[said[-40:]] = outcomes.get(said[-40:], 0) + 1
    return outcomes


HEAD = b't [s],x [mm]\n'


@pytest.mark.parametrize(
    ('content', 'problem'),
    [
        (b'', 'empty; give a header'),
        (b'\n' * 900_000, 'empty; give a header'),
        (HEAD + b'\n' * 900_000, '0 rows: give at least 2'),
        (HEAD + b' ' * 900_000, '0 rows: give at least 2'),
        (b'(' * 900_000, r'no column for the'),
        (b'\n' * 30_000_000, '30000000 lines: cut it'),
        (HEAD + b'0,' * 2_000_000, 'a line of more than 1000000 bytes'),
        (b't [s],' * 2000 + b'\n' + b'0,' * 2000, 'more than 1000 columns: leave some out'),
        (b'x [mm],' * 100_000 + b'\n' + b'0,' * 100_000, 'more than 1000 columns'),
        ((b'a [mm],b,' * 90_000 + b'\n') * 40, 'more than 1000 columns'),
        (HEAD + b'0,"1\n1,2\n', 'line 2: a quote that is not closed'),
        (HEAD + b'0,"' + b'x' * 200_000 + b'"\n1,2\n', 'line 2, column'),
        (HEAD + b'0,1\n' + b'1,' * 5 + b'\n', '6 cells below a header of 2'),
        (b'\x89PNG\0\1', 'no text: export the data as CSV'),
    ],
)
def test_hostile_tables(tmp_path, content, problem):
    path = tmp_path / 'file.csv'
    path.write_bytes(content)
    with pytest.raises(ValueError, match=problem):
        raise ValueError(judged(path, read_table_motion))


@pytest.mark.parametrize('read', [read_table_motion, read_impacts, random_lines])
def test_what_is_no_plain_file_is_not_opened(tmp_path, read):
    os.mkfifo(tmp_path / 'pipe.csv')
    (tmp_path / 'loop.csv').symlink_to('loop.csv')
    (tmp_path / 'zero.csv').symlink_to('/dev/zero')
    (tmp_path / 'pipe.wav').symlink_to('pipe.csv')
    for name, problem in (
        ('pipe.csv', 'not a regular file'),
        ('pipe.wav', 'not a regular file'),
        ('zero.csv', 'not a regular file'),
        ('', 'not a regular file'),
        ('loop.csv', 'cannot be read'),
        ('none.csv', 'cannot be read'),
        ('null\0.csv', 'cannot be read'),
    ):
        with pytest.raises(TableError, match=problem):
            read(tmp_path / name)


def test_archives(tmp_path):
    """One that is large unpacked is not unpacked, whatever it says of its size."""
    path = tmp_path / 'file.zip'
    bomb = packed(b'1,2\n' * 40_000_000, zipfile.ZIP_DEFLATED)
    good = packed(TEXT, zipfile.ZIP_STORED)
    at = good.index(b'PK\1\2')
    method = good[:8] + b'\x63\0' + good[10 : at + 10] + b'\x63\0' + good[at + 12 :]
    encrypted = good[:6] + b'\1' + good[7 : at + 8] + b'\1' + good[at + 9 :]
    for content, problem in (
        (bomb, '160000000 bytes unpacked: give at most 100000000'),
        (bomb.replace((160_000_000).to_bytes(4, 'little'), (9).to_bytes(4, 'little')), 'no .zip'),
        (good.replace(b'0,0050', b'0,0051', 1), 'no .zip file that can be read: Bad CRC'),
        (method, 'no .zip file .* compression method is not supported'),
        (encrypted, 'no .zip file .* is encrypted'),
        (good.replace(b'.csv', b'.txt'), r'0 tables \(none\): unpack it'),
    ):
        path.write_bytes(content)
        with pytest.raises(ValueError, match=problem):
            raise ValueError(judged(path, read_table_motion))


@pytest.mark.parametrize(
    ('place', 'value', 'problem'),
    [
        (22, b'\0\0', 'no sound that can be read'),
        (32, b'\0\0\0\0', 'no sound that can be read'),
        (24, b'\0\0\0\0\0\0\0\0', r'a rate of 0 Hz: from 1000 to 10000000'),
        (16, b'\xff\xff\xff\xff', 'no sound that can be read'),
        (20, b'\x63\0', 'no sound that can be read'),
    ],
)
def test_headers_of_sounds(tmp_path, place, value, problem):
    path = tmp_path / 'file.wav'
    content = sound()
    path.write_bytes(content[:place] + value + content[place + len(value) :])
    with pytest.raises(ValueError, match=problem):
        raise ValueError(judged(path, read_impacts))


@pytest.mark.parametrize('size', [b'\0\0\0\0', b'\xff\xff\xff\xff'])
@pytest.mark.parametrize('after', [b'', b'\0'])
def test_sounds_whose_size_was_never_written(tmp_path, size, after):
    """By a recorder that was ended, or one that streams; a part of a sample may come last."""
    whole, path = tmp_path / 'whole.wav', tmp_path / 'file.wav'
    content = sound()
    whole.write_bytes(content)
    path.write_bytes(content[:4] + size + content[8:40] + size + content[44:] + after)
    (times, _), (expected, _) = read_impacts(path), read_impacts(whole)
    assert times.tolist() == expected.tolist()


@pytest.mark.parametrize('value', [1.1e12, 1e300, np.inf])
def test_a_record_has_one_bound(tmp_path, value):
    path = tmp_path / 'big.csv'
    values = np.where(np.arange(60) == 30, value, 1.0)
    path.write_text('t [s],force [N]\n' + rows('{t:.3f},{x:.3e}', TIME, values))
    problem = (
        r'line 32, .*: give at most 1e\+12 N or m/s\^2' if np.isfinite(value) else 'no number'
    )
    with pytest.raises(TableError, match=problem):
        read_record(path, 'force')


if __name__ == '__main__':
    from pathlib import Path
    from tempfile import TemporaryDirectory

    number, first = int(sys.argv[1]), int((*sys.argv, '1')[2])
    with TemporaryDirectory() as held:
        for one in FORMATS:
            results = tried(Path(held), one, number, first)
            print(f'{one}: {results.pop("")} of {number} read, {len(results)} refusals')
    memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    print(f'{memory / 2**20:.0f} MB at most')
    assert memory < MOST_BYTES
