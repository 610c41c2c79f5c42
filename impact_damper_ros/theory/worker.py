# SPDX-License-Identifier: Apache-2.0
"""
The process that computes theory: requests on its standard input, answers on its standard output.

Only the newest request counts. Each is processed by a fork of this process, which has all modules
loaded, and is killed when the next one arrives. The process ends with its input, hence with the
program that started it, however that ends. ROS is not imported here.
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
from typing import NoReturn

# Loaded here once; the solvers import it on first use, which would be in each fork.
import scipy.linalg
import scipy.optimize  # noqa: F401

from .child_process import decoded, send
from .documents import theory
from .prediction import Prediction

NICENESS = 10
#: Delay of the work, s: turning a knob makes a request at each step, and only the last counts.
_QUIET_S = 0.04
#: Longest processor time of a request, s.
_PATIENCE_S = 60.0
_BLOCK = 1 << 20
_PR_SET_PDEATHSIG = 1


def _answer(line: bytes, answers: int) -> NoReturn:
    """Process a request, in a fork, and end."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.setitimer(signal.ITIMER_PROF, _PATIENCE_S)
    try:
        number, state, measured, document = decoded(line)
        time.sleep(_QUIET_S)
        try:
            for answer in theory(state, measured, document=document):
                known = isinstance(answer, Prediction)
                send(answers, (number, answer if known else json.dumps(answer, allow_nan=False)))
            send(answers, (number, None))
        except Exception as error:
            send(answers, (number, Prediction(error=f'{type(error).__name__}: {error}')))
    finally:
        os._exit(0)


class _Fork:
    """A fork that processes a request."""

    def __init__(self, line: bytes, answers: int) -> None:
        self._line, self._answers = line, answers
        self._process = os.fork()
        if not self._process:
            _answer(line, answers)
        #: Can be read when the fork has ended.
        self.descriptor = os.pidfd_open(self._process)

    def end(self, *, killed: bool) -> None:
        """Bury it; if it was not killed by this process, say how it failed."""
        if killed:
            with contextlib.suppress(ProcessLookupError):
                os.kill(self._process, signal.SIGKILL)
        os.close(self.descriptor)
        code = os.waitstatus_to_exitcode(os.waitpid(self._process, 0)[1])
        if code and not killed:
            how = f'the search ended by signal {-code}'
            if code == -signal.SIGPROF:
                how = f'not finished within {_PATIENCE_S:g} s of computing'
            send(self._answers, (decoded(self._line)[0], Prediction(error=how)))


def _serve(answers: int) -> None:
    """Process requests until the input ends."""
    fork: _Fork | None = None
    read = b''
    while True:
        watched = [0] if fork is None else [0, fork.descriptor]
        ready = select.select(watched, [], [])[0]
        if fork is not None and fork.descriptor in ready:
            fork.end(killed=False)
            fork = None
        if 0 not in ready:
            continue
        block = os.read(0, _BLOCK)
        *lines, read = (read + block).split(b'\n')
        requests = list(filter(None, lines))
        if fork is not None and (requests or not block):
            fork.end(killed=True)
            fork = None
        if not block:
            break
        if requests:
            fork = _Fork(requests[-1], answers)


def main() -> None:
    """Serve the program that has started this process."""
    # Not the scheduling of the thread that started it
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    os.nice(NICENESS)
    warnings.simplefilter('ignore')
    # Answers have a channel of their own: what a library prints must not get among them.
    answers = os.dup(1)
    os.dup2(2, 1)
    # A collection in a fork would copy all pages for nothing.
    gc.freeze()
    with contextlib.suppress(BrokenPipeError):
        _serve(answers)


if __name__ == '__main__':
    main()
