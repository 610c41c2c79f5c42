"""A child process of this package: requests are lines of JSON, answers are lines."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import impact_damper_ros

#: Longest line of its output.
_LONGEST_LINE = 8 * 1024 * 1024


def environment() -> dict[str, str]:
    """Return the environment in which another Python finds this package."""
    root = str(Path(impact_damper_ros.__file__).parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
    return {**os.environ, 'PYTHONPATH': path}


class Child:
    """
    A running child process, which ends when it is closed.

    Parameters
    ----------
    command : sequence of str
        The command line.
    take : callable
        Called with each line of the output.
    on_end : callable, optional
        Called if the process ends by itself.
    """

    def __init__(
        self,
        command: Sequence[str],
        take: Callable[[bytes], None],
        on_end: Callable[[], None] = lambda: None,
    ) -> None:
        self._command = list(command)
        self._take = take
        self._on_end = on_end
        self._process: asyncio.subprocess.Process | None = None
        self._unsent: Any = None
        self._task = asyncio.ensure_future(self._run())

    @property
    def ended(self) -> bool:
        """Whether the process has ended."""
        return self._task.done()

    def send(self, request: Any) -> None:
        """Send a request; of those made before the process has started, only the last one."""
        if self._process is None or self._process.stdin is None:
            self._unsent = request
            return
        with contextlib.suppress(OSError, RuntimeError):
            self._process.stdin.write(f'{json.dumps(request)}\n'.encode())

    async def _run(self) -> None:
        try:
            process = await asyncio.create_subprocess_exec(
                *self._command,
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                env=environment(),
                limit=_LONGEST_LINE,
            )
        except OSError:  # of a machine without room for another process
            self._on_end()
            return
        assert process.stdout is not None
        self._process = process
        if self._unsent is not None:
            self.send(self._unsent)
        try:
            # A line longer than the limit raises ValueError.
            with contextlib.suppress(ValueError):
                while line := await process.stdout.readline():
                    self._take(line)
            self._on_end()
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            with contextlib.suppress(ValueError):
                while await process.stdout.read(_LONGEST_LINE):
                    pass
            await process.wait()

    async def close(self) -> None:
        """End the process."""
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
