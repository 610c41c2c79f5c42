"""Where the engine's messages go: topics, and a recording."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

__all__ = ['Emitter', 'Log', 'Outlet', 'Outlets']


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

    def split_due(self, stamp_ns: int, /) -> bool:
        """Return whether a new file should begin with this stamp."""

    def split(self, stamp_ns: int, /) -> bool:
        """Let what comes go to a new file; false if that cannot be now."""


class Outlets(NamedTuple):
    """Where the engine publishes, and the topics it only records."""

    joint_states: Outlet
    impacts: Outlet
    gap_control: Outlet
    snapshot: Outlet
    clock: Outlet | None
    parameter_events: str
    diagnostics: str
    robot_description: str = ''


class Emitter:
    """
    Publish what the engine hands out, and record it while there is a log.

    Parameters
    ----------
    alive : callable
        Whether ROS still runs; publishing fails once it does not.
    on_end : callable
        Called if it does not.

    Attributes
    ----------
    log : Log or None
        The recording.
    recorded : int
        Messages given to it.
    """

    def __init__(self, alive: Callable[[], bool], on_end: Callable[[], object]) -> None:
        """Record nothing so far."""
        self.log: Log | None = None
        self.recorded = 0
        self._alive = alive
        self._on_end = on_end

    def emit(self, outlet: Outlet, data: bytes, stamp_ns: int) -> None:
        """Record and publish a serialised message."""
        # Record first: once ROS shuts down nothing can be published, but the log is to be whole.
        self.record(outlet.topic, data, stamp_ns)
        self.publish(outlet, data)

    def record(self, topic: str, data: bytes, stamp_ns: int) -> None:
        """Record a serialised message, if there is a log."""
        if self.log is not None:
            self.log.write(topic, data, stamp_ns)
            self.recorded += 1

    def publish(self, outlet: Outlet, data: bytes) -> None:
        """Publish a serialised message; what fails because ROS has ended is not an error."""
        try:
            outlet.publish(data)
        except Exception:
            if self._alive():
                raise
            self._on_end()
