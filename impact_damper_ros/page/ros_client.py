# SPDX-License-Identifier: Apache-2.0
"""
The rigs of the ROS network, as a client without an executor.

Everything is polled: the server takes messages and answers just before each display frame. An
executor would wake up for each joint state, which costs several times the processor time of taking
them together, and pass them to another thread.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rcl_interfaces.srv import GetParameters, ListParameters, SetParametersAtomically
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.bag.rig_topics import rig_nodes
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import ALL_SPECS

#: Time after which a request is repeated, since its answer may have been lost during discovery, s;
#: it doubles each time.
ASK_AGAIN_S = 1.0
#: Silence of the node after which a request fails, s, as its diagnostics come every second; and
#: time that it has in any case.
SILENT_S, LEAST_S = 15.0, 3.0
#: Longest time between two polls that counts as silence of the node, s: longer, this one was busy.
_LONGEST_PAUSE_S = 0.5
#: Topics that all nodes share
_OF_ALL = frozenset(('diagnostics', 'parameter_events'))
_TOPICS = ('joint_states', 'impacts', 'measurements', 'gap_control', 'snapshot', 'theory')
#: Most messages of a topic that are taken at once.
_MOST_TAKEN = 2000
#: Joint states out of the order in which one node numbers them, within a time (s), from which on
#: several nodes send them. One that was started again under the name of another is no case of it.
_MIXED, _MIXED_S = 4, 3.0
#: A node finds the clients in their order: once it has answered the last one, it can answer all.
_LAST = 'get_parameters'
_SERVICES = {
    'pause': SetBool,
    'reset': Trigger,
    'step': Trigger,
    'step_to_impact': Trigger,
    'set_parameters_atomically': SetParametersAtomically,
    'list_parameters': ListParameters,
    _LAST: GetParameters,
}


class _Service:
    """A client of one service, which is polled for its answers."""

    def __init__(self, node: Node, kind: Any, name: str) -> None:
        self._kind = kind
        self._changes = kind not in (ListParameters, GetParameters)
        # A step or a reset that is asked for again would be made twice.
        self._repeatable = kind is not Trigger
        self._client = node.create_client(kind, name)
        self._waiting: dict[int, asyncio.Future[Any]] = {}

    def poll(self) -> None:
        while self._waiting:
            with self._client.handle:
                header, answer = self._client.handle.take_response(self._kind.Response)
            if header is None:
                return
            future = self._waiting.pop(header.request_id.sequence_number, None)
            if future is not None and not future.done():
                future.set_result(answer)

    async def call(self, silence: Callable[[], float], **fields: Any) -> Any:
        """Return the answer, for which a node that is busy may need long; else a TimeoutError."""
        request = self._kind.Request(**fields)
        answer: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        numbers: list[int] = []
        begin = due = time.monotonic()
        pause = ASK_AGAIN_S
        try:
            while silence() < SILENT_S or time.monotonic() < begin + LEAST_S:
                if time.monotonic() >= due and self._client.service_is_ready():
                    with self._client.handle:
                        number = self._client.handle.send_request(request)
                    self._waiting[number] = answer
                    numbers.append(number)
                    due = time.monotonic() + pause if self._repeatable else math.inf
                    pause *= 2.0
                # Without cancelling the answer where it does not come in this time
                done, _ = await asyncio.wait([answer], timeout=ASK_AGAIN_S)
                if done:
                    return answer.result()
        finally:
            for number in numbers:
                self._waiting.pop(number, None)
        raise TimeoutError(
            f'the node does not answer ({self._client.srv_name}), and sends nothing: '
            + (
                'the change may or may not have been made'
                if numbers and self._changes
                else 'nothing was changed'
            )
        )

    def begin_again(self) -> None:
        """Give up requests that are not repeated: the node that had them is no more."""
        for future in [] if self._repeatable else self._waiting.values():
            if not future.done():
                future.set_exception(TimeoutError('the node was started again before its answer'))

    def close(self) -> None:
        for future in self._waiting.values():
            future.cancel()
        self._client.destroy()


class RigLink:
    """The topics, services and parameters of one rig."""

    def __init__(self, node: Node, name: str, topics: Mapping[str, str]) -> None:
        self.name = name
        self._node = node
        latched = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        # With reliable joint states the writer would have to wait for each reader.
        loose = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
        # Snapshots after samples: none published after a snapshot may be processed without it.
        self._subscriptions = {
            key: self._subscribe(kind, topic, qos)
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
        self._services = {
            service: _Service(node, kind, f'{name}/{service}')
            for service, kind in _SERVICES.items()
        }
        # Whether its answers reach this client
        self._answers = False
        #: How long the node has sent nothing, s
        self.silence = 0.0
        self._polled_at = time.monotonic()
        # Number of the last joint state, and when there was a lower one after a higher one
        self._number = 0
        self._back: deque[float] = deque(maxlen=_MIXED)

    def _subscribe(self, kind: Any, topic: str, qos: QoSProfile) -> Any:
        return self._node.create_subscription(kind, topic, lambda _: None, qos, raw=True)

    def match(self) -> None:
        """Subscribe best effort where the node publishes so, by `qos_overrides`."""
        best_effort = ReliabilityPolicy.BEST_EFFORT
        for key, subscription in self._subscriptions.items():
            qos = subscription.qos_profile
            if qos.reliability != best_effort and any(
                info.qos_profile.reliability == best_effort
                for info in self._node.get_publishers_info_by_topic(subscription.topic_name)
            ):
                qos.reliability = best_effort
                kind, topic = subscription.msg_type, subscription.topic_name
                subscription.destroy()
                self._subscriptions[key] = self._subscribe(kind, topic, qos)

    def poll(self) -> dict[str, list[bytes]]:
        """Return new messages, in CDR, by topic; and complete the requests that were answered."""
        now = time.monotonic()
        self.silence += min(now - self._polled_at, _LONGEST_PAUSE_S)
        self._polled_at = now
        for service in self._services.values():
            service.poll()
        polled: dict[str, list[bytes]] = {}
        for name, subscription in self._subscriptions.items():
            messages = polled[name] = []
            with subscription.handle:
                while len(messages) < _MOST_TAKEN:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    messages.append(taken[0])
                    if name not in _OF_ALL:
                        self.silence = 0.0
                    if name == 'joint_states':
                        self._count(taken[1]['publication_sequence_number'])
        return polled

    def _count(self, number: int) -> None:
        if number <= self._number:
            self._back.append(time.monotonic())
        self._number = number

    def begin_again(self) -> None:
        """Expect no answer of the node before: a new one has its name."""
        self._answers = False
        for service in self._services.values():
            service.begin_again()

    async def _call(self, service: str, **fields: Any) -> Any:
        return await self._services[service].call(lambda: self.silence, **fields)

    @property
    def mixed(self) -> bool:
        """Whether several nodes of this name send joint states."""
        back = self._back
        return len(back) == _MIXED and time.monotonic() < back[0] + _MIXED_S

    async def parameters(self) -> dict[str, Any]:
        """Return the values of all parameters."""
        listed = await self._call('list_parameters')
        names = list(listed.result.names)
        got = await self._values(names)
        return dict(zip(names, map(parameter_value_to_python, got), strict=False))

    async def _values(self, names: list[str]) -> Any:
        answer = await self._call(_LAST, names=names)
        self._answers = True
        return answer.values

    async def set(self, values: Mapping[str, Any]) -> str:
        """Set parameters, all or none; return why they are rejected, or an empty text."""
        parameters = []
        try:
            for name, value in values.items():
                checked = ALL_SPECS[name].checked(value)
                given = list(checked) if isinstance(checked, tuple) else checked
                parameters.append(Parameter(name, value=given).to_parameter_msg())
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
        """Call `reset`, `step` or `step_to_impact`, once."""
        if not self._answers:
            await self._values([])
        answer = await self._call(service)
        return bool(answer.success), str(answer.message)

    def close(self) -> None:
        """Destroy the subscriptions and clients."""
        for subscription in self._subscriptions.values():
            subscription.destroy()
        for service in self._services.values():
            service.close()


class RosClient:
    """A node that finds the rigs of the ROS network."""

    def __init__(self) -> None:
        self._context = Context()
        # Signals are Python's.
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
