"""Sweeps on a Dask cluster: a real scheduler and real workers, on this machine alone."""

import json
import os
from contextlib import ExitStack
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from running import DEADLINE_S, Running

import impact_damper_ros
from impact_damper_ros import InitialConditions, RigParameters
from impact_damper_ros.sweep import Grid, Settling, sweep
from impact_damper_ros.sweep.part_file import PartFile

pytest.importorskip('pyarrow')

ROOT = Path(impact_damper_ros.__file__).parents[1]
PAPER = str(ROOT / 'config' / 'paper.yaml')
ENVIRONMENT = {
    **os.environ,
    'PYTHONPATH': str(ROOT),
    'DASK_DISTRIBUTED__ADMIN__SYSTEM_MONITOR__GIL__ENABLED': 'false',
}
START = InitialConditions(initial_primary_position=1.0)
#: Mostly chaotic, each rig on its own: enough work for two.
GRID = Grid(
    RigParameters(gravity=0.0, gap=10.0),
    START,
    settling=Settling(cycles=1000, watch=40),
    force_frequencies=np.linspace(0.98, 1.04, 40),
)


def client_of(address):
    """Return a client of a scheduler; Dask takes long to import, so only these tests do."""
    return import_module('distributed').Client(address, set_as_default=False)


def start(stack, folder, module, *arguments):
    """Start a process of the cluster; it ends with the test."""
    program = ('-m', f'distributed.cli.{module}', '--no-dashboard')
    return stack.enter_context(Running(folder, *program, *arguments, environment=ENVIRONMENT))


@pytest.fixture(scope='module')
def cluster(tmp_path_factory):
    """Yield the address of a scheduler and its two workers."""
    pytest.importorskip('distributed')
    folder = tmp_path_factory.mktemp('cluster')
    with ExitStack() as stack:
        found = folder / 'scheduler.json'
        here = ('--host', '127.0.0.1')
        scheduler = start(
            stack, folder, 'dask_scheduler', *here, '--port', '0', '--scheduler-file', str(found)
        )
        worker = ('--nthreads', '1', '--no-nanny', '--memory-limit', '0')
        workers = [
            start(
                stack,
                folder,
                'dask_worker',
                *('--scheduler-file', str(found), *here, *worker),
                *('--local-directory', str(folder / f'worker_{i}')),
            )
            for i in range(2)
        ]
        scheduler.until(lambda: found.exists() and found.read_text())
        address = json.loads(found.read_text())['address']
        assert address.startswith('tcp://127.0.0.1:')
        with client_of(address) as client:
            client.wait_for_workers(2, timeout=DEADLINE_S)
        yield address, workers


def test_rows_of_a_cluster_are_those_of_one_thread(cluster, tmp_path):
    there, here = tmp_path / 'there.parquet', tmp_path / 'here.parquet'
    grid = Grid(RigParameters(gravity=0.0), START, gap=np.linspace(24.0, 37.0, 6))
    with client_of(cluster[0]) as client:
        sweep(grid, there, executor=client.get_executor(pure=False))
    sweep(grid, here)
    assert there.read_bytes() == here.read_bytes()


def test_a_programming_error_comes_back_from_the_cluster(cluster, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.sweep.execution.run_task', 'no function')
    with client_of(cluster[0]) as client, pytest.raises(TypeError):
        sweep(GRID, executor=client.get_executor(pure=False))


def test_a_killed_worker_loses_no_row_and_leaves_no_trace(cluster, tmp_path, monkeypatch):
    """Kill -9 of one of two workers with work in hand; what is done is run only once."""
    address, processes = cluster
    here, there = tmp_path / 'here.parquet', tmp_path / 'there.parquet'
    sweep(GRID, here)
    killed, added = [], []
    add = PartFile.add

    def noted(part, rows, state):
        added.extend(point for point, _ in rows)
        add(part, rows, state)

    def kill_one(done):
        """Kill a worker as soon as the first rigs are back."""
        if done and not killed:
            processes[0].kill()
            killed.append((processes[0].wait(), done))

    monkeypatch.setattr(PartFile, 'add', noted)
    with client_of(address) as client:
        sweep(GRID, there, executor=client.get_executor(pure=False), progress=kill_one)
        assert len(client.nthreads()) == 1
    assert killed[0][0] == -9
    assert killed[0][1] < GRID.size / 2
    assert sorted(added) == list(range(GRID.size))
    assert there.read_bytes() == here.read_bytes()
