"""The finished rigs of a sweep, in lines: cut off, damaged, locked, of another sweep."""

import json
import os

import numpy as np
import pytest
from running import Running
from small_disk import mounted

from impact_damper_ros import RigParameters
from impact_damper_ros.sweep import Grid, MetadataError, sweep
from impact_damper_ros.sweep.part_file import PartFile

GRID = Grid(RigParameters(gravity=0.0), gap=np.linspace(1.0, 40.0, 14))
INPUTS = GRID.inputs()
ROW = {'ok': True, 'x_max': 0.1, 'lyapunov_exponent': -float('inf'), 'section_x': [1e-300, -0.0]}


def held(path, inputs=INPUTS, **options):
    """Return the rigs that a file holds, and the state after the second one."""
    with PartFile(path, inputs, **options) as part:
        return part.rows, part.left_of(range(3))


def test_rows_come_back_to_the_bit(tmp_path):
    path = tmp_path / 'a.part'
    with PartFile(path, INPUTS) as part:
        part.add([(0, ROW), (1, ROW)], {'time': 0.1})
    rows, left = held(path)
    assert rows == {0: ROW, 1: ROW}
    assert str(rows[0]) == str(ROW)
    assert (list(left[0]), left[1]) == ([2], {'time': 0.1})


def test_a_line_that_was_cut_off_is_run_again(tmp_path):
    path = tmp_path / 'a.part'
    with PartFile(path, INPUTS) as part:
        for point in range(3):
            part.add([(point, ROW)], None)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        lines = whole[:length].count(b'\n')
        with PartFile(path, INPUTS) as part:
            assert set(part.rows) == set(range(max(0, lines - 1)))
            for point in range(len(part.rows), 3):
                part.add([(point, ROW)], None)
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    'content', ['gap: 3\n', 'SQLite format 3\0\n', '[1]\n', '{"axes":{}}\nx\n[]\n']
)
def test_a_foreign_file_is_left_alone(tmp_path, content):
    path = tmp_path / 'a.part'
    path.write_text(content)
    with pytest.raises(MetadataError, match='does not hold the rigs of a sweep, or is damaged'):
        PartFile(path, INPUTS)
    assert path.read_text() == content


def test_what_is_no_ordinary_file_is_left_alone(tmp_path):
    """A pipe would be waited for without end."""
    os.mkfifo(tmp_path / 'a.parquet.part')
    with pytest.raises(MetadataError, match='is not an ordinary file: move it away'):
        sweep(GRID, tmp_path / 'a.parquet')
    os.mkfifo(tmp_path / 'b.parquet')
    for overwrite in (False, True):
        with pytest.raises(MetadataError, match='is not an ordinary file: give another output'):
            sweep(GRID, tmp_path / 'b.parquet', overwrite=overwrite)


def test_rigs_of_another_sweep_are_refused(tmp_path):
    path = tmp_path / 'a.part'
    with PartFile(path, INPUTS) as part:
        part.add([(0, ROW)], None)
    other = json.loads(json.dumps(INPUTS))
    other['parameters']['damping'] = 0.02
    with pytest.raises(MetadataError) as refused:
        PartFile(path, other)
    assert 'holds 1 rigs of a sweep with other inputs' in str(refused.value)
    assert 'parameters.damping: 0.01 there, 0.02 here' in str(refused.value)
    assert held(path)[0] == {0: ROW}
    assert held(path, other, anew=True)[0] == {}


def test_a_file_is_held_by_one_sweep_alone(tmp_path):
    path = tmp_path / 'a.part'
    with PartFile(path, INPUTS), pytest.raises(MetadataError, match='in use by another sweep'):
        PartFile(path, INPUTS)


def test_a_full_disk_keeps_what_is_done(tmp_path):
    row = {**ROW, 'section_x': list(np.linspace(0.0, 1.0, 200))}
    with mounted(tmp_path / 'disk', 128) as disk:
        path = disk / 'a.part'
        done = 0

        def fill(part):
            nonlocal done
            for done in range(1000):
                part.add([(done, row)], {'time': 1.0})

        with (
            PartFile(path, INPUTS) as part,
            pytest.raises(OSError, match='No space left on device'),
        ):
            fill(part)
        assert held(path)[0].keys() == set(range(done))
    assert done > 10


WRITER = """
import json, sys
from pathlib import Path
from impact_damper_ros.sweep.part_file import PartFile
with PartFile(Path(sys.argv[1]), json.loads(sys.argv[2])) as part:
    for number in range(10**6):
        part.add([(number, {'x': [0.5] * 20000})], {'number': number})
        print(number, flush=True)
"""


def test_a_file_whose_writer_is_killed_is_whole(tmp_path):
    path = tmp_path / 'a.part'
    with Running(tmp_path, '-c', WRITER, path, json.dumps(INPUTS)) as process:
        process.until(lambda: '\n5\n' in process.output)
    rows, _ = held(path)
    assert set(rows) == set(range(len(rows)))
    assert len(rows) > 5
