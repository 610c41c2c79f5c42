"""Processes on this machine that compute."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import connection, get_context, parent_process
from typing import Any

__all__ = ['ProcessPool']


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
