# SPDX-License-Identifier: Apache-2.0
"""Subscriptions that are polled for encoded messages, which no executor wakes up for."""

from __future__ import annotations

from typing import Any, NamedTuple

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription


class Polled(ReentrantCallbackGroup):
    """Callback group of polled entities: an executor wakes up for their events alone."""

    def can_execute(self, entity: Any) -> bool:
        """Return whether an executor may take from the entity."""
        return not isinstance(entity, Subscription | Client)


class Taken(NamedTuple):
    """A message in CDR, its number among those of its publisher, and the time of sending, ns."""

    content: bytes
    number: int
    sent_ns: int


class RawSubscription:
    """One subscription, with any profile."""

    def __init__(self, node: Node, kind: Any, topic: str, qos: QoSProfile) -> None:
        self._node = node
        self._subscription = node.create_subscription(
            kind, topic, lambda _: None, qos, callback_group=Polled(), raw=True
        )
        self.handle, self.topic = self._subscription.handle, self._subscription.topic_name
        self.kind, self.qos = kind, qos

    def publishers(self) -> int:
        """Return the number of publishers that match."""
        return int(self._subscription.get_publisher_count())

    def take(self, most: int) -> list[Taken]:
        """Return the messages that have come, at most so many."""
        taken: list[Taken] = []
        with self.handle:
            while len(taken) < most and (one := self.handle.take_message(self.kind, True)):
                content, about = one
                number, sent_ns = about['publication_sequence_number'], about['source_timestamp']
                taken.append(Taken(bytes(content), number, sent_ns))
        return taken

    def destroy(self) -> None:
        """Leave the topic."""
        self._node.destroy_subscription(self._subscription)
