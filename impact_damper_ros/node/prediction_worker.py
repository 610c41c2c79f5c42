"""
The process that predicts periodic motions for a node.

It reads requests from its standard input and writes answers to its standard output, one JSON
object per line. Only the newest request counts. Each is processed by a fork of this process, which
has all modules loaded: an older request is ended by killing its fork, and a new one starts within
milliseconds.

The forks have the kernel's idle priority, so that they take no time from the engine of the node,
whatever else runs. Where other programs leave them hardly any time at all, a fork of low but
ordinary priority takes over.

ROS is not imported here. The process ends with its input, hence with the node, however that ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import json
import os
import select
import signal
import time
import warnings
from collections.abc import Iterator
from typing import Any, NoReturn

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import PeriodicOrbit
from impact_damper_ros.orbits.orbit import Rhythm
from impact_damper_ros.rig import Event, EventKind
from impact_damper_ros.theory import ObservedMotion, Prediction, predictions

NICENESS = 5
#: Without a first answer after this time, or the last one after the second, a fork of ordinary
#: priority takes over.
HURRY_S, LONG_HURRY_S = 0.25, 2.0
#: After the first, quick answer the parameters must have been left alone for so long before the
#: search continues, so that a parameter that is still being changed causes quick searches only.
QUIET_S = 0.3
#: Longest search.
PATIENCE_S = 60
_BLOCK = 65_536
_PR_SET_PDEATHSIG = 1


def _orbit(orbit: PeriodicOrbit) -> dict[str, Any]:
    """Return a motion for the node."""
    return {
        'stops': orbit.stops,
        'cycles': orbit.cycles,
        'phases': orbit.phases,
        'x': orbit.x,
        'x_max': orbit.x_max,
        'amplitude_ratio': orbit.amplitude_ratio,
        'largest_multiplier': abs(orbit.multipliers[0]),
        'stable': orbit.stable,
        'viable': orbit.viable,
        'reason': orbit.reason,
    }


def _answer(prediction: Prediction) -> dict[str, Any]:
    expected = next(
        (i for i, orbit in enumerate(prediction.orbits) if orbit is prediction.expected), None
    )
    return {
        'orbits': [_orbit(orbit) for orbit in prediction.orbits],
        'expected': expected,
        'basis': prediction.basis,
        'reason': prediction.reason,
        'complete': prediction.complete,
        'applies': prediction.applies,
    }


def _answers(request: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield answers to a request, each better than the one before."""
    try:
        observed = None
        if (measured := request['measured']) is not None:
            instant, kind, *numbers = measured['impact']
            impact = Event(instant, EventKind(kind), *numbers)
            observed = ObservedMotion(
                Rhythm.from_dict(measured['rhythm']), impact, measured['phase']
            )
        rig = Rig.restore(request['snapshot']['state'])
        for prediction in predictions(rig, observed):
            yield _answer(prediction)
    except Exception as error:
        yield _failure(f'{type(error).__name__}: {error}')


def _failure(error: str) -> dict[str, Any]:
    return {'error': error, 'complete': True}


def _idle() -> None:
    """Take the idle priority, where the system has it; it may be final."""
    with contextlib.suppress(AttributeError, OSError):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def _work(line: bytes, began: float, out: int, given: int | None) -> NoReturn:
    """Answer a request, in a fork, and end."""
    with contextlib.suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.alarm(PATIENCE_S)
    if given is None:
        _idle()
    request = json.loads(line)
    for count, answer in enumerate(_answers(request)):
        if count < (given or 0):
            continue
        seconds = time.monotonic() - began
        _write(out, {'request': request['request'], 'seconds': seconds, **answer})
        if count == 0:
            time.sleep(QUIET_S)
    os._exit(0)


def _write(out: int, message: dict[str, Any]) -> None:
    rest = json.dumps(message).encode() + b'\n'
    while rest:
        rest = rest[os.write(out, rest) :]


class _Fork:
    """A fork that works on a request."""

    def __init__(
        self, line: bytes, began: float, given: int | None, others: tuple[int, ...]
    ) -> None:
        self.line, self.began = line, began
        self.hurried = given is not None
        self.answers = given or 0
        self.pipe, out = os.pipe()
        self._read = b''
        self._process = os.fork()
        if self._process == 0:
            try:
                for descriptor in (*others, self.pipe):
                    os.close(descriptor)
                _work(line, began, out, given)
            finally:
                os._exit(1)
        os.close(out)

    def take(self) -> bytes | None:
        """Return whole lines that have come, or None if it has ended."""
        block = os.read(self.pipe, _BLOCK)
        if not block:
            return None
        whole, separator, self._read = (self._read + block).rpartition(b'\n')
        lines = whole + separator
        self.answers += lines.count(b'\n')
        return lines

    def end(self) -> int:
        """End it, and return its exit code, or minus the signal that it ended by."""
        with contextlib.suppress(ProcessLookupError):
            os.kill(self._process, signal.SIGKILL)
        os.close(self.pipe)
        return os.waitstatus_to_exitcode(os.waitpid(self._process, 0)[1])


class _Server:
    """Answer requests until the input ends."""

    def __init__(self, requests: int, answers: int) -> None:
        self._requests, self._answers = requests, answers
        self._read = b''
        self._fork: _Fork | None = None

    def serve(self) -> None:
        """Read requests and forward answers."""
        while True:
            fork = self._fork
            watched = [self._requests] if fork is None else [self._requests, fork.pipe]
            ready = select.select(watched, [], [], self._time_left())[0]
            if self._requests in ready:
                block = os.read(self._requests, _BLOCK)
                if not block:
                    break
                lines, _, self._read = (self._read + block).rpartition(b'\n')
                if lines:
                    self._begin(lines.rpartition(b'\n')[2], time.monotonic(), None)
            elif fork is not None and fork.pipe in ready:
                self._forward(fork)
            elif fork is not None and self._time_left() == 0.0:
                self._begin(fork.line, fork.began, fork.answers)
        self._end()

    def _time_left(self) -> float | None:
        """Return the time until the present fork is to be replaced, s; None for ever."""
        fork = self._fork
        if fork is None or fork.hurried:
            return None
        patience = LONG_HURRY_S if fork.answers else HURRY_S
        return max(0.0, fork.began + patience - time.monotonic())

    def _begin(self, line: bytes, began: float, given: int | None) -> None:
        self._end()
        self._fork = _Fork(line, began, given, (self._requests, self._answers))

    def _end(self) -> int:
        fork, self._fork = self._fork, None
        return 0 if fork is None else fork.end()

    def _forward(self, fork: _Fork) -> None:
        lines = fork.take()
        if lines is not None:
            while lines:
                lines = lines[os.write(self._answers, lines) :]
        elif code := self._end():
            how = f'no result within {PATIENCE_S} s'
            if code != -signal.SIGALRM:
                how = f'the search ended {f"by signal {-code}" if code < 0 else f"with {code}"}'
            number = json.loads(fork.line)['request']
            seconds = time.monotonic() - fork.began
            _write(self._answers, {'request': number, 'seconds': seconds, **_failure(how)})


def main() -> int:
    """Serve the node that has started this process."""
    os.nice(NICENESS)
    with contextlib.suppress(AttributeError, OSError):
        # Not the scheduling of the thread that started this process
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    # A Ctrl-C in a terminal reaches all processes; the node ends this one.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter('ignore')
    # Answers have a channel of their own: what a library prints must not get among them.
    answers = os.dup(1)
    os.dup2(2, 1)
    # A collection in a fork would copy all pages for nothing.
    gc.freeze()
    with contextlib.suppress(BrokenPipeError):
        _Server(0, answers).serve()
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
