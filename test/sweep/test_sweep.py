"""Sweeps: the same table however they are run, cut short and taken up again."""

import json
import os
import signal
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from sweep.made_tables import Shuffled, table_of

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits.settling import Settling
from impact_damper_ros.rig import InitialConditions, RigParameters
from impact_damper_ros.sweep.execution import LocalWorkers, WorkersError, rig_row
from impact_damper_ros.sweep.journal import Done, Journal, JournalError, journal_path
from impact_damper_ros.sweep.plan import Follow, SweepPlan, axis_from_text
from impact_damper_ros.sweep.steady_state import steady_state
from impact_damper_ros.sweep.table import SweepTable

pytest.importorskip('pyarrow')

RIG = RigParameters(gravity=0.0, force_frequencies=1.02)
START = InitialConditions(initial_primary_position=1.0)
BRIEF = Settling(cycles=300, watch=40, section=20)


def plan_of(*ranges, rig=RIG, start=START, follow=Follow.NONE, settling=BRIEF):
    axes = tuple(axis_from_text(text, rig) for text in ranges)
    return SweepPlan(rig, start, axes, follow, settling)


def plan_with(value, *ranges, **others):
    """Return a plan with a value more on its first axis, which the command would refuse."""
    plan = plan_of(*ranges, **others)
    first = replace(plan.axes[0], values=tuple(sorted((value, *plan.axes[0].values))))
    return replace(plan, axes=(first, *plan.axes[1:]))


#: Compressed air and elastic stops: ever more impacts.
PUMPED = RigParameters(air_force=0.3, gravity=0.0, gap=5.0)
LITTLE = Settling(cycles=100, watch=21, events=5000)
#: From a gap that cannot be to one of another motion; some chaotic.
MIXED = plan_with(-2.0, 'gap=1:40:14')
FOLLOWED = plan_of('gap=6:30:9', 'restitution_1=0.7,0.75', follow=Follow.BOTH)


@pytest.mark.parametrize('plan', [MIXED, FOLLOWED], ids=['independent', 'followed'])
def test_table_does_not_depend_on_who_runs_it(plan, tmp_path):
    alone = table_of(plan, tmp_path / 'alone.parquet')
    shuffled = Shuffled()
    with shuffled.pool:
        assert table_of(plan, tmp_path / 'other.parquet', shuffled, at_once=5) == alone


@pytest.mark.parametrize('plan', [MIXED, FOLLOWED], ids=['independent', 'followed'])
def test_interrupted_sweeps_go_on_where_they_were(plan, tmp_path, monkeypatch):
    """Cut short again and again, each time after two rigs, in a line that is half written."""
    monkeypatch.setattr('impact_damper_ros.sweep.execution._SECONDS', 0.0)
    whole = table_of(plan, tmp_path / 'whole.parquet')
    path = tmp_path / 'cut.parquet'
    part = journal_path(path)
    done = 0

    def stop_after_two(count):
        nonlocal done
        done += count
        if done >= 2:
            raise KeyboardInterrupt

    for _ in range(3):
        done = 0
        with pytest.raises(KeyboardInterrupt):
            table_of(plan, path, progress=stop_after_two)
        with part.open('ab') as stream:
            stream.write(b'{"point":3,"row":{"ok":tr')
    finished = [json.loads(line)['point'] for line in part.read_bytes().splitlines()[1:-1]]
    assert len(finished) == len(set(finished)) == 6
    assert table_of(plan, path) == whole


def test_a_journal_that_lacks_the_last_state_of_a_chain(tmp_path, monkeypatch):
    """As a kill in the middle of a long write leaves it: rows without the state after them."""
    monkeypatch.setattr('impact_damper_ros.sweep.execution._SECONDS', 0.0)
    whole = table_of(FOLLOWED, tmp_path / 'whole.parquet')
    path = tmp_path / 'cut.parquet'

    def stop(_):
        raise KeyboardInterrupt

    for _ in range(3):
        with pytest.raises(KeyboardInterrupt):
            table_of(FOLLOWED, path, progress=stop)
    part = journal_path(path)
    *lines, last = part.read_bytes().splitlines(keepends=True)
    entry = json.loads(last)
    assert entry.pop('state')
    part.write_bytes(b''.join([*lines, json.dumps(entry).encode() + b'\n']))
    assert table_of(FOLLOWED, path) == whole


def test_a_failing_rig_is_a_row_with_its_reason(tmp_path):
    table_of(MIXED, tmp_path / 'mixed.parquet')
    table = pd.read_parquet(tmp_path / 'mixed.parquet')
    assert list(table.gap) == list(np.linspace(-2.0, 40.0, 15))
    assert list(table.ok) == [False] + [True] * 14
    assert table.reason[0] == 'gap is -2.0 m: give a number from 1e-09 to 1e+09 m'
    assert pd.isna(table.x_max[0])
    assert pd.isna(table.attractor[0])
    assert table.reason[1:].isna().all()
    assert (table.attractor[1:] == 0).all()


def test_a_rig_with_endless_events_is_a_row(tmp_path):
    plan = plan_of('restitution_1=restitution_2=0.5,1', rig=PUMPED, settling=LITTLE)
    table_of(plan, tmp_path / 'elastic.parquet')
    table = pd.read_parquet(tmp_path / 'elastic.parquet')
    assert list(table.ok) == [True, False]
    assert 'allow more events, or make the stops less elastic' in table.reason[1]


def test_a_failing_rig_does_not_break_a_chain(tmp_path):
    """Those that follow take over the state of the last one that could be run."""
    plan = plan_with(1.2, 'restitution_1=0.7,0.75,0.8', follow=Follow.UP)
    table_of(plan, tmp_path / 'chain.parquet')
    table = SweepTable(tmp_path / 'chain.parquet')
    assert list(table.flags('ok')) == [True, True, True, False]
    plan = plan_of('restitution_1=0.7,0.8', follow=Follow.UP)
    settings = plan.settings(plan.point(1).values)
    row, state = rig_row(plan.setup, plan.settings(plan.point(0).values))
    assert row['x_max'] == table.numbers('x_max')[0]
    following, _ = rig_row(plan.setup, settings, state)
    assert following['settled']
    # From the motion next to it a rig settles sooner than from X = 1
    fresh, _ = rig_row(plan.setup, settings)
    assert following['x_max'] == pytest.approx(fresh['x_max'], rel=1e-6)
    assert following['settling_cycles'] <= fresh['settling_cycles']


def test_following_up_and_down_shows_hysteresis(tmp_path):
    """At a gap of 52 the rig keeps two impacts per cycle, or none, whichever it had."""
    plan = plan_of('gap=44,52,100', follow=Follow.BOTH, settling=Settling(cycles=1500))
    table_of(plan, tmp_path / 'both.parquet')
    table = pd.read_parquet(tmp_path / 'both.parquet').set_index(['direction', 'gap'])
    up, down = table.loc['up'], table.loc['down']
    assert up.stops.loc[44.0] == up.stops.loc[52.0] == '1,2'
    assert down.motion.loc[100.0] == down.motion.loc[52.0] == 'without impacts'
    assert down.x_max_ratio.loc[52.0] == pytest.approx(1.0, rel=1e-6)
    assert up.x_max_ratio.loc[52.0] < 0.12
    assert down.stops.loc[44.0] == '1,2'
    assert down.x_max.loc[44.0] == pytest.approx(up.x_max.loc[44.0], rel=1e-6)


def test_table_tells_units_meanings_and_inputs(tmp_path):
    path = tmp_path / 'mixed.parquet'
    table_of(MIXED, path)
    import pyarrow.parquet as pq

    schema = pq.read_schema(path)
    field = schema.field('lyapunov_exponent')
    assert field.metadata[b'unit'] == b'1/s'
    assert field.metadata[b'description'].startswith(b'Largest Lyapunov exponent')
    assert schema.field('gap').metadata[b'unit'] == b'm'
    assert all(f.metadata[b'description'] for f in schema)
    table = pd.read_parquet(path)
    assert table.attrs['units']['x_max'] == 'm'
    assert table.attrs['inputs'] == MIXED.inputs()
    assert SweepTable(path).plan == MIXED
    state = steady_state(Rig(RIG.replace(gap=37.0), START, compiled=None), BRIEF)
    row = table[table.gap == 37.0].iloc[0]
    assert row.x_max == state.x_max
    assert row.lyapunov_exponent == state.exponent.value
    assert list(row.section_x) == list(state.section[:, 0])
    assert list(row.impact_stop) == list(state.hits[:, 0])


def test_table_reads_as_an_xarray_dataset(tmp_path):
    pytest.importorskip('xarray')
    plan = plan_of('gap=24,30', 'restitution_1=0.7,0.75', 'friction=0,0.1')
    table_of(plan, tmp_path / 'grid.parquet')
    table = pd.read_parquet(tmp_path / 'grid.parquet')
    grid = table.set_index(['gap', 'restitution_1', 'friction']).x_max.to_xarray()
    assert grid.shape == (2, 2, 2)
    assert grid.sel(gap=30.0, restitution_1=0.75, friction=0.0) == table.x_max[6]


def test_a_journal_of_other_inputs_is_refused(tmp_path):
    path = tmp_path / 'sweep.parquet.part'
    with Journal(path, MIXED.inputs()) as journal:
        journal.add([Done(0, {'ok': False, 'reason': 'so'}, None)])
    other = plan_with(-2.0, 'gap=1:40:14', rig=RIG.replace(damping=0.02))
    with pytest.raises(JournalError) as refused:
        Journal(path, other.inputs())
    assert 'holds 1 rigs of a sweep with other inputs' in str(refused.value)
    assert 'parameters.damping: 0.01 there, 0.02 here' in str(refused.value)
    with Journal(path, MIXED.inputs()) as journal:
        assert journal.row(0) == {'ok': False, 'reason': 'so'}
    with Journal(path, other.inputs(), anew=True) as journal:
        assert not journal.points


def test_a_journal_is_held_by_one_sweep_alone(tmp_path):
    path = tmp_path / 'sweep.parquet.part'
    with (
        Journal(path, MIXED.inputs()),
        pytest.raises(JournalError, match='in use by another sweep'),
    ):
        Journal(path, MIXED.inputs())


def test_a_damaged_journal_says_in_which_line(tmp_path):
    path = tmp_path / 'sweep.parquet.part'
    with Journal(path, MIXED.inputs()) as journal:
        journal.add([Done(0, {'ok': False, 'reason': 'so'}, None)])
    path.write_bytes(path.read_bytes() + b'{"point":}\n')
    with pytest.raises(JournalError, match='damaged in line 3: delete this line'):
        Journal(path, MIXED.inputs())
    path.write_text('gap: 3\n')
    with pytest.raises(JournalError, match='is not the journal of a sweep'):
        Journal(path, MIXED.inputs())


def test_killed_processes_are_replaced(tmp_path):
    """A worker is killed as soon as the first rigs are back."""
    plan = plan_of('gap=2:14:40', settling=Settling(cycles=600, watch=40))
    alone = table_of(plan, tmp_path / 'alone.parquet')
    victims = []
    with LocalWorkers(2) as workers:

        def kill(_):
            if not victims:
                victims.append(next(iter(workers._pool._processes.values())))
                os.kill(victims[0].pid, signal.SIGKILL)

        killed = table_of(
            plan,
            tmp_path / 'killed.parquet',
            workers,
            at_once=4,
            losses=workers.losses,
            progress=kill,
        )
        assert victims[0].exitcode == -signal.SIGKILL
    assert killed == alone


class Deadly:
    """An executor whose workers die whatever they do."""

    def submit(self, *_):
        future = Future()
        future.set_exception(BrokenProcessPool('a process ended'))
        return future


def test_workers_that_always_die_end_the_sweep(tmp_path):
    with pytest.raises(WorkersError, match=r'5 workers in a row died .* rigs 0 to'):
        table_of(MIXED, tmp_path / 'sweep.parquet', Deadly())


def test_another_version_on_a_worker_ends_the_sweep(tmp_path, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.__version__', '0.0.1')
    with (
        LocalWorkers(1) as workers,
        pytest.raises(WorkersError, match=r'sweep is of version 0\.0\.1'),
    ):
        table_of(plan_of('gap=20,30'), tmp_path / 'sweep.parquet', workers)
