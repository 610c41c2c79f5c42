# SPDX-License-Identifier: Apache-2.0
"""
The rigs of the ROS network, as a client without an executor.

Everything is polled: the server takes messages and answers just before each display frame. An
executor would wake up for each joint state, which costs several times the processor time of taking
them together, and pass them to another thread.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros.bag.rig_topics import rig_nodes
from impact_damper_ros.node.raw_subscription import RawSubscription
from impact_damper_ros.node.rig_client import LAST, RigClient, parameter_messages, plain_values
from impact_damper_ros.parameters.parameter_spec import ParameterError

#: Silence of the node after which a request fails, s: diagnostics come every second; and least
#: time for an answer.
SILENT_S, LEAST_S = 15.0, 3.0
#: Longest time between two polls that counts as silence of the node, s: after a longer one this
#: process was busy.
_LONGEST_PAUSE_S = 0.5
#: Topics that all nodes share
_OF_ALL = frozenset(('diagnostics', 'parameter_events'))
_TOPICS = ('joint_states', 'impacts', 'measurements', 'gap_control', 'snapshot', 'theory')
#: Most messages of a topic that are taken at once.
_MOST_TAKEN = 2000
#: Interval at which an answer is looked for, s.
_LOOK_S = 1.0


class RigLink:
    """The topics, services and parameters of one rig."""

    def __init__(self, node: Node, name: str, topics: Mapping[str, str]) -> None:
        self.name = name
        self._node = node
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        # With reliable joint states the writer would wait for each reader.
        loose = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        # Snapshots come after samples: no sample published after a snapshot may be processed
        # without it.
        self._subscriptions = {
            key: RawSubscription(node, kind, topic, qos)
            for key, kind, topic, qos in (
                ('joint_states', JointState, topics['joint_states'], loose),
                ('impacts', JointState, topics['impacts'], QoSProfile(depth=1000)),
                ('measurements', JointState, topics['measurements'], loose),
                ('gap_control', JointState, topics['gap_control'], QoSProfile(depth=1000)),
                ('snapshot', String, topics['snapshot'], latched),
                ('theory', String, topics['theory'], latched),
                ('diagnostics', DiagnosticArray, '/diagnostics', QoSProfile(depth=20)),
                ('parameter_events', ParameterEvent, '/parameter_events', QoSProfile(depth=100)),
            )
        }
        self._rig = RigClient(node, name)
        #: Time since the last message of the node, s
        self.silence = 0.0
        self._polled_at = time.monotonic()

    def match(self) -> None:
        """Subscribe best effort where the node publishes best effort, by `qos_overrides`."""
        best_effort = ReliabilityPolicy.BEST_EFFORT
        for key, one in self._subscriptions.items():
            offered = self._node.get_publishers_info_by_topic(one.topic)
            if one.qos.reliability != best_effort and any(
                info.qos_profile.reliability == best_effort for info in offered
            ):
                one.destroy()
                one.qos.reliability = best_effort
                self._subscriptions[key] = RawSubscription(
                    self._node, one.kind, one.topic, one.qos
                )

    def poll(self) -> dict[str, list[bytes]]:
        """Return new messages, in CDR, by topic; and complete the requests that were answered."""
        now = time.monotonic()
        self.silence += min(now - self._polled_at, _LONGEST_PAUSE_S)
        self._polled_at = now
        self._rig.poll()
        polled: dict[str, list[bytes]] = {}
        for name, subscription in self._subscriptions.items():
            taken = subscription.take(_MOST_TAKEN)
            polled[name] = [message.content for message in taken]
            if taken and name not in _OF_ALL:
                self.silence = 0.0
        return polled

    def poll_theory(self) -> list[bytes]:
        """Return new messages of the theory alone, in CDR."""
        return [message.content for message in self._subscriptions['theory'].take(_MOST_TAKEN)]

    def begin_again(self) -> None:
        """Expect no answer of the old node: a new one has its name."""
        self._rig.begin_again()

    async def _call(self, service: str, **fields: Any) -> Any:
        """Return the answer, which a busy node may delay; else a TimeoutError."""
        if service != LAST and not self._rig.answers:
            await self._call(LAST, names=[])
        asked = self._rig.ask(service, **fields)
        # Sent now, and not with the next tick: theory is to follow a knob.
        self._rig.poll()
        answer, begin = asyncio.wrap_future(asked), time.monotonic()
        while self.silence < SILENT_S or time.monotonic() < begin + LEAST_S:
            # An answer that does not come in this time is not cancelled.
            done, _ = await asyncio.wait([answer], timeout=_LOOK_S)
            if done:
                return answer.result()
        made = self._rig.may_be_made(service, asked)
        answer.cancel()
        raise TimeoutError(
            f'the node does not answer ({self.name}/{service}), and sends nothing: '
            + ('the change may or may not have been made' if made else 'nothing was changed')
        )

    async def parameters(self) -> dict[str, Any]:
        """Return the values of all parameters."""
        listed = await self._call('list_parameters')
        names = list(listed.result.names)
        got = await self._call(LAST, names=names)
        return plain_values(names, got.values)

    async def set(self, values: Mapping[str, Any]) -> str:
        """Set parameters, all or none; return why they are rejected, or an empty text."""
        try:
            parameters = parameter_messages(values)
        except KeyError as error:
            return f'{error.args[0]} is not a parameter of {self.name}'
        except ParameterError as error:
            return str(error)
        answer = await self._call('set_parameters_atomically', parameters=parameters)
        return '' if answer.result.successful else str(answer.result.reason)

    async def pause(self, hold: bool) -> tuple[bool, str]:
        """Pause the rig, or resume it."""
        answer = await self._call('pause', data=hold)
        return bool(answer.success), str(answer.message)

    async def trigger(self, service: str) -> tuple[bool, str]:
        """Call `reset`, `step` or `step_to_impact`."""
        answer = await self._call(service)
        return bool(answer.success), str(answer.message)

    def close(self) -> None:
        """Destroy the subscriptions and clients."""
        for subscription in self._subscriptions.values():
            subscription.destroy()
        self._rig.close()


class RosClient:
    """A node that finds the rigs of the ROS network."""

    def __init__(self) -> None:
        self._context = Context()
        # Python keeps its signal handlers.
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node(
            'rig_page',
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
        )

    def rigs(self) -> list[str]:
        """Return the full names of the nodes that are rigs."""
        return rig_nodes(dict(self._node.get_service_names_and_types()))

    def join(self, rig: str) -> RigLink:
        """Return the link to a rig; its topics may have been remapped."""
        space, _, name = rig.rpartition('/')
        topics = {topic: f'{space}/{topic}' for topic in _TOPICS}
        try:
            published = self._node.get_publisher_names_and_types_by_node(name, space or '/')
        except RuntimeError:  # it has just left
            published = []
        for topic, _ in published:
            base = topic.rpartition('/')[2]
            if base in topics:
                topics[base] = topic
        return RigLink(self._node, rig, topics)

    def close(self) -> None:
        """Leave the network."""
        self._node.destroy_node()
        self._context.try_shutdown()
