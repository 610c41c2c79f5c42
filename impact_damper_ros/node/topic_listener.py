# SPDX-License-Identifier: Apache-2.0
"""Some seconds of any topic, and of topics of the same rig, as messages in CDR."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from importlib import import_module

import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from impact_damper_ros.bag import RecordedMessage

from .raw_subscription import RawSubscription

#: Time within which a topic has to be found, s.
PATIENCE_S = 10.0
_POLL_S = 0.002
#: Reliable, and with earlier messages, if all publishers offer that.
_AS_OFFERED = QoSProfile(
    depth=5000,
    reliability=ReliabilityPolicy.BEST_AVAILABLE,
    durability=DurabilityPolicy.BEST_AVAILABLE,
)


class TopicError(Exception):
    """A topic without publisher; the text lists the topics that there are."""


def listen(
    topic: str,
    beside: Sequence[str],
    types: Sequence[str],
    seconds: float,
    progress: Callable[[float], object] = bool,
) -> list[RecordedMessage]:
    """
    Return the messages of a topic over some seconds.

    Parameters
    ----------
    topic : str
        Full name of the topic.
    beside : sequence of str
        Other topics that are taken, too, if they are published.
    types : sequence of str
        Types of messages that can be used.
    seconds : float
        Duration, from the first message on.
    progress : callable, optional
        Called with the seconds so far.

    Raises
    ------
    TopicError
        If nobody publishes it with one of the types, or no message comes.
    """
    context = Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(
            '_fit_rig', context=context, start_parameter_services=False, enable_rosout=False
        )
        return _Listener(node, types).take(topic, beside, seconds, progress)
    finally:
        rclpy.try_shutdown(context=context)


class _Listener:
    """Subscriptions that are polled for whole messages."""

    def __init__(self, node: Node, types: Sequence[str]) -> None:
        self._node, self._types = node, types
        self._subscriptions: dict[str, tuple[str, RawSubscription]] = {}
        self._messages: list[RecordedMessage] = []

    def take(
        self,
        topic: str,
        beside: Sequence[str],
        seconds: float,
        progress: Callable[[float], object],
    ) -> list[RecordedMessage]:
        begin = time.monotonic()
        end = begin + PATIENCE_S
        first: float | None = None
        while time.monotonic() < end:
            # Other topics may be discovered after the topic.
            self._subscribe(topic, beside)
            self._take()
            if first is None and any(m.topic == topic for m in self._messages):
                first = time.monotonic()
                end = first + seconds
            if first is not None:
                progress(min(seconds, time.monotonic() - first))
            time.sleep(_POLL_S)
        if first is None:
            raise TopicError(self._words(topic))
        return self._messages

    def _subscribe(self, topic: str, beside: Sequence[str]) -> None:
        there = dict(self._node.get_topic_names_and_types())
        for name in (topic, *beside):
            if name in self._subscriptions:
                continue
            usable = [t for t in there.get(name, ()) if t in self._types or name in beside]
            if not usable or not self._node.count_publishers(name):
                continue
            package, _, kind = usable[0].replace('/', '.').rpartition('.')
            interface = getattr(import_module(package), kind)
            subscription = RawSubscription(self._node, interface, name, _AS_OFFERED)
            self._subscriptions[name] = usable[0], subscription

    def _take(self) -> None:
        for topic, (kind, subscription) in self._subscriptions.items():
            self._messages += [
                RecordedMessage(topic, kind, sent_ns or time.time_ns(), content)
                for content, _, sent_ns in subscription.take(_AS_OFFERED.depth)
            ]

    def _words(self, topic: str) -> str:
        there = self._node.get_topic_names_and_types()
        usable = sorted(n for n, kinds in there if any(kind in self._types for kind in kinds))
        held = ', '.join(usable) or 'none'
        if topic in self._subscriptions:
            return f'no message came on {topic} in {PATIENCE_S:g} s: see that the rig runs'
        return (
            f'nobody publishes {topic} as {" or ".join(self._types)}; topics of these types: '
            f'{held}; are ROS_DOMAIN_ID and the network the same?'
        )
