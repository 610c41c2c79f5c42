"""
The process that computes theory for the page.

It reads requests from its standard input and writes messages to its standard output, one JSON
object per line. Only the newest request counts: each is processed by a fork of this process, which
has all modules loaded, and is killed when the next one arrives. A line that this cuts off stays
unfinished, so each line begins with a line break. The process ends with its input.
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

from .theory import theory

NICENESS = 5
#: Delay of the work, s: turning a knob makes a request at each step, and only the last counts.
_QUIET_S = 0.04
#: Longest processor time of a request, s.
_PATIENCE_S = 60
_BLOCK = 65_536
_PR_SET_PDEATHSIG = 1


def _write(message: dict[str, object]) -> None:
    line = f'\n{json.dumps(message, allow_nan=False)}\n'.encode()
    while line:
        line = line[os.write(1, line) :]


def _end_of_patience(*_: object) -> NoReturn:
    raise TimeoutError(f'not finished within {_PATIENCE_S} s of computing')


def _work(line: bytes) -> NoReturn:
    """Process a request, in a fork."""
    code = 0
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    signal.signal(signal.SIGPROF, _end_of_patience)
    signal.setitimer(signal.ITIMER_PROF, _PATIENCE_S)
    number = 0
    try:
        request = json.loads(line)
        number = request['number']
        time.sleep(_QUIET_S)
        try:
            for message in theory(
                request['state'], orbit=request['orbit'], curve=request['curve']
            ):
                _write({**message, 'for': number})
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            _write({'type': 'theory_failed', 'text': f'{error}', 'for': number})
    except Exception as error:
        code = 1
        with contextlib.suppress(OSError):
            text = f'{type(error).__name__}: {error}'
            _write({'type': 'theory_failed', 'text': text, 'for': number})
    finally:
        os._exit(code)


def _end(fork: int) -> None:
    with contextlib.suppress(ProcessLookupError, ChildProcessError):
        os.kill(fork, signal.SIGKILL)
        os.waitpid(fork, 0)


def main() -> None:
    """Serve requests until the input ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    warnings.simplefilter('ignore')
    os.nice(NICENESS)
    gc.freeze()
    fork, waiting = 0, b''
    while True:
        select.select([0], [], [])
        block = os.read(0, _BLOCK)
        if not block:
            break
        waiting += block
        *lines, waiting = waiting.split(b'\n')
        if not lines:
            continue
        if fork:
            _end(fork)
            fork = 0
        if lines[-1]:
            fork = os.fork()
            if not fork:
                _work(lines[-1])
    if fork:
        _end(fork)


if __name__ == '__main__':
    main()
