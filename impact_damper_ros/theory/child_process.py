# SPDX-License-Identifier: Apache-2.0
"""
A module of this package in a process of its own, which takes and gives Python objects.

Each message is a line of base64 on the standard input or output of that process. A message that is
cut off by the end of its writer is left out: each line begins with a line break.
"""

from __future__ import annotations

import base64
import contextlib
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import impact_damper_ros

_BLOCK = 1 << 20


def environment() -> dict[str, str]:
    """Return the environment in which another Python finds this package and uses one core."""
    root = str(Path(impact_damper_ros.__file__).parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
    threads = ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'MKL_NUM_THREADS')
    return {**os.environ, **dict.fromkeys(threads, '1'), 'PYTHONPATH': path}


def encoded(message: Any) -> bytes:
    """Return the line of a message."""
    return b'\n' + base64.b64encode(pickle.dumps(message)) + b'\n'


def decoded(line: bytes) -> Any:
    """Return the message of a line; None of one that is empty or cut off."""
    try:
        return pickle.loads(base64.b64decode(line, validate=True))
    except (ValueError, EOFError, pickle.UnpicklingError):
        return None


def send(descriptor: int, message: Any) -> None:
    """Write a message whole."""
    line = encoded(message)
    while line:
        line = line[os.write(descriptor, line) :]


class ChildProcess:
    """
    A running child process; `poll` must be called often, as there is no thread that waits for it.

    Parameters
    ----------
    *command : str
        What follows the name of the Python interpreter, as ``-m`` and the name of a module.

    Attributes
    ----------
    number : int
        Number of the process.
    """

    def __init__(self, *command: str) -> None:
        # Not in the group that Ctrl-C in a terminal interrupts
        self._process = subprocess.Popen(
            [sys.executable, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            bufsize=0,
            env=environment(),
            process_group=0,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._in, self._out = self._process.stdin, self._process.stdout
        for stream in (self._in, self._out):
            os.set_blocking(stream.fileno(), False)
        self.number = self._process.pid
        self._writing = self._next = b''
        self._read = b''

    @property
    def end(self) -> str:
        """How the process has ended, in words; empty while it runs."""
        code = self._process.poll()
        if code is None:
            return ''
        return f'by signal {-code}' if code < 0 else f'with code {code}'

    def send(self, message: Any) -> None:
        """Send a message; it replaces those that the process could not take yet."""
        self._next = encoded(message)
        self._write()

    def poll(self) -> list[Any]:
        """Return the messages that have come since the last call."""
        self._write()
        with contextlib.suppress(BlockingIOError):
            while block := os.read(self._out.fileno(), _BLOCK):
                self._read += block
        *lines, self._read = self._read.split(b'\n')
        return [message for line in lines if (message := decoded(line)) is not None]

    def _write(self) -> None:
        # The process has ended, or takes no more now.
        with contextlib.suppress(BrokenPipeError, BlockingIOError):
            while self._writing or self._next:
                if not self._writing:
                    self._writing, self._next = self._next, b''
                self._writing = self._writing[os.write(self._in.fileno(), self._writing) :]

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.wait()
        self._in.close()
        self._out.close()
