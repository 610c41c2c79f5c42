"""Processes that compute for a command, and their number on the command line."""

from __future__ import annotations

import argparse
import signal
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context

__all__ = ['add_jobs_option', 'worker_pool']


def _jobs(text: str) -> int:
    try:
        value = int(text)
    except ValueError:
        value = 0
    if not 1 <= value <= 64:
        raise argparse.ArgumentTypeError(f'{text!r}: give a whole number from 1 to 64')
    return value


def add_jobs_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--jobs``."""
    parser.add_argument('--jobs', type=_jobs, default=2, metavar='N', help='processes [2]')


def _quiet_worker() -> None:
    """Leave Ctrl-C to the parent, and the cores to the processes."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def worker_pool(jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Provide processes; what is under way is not waited for if something goes wrong."""
    pool = ProcessPoolExecutor(jobs, get_context('spawn'), initializer=_quiet_worker)
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)
