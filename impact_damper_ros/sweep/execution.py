# SPDX-License-Identifier: Apache-2.0
"""
The execution of a sweep on any executor of `concurrent.futures`.

Each rig is run by one call of `rig_row`, so that its row does not depend on the executor, on the
number of its workers, or on which rigs are run together. Finished rigs are appended to a file,
from which the same call resumes an interrupted sweep.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import queue
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import (
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    ThreadPoolExecutor,
)
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait as wait_for
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import impact_damper_ros
from impact_damper_ros.control.own_law import LawError, OwnLaw
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.parameters.parameter_spec import ParameterError, whole_number
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.snapshot import Snapshot

from .grid import Grid, RigSetup, Varied
from .part_file import PartFile, State, other_inputs, part_path
from .steady_state import Row, Settling, steady_state
from .table import (
    Columns,
    MetadataError,
    check_format,
    read_columns,
    write_table,
)

if TYPE_CHECKING:
    import pandas as pd

_log = logging.getLogger(__name__)


def _continue(setup: RigSetup, state: State, law: OwnLaw | None) -> Rig:
    """Return a rig that starts from the last state of another one, by a change of parameters."""
    if setup.control.active:
        # The rig starts at the time of that state: the control has its instants of samples.
        rig = Rig.restore(state, law, compiled=None)
        rig.change(setup.parameters, setup.control)
        return rig
    rig = Rig.resume(Snapshot.from_dict(state), compiled=None)
    rig.change(setup.parameters)
    here = rig.state()
    run = here.run
    # The rig starts at time 0; a flight begins at a change of the parameters, if they differ.
    since, run.now = run.time - run.now, 0.0
    run.time = since + run.time_low
    run.time_low -= run.time - since
    return Rig.resume(here, compiled=None)


def _law_of(setup: RigSetup) -> OwnLaw | None:
    """Return the law of the user's own; raise WorkersError unless it is the law of the sweep."""
    if not setup.law:
        return None
    law = OwnLaw.from_text(setup.law)
    if law.digest != setup.law_digest:
        raise WorkersError(
            f'the law {setup.law} is not the one that the sweep began with: begin it anew with '
            '--overwrite, and give all workers the same file'
        )
    return law


def _never() -> bool:
    return False


def rig_row(
    setup: RigSetup,
    settings: Mapping[Varied, float],
    state: State | None = None,
    halted: Callable[[], bool] = _never,
) -> tuple[Row, Rig | None]:
    """
    Run one rig of a sweep; return its columns, and the rig where it is then.

    The rig starts from the last state of another rig, if one is given. Only failures of a rig
    become rows: other errors are those of the program.
    """
    try:
        parameters, initial, control, _, _, settling = setup = setup.vary(settings)
        law = _law_of(setup)
        if state is not None:
            rig = _continue(setup, state, law)
        else:
            rig = Rig(parameters, initial, control=control, law=law, compiled=None)
        row = steady_state(rig, settling, halted)
    except (ParameterError, RunawayError, LawError, OverflowError) as error:
        return {'ok': False, 'reason': str(error)}, None
    if control.active:
        # The section does not hold the state of the control.
        row['state'] = json.dumps(rig.snapshot(), separators=(',', ':'))
    return row, rig


class WorkersError(RuntimeError):
    """The workers cannot do the work; the message has the reason."""


class Task(NamedTuple):
    """A rig that a worker runs."""

    version: str  # version of the package that planned the task
    setup: RigSetup
    settings: dict[Varied, float]
    follow: bool  # whether another rig starts from its last state
    state: State | None  # state from which the rig starts


#: Columns of a rig, and the state from which the next rig starts.
RunTask = Callable[[Task], tuple[Row, State | None]]


def run_task(task: Task, halted: Callable[[], bool] = _never) -> tuple[Row, State | None]:
    """Run the rig of a task; one that fails leaves the state to the next one."""
    if task.version != impact_damper_ros.__version__:
        raise WorkersError(
            f'a worker has version {impact_damper_ros.__version__} of impact_damper_ros, the '
            f'sweep is of version {task.version}: install the same version everywhere'
        )
    row, rig = rig_row(task.setup, task.settings, task.state, halted)
    return row, rig.snapshot() if task.follow and rig is not None else task.state


#: Most threads or processes.
MOST_JOBS = 1024
#: Time after which a thread hands on the lock of the interpreter, s.
_SWITCH_SECONDS = 2e-4


def _begin_worker() -> None:
    """Leave Ctrl-C and log messages to the parent process, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger(impact_damper_ros.__name__).setLevel(logging.ERROR)
    parent = parent_process()
    assert parent is not None

    def end_with_it() -> None:
        wait_for([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end_with_it, daemon=True).start()


@contextmanager
def _workers(grid: Grid, jobs: int) -> Iterator[tuple[Executor, RunTask]]:
    """Yield an executor of this machine, which an exception ends, and a function for tasks."""
    setup = grid.setup
    if has_numba() and (not setup.law or OwnLaw.from_text(setup.law).compiles):
        # Ctrl-C ends compiled code in the main thread, but not in others.
        brief = setup._replace(settling=Settling(cycles=1, watch=21, events=1000))
        rig_row(brief, grid.settings(grid.values(0)))
        halted, interval = threading.Event(), sys.getswitchinterval()
        # A thread that comes back from compiled code would wait for the lock longer than it ran
        sys.setswitchinterval(_SWITCH_SECONDS)
        with ThreadPoolExecutor(jobs) as threads:
            try:
                yield threads, lambda task: run_task(task, halted.is_set)
            finally:
                halted.set()
                sys.setswitchinterval(interval)
        return
    why = f'the law {setup.law} is plain Python' if has_numba() else 'there is no numba'
    _log.warning('%s, which takes one processor: the rigs run in %d processes', why, jobs)
    # A new process must not receive Ctrl-C before it ignores that signal.
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    with ProcessPoolExecutor(jobs, get_context('spawn'), initializer=_begin_worker) as processes:
        try:
            for _ in range(jobs):
                processes.submit(abs, 0)
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
            yield processes, run_task
        except BaseException:
            for process in list((processes._processes or {}).values()):
                process.terminate()
            raise


#: Most rigs under way.
_UNDER_WAY = 512
#: Period in which a sweep reports its progress while its workers are silent, s.
_BEAT = 5.0


def _run(
    grid: Grid,
    part: PartFile,
    executor: Executor | None,
    progress: Callable[[int], object],
    run: RunTask | None = None,
) -> None:
    """Run all rigs that are not done, in this process if there is no executor."""
    run, follow = run or run_task, grid.follow != 'none'
    chains = grid.chains() if follow else (range(k, k + 1) for k in range(grid.size))
    waiting = (left for left in map(part.left_of, chains) if left[0])
    under_way: dict[Future[Any], Sequence[int]] = {}
    finished: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()
    most = 1 if executor is None else _UNDER_WAY
    progress(len(part.rows))

    def hand_out(left: Sequence[int], state: State | None) -> None:
        settings = grid.settings(grid.values(left[0]))
        task = Task(impact_damper_ros.__version__, grid.setup, settings, follow, state)
        if executor is None:
            future: Future[Any] = Future()
            future.set_result(run(task))
        else:
            future = executor.submit(run, task)
        under_way[future] = left
        future.add_done_callback(finished.put)

    try:
        while True:
            while len(under_way) < most and (chain := next(waiting, None)) is not None:
                hand_out(*chain)
            if not under_way:
                return
            try:
                future = finished.get(timeout=_BEAT)
            except queue.Empty:
                progress(len(part.rows))
                continue
            left = under_way.pop(future)
            row, state = future.result()
            part.add([(left[0], row)], state)
            progress(len(part.rows))
            if left[1:]:
                hand_out(left[1:], state)
    except CancelledError as error:
        raise WorkersError('the work was cancelled: has the scheduler ended?') from error
    except BrokenExecutor as error:
        # A broken executor ends its calls in another thread, which a cancelled call would disturb.
        under_way.clear()
        raise WorkersError(
            f'a process died ({error}): is there enough memory? Give fewer --jobs'
        ) from error
    finally:
        for future in under_way:
            future.cancel()


def _existing(grid: Grid, path: Path) -> Columns:
    """Return the table of this sweep, if the file exists; raise MetadataError for another file."""
    table = read_columns(path)
    differing = other_inputs(table.grid.inputs(), grid.inputs())
    if differing:
        raise MetadataError(f'{path} is the table of a sweep with other inputs:\n{differing}')
    return table


def sweep(
    grid: Grid,
    output: str | Path | None = None,
    *,
    executor: Executor | None = None,
    jobs: int | None = 1,
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
        File of the table: CSV if its name ends in .csv, else Parquet. Until it is complete, rigs
        that are done are in a file beside it, from which the same call resumes the sweep. A
        complete file is read, and nothing is run.
    executor : concurrent.futures.Executor, optional
        The executor of the rigs: any whose workers can import this package, such as that of a Dask
        client (``client.get_executor()``). It is not shut down.
    jobs : int, optional
        Number of threads, without `executor`; as many as there are cores, if None. A law that is
        plain Python runs in as many processes.
    overwrite : bool, optional
        Whether to run all rigs anew, and to replace the file, whatever it is, and the rest of
        another sweep. An interrupted run of this sweep is resumed.
    progress : callable, optional
        Called with the number of rigs that are done, at the beginning, whenever it rises, and
        every few seconds.

    Returns
    -------
    pandas.DataFrame
        A row for each rig; `attrs` has units and descriptions of the columns, and the inputs.

    Raises
    ------
    MetadataError
        If the file exists and is not the table of this sweep, or rigs of another sweep are beside
        it.
    WorkersError
        If a process dies, or workers have another version of the package.
    OSError
        If a file cannot be written.
    ImportError
        Without pandas, or without pyarrow for Parquet (extra ``sweep``).

    Notes
    -----
    The rows do not depend on executor and jobs, nor on interruptions. A failure of a rig (too many
    events, a parameter out of range) is a row with the reason; any other error ends the sweep.

    Examples
    --------
    >>> import numpy as np
    >>> from impact_damper_ros.parameters.rig_parameters import RigParameters
    >>> from impact_damper_ros.sweep import Grid, sweep
    >>> table = sweep(Grid(RigParameters(gravity=0.0), gap=np.linspace(40.0, 50.0, 3)))
    >>> list(table.stops)
    ['1,2', '1,2', '1,2']
    """
    check_format(output, frame=True)
    return run_grid(grid, output, executor, jobs, overwrite=overwrite, progress=progress).frame()


def run_grid(
    grid: Grid,
    output: str | Path | None,
    executor: Executor | None,
    jobs: int | None,
    *,
    overwrite: bool,
    progress: Callable[[int], object],
) -> Columns:
    """Return the table of `sweep`, without pandas unless its file needs it: see `check_format`."""
    path = None if output is None else Path(output)
    cores = len(os.sched_getaffinity(0))
    jobs = cores if jobs is None else whole_number('jobs', jobs, 1, MOST_JOBS)
    if path is not None and not path.parent.is_dir():
        raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(path.parent))
    place = None if path is None else part_path(path)
    if path is not None and path.exists():
        if not path.is_file():
            raise MetadataError(f'{path} is not an ordinary file: give another output')
        if not overwrite:
            try:
                table = _existing(grid, path)
            except MetadataError as error:
                raise MetadataError(
                    f'{error}\ngive another output, or overwrite it (--overwrite)'
                ) from None
            part_path(path).unlink(missing_ok=True)
            return table
    with PartFile(place, grid.inputs(), anew=overwrite) as part:
        if executor is not None or jobs == 1:
            _run(grid, part, executor, progress)
        else:
            with _workers(grid, jobs) as (workers, run):
                _run(grid, part, workers, progress, run)
        columns = Columns.of_rows(grid, (part.rows[k] for k in range(grid.size)))
        if path is not None:
            write_table(columns, path)
        part.delete()
    return columns
