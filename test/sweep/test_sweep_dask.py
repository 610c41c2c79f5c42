"""Sweeps on a Dask cluster: a real scheduler and real workers, on this machine alone."""

import json
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pandas as pd
import pytest
from control.controlled_rigs import TRIAL, control
from sweep.made_tables import table_of

import impact_damper_ros
from impact_damper_ros.cli.sweep_rig import main
from impact_damper_ros.orbits.settling import Settling
from impact_damper_ros.rig import InitialConditions, RigParameters
from impact_damper_ros.sweep.execution import DaskWorkers, LocalWorkers, WorkersError, run_sweep
from impact_damper_ros.sweep.journal import Journal, journal_path
from impact_damper_ros.sweep.plan import Follow, SweepPlan, axis_from_text
from impact_damper_ros.sweep.table import write_table

Client = pytest.importorskip('distributed').Client
pytest.importorskip('pyarrow')

ROOT = Path(impact_damper_ros.__file__).parents[1]
ENVIRONMENT = {
    **os.environ,
    'PYTHONPATH': str(ROOT),
    'DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__GIL__ENABLED': 'false',
}
#: Mostly chaotic: enough work for two.
PLAN = SweepPlan(
    RigParameters(gravity=0.0, force_frequencies=1.02),
    InitialConditions(initial_primary_position=1.0),
    (axis_from_text('gap=2:14:40', RigParameters()),),
    settling=Settling(cycles=1000, watch=40),
)
#: Each rig takes over stops, estimates and waiting commands of the one before, noise and all.
CONTROLLED = SweepPlan(
    TRIAL,
    InitialConditions(initial_primary_position=1.0),
    (
        axis_from_text('gap_control_park=1.2:1.8:3', TRIAL),
        axis_from_text('gap_min=0.01,2e3', TRIAL),
    ),
    Follow.BOTH,
    Settling(cycles=60, watch=21, section=10),
    control('timed', actuator_delay=0.1, actuator_speed=40.0, gap_control_noise_position=0.02),
)


def table_by(plan, path, workers):
    """Return the bytes of the table that some workers make."""
    with workers:
        return table_of(
            *(plan, path, workers), at_once=lambda: workers.at_once, losses=workers.losses
        )


def start(stack, module, *arguments):
    """Start a process of the cluster; it ends with the test."""
    process = subprocess.Popen(
        [sys.executable, '-m', f'distributed.cli.{module}', '--no-dashboard', *arguments],
        env=ENVIRONMENT,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def end():
        process.kill()
        process.wait()

    stack.callback(end)
    return process


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    """Yield the address of a scheduler and its two workers."""
    folder = tmp_path_factory.mktemp('cluster')
    with ExitStack() as stack:
        found = folder / 'scheduler.json'
        here = ('--host', '127.0.0.1')
        start(stack, 'dask_scheduler', *here, '--port', '0', '--scheduler-file', str(found))
        worker = ('--nthreads', '1', '--no-nanny', '--memory-limit', '0')
        workers = [
            start(
                stack,
                'dask_worker',
                *('--scheduler-file', str(found), *here, *worker),
                *('--local-directory', str(folder / f'worker_{i}')),
            )
            for i in range(2)
        ]
        deadline = time.monotonic() + 100.0
        while not (found.exists() and found.read_text()):
            assert time.monotonic() < deadline, 'the scheduler did not start'
            time.sleep(0.02)
        address = json.loads(found.read_text())['address']
        assert address.startswith('tcp://127.0.0.1:')
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=100)
        yield address, workers


def test_command_runs_on_a_cluster(cluster, tmp_path):
    address, _ = cluster
    words = [str(ROOT / 'config' / 'paper.yaml'), '--vary', 'gap=24:37:6', '--quiet']
    table = tmp_path / 'there.parquet'
    assert main([*words, '--scheduler', address, '-o', str(table)]) == 0
    other = tmp_path / 'here.parquet'
    assert main([*words, '--jobs', '1', '-o', str(other)]) == 0
    assert table.read_bytes() == other.read_bytes()


def test_controlled_rigs_on_a_cluster(cluster, tmp_path):
    """As by local processes, to the last byte; some of the rigs cannot be."""
    address, _ = cluster
    local = table_by(CONTROLLED, tmp_path / 'local.parquet', LocalWorkers(2))
    assert table_by(CONTROLLED, tmp_path / 'there.parquet', DaskWorkers(address)) == local
    table = pd.read_parquet(tmp_path / 'there.parquet')
    assert list(table.direction) == ['up'] * 6 + ['down'] * 6
    assert list(table.ok) == [True, False] * 6
    assert table.x_rms[0] != table.x_rms[6]


def test_no_scheduler_at_the_address(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.sweep.execution._CONNECT_SECONDS', 0.3)
    words = [str(ROOT / 'config' / 'paper.yaml'), '--vary', 'gap=24:37:6', '--quiet']
    table = tmp_path / 'table.parquet'
    assert main([*words, '--scheduler', 'tcp://127.0.0.1:9', '-o', str(table)]) == 1
    assert 'no Dask scheduler at tcp://127.0.0.1:9' in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_killed_worker_leaves_no_trace_in_the_table(cluster, tmp_path):
    address, processes = cluster
    here, there = tmp_path / 'here.parquet', tmp_path / 'there.parquet'
    table_of(PLAN, here)
    killed = []
    with (
        DaskWorkers(address) as workers,
        Journal(journal_path(there), PLAN.inputs()) as journal,
    ):

        def kill_one(_):
            """Kill one of the two as soon as the first rigs are back, with work in hand."""
            if not killed:
                processes[0].kill()
                killed.append((processes[0].wait(), len(journal.points)))

        run_sweep(
            PLAN,
            journal,
            workers,
            at_once=lambda: workers.at_once,
            losses=workers.losses,
            progress=kill_one,
        )
        assert len(workers._client.nthreads()) == 1
        write_table(PLAN, journal, there)
    assert killed[0][0] == -9
    assert killed[0][1] < PLAN.size / 2
    assert there.read_bytes() == here.read_bytes()


def test_a_sweep_whose_workers_have_all_gone_says_so(cluster, tmp_path, monkeypatch):
    """The last test of the cluster, which it leaves without workers."""
    monkeypatch.setattr('impact_damper_ros.sweep.execution._PATIENCE', 0.1)
    monkeypatch.setattr('impact_damper_ros.sweep.execution._WORKERS_SECONDS', 0.3)
    address, processes = cluster
    path = journal_path(tmp_path / 'there.parquet')
    with DaskWorkers(address) as workers, Journal(path, PLAN.inputs()) as journal:
        for process in processes:
            process.kill()
            process.wait()
        with pytest.raises(WorkersError, match='all workers have disconnected'):
            run_sweep(PLAN, journal, workers, at_once=lambda: workers.at_once)
    with pytest.raises(OSError, match='has no workers: start some'):
        DaskWorkers(address)
