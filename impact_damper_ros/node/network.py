# SPDX-License-Identifier: Apache-2.0
"""Conflicts with other nodes of the network, which keep messages or requests from arriving."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, ReliabilityPolicy, qos_check_compatible


def other_namespace(taken: str) -> str:
    """Return a namespace for a second node of a name, as an example."""
    return '/rig3' if taken == '/rig2' else '/rig2'


class NetworkReport(NamedTuple):
    """The conflicts, in words and by keys."""

    text: str = ''
    values: Mapping[str, int] = MappingProxyType({})


class Network:
    """
    Detects nodes of the same name, a second clock, and partners that do not match.

    `commands` has full name and type of the topics that the node subscribes to.
    """

    def __init__(self, node: Node, clock: str, commands: Mapping[str, tuple[str, str]]) -> None:
        self._node = node
        self._clock = clock
        self._commands = commands
        # Topics for which the middleware has found an incompatible subscription
        self._mismatched: set[str] = set()
        self._warned: set[str] = set()

    def events_of(self, topic: str, matched: Any = None) -> PublisherEventCallbacks:
        """Return the event callbacks of a publisher, given the full name of its topic."""
        return PublisherEventCallbacks(
            incompatible_qos=lambda _: self._mismatched.add(topic), matched=matched
        )

    def report(self) -> NetworkReport:
        """Return the present conflicts; each is logged once."""
        node = self._node
        own = node.get_name(), node.get_namespace()
        namesakes = node.get_node_names_and_namespaces().count(own)
        clocks = node.count_publishers(self._clock) if self._clock else 0
        deaf = list(self._deaf())
        values = {'Nodes of this name': namesakes, 'Publishers of /clock': clocks}
        texts = []
        if namesakes > 1:
            texts.append(
                f'{namesakes} nodes are named {node.get_fully_qualified_name()}: a request '
                'reaches any one of them, and their messages are mixed; start each in a namespace '
                f'of its own (-r __ns:={other_namespace(node.get_namespace())})'
            )
        if clocks > 1:
            in_step = node.get_parameter('lock_step').value != 'off'
            also = '' if in_step else ', or real_time_factor:=1.0 publish_clock:=false'
            texts.append(
                f'another node publishes {self._clock}, too: the time of nodes with use_sim_time '
                'jumps between the two; give the rigs ROS domains of their own (ROS_DOMAIN_ID)'
                f'{also}'
            )
        texts += deaf
        unheard: list[str] = []
        for key, (topic, kind) in self._commands.items():
            publishers = node.get_publishers_info_by_topic(topic)
            values[f'Publishers of {key}'] = len(publishers)
            if len(publishers) > 1:
                texts.append(
                    f'{" and ".join(sorted(map(_name, publishers)))} publish {topic}: commands of '
                    f'{"both" if len(publishers) == 2 else "all"} are refused; stop all but one'
                )
            unheard += _unheard(topic, kind, publishers)
        values['Subscriptions that do not match'] = len(deaf)
        values['Publishers that do not match'] = len(unheard)
        texts += unheard
        for text in texts:
            if text not in self._warned:
                self._warned.add(text)
                node.get_logger().warning(text)
        return NetworkReport('; '.join(texts), values)

    def _deaf(self) -> Iterator[str]:
        """Yield the subscriptions that do not receive topics of the node."""
        for publisher in self._node.publishers:
            topic = publisher.topic_name
            if topic not in self._mismatched:
                continue
            for info in self._node.get_subscriptions_info_by_topic(topic):
                fits, why = qos_check_compatible(publisher.qos_profile, info.qos_profile)
                if fits == QoSCompatibility.ERROR:
                    yield f'{_name(info)} does not receive {topic}: {_reason(why)}'


def _unheard(topic: str, kind: str, publishers: Sequence[Any]) -> Iterator[str]:
    """Yield the publishers of commands that the node does not receive."""
    for info in publishers:
        if info.topic_type != kind:
            yield (
                f'{_name(info)} publishes {topic} as {info.topic_type}, which is not '
                f'received: publish {kind}'
            )
        elif info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            yield (
                f'{_name(info)} publishes {topic} best effort, which is not received: publish it '
                'reliable'
            )


def _name(info: Any) -> str:
    return f'{info.node_namespace.rstrip("/")}/{info.node_name}'


def _reason(text: str) -> str:
    """Return the reason that the middleware gives, in a line."""
    return '; '.join(part.strip() for part in text.removeprefix('ERROR: ').split(';') if part)
