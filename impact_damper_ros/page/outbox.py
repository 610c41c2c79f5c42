"""
The queue of messages to one page, of bounded length.

At most one write is under way. A frame is made when the previous one has been sent, with all that
came since. Of messages that describe a state, only the newest one is kept.
"""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable
from typing import Any, Protocol

#: Messages that replace the previous one of their type.
_STATES = frozenset(
    (
        *('status', 'diagnostics', 'numbers', 'orbit', 'gap_curve', 'theory_failed'),
        *('rigs', 'recordings', 'what_if', 'slow_motion'),
    )
)
#: Most other messages that wait, and the longest write, s; beyond these the page is closed.
_MOST_WAITING = 256
STALLED_S = 60.0


class Sink(Protocol):
    """A WebSocket."""

    def write_message(self, message: str | bytes, binary: bool = False) -> Any:
        """Write a message; the result is done when it has been sent."""

    def close(self) -> None:
        """End the connection."""


class Outbox:
    """
    Messages to one page.

    Parameters
    ----------
    sink : Sink
        Where they go.
    """

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        self._waiting: dict[object, str] = {}
        self._count = 0
        self._last: asyncio.Future[Any] | None = None
        self._since = 0.0
        self.closed = False

    def put(self, message: dict[str, Any]) -> None:
        """Queue a message."""
        if self.closed:
            return
        kind = message['type']
        self._count += 1
        key = kind if kind in _STATES else self._count
        # To the end, also if there is an older one
        self._waiting.pop(key, None)
        self._waiting[key] = json.dumps(message, allow_nan=False)
        if len(self._waiting) > _MOST_WAITING:
            self.close()

    def pump(self, frame: Callable[[], bytes | None]) -> None:
        """Send the queued messages and a frame, unless the last write is still under way."""
        if self.closed:
            return
        if self._last is not None and not self._last.done():
            if time.monotonic() > self._since + STALLED_S:
                self.close()
            return
        waiting, self._waiting = self._waiting, {}
        for text in waiting.values():
            self._write(text, binary=False)
        content = frame()
        if content is not None:
            self._write(content, binary=True)

    def _write(self, content: str | bytes, *, binary: bool) -> None:
        if self.closed:
            return
        try:
            self._last = asyncio.ensure_future(self._sink.write_message(content, binary=binary))
        except Exception:  # of a connection that has just been closed
            self.close()
            return
        self._since = time.monotonic()
        self._last.add_done_callback(self._written)

    def _written(self, write: asyncio.Future[Any]) -> None:
        if not write.cancelled() and write.exception() is not None:
            self.close()

    def close(self) -> None:
        """Close the connection; the page may connect again."""
        if not self.closed:
            self.closed = True
            self._waiting.clear()
            self._sink.close()
