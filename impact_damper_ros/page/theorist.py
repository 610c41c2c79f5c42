"""Theory for the pages: a child process that computes it, and its results so far."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Callable, Sequence
from typing import Any

from .child import Child

_PROCESS = 'impact_damper_ros.page.theory_process'
#: Time after which a process that has ended is started again, s.
_BACK_OFF_S = 2.0


class Theorist:
    """
    Predictions of the theory for the present rig.

    Parameters
    ----------
    tell : callable
        Called with each message.
    command : sequence of str, optional
        Command line of the process.

    Attributes
    ----------
    predicted, optimum : float or None
        Xmax/A of the predicted motion, and the gap with the least Xmax/A; None if not known.
    bound : str
        Whether the best gap is ``'at least'`` or ``'at most'`` the optimum; empty if it is that.
    complete : bool
        Whether the curve over the gap is complete, so that the optimum is final.
    failed : bool
        Whether the theory does not apply to the rig.
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
        self._child: Child | None = None
        self._again: asyncio.TimerHandle | None = None
        self.predicted: float | None = None
        self.optimum: float | None = None
        self.bound = ''
        self.complete = self.failed = False

    def ask(self, state: dict[str, Any]) -> None:
        """Request the theory of a rig, and discard that of the one before."""
        self.forget()
        self._state = state
        self._number += 1
        self.start()
        if self._child is not None:
            self._child.send({'number': self._number, 'state': state, **self._wanted})

    def start(self) -> None:
        """Start the process; if it ends, it is started again with the last request."""
        if self._child is None:
            self._child = Child(self._command, self._take, self._ended)

    def _ended(self) -> None:
        self._again = asyncio.get_running_loop().call_later(_BACK_OFF_S, self._start_again)

    def _start_again(self) -> None:
        self._child = None
        if self._state is None:
            self.start()
        else:
            self.ask(self._state)

    def want(self, orbit: bool, curve: bool) -> None:
        """Choose what is computed."""
        wanted = {'orbit': orbit, 'curve': curve}
        if wanted != self._wanted:
            self._wanted = wanted
            if self._state is not None:
                self.ask(self._state)

    def forget(self) -> None:
        """Discard all results: the rig has changed."""
        self._known.clear()
        self.predicted = self.optimum = None
        self.complete = self.failed = False

    def known(self) -> list[dict[str, Any]]:
        """Return the newest message of each kind."""
        return list(self._known.values())

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
        if message['type'] == 'gap_curve':
            best = message['optimum'] or {'gap': None, 'bound': ''}
            self.optimum, self.bound = best['gap'], best['bound']
            self.complete = message['done']
        self.failed |= message['type'] == 'theory_failed'
        self._tell(message)

    async def close(self) -> None:
        """End the process."""
        if self._again is not None:
            self._again.cancel()
        if self._child is not None:
            await self._child.close()
