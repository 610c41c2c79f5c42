"""Run a sweep: hand out the rigs that are not done, and write down what comes back."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from dataclasses import dataclass, replace

import impact_damper_ros

from .sweep_executors import FutureLike, SweepExecutor, WorkersError
from .sweep_journal import Journal
from .sweep_plan import Follow, SweepPlan
from .sweep_work import Block, Done, Snapshot, run_block

__all__ = ['run_sweep']

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
