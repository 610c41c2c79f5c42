# SPDX-License-Identifier: Apache-2.0
"""
Functions that run in processes of low priority, and what they send.

The processes are forks of a server (`multiprocessing`'s forkserver), which has loaded the solvers
and neither ROS nor the program that asks. It ends with this program.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait as wait_for
from types import ModuleType
from typing import Any

#: Modules that the server loads.
_PRELOADED = ['impact_damper_ros.theory.documents', 'scipy.linalg', 'scipy.optimize']
_THREADS = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
_NICENESS = 10
#: Longest processor time of a call, s.
PATIENCE_S = 60.0
_CONTEXT = multiprocessing.get_context('forkserver')
_CONTEXT.set_forkserver_preload(_PRELOADED)
_starting = threading.Lock()


@contextmanager
def _bare_start() -> Iterator[None]:
    """Let a process that starts now use one core, and not import the main module of this one."""
    main, before = sys.modules['__main__'], {name: os.environ.get(name) for name in _THREADS}
    sys.modules['__main__'] = ModuleType('__main__')
    os.environ.update(dict.fromkeys(_THREADS, '1'))
    try:
        yield
    finally:
        sys.modules['__main__'] = main
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value


def end_with_parent() -> None:
    """Let this process end when the one that started it does, however that ends."""
    parent = multiprocessing.parent_process()
    if parent is not None:

        def wait() -> None:
            wait_for([parent.sentinel])
            os._exit(1)

        threading.Thread(target=wait, daemon=True).start()


def _lower_priority(niceness: int) -> None:
    """Give this thread, and what it starts, the ordinary scheduling and at least a niceness."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    present = os.getpriority(os.PRIO_PROCESS, 0)
    os.setpriority(os.PRIO_PROCESS, 0, max(niceness, present))


def _carry_out(
    out: Connection,
    niceness: int,
    patience: float,
    function: Callable[..., Iterator[Any]],
    arguments: Any,
) -> None:
    """Send what a function yields, in the process that is for it."""
    # A server that another part of the program has started has the priority of that
    _lower_priority(niceness)
    # Ctrl-C in the terminal is for the program that asks
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with_parent()
    signal.setitimer(signal.ITIMER_PROF, patience)
    try:
        for answer in function(*arguments):
            out.send(answer)
    except BrokenPipeError:
        # The program that asked is ending
        os._exit(1)


class BackgroundCall:
    """
    A call of a generator function in a process of its own.

    It begins at once; no method waits for it.

    Parameters
    ----------
    function : callable
        A function at the top of a module, which yields what is sent.
    *arguments
        Its arguments.
    patience : float, optional
        Longest processor time, s; 0 for no limit.

    Attributes
    ----------
    end : str
        How the process has ended, in words; empty until all that it sent has been polled.
    """

    def __init__(
        self,
        function: Callable[..., Iterator[Any]],
        *arguments: Any,
        patience: float = PATIENCE_S,
    ) -> None:
        self.end = ''
        self._patience = patience
        self._incoming, out = _CONTEXT.Pipe(duplex=False)
        self._niceness = os.getpriority(os.PRIO_PROCESS, 0) + _NICENESS
        self._process = _CONTEXT.Process(
            target=_carry_out,
            args=(out, self._niceness, patience, function, arguments),
            daemon=True,
        )
        self._closed = False
        # The first one waits until the server has loaded its modules
        threading.Thread(target=self._start, args=(out,), daemon=True).start()

    def _start(self, out: Connection) -> None:
        # Of this thread, and so of a server that it starts
        _lower_priority(self._niceness)
        try:
            with _starting, _bare_start():
                # A server that still loads its modules would be ended by Ctrl-C in the terminal.
                # The tracker, which it needs, lets the signal through again where it starts.
                resource_tracker.ensure_running()
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
                if not self._closed:
                    self._process.start()
        except (OSError, EOFError) as error:
            self.end = f'the process cannot be started: {error or "no answer"}'
        finally:
            out.close()
        if self._closed and self.number:
            self._process.kill()

    @property
    def number(self) -> int:
        """Number of the process; 0 if it does not run."""
        return self._process.pid or 0

    def poll(self) -> list[Any]:
        """Return what has been sent since the last call."""
        found = []
        # It may send before it is known here by its number
        while self.number and not self._closed and not self.end and self._incoming.poll():
            try:
                found.append(self._incoming.recv())
            except (EOFError, OSError):
                self._process.join()
                self.end = self._ended()
        return found

    def _ended(self) -> str:
        code = self._process.exitcode or 0
        if code == -signal.SIGPROF:
            return f'not finished within {self._patience:g} s of computing'
        return f'the process has ended {f"by signal {-code}" if code < 0 else f"with code {code}"}'

    def close(self) -> None:
        """End the process, if it still runs."""
        self._closed = True
        if self.number:
            self._process.kill()
            self._process.join()
        self._incoming.close()
