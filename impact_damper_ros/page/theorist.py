"""Theory for the pages: a process that is asked at each change, and what it has found."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import impact_damper_ros

__all__ = ['Theorist']


_PROCESS = 'impact_damper_ros.page.theory_process'
#: Longest line of its output.
_LONGEST_LINE = 8 * 1024 * 1024
#: A process that has ended is started again at the next request, but not sooner than this, s.
_BACK_OFF_S = 2.0


class Theorist:
    """
    What theory says of the present rig.

    Parameters
    ----------
    tell : callable
        Takes each message.
    command : sequence of str, optional
        What starts the process.

    Attributes
    ----------
    predicted, optimum : float or None
        Xmax/A of the predicted motion, and the gap with the least; None if they are not known.
    """

    def __init__(
        self,
        tell: Callable[[dict[str, Any]], None],
        command: Sequence[str] = (sys.executable, '-m', _PROCESS),
    ) -> None:
        self._tell = tell
        self._command = list(command)
        self._known: dict[str, dict[str, Any]] = {}
        self._wanted = {'orbit': True, 'curve': True}
        self._state: dict[str, Any] | None = None
        self._number = 0
        self._process: asyncio.subprocess.Process | None = None
        self._task: asyncio.Task[None] | None = None
        self._began = 0.0
        self.predicted: float | None = None
        self.optimum: float | None = None

    def ask(self, state: dict[str, Any]) -> None:
        """Begin to work on a rig, and forget the one before."""
        self.forget()
        self._state = state
        self._number += 1
        if self._process is not None:
            self._send()
        else:
            self.start()

    def start(self) -> None:
        """Start the process, which takes a while, unless it runs."""
        if self._task is None or self._task.done():
            self._task = asyncio.ensure_future(self._serve())

    def want(self, orbit: bool, curve: bool) -> None:
        """Say what is wanted."""
        wanted = {'orbit': orbit, 'curve': curve}
        if wanted != self._wanted:
            self._wanted = wanted
            if self._state is not None:
                self.ask(self._state)

    def forget(self) -> None:
        """Forget what is known: the rig is another one."""
        self._known.clear()
        self.predicted = self.optimum = None

    def known(self) -> list[dict[str, Any]]:
        """Return the newest message of each kind."""
        return list(self._known.values())

    def _send(self) -> None:
        process = self._process
        if process is None or process.stdin is None or self._state is None:
            return
        request = {'number': self._number, 'state': self._state, **self._wanted}
        with contextlib.suppress(OSError, RuntimeError):
            process.stdin.write(f'{json.dumps(request)}\n'.encode())

    async def _serve(self) -> None:
        """Run the process, and take what it finds, until it ends."""
        await asyncio.sleep(max(0.0, self._began + _BACK_OFF_S - time.monotonic()))
        self._began = time.monotonic()
        root = str(Path(impact_damper_ros.__file__).parents[1])
        path = os.pathsep.join(filter(None, [root, os.environ.get('PYTHONPATH')]))
        process = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env={**os.environ, 'PYTHONPATH': path},
            limit=_LONGEST_LINE,
        )
        self._process = process
        self._send()
        assert process.stdout is not None
        try:
            while line := await process.stdout.readline():
                self._take(line)
        except ValueError:  # a line beyond all measure
            process.kill()
        finally:
            self._process = None
        await process.wait()

    def _take(self, line: bytes) -> None:
        try:
            message = json.loads(line)
        except ValueError:  # cut off by the next request, or empty
            return
        if message.get('for') != self._number:
            return
        self._known[message['type']] = message
        if message['type'] == 'orbit' and message['found']:
            self.predicted = message.get('x_max_ratio')
        if message['type'] == 'gap_curve' and message['optimum']:
            self.optimum = message['optimum']['gap']
        self._tell(message)

    def close(self) -> None:
        """End the process."""
        if self._task is not None:
            self._task.cancel()
        if self._process is not None:
            with contextlib.suppress(ProcessLookupError):
                self._process.kill()
