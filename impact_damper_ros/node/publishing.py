# SPDX-License-Identifier: Apache-2.0
"""The topics of the rig, and how its messages go out: recorded, then published."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from impact_damper_ros.bag import RunWriter


class TopicPublisher(NamedTuple):
    """A topic: its resolved name, and the function that publishes encoded messages on it."""

    topic: str
    publish: Callable[[bytes], object]


#: By the keys of `RIG_TOPICS`, and ``'clock'`` if the node publishes it.
RigPublishers = Mapping[str, TopicPublisher]


class OutgoingMessage(NamedTuple):
    """An encoded message that is ready to go out."""

    publisher: TopicPublisher
    content: bytes
    stamp_ns: int


class Emitter:
    """Publishes messages, and records them while there is a log."""

    def __init__(self, alive: Callable[[], bool], on_end: Callable[[], object]) -> None:
        #: The recording, and the number of messages given to it
        self.log: RunWriter | None = None
        self.recorded = 0
        self._alive = alive
        self._on_end = on_end

    def emit(self, publisher: TopicPublisher, content: bytes, stamp_ns: int) -> None:
        """Record and publish a message."""
        # Record first: during a shutdown publishing fails, but the log must be complete.
        self.record(publisher.topic, content, stamp_ns)
        self.publish(publisher, content)

    def record(self, topic: str, content: bytes, stamp_ns: int) -> None:
        """Record a message, if there is a log."""
        if self.log is not None:
            self.log.write(topic, content, stamp_ns)
            self.recorded += 1

    def publish(self, publisher: TopicPublisher, content: bytes) -> None:
        """Publish a message; a failure because ROS has ended is not an error."""
        try:
            publisher.publish(content)
        except Exception:
            if self._alive():
                raise
            self._on_end()
