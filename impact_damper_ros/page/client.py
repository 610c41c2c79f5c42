# SPDX-License-Identifier: Apache-2.0
"""
One page: its queue of messages, its requests, and the part of the motion that it has.

At most one write is under way. A frame is made when the previous one has been sent, with
everything since: a slow page gets fewer frames, and delays no other page. Of messages that
describe a state, only the newest one is kept.
"""

from __future__ import annotations

import asyncio
import json
import time
import traceback
from collections.abc import Awaitable, Callable
from typing import TYPE_CHECKING, Any

from .frames import PageView
from .requests import RequestError, check_request, identity_of, read_json
from .source import Source

if TYPE_CHECKING:
    from tornado.websocket import WebSocketHandler

#: Longest message of a page, bytes; Tornado closes the connection at longer ones.
LONGEST_MESSAGE = 65_536
#: Messages that replace the previous one of their type.
_STATES = frozenset(
    (
        *('status', 'diagnostics', 'numbers', 'orbit', 'gap_curve', 'theory_failed'),
        *('hello', 'rigs', 'recordings', 'what_if'),
    )
)
#: Most other messages that wait; with more, the page is closed.
_MOST_WAITING = 256
#: Time after which a page that takes nothing, or leaves a ping unanswered, counts as gone, s:
#: longer than a browser waits on a busy machine.
STALLED_S = 180.0
_MOST_RATE = 60.0
#: Requests that a page may make that only watches; the other requests change the rig.
_WATCHING = frozenset(('view', 'play', 'seek', 'jump', 'what_if'))

Handler = Callable[[dict[str, Any], 'Client'], Awaitable[dict[str, Any] | None]]


class Client:
    """A page; `handle` processes its requests and returns the answers."""

    def __init__(
        self, sink: WebSocketHandler, source: Source, handle: Handler, *, steers: bool = True
    ) -> None:
        self.source = source
        self.view = PageView()
        self._sink = sink
        self._handle = handle
        self._steers = steers
        self._waiting: dict[object, str] = {}
        self._count = 0
        self._requests: set[asyncio.Task[None]] = set()
        self._last: asyncio.Future[Any] | None = None
        self._since = 0.0
        self.closed = False
        self._period = self._due = 0.0
        self.show(source)

    def show(self, source: Source) -> None:
        """Show a source from the beginning."""
        self.source.clients.discard(self)
        self.source = source
        source.clients.add(self)
        self.view.begin_again()
        self.put(source.hello() | {'steers': self._steers})
        for message in source.news():
            self.put(message)

    # To the page

    @property
    def waits(self) -> bool:
        """Whether messages are queued."""
        return bool(self._waiting)

    def put(self, message: dict[str, Any]) -> None:
        """Queue a message."""
        if self.closed:
            return
        kind = message['type']
        self._count += 1
        key = kind if kind in _STATES else self._count
        # The message goes to the end, even if an older one of its type waits.
        self._waiting.pop(key, None)
        self._waiting[key] = json.dumps(message, allow_nan=False)
        if len(self._waiting) > _MOST_WAITING:
            self.close()

    def pump(self) -> None:
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
        now = time.monotonic()
        if now >= self._due:
            # Half a tick early, so that a period of two ticks is not three
            self._due = now + self._period - 0.5 / _MOST_RATE if self._period else 0.0
            content = self.source.frame(self.view)
            if content is not None:
                self._write(content, binary=True)

    def _write(self, content: str | bytes, *, binary: bool) -> None:
        if self.closed:
            return
        try:
            self._last = asyncio.ensure_future(self._sink.write_message(content, binary=binary))
        except Exception:  # the connection has just been closed
            self.close()
            return
        self._since = time.monotonic()
        self._last.add_done_callback(self._after_write)

    def _after_write(self, write: asyncio.Future[Any]) -> None:
        if not write.cancelled() and write.exception() is not None:
            self.close()

    def close(self) -> None:
        """Close the connection; the page may connect again."""
        if not self.closed:
            self.closed = True
            self._waiting.clear()
            self._sink.close()

    # From the page

    def take(self, text: str | bytes) -> None:
        """Begin to process a message of the page; later messages do not wait for the answer."""
        task = asyncio.ensure_future(self._process(text))
        self._requests.add(task)
        task.add_done_callback(self._requests.discard)

    async def _process(self, text: str | bytes) -> None:
        """Process a message; errors in it are reported to this page only."""
        identity: int | str | None = None
        try:
            message = read_json(text)
            identity = identity_of(message)
            check_request(message)
            answer = await self._answer(message)
        except RequestError as error:
            answer = {'ok': False, 'reason': str(error)[:2000]}
        except Exception as error:
            # A page waits for the answer, whatever has failed.
            traceback.print_exc()
            answer = {'ok': False, 'reason': f'the request has failed: {error!r}'[:500]}
        if answer is not None:
            self.put({'type': 'answer', 'id': identity, **answer})

    async def _answer(self, message: dict[str, Any]) -> dict[str, Any] | None:
        kind = message['type']
        if not self._steers and kind not in _WATCHING:
            raise RequestError(
                'this page only watches: open it on the machine of its server, or by the address '
                'with the token'
            )
        if kind != 'view':
            return await self._handle(message, self)
        window, rate = message['window'], message['rate']
        # A page that has a longer window already has all of a shorter one.
        if window > self.view.window:
            self.view = PageView(window)
        self._period = 0.0 if rate >= _MOST_RATE else 1.0 / max(rate, 0.1)
        # A page that comes into view gets no motion of a second ago.
        self._due = 0.0
        return None
