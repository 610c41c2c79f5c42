"""The execution of a sweep: in this process, in processes here, or on a Dask cluster."""

from __future__ import annotations

import os
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, Future, ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import connection, get_context, parent_process
from typing import Any, Protocol, Self, TypeVar

import impact_damper_ros

from .plan import Follow, SweepPlan
from .work import Block, Done, Journal, Snapshot, run_block

__all__ = [
    'DaskWorkers',
    'FutureLike',
    'Here',
    'LocalWorkers',
    'ProcessPool',
    'SweepExecutor',
    'Workers',
    'WorkersError',
    'run_sweep',
]


def _begin_worker() -> None:
    """Leave Ctrl-C to the parent, and do not outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:

        def wait() -> None:
            connection.wait([parent.sentinel])
            os._exit(1)

        threading.Thread(target=wait, daemon=True).start()


class ProcessPool(ProcessPoolExecutor):
    """
    Processes that leave Ctrl-C to this one, and do not outlive it.

    As a context manager it waits at the end for what is under way, but not after an exception.

    Parameters
    ----------
    jobs : int
        How many.
    """

    def __init__(self, jobs: int) -> None:
        super().__init__(jobs, get_context('spawn'), initializer=_begin_worker)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **keywords: Any) -> Future[Any]:
        """Have a function called in a process."""
        # A process that begins now must not hear a Ctrl-C before it knows to ignore it
        heard = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return super().submit(fn, *args, **keywords)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, heard)

    def __exit__(self, kind: object, *_: object) -> None:
        if kind is not None:
            for process in list((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)


T = TypeVar('T')
#: Blocks under way for each worker, so that none waits for the next one.
_AHEAD = 2
#: For the scheduler, and then for one of its workers, to be there.
_CONNECT_SECONDS = 15.0
_WORKERS_SECONDS = 15.0


class WorkersError(RuntimeError):
    """The workers cannot do the work; the message says why."""


class FutureLike(Protocol):
    """What a sweep needs of the futures of an executor."""

    def add_done_callback(self, fn: Callable[[Any], object], /) -> None:
        """Call a function with the future once it is done."""

    def result(self) -> Any:
        """Return the result, or raise what went wrong."""

    def cancel(self) -> object:
        """Give up what has not begun."""


class SweepExecutor(Protocol):
    """What a sweep needs of an executor: any of the kind of `concurrent.futures` has it."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called somewhere."""


class Workers(Protocol):
    """An executor, and what else is known of it."""

    @property
    def losses(self) -> tuple[type[BaseException], ...]:
        """What a future raises if its worker died."""

    @property
    def at_once(self) -> int:
        """How many blocks to have under way, 0 if there are no workers now."""

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called somewhere."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, *_: object) -> None: ...


class Here:
    """Run everything in this process, at once."""

    losses: tuple[type[BaseException], ...] = ()
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
        """Nothing is left to end."""


class LocalWorkers:
    """
    Processes on this machine; if one dies, all are replaced.

    Parameters
    ----------
    jobs : int
        How many.
    """

    losses: tuple[type[BaseException], ...] = (BrokenExecutor,)

    def __init__(self, jobs: int) -> None:
        self._jobs = jobs
        self._pool = ProcessPool(jobs)

    @property
    def at_once(self) -> int:
        """How many blocks to have under way."""
        return _AHEAD * self._jobs

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> Future[Any]:
        """Have a function called in a process."""
        try:
            return self._pool.submit(fn, *args)
        except BrokenExecutor:
            self._pool.shutdown(wait=False, cancel_futures=True)
            self._pool = ProcessPool(self._jobs)
            return self._pool.submit(fn, *args)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        # Those under way need not be waited for after an exception: they are run again
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
        If there is no scheduler at the address, or it has no workers.
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
        """How many blocks to have under way; workers may come and go, 0 if there are none."""
        try:
            threads: dict[str, int] = self._client.nthreads()
        except OSError as error:
            raise WorkersError(f'the scheduler cannot be reached any more ({error})') from error
        return _AHEAD * sum(threads.values())

    def submit(self, fn: Callable[..., Any], /, *args: Any) -> FutureLike:
        """Have a function called on a worker."""
        future: FutureLike = self._executor.submit(fn, *args)
        return future

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        self._executor.shutdown(wait=False)
        self._client.close(timeout=5)


#: Most rigs in one block, and for how long a worker goes on with one, s.
_MOST_POINTS = 256
_SECONDS = 0.25
#: How often a block is handed out again whose worker died.
_TRIES = 5
#: For how long nothing may come back while there are no workers, s.
_PATIENCE = 120.0


@dataclass
class _Line:
    """Rigs that have to be run in a row, and how far that is done."""

    rows: Sequence[int]
    place: int = 0
    state: Snapshot | None = None


@dataclass
class _Sent:
    """A block that is under way."""

    block: Block
    line: _Line | None
    tries: int = 1


class _Work:
    """What is left to do of a sweep."""

    def __init__(self, plan: SweepPlan, journal: Journal) -> None:
        self.plan = plan
        self.followed = plan.follow is not Follow.NONE
        self.left = plan.size - len(journal.points)
        self._lines: deque[_Line] = deque()
        self._loose: deque[int] = deque()
        if not self.followed:
            self._loose.extend(i for i in range(plan.size) if i not in journal.points)
            return
        for rows in plan.chains():
            line = _Line(rows)
            for place, row in enumerate(rows, 1):
                if row not in journal.points:
                    break
                # One can go on only from a rig whose last state is known
                if row in journal.states:
                    line.place, line.state = place, journal.states[row]
            if any(row not in journal.points for row in rows[line.place :]):
                self._lines.append(line)

    def next(self, at_once: int) -> _Sent | None:
        """Return a block to hand out, if one is ready."""
        if self.followed:
            if not self._lines:
                return None
            line = self._lines.popleft()
            rows = line.rows[line.place : line.place + _MOST_POINTS]
            return _Sent(self._block(rows, line.state), line)
        count = min(_MOST_POINTS, max(1, len(self._loose) // (4 * at_once)), len(self._loose))
        if not count:
            return None
        return _Sent(self._block([self._loose.popleft() for _ in range(count)], None), None)

    def _block(self, rows: Sequence[int], state: Snapshot | None) -> Block:
        plan = self.plan
        return Block(
            version=impact_damper_ros.__version__,
            parameters=plan.parameters,
            initial=plan.initial,
            settling=plan.settling,
            control=plan.control,
            points=tuple((row, tuple(plan.settings(plan.point(row)))) for row in rows),
            followed=self.followed,
            state=state,
            seconds=_SECONDS,
        )

    def returned(self, sent: _Sent, done: Sequence[Done]) -> None:
        """Take back what a worker has left."""
        if sent.line is None:
            self._loose.extendleft(row for row, _ in reversed(sent.block.points[len(done) :]))
            return
        line = sent.line
        line.place += len(done)
        line.state = done[-1].state
        if line.place < len(line.rows):
            self._lines.append(line)


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
        Its journal; each rig is on disk as soon as it is back.
    executor : SweepExecutor
        Where the rigs are run: anything with the `submit` of `concurrent.futures`, whose workers
        can import this package. It is left running.
    at_once : int or callable, optional
        How many blocks of rigs to have under way, now; 0 says that there are no workers.
    losses : tuple of exception types, optional
        What a future raises if its worker died; its rigs are then handed out again.
    progress : callable, optional
        Called with the number of rigs that have come back.

    Raises
    ------
    WorkersError
        If the workers die again and again, all have gone, or cannot run the rigs at all, as with
        another version of the package.
    OSError
        If the journal cannot be written.

    Notes
    -----
    The rows do not depend on the workers, their number, or the order in which they finish.
    """
    work = _Work(plan, journal)
    under_way: dict[FutureLike, _Sent] = {}
    finished: queue.SimpleQueue[FutureLike] = queue.SimpleQueue()

    def hand_out(sent: _Sent) -> None:
        future = executor.submit(run_block, sent.block)
        under_way[future] = sent
        future.add_done_callback(finished.put)

    def most() -> int:
        return at_once if isinstance(at_once, int) else at_once()

    try:
        while True:
            room = max(1, most())
            while len(under_way) < room:
                sent = work.next(room)
                if sent is None:
                    break
                hand_out(sent)
            if not under_way:
                return
            try:
                future = finished.get(timeout=_PATIENCE)
            except queue.Empty:
                if most() == 0:
                    raise WorkersError('all workers have gone') from None
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
            work.returned(sent, done)
            if progress is not None:
                progress(fresh)
    finally:
        for future in under_way:
            future.cancel()


def _again(sent: _Sent, error: BaseException) -> _Sent:
    if sent.tries >= _TRIES:
        first, last = sent.block.points[0][0], sent.block.points[-1][0]
        raise WorkersError(
            f'{sent.tries} workers in a row died while they ran some of the rigs {first} to '
            f'{last} ({type(error).__name__}: {error}): is there enough memory? Give fewer --jobs'
        ) from error
    # Less at a time, in case the rigs are to blame
    return replace(sent, tries=sent.tries + 1, block=replace(sent.block, seconds=0.0))
