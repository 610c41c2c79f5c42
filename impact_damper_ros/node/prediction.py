"""
The node's side of the prediction: a worker process, its requests and its answers.

A thread of its own starts the worker, writes to it and restarts it if it ends; another one
reads its answers. They sleep but for some microseconds per request, so that neither the engine
nor the executor ever waits for a prediction.
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import impact_damper_ros
from impact_damper_ros.orbits.orbit import Apart, Rhythm
from impact_damper_ros.rig import Event


@dataclass(frozen=True)
class PredictedMotion:
    """
    A periodic motion of the theory.

    Attributes
    ----------
    rhythm : Rhythm
        Stops, period, phases, X.
    amplitude_ratio : float
        Largest |X| as a share of the amplitude A without impacts.
    largest_multiplier : float
        Largest modulus of the stability multipliers.
    stable, viable : bool
        Whether it is stable, and whether the rig can perform it.
    reason : str
        Why it is not viable.
    """

    rhythm: Rhythm
    amplitude_ratio: float
    largest_multiplier: float
    stable: bool
    viable: bool
    reason: str

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> PredictedMotion:
        """Read a motion written by the worker."""
        names = ('amplitude_ratio', 'largest_multiplier', 'stable', 'viable', 'reason')
        return cls(Rhythm.from_dict(stored), *(stored[name] for name in names))


@dataclass(frozen=True)
class Answer:
    """
    The answer of the worker to a request.

    Attributes
    ----------
    request : int
        Number of the request; 0 before the first answer.
    motions : tuple of PredictedMotion
        Stable and viable ones first.
    expected : PredictedMotion or None
        The one of them that is predicted.
    basis, reason : str
        Why that one, or why there is none.
    complete : bool
        Whether no better answer is to come.
    seconds : float
        Time since the worker took the request, s.
    error : str
        Description of a failure; empty if there is none.
    applies : bool
        Whether the theory applies to such a rig.
    """

    request: int = 0
    motions: tuple[PredictedMotion, ...] = ()
    expected: PredictedMotion | None = None
    basis: str = ''
    reason: str = ''
    complete: bool = False
    seconds: float = 0.0
    error: str = ''
    applies: bool = True

    @classmethod
    def from_line(cls, line: bytes) -> Answer:
        """Read a motion written by the worker."""
        stored = json.loads(line)
        motions = tuple(PredictedMotion.from_dict(orbit) for orbit in stored.get('orbits', ()))
        index = stored.get('expected')
        return cls(
            stored['request'],
            motions,
            None if index is None else motions[index],
            stored.get('basis', ''),
            stored.get('reason', ''),
            stored['complete'],
            stored['seconds'],
            stored.get('error', ''),
            stored.get('applies', True),
        )

    def nearest(self, measured: Rhythm) -> tuple[PredictedMotion, Apart] | None:
        """Return the nearest motion, beginning at the same impact, and its distance."""
        found = []
        for motion in self.motions:
            turned = motion.rhythm.nearest_turn(measured)
            if turned is not None:
                found.append((replace(motion, rhythm=turned[0]), turned[1]))
        return min(found, key=lambda pair: max(pair[1]), default=None)


WORKER = 'impact_damper_ros.node.prediction_worker'
#: After the node has started, so that its start is not slowed down.
FIRST_START_S = 1.0
#: Pause before a worker that ended is restarted; doubled each time, up to the second number,
#: and the first one again once a worker has lived for the second.
BACK_OFF_S, LONGEST_BACK_OFF_S = 0.5, 60.0
END_TIMEOUT_S = 1.0
# One core is enough for small matrices, and the others are the rig's.
_ONE_THREAD = dict.fromkeys(('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS'), '1')


@dataclass(frozen=True)
class PredictorStatus:
    """
    State of the prediction.

    Attributes
    ----------
    enabled : bool
        Whether predictions are wanted.
    course : int
        Number of the newest course that was asked for; 0 before the first.
    answer : Answer
        The newest answer for that course; its request is 0 if there is none yet.
    process : int
        Process number of the worker; 0 if there is none.
    restarts : int
        Number of restarts of the worker.
    trouble : str
        Why there is no worker at present; empty if there is one, or none is needed.
    last_trouble : str
        Why the last worker ended, if one did.
    """

    enabled: bool = True
    course: int = 0
    answer: Answer = field(default_factory=Answer)
    process: int = 0
    restarts: int = 0
    trouble: str = ''
    last_trouble: str = ''


class _Worker:
    """A running worker, and the thread that reads its answers."""

    def __init__(self, command: Sequence[str], take: Callable[[_Worker], None]) -> None:
        root = str(Path(impact_damper_ros.__file__).parents[1])
        path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
        self.began = time.monotonic()
        # The ROS 2 wheels restart Python unless their mark is in the environment; this
        # process has it already, so the worker starts once.
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **_ONE_THREAD, 'PYTHONPATH': path},
        )
        self._reader = threading.Thread(target=take, args=(self,), daemon=True)
        self._reader.start()

    def answers(self) -> Iterator[bytes]:
        """Yield the lines of the worker until it ends."""
        assert self.process.stdout is not None
        with self.process.stdout as stream:
            yield from stream

    def write(self, line: str) -> None:
        """Send a request."""
        assert self.process.stdin is not None
        # If the worker has ended, its reader is about to report that, and the next one gets it.
        with contextlib.suppress(OSError):
            self.process.stdin.write(line.encode())
            self.process.stdin.flush()

    def end(self) -> int:
        """End the worker by the end of its input, or by force; return its exit code."""
        assert self.process.stdin is not None
        with contextlib.suppress(OSError):
            self.process.stdin.close()
        try:
            code = self.process.wait(END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self._reader.join(END_TIMEOUT_S)
        return code


class Predictor:
    """
    Predictions for the newest course of a rig, from a process of low priority.

    Parameters
    ----------
    on_answer : callable
        Called from a thread of the predictor when an answer has come, or the worker has ended.
    warn : callable
        Takes warnings for the console.
    enabled : bool, optional
        Whether to predict.
    command : sequence of str, optional
        What starts the worker.
    on_thread : callable, optional
        Called first of all in each thread of the predictor.
    """

    def __init__(
        self,
        on_answer: Callable[[], object],
        warn: Callable[[str], object],
        *,
        enabled: bool = True,
        command: Sequence[str] = (sys.executable, '-m', WORKER),
        on_thread: Callable[[], object] = lambda: None,
    ) -> None:
        self._on_answer = on_answer
        self._warn = warn
        self._command = list(command)
        self._on_thread = on_thread
        self._enabled = enabled
        # Number and snapshot of the newest course; written by `ask` alone
        self._course, self._snapshot = 0, ''
        # The newest answer, and the course that it is for
        self._answered: tuple[int, Answer] = (0, Answer())
        # Number of the newest request, the course that it is for, and its text until it is sent
        self._request, self._requested, self._unsent = 0, 0, ''
        self._worker: _Worker | None = None
        self._restarts = 0
        self._trouble = self._last_trouble = ''
        self._pause = BACK_OFF_S
        self._due = time.monotonic() + FIRST_START_S
        # Carried out in order by the predictor's own thread
        self._orders: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name='predictor', daemon=True)
        self._thread.start()

    # Called from other threads; none of these waits, but for `close`

    def ask(self, snapshot: str) -> None:
        """Request the motion of a rig that was changed or reset; from one thread only."""
        self._snapshot = snapshot
        self._course += 1
        self._orders.put(lambda: self._compose(None))

    def ask_like(self, rhythm: Rhythm, impact: Event, phase: float, course: int) -> None:
        """Request the motion once more, given how the rig was measured to move."""
        measured = {'rhythm': rhythm.as_dict(), 'impact': impact, 'phase': phase}

        def order() -> None:
            if course == self._course:
                self._compose(measured)

        self._orders.put(order)

    def enable(self, enabled: bool) -> None:
        """Switch the prediction on, or off and end the worker."""
        self._orders.put(lambda: self._switch(enabled))

    def status(self) -> PredictorStatus:
        """Return the state of the prediction."""
        worker, course = self._worker, self._course
        answered, answer = self._answered
        return PredictorStatus(
            self._enabled,
            course,
            answer if answered == course else Answer(),
            worker.process.pid if worker is not None else 0,
            self._restarts,
            self._trouble,
            self._last_trouble,
        )

    def close(self) -> None:
        """End the worker; no callback comes after that."""
        self._closing = True
        self._orders.put(lambda: None)
        self._thread.join(END_TIMEOUT_S)
        if (worker := self._worker) is not None:
            self._worker = None
            if self._thread.is_alive():
                # It waits for a worker that does not read.
                worker.process.kill()
            worker.end()

    # The predictor's thread

    def _run(self) -> None:
        # Inherited by the worker: Ctrl-C and the end of the terminal are signals to the node, and
        # must not reach the worker while it starts
        signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGHUP})
        self._on_thread()
        while not self._closing:
            wait = None
            if self._worker is None and self._enabled and self._course:
                wait = max(0.0, self._due - time.monotonic())
            try:
                self._orders.get(timeout=wait)()
            except queue.Empty:
                self._start()
            # Of several requests in a row only the last one is sent.
            if self._worker is not None and self._unsent and self._orders.empty():
                line, self._unsent = self._unsent, ''
                self._worker.write(line)

    def _compose(self, measured: dict[str, Any] | None) -> None:
        if not self._enabled:
            return
        # In this order: an answer to the request before must not pass for one to this course.
        self._request += 1
        self._requested = self._course
        head = f'"request": {self._request}, "measured": {json.dumps(measured)}'
        # The snapshot is JSON already.
        self._unsent = f'{{{head}, "snapshot": {self._snapshot}}}\n'

    def _switch(self, enabled: bool) -> None:
        self._enabled = enabled
        self._trouble, self._unsent = '', ''
        if enabled:
            self._pause, self._due = BACK_OFF_S, time.monotonic()
        elif (worker := self._worker) is not None:
            self._worker = None
            worker.end()
            self._answered = (0, Answer())

    def _start(self) -> None:
        """Start a worker, and ask it the request that is not answered yet."""
        try:
            worker = _Worker(self._command, self._read)
        except OSError as error:
            self._fail(f'the predicting process cannot be started: {error}')
            return
        # In this order: who sees the worker sees no trouble.
        self._trouble = ''
        self._worker = worker
        course, answer = self._answered
        if not self._unsent and (course != self._course or not answer.complete):
            self._compose(None)

    def _read(self, worker: _Worker) -> None:
        """Take answers, in a thread of their own."""
        self._on_thread()
        try:
            for line in worker.answers():
                answer = Answer.from_line(line)
                if answer.request == self._request:
                    self._answered = (self._requested, answer)
                    self._tell()
        except (ValueError, KeyError, TypeError) as error:
            self._warn(f'the output of the predicting process cannot be read: {error}')
        self._orders.put(lambda: self._bury(worker))

    def _bury(self, worker: _Worker) -> None:
        """Replace a worker that has ended, unless it was ended on purpose."""
        if worker is not self._worker or self._closing:
            return
        self._worker = None
        code = worker.end()
        if time.monotonic() - worker.began > LONGEST_BACK_OFF_S:
            self._pause = BACK_OFF_S
        how = f'by signal {-code}' if code < 0 else f'with code {code}'
        self._fail(f'the predicting process has ended {how}')

    def _fail(self, trouble: str) -> None:
        self._last_trouble = trouble
        self._trouble = f'{trouble}; it is restarted after {self._pause:g} s'
        self._due = time.monotonic() + self._pause
        self._pause = min(2.0 * self._pause, LONGEST_BACK_OFF_S)
        self._restarts += 1
        self._warn(self._trouble)
        self._tell()

    def _tell(self) -> None:
        if not self._closing:
            self._on_answer()
