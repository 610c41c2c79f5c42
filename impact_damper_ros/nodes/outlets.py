"""Where the engine's messages go: topics, and a recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

__all__ = ['Log', 'Outlet', 'Outlets']


class Outlet(NamedTuple):
    """A topic: its resolved name, and what publishes a serialised message on it."""

    topic: str
    publish: Callable[[bytes], None]


class Log(Protocol):
    """A recording."""

    @property
    def backlog(self) -> int:
        """Number of messages that wait to be written."""

    def write(self, topic: str, data: bytes, stamp_ns: int, /) -> object:
        """Take a serialised message, without blocking."""


class Outlets(NamedTuple):
    """Where the engine publishes, and the topics it only records."""

    joint_states: Outlet
    impacts: Outlet
    snapshot: Outlet
    clock: Outlet | None
    parameter_events: str
    diagnostics: str
