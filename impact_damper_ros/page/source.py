# SPDX-License-Identifier: Apache-2.0
"""Sources of pages: a rig in the network, a recording or, as here, none."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

from impact_damper_ros import __version__

from .frames import LAYOUT, PageView
from .requests import RequestError

#: Messages of theory as long as its parts are unknown.
_UNKNOWN: dict[str, dict[str, Any]] = {
    'orbit': {'type': 'orbit', 'found': False, 'text': '', 'kind': ''},
    'gap_curve': {'type': 'gap_curve', 'branches': [], 'text': ''},
    'theory_failed': {'type': 'theory_failed', 'text': ''},
}


class Page(Protocol):
    """A page that shows a source."""

    @property
    def waits(self) -> bool:
        """Whether messages are queued."""

    def put(self, message: dict[str, Any]) -> None:
        """Queue a message."""

    def show(self, source: Source) -> None:
        """Show a source from the beginning."""

    def pump(self) -> None:
        """Send what is queued."""


class Source:
    """
    A source of frames and messages; this one stands for a network without a rig.

    `common` returns the common part of first messages, such as rigs, recordings and presets.
    """

    #: Time for which the source is kept without a page, s.
    kept_s = 0.0

    def __init__(self, common: Callable[[], dict[str, Any]]) -> None:
        self.clients: set[Page] = set()  # the pages that show the source
        self._common = common
        #: Messages of the theory of the present rig
        self.theory = dict(_UNKNOWN)

    def hello(self) -> dict[str, Any]:
        """Return the first message."""
        return {
            'type': 'hello',
            'version': __version__,
            'mode': 'live',
            'rig': '',
            'bag': '',
            'parameters': [],
            'frame': LAYOUT,
            **self._common(),
        }

    def news(self) -> list[dict[str, Any]]:
        """Return the messages that a new page needs, after the first one."""
        return [{'type': 'status', 'state': 'gone', 'text': 'no rig', 'time': None}]

    def send(self, message: dict[str, Any]) -> None:
        """Send a message to all pages that show it."""
        for client in self.clients:
            client.put(message)

    def send_theory(self, document: dict[str, Any]) -> None:
        """Send the new parts of a document of `theory.documents`."""
        for kind, before in self.theory.items():
            now = document.get(kind) or _UNKNOWN[kind]
            if now != before:
                self.theory[kind] = now
                self.send(now)

    def tick(self) -> None:
        """Take new messages; called 60 times a second."""

    def hasten(self) -> bool:
        """Send what is not to wait for the next tick; return whether more is expected soon."""
        return False

    def frame(self, view: PageView) -> bytes | None:
        """Return a frame with new rows; None without any."""
        del view
        return None

    async def handle(self, message: dict[str, Any]) -> dict[str, Any] | None:
        """Process a request; return the answer, if there is one."""
        del message
        raise RequestError('there is no rig on the network')

    async def close(self) -> None:
        """End the tasks that were started."""
