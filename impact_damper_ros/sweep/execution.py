# SPDX-License-Identifier: Apache-2.0
"""
The execution of a sweep: tasks of rigs on any executor, their rows in a journal, then the table.

The rows do not depend on the executor, the number of its workers, or the order in which they
finish.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import queue
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
)
from importlib.util import find_spec
from multiprocessing import connection, get_context, parent_process
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import impact_damper_ros
from impact_damper_ros.control.own_law import LawError, OwnLaw
from impact_damper_ros.parameters.parameter_spec import ParameterError, whole_number
from impact_damper_ros.rig.event_budget import RunawayError
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.snapshot import Snapshot

from .ensemble import Transient, can_share, shared_values, transients
from .grid import Grid, RigSetup, Varied
from .journal import Journal, Progress, Row, delete_journal, differences, journal_path
from .steady_state import Settling, steady_state
from .table import (
    MetadataError,
    check_format,
    failed_row,
    read_table,
    table_of,
    write_table,
)

if TYPE_CHECKING:
    import pandas as pd

#: What a run depends on from here on, as its `snapshot` gives it.
State = dict[str, Any]


def _continued(setup: RigSetup, state: State, law: OwnLaw | None) -> Rig:
    """Return a rig that starts from the last state of another one, by a change of parameters."""
    if setup.control.active:
        # At the time of that state, since the control samples at its own instants
        rig = Rig.restore(state, law, compiled=None)
        rig.change(setup.parameters, setup.control)
        return rig
    rig = Rig.resume(Snapshot.from_dict(state), compiled=None)
    rig.change(setup.parameters)
    here = rig.state()
    run = here.run
    # At time 0; a flight begins at a change of the parameters, or earlier if none is another
    since, run.now = run.time - run.now, 0.0
    run.time = since + run.time_low
    run.time_low -= run.time - since
    return Rig.resume(here, compiled=None)


def rig_row(
    setup: RigSetup, state: State | None = None, transient: Transient | None = None
) -> tuple[Row, State | None]:
    """
    Run one rig of a sweep; return its columns and last state.

    It starts from the last state of another rig or after a known transient, if one is given.
    Only what a rig does becomes a row: other errors are those of the program.
    """
    parameters, initial, control, law_name, settling = setup
    try:
        law = OwnLaw.from_text(law_name) if law_name and control.active else None
        if state is not None:
            rig = _continued(setup, state, law)
        else:
            start = initial if transient is None else transient.state
            rig = Rig(parameters, start, control=control, law=law, compiled=None)
        known = None if transient is None else transient[:2]
        row = steady_state(rig, settling, known)
    except (ParameterError, RunawayError, LawError, OverflowError) as error:
        return failed_row(str(error)), None
    last = rig.snapshot()
    if control.active:
        # The section holds nothing of the control
        row['state'] = json.dumps(last, separators=(',', ':'))
    return row, last


class WorkersError(RuntimeError):
    """The workers cannot do the work, for the reason in the message."""


class Task(NamedTuple):
    """Rigs that one worker runs one after another."""

    version: str  # of the package that planned it
    setup: RigSetup
    rigs: tuple[tuple[int, dict[Varied, float]], ...]  # number and settings of each rig
    threads: int | None  # of an ensemble; 0 if the rigs are none
    chain: int | None = None  # number of the chain that they are part of
    done: Progress = Progress()  # of this chain


#: Time after which a worker begins no further rig of a task, s.
_SECONDS = 0.25


def run_task(task: Task) -> tuple[list[tuple[int, Row]], State | None]:
    """Run rigs until all are done or the time is up, at least one; return the last state, too."""
    if task.version != impact_damper_ros.__version__:
        raise WorkersError(
            f'a worker has version {impact_damper_ros.__version__} of impact_damper_ros, the '
            f'sweep is of version {task.version}: install the same version everywhere'
        )
    until = time.monotonic() + _SECONDS
    varied: list[RigSetup | str] = []
    for _, settings in task.rigs:
        try:
            varied.append(task.setup.vary(settings))
        except ParameterError as error:
            varied.append(str(error))
    known = {}
    if task.threads != 0 and find_spec('numba') is not None:
        points = [point for point, _ in task.rigs]
        pairs = zip(points, varied, strict=True)
        known = transients({k: s for k, s in pairs if isinstance(s, RigSetup)}, task.threads)
    state = task.done.state
    rows = []
    for (point, _), setup in zip(task.rigs, varied, strict=True):
        if isinstance(setup, str):
            row, last = failed_row(setup), None
        else:
            row, last = rig_row(setup, state, known.get(point))
        rows.append((point, row))
        if task.chain is not None and last is not None:
            state = last
        if not known and time.monotonic() >= until:
            break
    return rows, state


def _begin_worker() -> None:
    """Leave Ctrl-C and what is logged to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger(impact_damper_ros.__name__).setLevel(logging.ERROR)
    parent = parent_process()
    if parent is not None:

        def wait() -> None:
            connection.wait([parent.sentinel])
            os._exit(1)

        threading.Thread(target=wait, daemon=True).start()


#: Most processes of a pool.
MOST_JOBS = 1024


class ProcessPool(ProcessPoolExecutor):
    """
    A pool of processes that ignore Ctrl-C and end with this process.

    On leaving its ``with`` block it waits for calls that are under way, except after an exception.
    """

    def __init__(self, jobs: int) -> None:
        jobs = whole_number('jobs', jobs, 1, MOST_JOBS)
        super().__init__(jobs, get_context('spawn'), initializer=_begin_worker)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **keywords: Any) -> Future[Any]:
        """Call a function in one of the processes."""
        # A process that starts now must not receive Ctrl-C before it ignores it
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *args, **keywords)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            for process in list((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)


#: Rigs of a chain in one task, and of an ensemble in this process and elsewhere.
_CHAINED, _TOGETHER_HERE, _TOGETHER = 256, 256, 64
#: Samples of an ensemble that are kept in memory.
_MOST_SAMPLES = 2**20
#: Rigs of other tasks, and tasks of a sweep, so that workers end at about the same time.
_MOST_RIGS, _MANY = 64, 256
#: Tasks under way.
_UNDER_WAY = 2048
#: Period in which a sweep whose workers are silent reports that, s.
_BEAT = 5.0
#: Pools of processes that may break in a row.
_TRIES = 5


def _tasks(grid: Grid, journal: Journal, *, here: bool) -> Iterator[Task]:
    """Yield the rigs of a sweep that its journal does not hold."""

    def task(rows: Sequence[int], threads: int | None, *chain: Any) -> Task:
        rigs = tuple((row, grid.settings(grid.values(row))) for row in rows)
        return Task(impact_damper_ros.__version__, grid.setup, rigs, threads, *chain)

    if grid.follow != 'none':
        begun = journal.chains()
        for number, rows in enumerate(grid.chains()):
            done = begun.get(number, Progress())
            if done.place < len(rows):
                yield task(rows[done.place :], 0, number, done)
        return
    known = journal.points()
    left = [row for row in range(grid.size) if row not in known]
    most = max(1, min(_MOST_RIGS, len(left) // _MANY))
    threads: int | None = 0
    if can_share(grid):
        # Rigs with the same force and start side by side
        left.sort(key=lambda row: shared_values(grid, row))
        most = _TOGETHER_HERE if here else min(_TOGETHER, 1 + len(left) // 16)
        most = max(1, min(most, _MOST_SAMPLES // grid.setup.settling.cycles))
        threads = None if here else 1
    for first in range(0, len(left), most):
        yield task(left[first : first + most], threads)


def _run(
    grid: Grid, journal: Journal, executor: Executor | None, progress: Callable[[int], object]
) -> None:
    """Run all rigs that the journal does not hold."""
    tasks = _tasks(grid, journal, here=executor is None)
    under_way: dict[Future[Any], Task] = {}
    finished: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    count = len(journal.points())
    progress(count)

    def hand_out(task: Task) -> None:
        some = task._replace(rigs=task.rigs[:_CHAINED])
        if executor is None:
            future: Future[Any] = Future()
            future.set_result(run_task(some))
        else:
            future = executor.submit(run_task, some)
        under_way[future] = task
        future.add_done_callback(finished.put)

    try:
        while True:
            while len(under_way) < (1 if executor is None else _UNDER_WAY):
                task = next(tasks, None)
                if task is None:
                    break
                hand_out(task)
            if not under_way:
                return
            try:
                future = finished.get(timeout=_BEAT)
            except queue.Empty:
                progress(count)
                continue
            task = under_way.pop(future)
            rows, state = future.result()
            done = Progress(task.done.place + len(rows), state)
            journal.add(rows, task.chain, done)
            count += len(rows)
            progress(count)
            if left := task.rigs[len(rows) :]:
                hand_out(task._replace(rigs=left, done=done))
    except CancelledError as error:
        raise WorkersError('the work was cancelled: has the scheduler ended?') from error
    except BrokenExecutor:
        # It ends its calls itself, in another thread, which stumbles over a cancelled one
        under_way.clear()
        raise
    finally:
        for future in under_way:
            future.cancel()


def _run_in_processes(
    grid: Grid, journal: Journal, jobs: int, progress: Callable[[int], object]
) -> None:
    """Run all rigs in processes of this machine; if one dies, all are replaced."""
    if find_spec('numba') is not None:
        # What is compiled here, and what that reports, the processes need not compile and report
        brief = grid.setup._replace(settling=Settling(cycles=1, watch=21, events=1000))
        first = grid.settings(grid.values(0))
        run_task(Task(impact_damper_ros.__version__, brief, ((0, first),), 1))
    broken = 0
    while True:
        before = len(journal.points())
        try:
            with ProcessPool(jobs) as pool:
                _run(grid, journal, pool, progress)
        except BrokenExecutor as error:
            broken = 1 if len(journal.points()) > before else broken + 1
            if broken == _TRIES:
                raise WorkersError(
                    f'{broken} times in a row a process died before a rig was done ({error}): is '
                    'there enough memory? Give fewer --jobs'
                ) from error
        else:
            return


def _existing(grid: Grid, path: Path, *, overwrite: bool) -> pd.DataFrame | None:
    """Return the table if it exists already; refuse to replace that of another sweep."""
    try:
        table = read_table(path)
    except MetadataError as error:
        if overwrite:
            return None
        raise MetadataError(
            f'{error}: give another output, or overwrite it (--overwrite)'
        ) from None
    differing = differences(table.attrs['inputs'], grid.inputs())
    if differing and not overwrite:
        raise MetadataError(
            f'{path} is the table of a sweep with other inputs:\n  '
            + '\n  '.join(differing[:12])
            + '\ngive another output, or overwrite it (--overwrite)'
        )
    return None if differing else table


def sweep(
    grid: Grid,
    output: str | Path | None = None,
    *,
    executor: Executor | None = None,
    jobs: int = 1,
    overwrite: bool = False,
    progress: Callable[[int], object] = lambda _: None,
) -> pd.DataFrame:
    """
    Run the rigs of a grid, each until its motion has settled.

    Parameters
    ----------
    grid : Grid
        The rigs.
    output : path, optional
        File of the table: CSV if its name ends in .csv, else Parquet. Until it is complete, rows
        that are done are in a journal beside it, from which the same call resumes the sweep.
    executor : concurrent.futures.Executor, optional
        What runs the rigs: any executor whose workers can import this package, such as that of a
        Dask client (``client.get_executor()``). It is not shut down.
    jobs : int, optional
        Number of processes of this machine, without `executor`; 1 is this process.
    overwrite : bool, optional
        Whether to replace the table or journal of another sweep.
    progress : callable, optional
        Called with the number of rigs that are done, at the beginning, whenever it rises, and
        every few seconds.

    Returns
    -------
    pandas.DataFrame
        A row for each rig; `attrs` has units and descriptions of the columns, and the inputs.

    Raises
    ------
    MetadataError, JournalError
        If the table or the journal exists and is that of another sweep.
    WorkersError
        If processes die again and again, or workers have another version of the package.
    OSError
        If table or journal cannot be written.
    ImportError
        Without pandas, or without pyarrow for Parquet (extra ``sweep``).

    Notes
    -----
    The rows do not depend on executor and jobs, nor on interruptions. What a rig does wrong (too
    many events, a parameter out of range) is a row with its reason; any other error ends the
    sweep.

    Examples
    --------
    >>> import numpy as np
    >>> from impact_damper_ros.parameters.rig_parameters import RigParameters
    >>> from impact_damper_ros.sweep import Grid, sweep
    >>> table = sweep(Grid(RigParameters(gravity=0.0), gap=np.linspace(30.0, 40.0, 3)))
    >>> list(table.stops)
    ['1,2', '1,2', '1,2']
    """
    path = None if output is None else Path(output)
    jobs = whole_number('jobs', jobs, 1, MOST_JOBS)
    check_format(path)
    if path is not None and not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent))
    if path is not None and path.exists():
        table = _existing(grid, path, overwrite=overwrite)
        if table is not None:
            delete_journal(path)
            return table
    place = None if path is None else journal_path(path)
    with Journal(place, grid.inputs(), anew=overwrite) as journal:
        if executor is None and jobs > 1:
            _run_in_processes(grid, journal, jobs, progress)
        else:
            _run(grid, journal, executor, progress)
        table = table_of(grid, journal.rows())
        if path is not None:
            write_table(table, path)
    if path is not None:
        delete_journal(path)
    return table
