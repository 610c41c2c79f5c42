"""Sweeps: the same table however they are run, killed and resumed."""

import json
import math
import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pandas as pd
import pytest
from control.controlled_rigs import TRIAL, control
from rigs import BENCH
from small_disk import mounted

from impact_damper_ros import InitialConditions, Rig, RigParameters
from impact_damper_ros.sweep import (
    Grid,
    JournalError,
    MetadataError,
    Settling,
    WorkersError,
    execution,
    read_table,
    sweep,
)
from impact_damper_ros.sweep.execution import ProcessPool
from impact_damper_ros.sweep.journal import Journal, Progress, journal_path
from impact_damper_ros.sweep.steady_state import steady_state

pytest.importorskip('pyarrow')

RIG = RigParameters(gravity=0.0, force_frequencies=1.02)
START = InitialConditions(initial_primary_position=1.0)
BRIEF = Settling(cycles=300, watch=40, section=20)


def grid_of(rig=RIG, settling=BRIEF, follow='none', **axes):
    return Grid(rig, START, follow=follow, settling=settling, **axes)


#: Compressed air and elastic stops: ever more impacts.
PUMPED = RigParameters(air_force=0.3, gravity=0.0, gap=5.0)
ELASTIC = grid_of(
    PUMPED,
    Settling(cycles=100, watch=21, events=5000),
    **{'restitution_1=restitution_2': [0.5, 1]},
)
#: An ensemble, some of its rigs chaotic; rigs of their own; some with endless events; chains.
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


@pytest.fixture
def brief_tasks(monkeypatch):
    """Let tasks return after a rig, and ensembles after two."""
    monkeypatch.setattr(execution, '_SECONDS', 0.0)
    monkeypatch.setattr(execution, '_TOGETHER_HERE', 2)


class Shuffled(ThreadPoolExecutor):
    """An executor that finishes in an order of its own."""

    chance = random.Random(4)

    def submit(self, fn, /, *args):
        delay = self.chance.random() * 0.02
        return super().submit(lambda: (time.sleep(delay), fn(*args))[1])


@GRIDS
@pytest.mark.usefixtures('brief_tasks')
def test_table_does_not_depend_on_who_runs_it(grid, tmp_path):
    sweep(grid, tmp_path / 'alone.parquet')
    with Shuffled(3) as shuffled:
        sweep(grid, tmp_path / 'other.parquet', executor=shuffled)
    alone, other = (tmp_path / f'{name}.parquet' for name in ('alone', 'other'))
    assert alone.read_bytes() == other.read_bytes()


@GRIDS
@pytest.mark.usefixtures('brief_tasks')
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


def test_an_ensemble_has_the_motions_of_single_rigs():
    """Transients together; then the same motion, to the tolerance of the sweep."""
    settling = Settling(cycles=1000, watch=40)
    grid = grid_of(settling=settling, gap=np.linspace(12.0, 44.0, 9))
    table = sweep(grid)
    assert 6 <= table.settled.sum() < 9
    for row, gap in enumerate(grid.axes[0].values):
        alone = steady_state(Rig(RIG.replace(gap=gap), START, compiled=None), settling)
        assert table.settled[row] == alone['settled']
        if alone['settled']:
            assert table.motion[row] == alone['motion']
            assert table.stops[row] == alone['stops']
            assert table.x_max[row] == pytest.approx(alone['x_max'], rel=1e-7)
            multiplier = pytest.approx(alone['largest_multiplier'], rel=1e-6)
            assert table.largest_multiplier[row] == multiplier


def test_an_ensemble_with_several_forces_and_rest_on_a_stop():
    """Each force is an ensemble of its own; m rests on the stop at the ends of cycles."""
    rig = RigParameters(angle=1.5708, one_sided=True, gravity=1.0, damping=0.1, damper_mass=0.01)
    start = InitialConditions(initial_damper_offset=0.5)
    grid = Grid(rig, start, gap=[1.0, 1.2], force_amplitudes=[0.05, 0.1], settling=BRIEF)
    table = sweep(grid)
    assert list(table.motion) == ['without impacts'] * 4
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


@pytest.mark.parametrize('suffix', ['csv', 'parquet'])
def test_pandas_alone_reads_the_table(tmp_path, suffix):
    path = tmp_path / f'a.{suffix}'
    grid = grid_of(settling=Settling(watch=40), damping=[0.01, 2.5])
    table = sweep(grid, path)
    pd.testing.assert_frame_equal(read_table(path), table)
    assert read_table(path).attrs == table.attrs
    assert table.attrs['units']['x_max'] == 'm'
    assert table.attrs['descriptions']['lyapunov_exponent'].startswith('Largest Lyapunov exponent')
    assert Grid.from_inputs(table.attrs['inputs']) == grid
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
    assert plain.period[0] == 1
    assert plain.period.isna()[1]


def test_a_journal_of_other_inputs_is_refused(tmp_path):
    path = tmp_path / 'sweep.parquet'
    with Journal(journal_path(path), TOGETHER.inputs()) as journal:
        journal.add([(0, {'ok': False, 'reason': 'so'})])
    other = grid_of(RIG.replace(damping=0.02), gap=TOGETHER.axes[0].values)
    with pytest.raises(JournalError) as refused:
        sweep(other, path)
    assert 'holds 1 rigs of a sweep with other inputs' in str(refused.value)
    assert 'parameters.damping: 0.01 there, 0.02 here' in str(refused.value)
    table = sweep(other, path, overwrite=True)
    assert table.ok[0]
    with pytest.raises(MetadataError, match='is the table of a sweep with other inputs'):
        sweep(TOGETHER, path)


def test_a_journal_is_held_by_one_sweep_alone(tmp_path):
    path = tmp_path / 'sweep.parquet.part'
    with (
        Journal(path, TOGETHER.inputs()),
        pytest.raises(JournalError, match='in use by another sweep'),
    ):
        Journal(path, TOGETHER.inputs())


def test_a_file_that_is_no_journal_is_left_alone(tmp_path):
    path = tmp_path / 'sweep.parquet.part'
    for content in ('gap: 3\n', 'SQLite format 3\0' + 200 * 'x'):
        path.write_text(content)
        with pytest.raises(JournalError, match='is not the journal of a sweep'):
            Journal(path, TOGETHER.inputs())
        assert path.read_text() == content
    path.unlink()
    base = sqlite3.connect(path)
    base.execute('CREATE TABLE other (x)')
    base.close()
    with pytest.raises(JournalError, match='is not the journal of a sweep'):
        Journal(path, TOGETHER.inputs())


def test_a_full_disk_keeps_what_is_done(tmp_path):
    row = {'ok': True, 'section_x': list(np.linspace(0.0, 1.0, 200))}
    with mounted(tmp_path / 'disk', 128) as disk:
        path = disk / 'a.parquet.part'
        done = 0

        def fill(journal):
            nonlocal done
            for done in range(1000):
                journal.add([(done, row)], 0, Progress(done + 1, {'time': 1.0}))

        with (
            Journal(path, TOGETHER.inputs()) as journal,
            pytest.raises(OSError, match='No space left on device'),
        ):
            fill(journal)
        kept = path.read_bytes()
    assert done > 10
    (tmp_path / 'a.part').write_bytes(kept)
    with Journal(tmp_path / 'a.part', TOGETHER.inputs()) as journal:
        assert journal.points() == set(range(done))
        assert journal.chains()[0].place == done


WRITER = """
import sys
from pathlib import Path
from impact_damper_ros.sweep.journal import Journal, Progress
with Journal(Path(sys.argv[1]), {}) as journal:
    for number in range(10**6):
        rows = [(number * 10 + k, {'x': [0.5] * 2000, 'k': k}) for k in range(10)]
        journal.add(rows, 0, Progress(10 * number + 10, {'number': number}))
        print(number, flush=True)
"""


def test_a_journal_killed_while_it_writes_is_whole(tmp_path):
    """Each batch of rows is there with the progress of its chain, or not at all."""
    path = tmp_path / 'a.part'
    for last in (3, 7):
        path.unlink(missing_ok=True)
        process = subprocess.Popen(
            [sys.executable, '-c', WRITER, str(path)], stdout=subprocess.PIPE, text=True
        )
        with process:
            said = -1
            while said < last:
                said = int(process.stdout.readline())
            process.kill()
        with Journal(path, {}) as journal:
            points, (progress,) = journal.points(), journal.chains().values()
            assert progress.place == len(points) >= 10 * (said + 1)
            assert points == set(range(len(points)))
            assert progress.state == {'number': len(points) // 10 - 1}


def test_killed_processes_are_replaced(monkeypatch):
    """A worker is killed as soon as the first rigs are back."""
    grid = grid_of(settling=Settling(cycles=600, watch=40), gap=np.linspace(2.0, 14.0, 40))
    alone = sweep(grid)
    victims = []

    class Watched(ProcessPool):
        def submit(self, *args):
            future = super().submit(*args)
            Watched.last = self
            return future

    monkeypatch.setattr(execution, 'ProcessPool', Watched)

    def kill(done):
        if done and not victims:
            victims.append(next(iter(Watched.last._processes.values())))
            os.kill(victims[0].pid, signal.SIGKILL)

    killed = sweep(grid, jobs=2, progress=kill)
    assert victims[0].exitcode == -signal.SIGKILL
    pd.testing.assert_frame_equal(killed, alone)


class Deadly:
    """Processes that die whatever they do."""

    def __init__(self, *_):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def submit(self, *_):
        future = Future()
        future.set_exception(BrokenProcessPool('a process ended'))
        return future


def test_processes_that_always_die_end_the_sweep(monkeypatch):
    monkeypatch.setattr(execution, 'ProcessPool', Deadly)
    with pytest.raises(
        WorkersError, match='5 times in a row a process died before a rig was done'
    ):
        sweep(TOGETHER, jobs=2)


def test_another_version_on_a_worker_ends_the_sweep(monkeypatch):
    monkeypatch.setattr('impact_damper_ros.__version__', '0.0.1')
    with ProcessPool(1) as pool, pytest.raises(WorkersError, match=r'sweep is of version 0\.0\.1'):
        sweep(grid_of(gap=[20, 30]), executor=pool)


def test_air_acts_from_the_stop_hit_last_after_a_transient_of_many():
    """An ensemble restarts its rigs from states that do not say which stop that was."""
    rig = BENCH.replace(one_sided=True, angle=1.2, air_force=0.5, force_amplitudes=0.6)
    grid = Grid(rig, settling=BRIEF, restitution_1=[0.1, 0.4])
    table = sweep(grid)
    for row, value in zip(table.itertuples(), grid.axes[0].values, strict=True):
        alone = steady_state(Rig(rig.replace(restitution_1=value), compiled=None), BRIEF)
        assert (row.motion, row.stops) == (alone['motion'], alone['stops'])
        assert row.x_max == pytest.approx(alone['x_max'], rel=1e-7)
    assert (table.impacts_per_cycle > 0.0).all()


def test_one_start_beyond_a_stop_is_one_row():
    grid = Grid(RIG, settling=BRIEF, initial_damper_offset=[-20.0, 0.0, 20.0])
    for jobs in (1, 2):
        table = sweep(grid, jobs=jobs)
        assert list(table.ok) == [False, True, False]
        assert 'm must start between the stops' in table.reason[0]


def test_a_csv_without_impacts_reads_back_equal(tmp_path):
    """In a CSV file an empty text and a missing one look alike."""
    grid = grid_of(gap=[30.0, 1e4], damping=[0.2, 2.5])
    table = sweep(grid, tmp_path / 'a.csv')
    assert '' in list(table.stops.dropna())
    assert table.stops.isna().any()
    pd.testing.assert_frame_equal(read_table(tmp_path / 'a.csv'), table)


def test_nothing_is_left_beside_a_table(tmp_path):
    left = tmp_path / 'a.parquet.part-journal'
    left.write_bytes(bytes(512))
    sweep(grid_of(gap=[30.0]), tmp_path / 'a.parquet')
    assert [path.name for path in tmp_path.iterdir()] == ['a.parquet']


def test_what_cannot_be_swept_is_refused_at_once(tmp_path):
    with pytest.raises(ValueError, match='jobs is 0: give a whole number from 1 to'):
        sweep(TOGETHER, jobs=0)
    with pytest.raises(FileNotFoundError) as refused:
        sweep(TOGETHER, tmp_path / 'none' / 'a.csv')
    assert refused.value.filename == str(tmp_path / 'none')


def test_a_journal_whose_texts_are_damaged(tmp_path):
    path = tmp_path / 'a.parquet'
    with Journal(journal_path(path), TOGETHER.inputs()):
        pass
    base = sqlite3.connect(journal_path(path))
    base.execute("UPDATE sweep SET inputs = CAST(x'FFFE8080' AS TEXT)")
    base.commit()
    base.close()
    with pytest.raises(JournalError, match='or damaged'):
        sweep(TOGETHER, path)
