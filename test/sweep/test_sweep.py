"""Sweeps: the same table however they are run, killed and resumed."""

import json
import math
import os
import random
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from control.controlled_rigs import TRIAL, control
from rigs import OFF_RESONANCE

from impact_damper_ros import InitialConditions, RigParameters
from impact_damper_ros.sweep import (
    Grid,
    GridError,
    MetadataError,
    Settling,
    WorkersError,
    grid as grid_module,
    read_table,
    sweep,
)
from impact_damper_ros.sweep.execution import rig_row
from impact_damper_ros.sweep.part_file import PartFile, part_path

pytest.importorskip('pyarrow')

START = InitialConditions(initial_primary_position=1.0)
BRIEF = Settling(cycles=300, watch=40, section=20)


def grid_of(rig=OFF_RESONANCE, settling=BRIEF, follow='none', **axes):
    return Grid(rig, START, follow=follow, settling=settling, **axes)


#: Compressed air and elastic stops: ever more impacts.
PUMPED = RigParameters(air_force=0.3, gravity=0.0, gap=5.0)
ELASTIC = grid_of(
    PUMPED,
    Settling(cycles=100, watch=21, events=5000),
    **{'restitution_1=restitution_2': [0.5, 1]},
)
#: Some of the rigs chaotic; some with endless events; chains.
TOGETHER = grid_of(gap=np.linspace(1.0, 40.0, 14))
APART = grid_of(force_frequencies=np.linspace(1.0, 1.2, 9))
FOLLOWED = grid_of(follow='both', gap=np.linspace(6.0, 30.0, 9), restitution_1=[0.7, 0.75])
#: The same under gap control, from a smallest gap that cannot be on.
CONTROLLED, CONTROLLED_CHAINS = (
    Grid(
        TRIAL,
        START,
        control('timed', gap_control_rate=16 / math.tau, **law),
        follow=follow,
        settling=Settling(cycles=60, watch=21, section=10),
        **axes,
    )
    for law, follow, axes in (
        ({}, 'none', {'gap_min': [0.1, 2e3], 'force_amplitudes': [0.5, 1]}),
        ({'actuator_delay': 0.1}, 'both', {'gap_control_park': [1.2, 1.5]}),
    )
)
GRIDS = pytest.mark.parametrize(
    'grid',
    [TOGETHER, APART, ELASTIC, FOLLOWED, CONTROLLED, CONTROLLED_CHAINS],
    ids=['together', 'apart', 'elastic', 'followed', 'controlled', 'controlled chains'],
)


class Shuffled(ThreadPoolExecutor):
    """An executor that finishes in an order of its own."""

    chance = random.Random(4)

    def submit(self, fn, /, *args):
        delay = self.chance.random() * 0.02
        return super().submit(lambda: (time.sleep(delay), fn(*args))[1])


@GRIDS
def test_table_does_not_depend_on_who_runs_it(grid, tmp_path):
    sweep(grid, tmp_path / 'alone.parquet')
    with Shuffled(3) as shuffled:
        sweep(grid, tmp_path / 'other.parquet', executor=shuffled)
    sweep(grid, tmp_path / 'threads.parquet', jobs=2)
    alone, *others = (
        (tmp_path / f'{n}.parquet').read_bytes() for n in ('alone', 'other', 'threads')
    )
    assert others == [alone, alone]


@GRIDS
def test_interrupted_sweeps_resume_where_they_were(grid, tmp_path):
    whole = sweep(grid)
    path = tmp_path / 'cut.parquet'

    class Stop(BaseException):
        pass

    counts = []

    def stop_after_one(count):
        counts.append(count)
        if count > counts[0]:
            raise Stop

    for _ in range(3):
        counts.clear()
        try:
            sweep(grid, path, progress=stop_after_one)
        except Stop:
            # Nothing is run twice: the next one begins where this one ended
            begun, *_, ended = counts
            assert begun < ended <= begun + 2
    counts.clear()
    table = sweep(grid, path)
    pd.testing.assert_frame_equal(table, whole)
    assert sorted(p.name for p in tmp_path.iterdir()) == ['cut.parquet']


def test_rigs_that_rest_on_a_stop_at_the_ends_of_cycles():
    rig = RigParameters(angle=1.5708, one_sided=True, gravity=1.0, damping=0.1, damper_mass=0.01)
    start = InitialConditions(initial_damper_offset=0.5)
    grid = Grid(rig, start, gap=[1.0, 1.2], force_amplitudes=[0.05, 0.1], settling=BRIEF)
    table = sweep(grid)
    assert list(table.kind) == ['without impacts'] * 4
    assert list(table.rest_share) == [1.0, 1.0] * 2
    # Both masses swing as one
    joint = rig.replace(primary_mass=1.01, damper_mass=1e-9, force_amplitudes=0.05)
    assert table.x_max[0] - abs(table.x_mean[0]) == pytest.approx(
        joint.response_amplitude, rel=1e-6
    )


def test_rigs_with_endless_events_are_rows_with_a_reason():
    table = sweep(ELASTIC)
    assert list(table.ok) == [True, False]
    assert 'allow more events, or make the stops less elastic' in table.reason[1]
    assert table.x_max.isna()[1]
    assert table.attractor.isna()[1]
    assert table.attractor[0] == 0


def test_rigs_out_of_range_are_rows_and_do_not_break_a_chain():
    """Twice the critical damping cannot be; those that follow start from the last that could."""
    grid = grid_of(follow='up', damping=[0.01, 2.5], gap=[30.0])
    table = sweep(grid)
    assert list(table.ok) == [True, False]
    assert 'damping is 2.5' in table.reason[1]
    grid = grid_of(follow='down', damping=[0.01, 2.5], gap=[30.0])
    assert list(sweep(grid).ok) == [True, False]


def test_a_programming_error_ends_the_sweep(monkeypatch):
    def fail(*_, **__):
        raise AssertionError('a state that cannot be')

    monkeypatch.setattr('impact_damper_ros.sweep.execution.steady_state', fail)
    for grid in (TOGETHER, FOLLOWED):
        with pytest.raises(AssertionError, match='a state that cannot be'):
            sweep(grid)


def upgraded_from_made_up(inputs):
    """Return inputs from those of a made-up format before, which called the axes otherwise."""
    inputs = dict(inputs)
    return {**inputs, 'axes': inputs.pop('varied')}


def test_a_table_of_an_earlier_format_is_read(tmp_path, monkeypatch):
    path = tmp_path / 'a.csv'
    grid = grid_of(settling=Settling(watch=40), damping=[0.01, 2.5])
    table = sweep(grid, path)
    text = path.read_text()
    assert text.count('"axes"') == 1
    upgrades = (*grid_module.UPGRADES, upgraded_from_made_up)
    monkeypatch.setattr(grid_module, 'UPGRADES', upgrades)
    path.write_text(text.replace('"axes"', '"varied"'))
    old = read_table(path)
    assert old.attrs['inputs'] == table.attrs['inputs'] | {'format': 1 + len(upgrades)}
    pd.testing.assert_frame_equal(old, table)
    path.write_text(text.replace('"format": ', '"format": 7'))
    with pytest.raises(MetadataError, match=r'a sweep of format 7\d; .* that made it, or a later'):
        read_table(path)


@pytest.mark.parametrize('suffix', ['csv', 'parquet'])
def test_pandas_alone_reads_the_table(tmp_path, suffix):
    path = tmp_path / f'a.{suffix}'
    grid = grid_of(settling=Settling(watch=40), damping=[0.01, 2.5])
    table = sweep(grid, path)
    assert table.attrs['units']['x_max'] == 'm'
    assert table.attrs['descriptions']['lyapunov_exponent'].startswith('Largest Lyapunov exponent')
    assert Grid.from_inputs(table.attrs['inputs']) == grid
    pd.testing.assert_frame_equal(read_table(path), table)
    part_path(path).write_text('left by a process that was killed')
    pd.testing.assert_frame_equal(sweep(grid, path), table)
    assert [one.name for one in tmp_path.iterdir()] == [path.name]
    if suffix == 'csv':
        plain = pd.read_csv(path, comment='#')
        assert json.loads(plain.section_x[0]) == pytest.approx(list(table.section_x[0]))
    else:
        plain = pd.read_parquet(path)
        assert plain.attrs == table.attrs
        assert list(plain.section_x[0]) == list(table.section_x[0])
    assert list(plain.columns) == list(table.columns)
    assert list(plain.ok) == [True, False]
    assert list(plain.x_max) == pytest.approx(list(table.x_max), nan_ok=True)
    assert plain.cycles[0] == 1
    assert plain.cycles.isna()[1]


def test_a_process_that_dies_ends_the_sweep(caplog):
    law, settling = control('timed', gap_control_rate=1.0), Settling(cycles=1, watch=21)
    grid = Grid(TRIAL, START, law, 'sweep.deadly_law:law', settling=settling, gap=[20.0, 21.0])
    with pytest.raises(
        WorkersError, match=r'a process died .*: is there enough memory\? Give few'
    ):
        sweep(grid, jobs=2)
    assert 'law is plain Python, which takes one processor: the rigs run in 2' in caplog.text


def test_another_version_on_a_worker_ends_the_sweep(monkeypatch):
    monkeypatch.setattr('impact_damper_ros.__version__', '0.0.1')
    with (
        ProcessPoolExecutor(1, get_context('spawn')) as pool,
        pytest.raises(WorkersError, match=r'sweep is of version 0\.0\.1'),
    ):
        sweep(grid_of(gap=[20, 30]), executor=pool)


def test_one_start_beyond_a_stop_is_one_row():
    grid = Grid(OFF_RESONANCE, settling=BRIEF, initial_damper_offset=[-20.0, 0.0, 20.0])
    for jobs in (1, 2, None):
        table = sweep(grid, jobs=jobs)
        assert list(table.ok) == [False, True, False]
        assert 'm must start between the stops' in table.reason[0]


def test_rigs_with_a_law_in_plain_python_run_in_processes(tmp_path, monkeypatch, capfd):
    """And the table is the same; what the package logs is left to this process."""
    monkeypatch.syspath_prepend(tmp_path)
    law, settling = control('timed', gap_control_rate=1.0), Settling(cycles=2, watch=21)
    source = (
        'import logging, os\nfrom pathlib import Path\n'
        'def law(seen, memory):\n'
        '    logging.getLogger("impact_damper_ros.rig").warning("this takes long")\n'
        f'    Path({str(tmp_path)!r}, f"{{os.getpid()}}.ran").touch()\n'
        '    return 9.0, -9.0\n'
    )
    (tmp_path / 'plain_law.py').write_text(source)
    monkeypatch.setenv('PYTHONPATH', str(tmp_path), prepend=os.pathsep)
    grid = Grid(TRIAL, START, law, 'plain_law:law', settling=settling, gap=[20.0, 21.0, 22.0])
    table = sweep(grid, jobs=2)
    ran = {one.name for one in tmp_path.glob('*.ran')}
    assert ran
    assert f'{os.getpid()}.ran' not in ran
    assert 'this takes long' not in capfd.readouterr().err
    pd.testing.assert_frame_equal(table, sweep(grid, jobs=1))


def test_a_file_is_replaced_by_rigs_that_are_run_anew(tmp_path):
    path, grid = tmp_path / 'a.csv', grid_of(settling=Settling(watch=40), damping=[0.01, 2.5])
    sweep(grid, path)
    whole = path.read_bytes()
    for text in (whole.replace(b'12', b'21'), whole[:-300], b'mine'):
        for name in (path, part_path(path)):
            name.write_bytes(text)
        sweep(grid, path, overwrite=True)
        assert path.read_bytes() == whole
        assert not part_path(path).exists()
    # What was begun with it is resumed
    with PartFile(part_path(path), grid.inputs()) as part:
        part.add([(0, rig_row(grid.setup, grid.settings(grid.values(0)))[0])], None)
    counts = []
    sweep(grid, path, overwrite=True, progress=counts.append)
    assert (counts[0], path.read_bytes()) == (1, whole)


def test_a_law_whose_source_has_changed_is_another_sweep(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / 'a.parquet'
    law, few = control('timed', gap_control_rate=1.0), Settling(cycles=2, watch=21)

    def grid():
        sys.modules.pop('changing_law', None)
        return Grid(TRIAL, START, law, 'changing_law:law', settling=few, gap=[20.0, 21.0])

    def write(half):
        text = f'def law(seen, memory):\n    return {half}, -{half}\n'
        Path('changing_law.py').write_text(text)

    write(9.0)
    begun = grid()
    table = sweep(begun, path)
    write(2.25)
    with pytest.raises(MetadataError, match=r'law_digest: "\w+" there, "\w+" here'):
        sweep(grid(), path)
    # The table of a law that is no longer there is read
    pd.testing.assert_frame_equal(read_table(path), table)
    other = sweep(grid(), path, overwrite=True)
    assert (other.x_max != table.x_max).all()
    with pytest.raises(WorkersError, match='changing_law:law is not the one that the sweep began'):
        sweep(begun)
    with pytest.raises(GridError, match='moves no stops, since gap_control is off'):
        Grid(TRIAL, START, law='changing_law:law', gap=[20.0, 21.0])


def test_what_cannot_be_swept_is_refused_at_once(tmp_path):
    for jobs in (0, 2.5, 1025):
        with pytest.raises(ValueError, match=r'jobs is .*: give a whole number from 1 to 1024'):
            sweep(TOGETHER, jobs=jobs)
    with pytest.raises(FileNotFoundError) as refused:
        sweep(TOGETHER, tmp_path / 'none' / 'a.csv')
    assert refused.value.filename == str(tmp_path / 'none')
