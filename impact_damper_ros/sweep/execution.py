"""
The execution of a sweep: rigs in tasks, run in this process, in local processes, or on Dask.

A task holds rigs that one worker runs one after another. The rows do not depend on the workers,
their number, or the order in which they finish.
"""

from __future__ import annotations

import json
import logging
import os
import queue
import signal
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context, parent_process
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

import impact_damper_ros
from impact_damper_ros.control import LawError, OwnLaw, Rig
from impact_damper_ros.rig import ParameterError, RunawayError
from impact_damper_ros.rig.parameter_spec import whole_number
from impact_damper_ros.rig.snapshot import Snapshot

from .journal import Done, Journal
from .plan import Follow, RigSetup, Settings, SweepPlan
from .steady_state import steady_state
from .table import Row, failed_row, row_of

#: What a run depends on from here on, as its `snapshot` gives it.
_State = dict[str, Any]


def _rig_of(setup: RigSetup, state: _State | None) -> Rig:
    """
    Return a rig; with a state, it continues from there.

    Under control it continues at the time of that state, without at time 0.
    """
    parameters, control = setup.parameters, setup.control
    law = OwnLaw.from_text(setup.law) if setup.law and control.active else None
    if state is None:
        return Rig(parameters, setup.initial, control=control, law=law, compiled=None)
    if control.active:
        rig = Rig.restore(state, law, compiled=None)
        rig.change(parameters, control)
        return rig
    rig = Rig.resume(Snapshot.from_dict(state), compiled=None)
    rig.change(parameters)
    here = rig.state()
    run = here.run
    # A flight begins at a change of the parameters, or earlier if none is another
    since, run.now = run.time - run.now, 0.0
    run.time = since + run.time_low
    run.time_low -= run.time - since
    return Rig.resume(here, compiled=None)


def rig_row(
    setup: RigSetup, settings: Settings, state: _State | None = None
) -> tuple[Row, _State | None]:
    """Run one rig of a sweep, from a state if given; return its columns and last state."""
    try:
        varied = setup.varied(settings)
        rig = _rig_of(varied, state)
        row, last = row_of(steady_state(rig, setup.settling), rig.parameters), rig.snapshot()
        if varied.control.active:
            # The section holds nothing of the control
            row['state'] = json.dumps(last, separators=(',', ':'))
        return row, last
    except (ParameterError, RunawayError, LawError) as error:
        return failed_row(str(error)), None
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        # Numbers beyond the floats in one rig must not end the sweep
        return failed_row(f'{type(error).__name__}: {error}'), None


class _WrongVersionError(RuntimeError):
    """A worker has another version of the package than the process that planned the sweep."""


@dataclass(frozen=True)
class Task:
    """Rigs that one worker runs one after another."""

    #: Version of the package that planned it.
    version: str
    setup: RigSetup
    rigs: tuple[tuple[int, Settings], ...]  # number and settings of each rig
    followed: bool  # whether each rig starts from the last state of the one before
    state: _State | None  # the last state before the first rig, if there is one
    seconds: float  # after this time, s, no further rig is begun


def run_task(task: Task) -> list[Done]:
    """Run rigs until all are done or the time is up; at least one."""
    if task.version != impact_damper_ros.__version__:
        raise _WrongVersionError(
            f'a worker has version {impact_damper_ros.__version__} of impact_damper_ros, the '
            f'sweep is of version {task.version}: install the same version everywhere'
        )
    until = time.monotonic() + task.seconds
    done: list[Done] = []
    state = task.state
    for point, settings in task.rigs:
        row, last = rig_row(task.setup, settings, state)
        if task.followed and last is not None:
            state = last
        done.append(Done(point, row, state if task.followed else None))
        if time.monotonic() >= until:
            break
    return done


class _ToParent(logging.Handler):
    """Send what a worker logs to the parent process, which says it once, beside its progress."""

    def __init__(self, pipe: connection.Connection) -> None:
        super().__init__()
        self._pipe = pipe

    def emit(self, record: logging.LogRecord) -> None:
        # Short enough for the pipe to take it at once, whatever other workers write
        with suppress(OSError):
            self._pipe.send((record.name, record.levelno, record.getMessage()[:800]))


def _repeat(pipe: connection.Connection) -> None:
    """Log what workers have logged, each text once, until all of them have ended."""
    logged = set()
    with suppress(EOFError, OSError):
        while True:
            one = name, level, text = pipe.recv()
            if one not in logged:
                logged.add(one)
                logging.getLogger(name).log(level, '%s', text)


def _begin_worker(log: connection.Connection) -> None:
    """Leave Ctrl-C to the parent process, log there, and end with it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    logging.getLogger(impact_damper_ros.__name__).addHandler(_ToParent(log))
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

    What the package logs in them is logged in this process, each text once.
    On leaving its ``with`` block it waits for calls that are under way, except after an exception.

    Parameters
    ----------
    jobs : int
        Number of processes, from 1 to 1024.

    Raises
    ------
    ValueError
        If it is another one.
    """

    def __init__(self, jobs: int) -> None:
        jobs = whole_number('jobs', jobs, 1, MOST_JOBS)
        context = get_context('spawn')
        log, self._log = context.Pipe(duplex=False)
        super().__init__(jobs, context, initializer=_begin_worker, initargs=(self._log,))
        threading.Thread(target=_repeat, args=(log,), name='log', daemon=True).start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **keywords: Any) -> Future[Any]:
        """Call a function in one of the processes."""
        # A process that starts now must not receive Ctrl-C before it ignores it
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *args, **keywords)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the processes."""
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._log.close()

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            for process in list((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)


#: Tasks under way for each worker, so that none waits for the next one.
_AHEAD = 2
#: Time allowed for the scheduler, and then for one of its workers, to answer.
_CONNECT_SECONDS = 15.0
_WORKERS_SECONDS = 15.0


class WorkersError(RuntimeError):
    """The workers cannot do the work, for the reason in the message."""


@runtime_checkable
class SweepExecutor(Protocol):
    """What a sweep needs of an executor; those of `concurrent.futures` have it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Call a function on a worker."""


class Here:
    """An executor that runs everything in this process, at once."""

    #: What a future raises if its worker died.
    losses: tuple[type[BaseException], ...] = ()
    #: Number of tasks to have under way.
    at_once = 1

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Call a function."""
        future: Future[Any] = Future()
        try:
            future.set_result(fn(*args))
        except Exception as error:
            future.set_exception(error)
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Do nothing; every call is complete."""


class LocalWorkers:
    """
    Processes on this machine; if one dies, all are replaced.

    Parameters
    ----------
    jobs : int
        Number of processes, from 1 to 1024.

    Raises
    ------
    ValueError
        If it is another one.
    """

    losses: tuple[type[BaseException], ...] = (BrokenExecutor,)

    def __init__(self, jobs: int) -> None:
        self._pool = ProcessPool(jobs)
        self._jobs = int(jobs)

    @property
    def at_once(self) -> int:
        """Number of tasks to have under way."""
        return _AHEAD * self._jobs

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Call a function in one of the processes."""
        try:
            return self._pool.submit(fn, *args)
        except BrokenExecutor:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = ProcessPool(self._jobs)
            return self._pool.submit(fn, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        self._pool.__exit__(kind, *rest)


class DaskWorkers:
    """
    The workers of a Dask cluster.

    Parameters
    ----------
    address : str
        Address of its scheduler, such as tcp://10.0.0.1:8786.

    Raises
    ------
    ImportError
        If dask.distributed is not installed; the message says how to install it.
    OSError
        If no scheduler answers at the address, or it has no workers.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise ImportError(
                f'dask.distributed, which --scheduler needs, cannot be imported ({error}): '
                'install it with "pip install distributed", or the package with its extra [dask]'
            ) from error
        self.losses: tuple[type[BaseException], ...] = (KilledWorker,)
        try:
            self._client: Any = Client(address, timeout=_CONNECT_SECONDS, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            raise OSError(
                f'no Dask scheduler at {address} ({error}): give the address that it prints when '
                'it starts, such as tcp://10.0.0.1:8786'
            ) from error
        try:
            self._client.wait_for_workers(1, timeout=_WORKERS_SECONDS)
        except TimeoutError as error:
            self._client.close()
            raise OSError(
                f'the Dask scheduler at {address} has no workers: start some, as with '
                f'"dask worker {address}"'
            ) from error
        self._executor: Any = self._client.get_executor(pure=False)

    @property
    def at_once(self) -> int:
        """Number of tasks to have under way; 0 while there are no workers."""
        try:
            threads: dict[str, int] = self._client.nthreads()
        except OSError as error:
            raise WorkersError(f'the connection to the scheduler is lost ({error})') from error
        return _AHEAD * sum(threads.values())

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Call a function on a worker."""
        future: Future[Any] = self._executor.submit(fn, *args)
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close(timeout=5)


#: Any of the kinds of workers that the command offers.
Workers = Here | LocalWorkers | DaskWorkers

#: Most rigs in one task, and the time after which a worker begins no other one of it, s.
_MOST_RIGS = 256
_SECONDS = 0.25
#: Workers that may die with one task.
_TRIES = 5
#: Time after which a sweep without workers ends, s.
_PATIENCE = 120.0


@dataclass
class _Chain:
    """A chain of rigs, each started from the one before, and its progress."""

    rows: Sequence[int]
    place: int = 0
    state: _State | None = None


@dataclass
class _Sent:
    """A task that a worker has."""

    task: Task
    chain: _Chain | None
    tries: int = 1


class _Queue:
    """The rigs of a sweep that are not under way and not done."""

    def __init__(self, plan: SweepPlan, journal: Journal) -> None:
        self.plan = plan
        self._chains: deque[_Chain] = deque()
        self._independent: deque[int] = deque()
        if plan.follow is Follow.NONE:
            self._independent.extend(i for i in range(plan.size) if i not in journal.points)
            return
        for rows in plan.chains():
            chain = _Chain(rows)
            for place, row in enumerate(rows, 1):
                if row not in journal.points:
                    break
                # A chain can continue only from a rig whose last state is in the journal
                if row in journal.states:
                    chain.place, chain.state = place, journal.states[row]
            if any(row not in journal.points for row in rows[chain.place :]):
                self._chains.append(chain)

    def take(self, at_once: int) -> _Sent | None:
        """Return the next task, if one is ready."""
        if self._chains:
            chain = self._chains.popleft()
            rows = chain.rows[chain.place : chain.place + _MOST_RIGS]
            return _Sent(self._task(rows, chain), chain)
        left = len(self._independent)
        count = min(_MOST_RIGS, max(1, left // (4 * at_once)), left)
        if not count:
            return None
        return _Sent(self._task([self._independent.popleft() for _ in range(count)], None), None)

    def _task(self, rows: Sequence[int], chain: _Chain | None) -> Task:
        plan = self.plan
        return Task(
            version=impact_damper_ros.__version__,
            setup=plan.setup,
            rigs=tuple((row, tuple(plan.settings(plan.point(row).values))) for row in rows),
            followed=chain is not None,
            state=None if chain is None else chain.state,
            seconds=_SECONDS,
        )

    def put_back(self, sent: _Sent, done: Sequence[Done]) -> None:
        """Take back the rigs that a worker has not begun."""
        chain = sent.chain
        if chain is None:
            self._independent.extendleft(row for row, _ in reversed(sent.task.rigs[len(done) :]))
            return
        chain.place += len(done)
        chain.state = done[-1].state
        if chain.place < len(chain.rows):
            self._chains.append(chain)


def run_sweep(
    plan: SweepPlan,
    journal: Journal,
    executor: SweepExecutor,
    *,
    at_once: Callable[[], int] | int = 8,
    losses: tuple[type[BaseException], ...] = (BrokenExecutor,),
    progress: Callable[[int], object] | None = None,
) -> None:
    """
    Run all rigs of a sweep that its journal does not hold.

    Parameters
    ----------
    plan : SweepPlan
        The sweep.
    journal : Journal
        Its journal; each row is on disk as soon as it has come back.
    executor : SweepExecutor
        The executor that runs the rigs: any with the `submit` of `concurrent.futures` whose
        workers can import this package. It is not shut down.
    at_once : int or callable, optional
        Number of tasks to have under way, now; 0 means that there are no workers.
    losses : tuple of exception types, optional
        Exceptions of a future whose worker died; its rigs are then run again.
    progress : callable, optional
        Called with the number of rigs that have come back.

    Raises
    ------
    WorkersError
        If workers die again and again, all have gone, or none can run the rigs, as with another
        version of the package.
    OSError
        If the journal cannot be written.

    Notes
    -----
    The rows do not depend on the workers, their number, or the order in which they finish.
    """
    if not callable(at_once):
        at_once = whole_number('at_once', at_once, 0, MOST_JOBS)
    left = _Queue(plan, journal)
    under_way: dict[Future[Any], _Sent] = {}
    finished: queue.SimpleQueue[Future[Any]] = queue.SimpleQueue()

    def hand_out(sent: _Sent) -> None:
        future = executor.submit(run_task, sent.task)
        under_way[future] = sent
        future.add_done_callback(finished.put)

    def most() -> int:
        return at_once() if callable(at_once) else at_once

    try:
        while True:
            room = max(1, most())
            while len(under_way) < room:
                sent = left.take(room)
                if sent is None:
                    break
                hand_out(sent)
            if not under_way:
                return
            try:
                future = finished.get(timeout=_PATIENCE)
            except queue.Empty:
                if most() == 0:
                    raise WorkersError('all workers have disconnected') from None
                continue
            sent = under_way.pop(future)
            try:
                done: list[Done] = future.result()
            except losses as error:
                hand_out(_again(sent, error))
                continue
            except CancelledError as error:
                raise WorkersError('the work was cancelled: has the scheduler ended?') from error
            except Exception as error:
                raise WorkersError(
                    f'a worker cannot run the rigs ({type(error).__name__}: {error})'
                ) from error
            fresh = sum(one.point not in journal.points for one in done)
            journal.add(done)
            left.put_back(sent, done)
            if progress is not None:
                progress(fresh)
    finally:
        for future in under_way:
            future.cancel()


def _again(sent: _Sent, error: BaseException) -> _Sent:
    """Return a task to be run again after its worker died."""
    if sent.tries >= _TRIES:
        first, last = sent.task.rigs[0][0], sent.task.rigs[-1][0]
        raise WorkersError(
            f'{sent.tries} workers in a row died while they ran some of the rigs {first} to '
            f'{last} ({type(error).__name__}: {error}): is there enough memory? Give fewer --jobs'
        ) from error
    # One rig at a time, so that one that kills its worker does not take others with it
    return replace(sent, tries=sent.tries + 1, task=replace(sent.task, seconds=0.0))
