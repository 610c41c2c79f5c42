"""The connection to one page: its requests, and what it is shown."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from typing import Any, Protocol, TypeVar

from impact_damper_ros.rig.quoting import shown

from .frames import View
from .outbox import Outbox, Sink

#: Longest message of a page, bytes; Tornado closes the connection at longer ones.
LONGEST_MESSAGE = 65_536
_MOST_RATE = 60.0
#: Messages of one page that are processed at once, and then per second; dragging a knob sends
#: some 60 per second. Further ones wait in the connection, without delaying other pages.
_BURST, _MESSAGES_PER_S = 100.0, 100.0


def _refuse(name: str) -> float:
    raise ValueError(f'{name} is not a number in JSON')


class RequestError(Exception):
    """A request of a page that is rejected; the message is for its user."""


_KINDS = {
    bool: 'true or false',
    dict: 'an object of values by their names',
    float: 'a finite number',
    int: 'a whole number',
    str: 'a text',
}
_T = TypeVar('_T')
#: Longest identifier of a request.
_LONGEST_ID = 80


def given(message: dict[str, Any], name: str, kind: type[_T], default: _T | None = None) -> _T:
    """
    Return a field of a request, checked for its type.

    Raises
    ------
    RequestError
        If the field is missing or of another type.
    """
    value = message.get(name, default)
    with contextlib.suppress(OverflowError):
        if kind is float and type(value) is int:
            value = float(value)
        elif kind is int and isinstance(value, float) and value.is_integer():
            value = int(value)
    if type(value) is not kind or (isinstance(value, float) and not math.isfinite(value)):
        said = shown(value) if name in message else 'missing'
        raise RequestError(f'{message["type"]}: {name} is {said}: give {_KINDS[kind]}')
    return value


class Source(Protocol):
    """The source of what a page shows: a live rig, or a recording."""

    def hello(self) -> dict[str, Any]:
        """Return the first message."""

    def frame(self, view: View) -> bytes | None:
        """Return a frame with what is new; None if nothing is."""

    async def handle(self, message: dict[str, Any], session: Session) -> dict[str, Any] | None:
        """Process a request; return the answer."""


class Session:
    """
    One WebSocket.

    Parameters
    ----------
    sink : Sink
        The WebSocket.
    source : Source
        The rig or recording that is shown.
    """

    def __init__(self, sink: Sink, source: Source) -> None:
        self.source = source
        self.outbox = Outbox(sink)
        self.view = View()
        self._period = 0.0
        self._due = 0.0
        self._credit, self._counted = _BURST, time.monotonic()
        self.outbox.put(source.hello())

    def greet(self) -> None:
        """Send the first message again: another source is shown."""
        self.view.begin_again()
        self.outbox.put(self.source.hello())

    def pump(self) -> None:
        """Send the waiting messages, and a frame."""
        self.outbox.pump(self._frame)

    def _frame(self) -> bytes | None:
        now = time.monotonic()
        if now < self._due:
            return None
        # Half a tick early, so that a period of two ticks is not three
        self._due = now + self._period - 0.5 / _MOST_RATE if self._period else 0.0
        return self.source.frame(self.view)

    async def take(self, text: str | bytes) -> None:
        """Process a message of the page; errors in it are reported to that page only."""
        await self._take_turn()
        identity: Any = None
        kind = 'set_result'
        try:
            message = json.loads(text, parse_constant=_refuse) if isinstance(text, str) else None
            if not isinstance(message, dict) or not isinstance(message.get('type'), str):
                raise RequestError('a message must be a JSON object with a type')
            identity = message.get('id')
            if not isinstance(identity, int | str) or len(str(identity)) > _LONGEST_ID:
                identity = None
            kind = 'set_result' if message['type'] in ('set', 'preset') else 'service_result'
            answer = await self._carry_out(message)
        except (ArithmeticError, KeyError, RecursionError, TypeError, ValueError) as error:
            answer = {'ok': False, 'reason': f'the message cannot be read: {error}'[:500]}
        except RequestError as error:
            answer = {'ok': False, 'reason': str(error)[:2000]}
        if answer is not None:
            self.outbox.put({'type': kind, 'id': identity, **answer})

    async def _take_turn(self) -> None:
        """Wait after too many messages; the next one is read only after this one is processed."""
        now = time.monotonic()
        earned = _MESSAGES_PER_S * (now - self._counted)
        self._credit, self._counted = min(_BURST, self._credit + earned) - 1.0, now
        if self._credit < 0.0:
            await asyncio.sleep(-self._credit / _MESSAGES_PER_S)

    async def _carry_out(self, message: dict[str, Any]) -> dict[str, Any] | None:
        if message['type'] != 'view':
            return await self.source.handle(message, self)
        self.view = View(given(message, 'window', float, 30.0), given(message, 'width', int, 1000))
        rate = min(max(given(message, 'rate', float, _MOST_RATE), 0.1), _MOST_RATE)
        self._period = 1.0 / rate if rate < _MOST_RATE else 0.0
        return None
