# SPDX-License-Identifier: Apache-2.0
"""
The node `sim_node`: the rig on a ROS 2 network.

The engine's thread moves the rig and publishes; the executor serves parameters and services and
makes the reports. The work of the executor does not change the pace of the rig.
"""

from __future__ import annotations

import contextlib
import gc
import math
import signal
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import String as StringMessage

from impact_damper_ros.bag.messages import (
    DIAGNOSTIC_ARRAY,
    JOINT_STATE,
    STRING,
    Parameter as RecordedParameter,
    ParameterEvent,
    String,
    encode,
)
from impact_damper_ros.bag.rig_topics import COMMAND_TOPICS, LIVE_TOPICS, RIG_TOPICS
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.bag.topics import QosProfile
from impact_damper_ros.motion.kernels import compile_elsewhere
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.description import frequency_hint
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.parameters_file import values_given
from impact_damper_ros.parameters.quoting import printable
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS
from impact_damper_ros.theory.theory_thread import TheoryThread

from .commands import DEPTH, CommandInbox, CommandTopic, read_force_command, read_stop_command
from .diagnostics import Diagnostics
from .engine import Engine
from .engine_state import ANSWER_TIMEOUT_S, NotNowError, wait_for
from .motion_report import MotionMonitor
from .network import Network
from .pacing import take_priority
from .parameters import (
    NodeParameters,
    admissible_part,
    coerce,
    descriptor,
    parameters_from_overrides,
    readable,
    values_in,
)
from .publishing import RigPublishers, TopicPublisher
from .raw_subscription import RawSubscription
from .recording import Recorder
from .services import RigServices
from .start_message import argument_fault, given_text, start_message, unknown_argument
from .usage import answer


def refuse(reason: object) -> int:
    """Print why the node does not start, and return the exit code."""
    print(printable(f'sim_node: cannot start: {reason}'), file=sys.stderr)
    return 1


def answer_foreign(arguments: Sequence[str]) -> int | None:
    """Answer arguments that are not for ROS; None if there are none."""
    if not arguments:
        return None
    if answer(arguments):
        return 0
    return refuse(unknown_argument(arguments[0]))


#: Time after which another thread has to hand over the interpreter. With Python's 5 ms the thread
#: that moves the rig waits until that of the executor, or of a recording, is done.
SWITCH_INTERVAL_S = 2e-5
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
#: Time after which the executor looks for signals and for a failure of the engine.
LOOK_PERIOD_S = 0.2
#: Least time between two warnings of a kind, such as those of a rig that falls behind, s.
WARNING_PERIOD_S = 5.0


class _ParameterServices(ParameterService):
    """Parameter services of every node; the order of a list does not matter here."""

    def _set_parameters_callback(self, request: Any, response: Any) -> Any:
        given = list(map(Parameter.from_parameter_msg, request.parameters))
        response.results = self._get_node().set_parameters(given)
        return response


class SimNode(Node):
    """The rig as a node: publishers, parameters, services and reports around an engine."""

    def __init__(self, arguments: Sequence[str], executor: SingleThreadedExecutor) -> None:
        super().__init__('sim_node', start_parameter_services=False)
        # There is no public way to get the overrides of parameters that are not declared yet;
        # declaring from overrides would make `37` an integer parameter.
        overrides = {name: p.value for name, p in self._parameter_overrides.items()}
        given, idle, applied = values_given(arguments, self.get_fully_qualified_name())
        self._sources = given_text(given, applied)
        known = {*ALL_SPECS, *STRUCTURE_SPECS}
        # Of values of different types, rclpy takes whole numbers before others.
        overrides |= {name: value for name, value in given.items() if name in known}
        for reason in idle:
            self.get_logger().warning(reason)
        declared = self.list_parameters([], 0).names
        parameters = parameters_from_overrides(overrides, declared, self.get_logger().warning)
        self._declare(parameters)
        if parameters.simulated_time and not parameters.publish_clock:
            self.get_logger().info(
                f'real_time_factor is {parameters.real_time_factor:g}, lock_step '
                f'{parameters.lock_step}: stamps count from 0, and /clock is published; give the '
                'other nodes use_sim_time'
            )
        # Run by the executor, whatever thread requests it
        self._post = executor.create_task
        self._warned_s: dict[str, float] = {}
        node = self.get_fully_qualified_name()
        commands = {
            key: (self.resolve_topic_name(key), topic.type)
            for key, topic in COMMAND_TOPICS.items()
        }
        self._network = Network(self, '/clock' if parameters.simulated_time else '', commands)
        self._topic_publishers = self._advertise(parameters)
        priority = parameters.priority
        # The priority of this thread and those that it starts is one lower than that of the
        # engine: they never keep the engine waiting, and threads of other programs do not keep
        # them from releasing the interpreter.
        take_priority(max(1, priority - 1) if priority else 0)
        # Compiled by another process: the compiler would keep the rig waiting.
        compile_elsewhere()
        self._theory = TheoryThread(partial(self._post, self._follow_theory))
        self._theory.enable(parameters.predict_motion)
        self.engine = Engine(
            parameters,
            self._topic_publishers,
            node=node,
            inbox=self._command_inbox(),
            alive=self.context.ok,
            on_new_motion=partial(self._post, self._request_theory),
            on_trouble=self._warn_of_trouble,
        )
        self._monitor = MotionMonitor(self.engine.trace, self._theory, parameters.state_rate)
        broken = partial(self._post, self._end_broken_recording)
        self._recorder = Recorder(self.engine, self._topic_publishers, node, broken)
        self._description = String('')
        self._describe(parameters)
        self._diagnostics = Diagnostics(
            *(node, parameters.state_rate, parameters.real_time_factor),
            measurement_rate=parameters.measurement_rate,
        )
        # Reports come in wall time, also when the node's clock is a simulated or stopped one.
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        period_s = 1.0 / RIG_TOPICS['diagnostics'].rate_of(parameters)
        self.create_timer(period_s, self._report, clock=steady)
        # The last theory in the topic `theory` and in the diagnostics
        self._document, self._prediction = '', self._theory.prediction
        self._theory_publisher = self._publisher(
            StringMessage, 'theory', _qos(LIVE_TOPICS['theory'].qos), self._on_listener
        )
        RigServices(self, self.engine, partial(self._post, lambda: None))
        #: The parameters that ROS shows; the engine has them as soon as it goes on
        self._parameters_set = self._judged = parameters
        # The waiting part of the last change, in words
        self._waits = ''
        self.add_pre_set_parameters_callback(self._read)
        self.add_on_set_parameters_callback(self._judge)
        self.add_post_set_parameters_callback(self._follow)
        self._parameter_service = _ParameterServices(self)
        if parameters.record:
            self._open_recording(parameters)
            self._recorder.begin(self._listing(parameters), encode(self._description))

    def _warn_of_trouble(self, kind: str, text: str) -> None:
        """Warn, from the engine's thread, but not too often of one kind."""
        now = time.monotonic()
        if now >= self._warned_s.get(kind, -math.inf) + WARNING_PERIOD_S:
            self._warned_s[kind] = now
            self.get_logger().warning(text)

    def start(self) -> None:
        """Start the rig, and log a summary."""
        self.engine.start()
        name = self.get_fully_qualified_name()
        text = start_message(self.engine.parameters, name, self._recorder.path, self._sources)
        self.get_logger().info(text)

    def finish(self) -> str:
        """Stop the rig and finish the bag, without ROS; return a summary of the recording."""
        self.engine.stop()
        summary = self._recorder.finish()
        self._theory.close()
        return summary

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """Set parameters, all or none; the present value of a fixed one is no change."""
        changes = [one for one in parameter_list if not self._is_fixed_at(one)]
        if parameter_list and not changes:
            return SetParametersResult(successful=True)
        self._waits = ''
        try:
            result = super().set_parameters_atomically(changes)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result.reason = result.reason or self._waits
        return result

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """Set the admissible part of a list, at one instant: its order does not matter."""
        changes = [one for one in parameter_list if not self._is_fixed_at(one)]
        together, reasons = admissible_part(changes, self._parameters_set, self.has_parameter)
        result = SetParametersResult(successful=True)
        if together:
            result = self.set_parameters_atomically(together)
        return [
            SetParametersResult(successful=False, reason=reasons[one.name])
            if one.name in reasons
            else result
            for one in parameter_list
        ]

    # Start

    def _declare(self, parameters: NodeParameters) -> None:
        for name, value in parameters.as_dict().items():
            self.declare_parameter(
                name,
                list(value) if isinstance(value, tuple) else value,
                descriptor(ALL_SPECS[name]),
                ignore_override=True,
            )

    def _advertise(self, parameters: NodeParameters) -> RigPublishers:
        publishers = {
            key: self._publisher(_MESSAGE_TYPES[topic.type], topic.name, _qos(topic.qos))
            for key, topic in RIG_TOPICS.items()
            if topic.type in _MESSAGE_TYPES
        }
        # rclpy publishes these by itself; the engine only records them.
        events = self.resolve_topic_name(RIG_TOPICS['parameter_events'].name)
        publishers['parameter_events'] = TopicPublisher(events, lambda _: None)
        if parameters.simulated_time:
            clock = LIVE_TOPICS['clock']
            publishers['clock'] = self._publisher(ClockMessage, clock.name, _qos(clock.qos))
        return publishers

    def _publisher(
        self, kind: Any, topic: str, qos: QoSProfile, on_match: Any = None
    ) -> TopicPublisher:
        publisher = self.create_publisher(
            kind,
            topic,
            qos,
            event_callbacks=self._network.events_of(self.resolve_topic_name(topic), on_match),
            qos_overriding_options=self._qos_overrides(topic),
        )
        return TopicPublisher(publisher.topic_name, publisher.publish)

    def _command_inbox(self) -> CommandInbox:
        """Subscribe to the commands of a controller, for the engine's thread."""
        subscriptions = {
            key: RawSubscription(self, kind, key, _qos(COMMAND_TOPICS[key].qos))
            for key, (kind, _) in _COMMANDS.items()
        }
        # As `rclpy.wait_for_message` waits
        waiting = _rclpy.WaitSet(len(subscriptions), 0, 0, 0, 0, 0, self.context.handle)

        def wait(seconds: float) -> None:
            waiting.clear_entities()
            for one in subscriptions.values():
                waiting.add_subscription(one.handle)
            waiting.wait(round(seconds * 1e9))

        def take(key: str) -> list[bytes]:
            return [message.content for message in subscriptions[key].take(DEPTH)]

        topics = [
            CommandTopic(key, one.topic, partial(take, key), one.publishers, _COMMANDS[key][1])
            for key, one in subscriptions.items()
        ]
        return CommandInbox(topics, wait)

    def _qos_overrides(self, topic: str) -> QoSOverridingOptions | None:
        """Return the options of a topic whose quality of service the user has set."""
        # Otherwise each topic would add three parameters.
        prefix = f'qos_overrides.{self.resolve_topic_name(topic)}.publisher.'
        given = any(name.startswith(prefix) for name in self._parameter_overrides)
        return QoSOverridingOptions.with_default_policies() if given else None

    # Parameters

    def _open_recording(self, parameters: NodeParameters) -> None:
        self._recorder.open(
            parameters.bag_directory,
            _description_of(parameters),
            parameters.max_bag_size,
            parameters.max_bag_duration,
        )

    def _is_fixed_at(self, parameter: Parameter) -> bool:
        """Return whether a parameter is fixed while the node runs, and has this value."""
        name = parameter.name
        if not (self.has_parameter(name) and self.describe_parameter(name).read_only):
            return False
        return bool(coerce(parameter).value == self.get_parameter(name).value)

    def _read(self, request: list[Parameter]) -> list[Parameter]:
        """Return a request in the declared types and units, before it is set."""
        return readable(request, self._parameters_set.rig, self.has_parameter)

    def _judge(self, request: list[Parameter]) -> SetParametersResult:
        """Return whether the rig can take a request now; nothing changes."""
        before = self._parameters_set
        try:
            after = before.with_changes(values_in(request))
            wait_for(self.engine.ask(self.engine.check, after))
            if after.record and not before.record:
                # Only a try shows whether a recording can begin.
                self._open_recording(after)
        except Exception as error:
            return SetParametersResult(successful=False, reason=str(error))
        self._judged = after
        return SetParametersResult(successful=True)

    def _follow(self, request: list[Parameter]) -> None:
        """Let the engine make an accepted change; wait until it is in effect."""
        before, self._parameters_set = self._parameters_set, self._judged
        after, node = self._parameters_set, self.get_fully_qualified_name()
        event = ParameterEvent(0, node, (), tuple(map(_recorded_parameter, request)), ())
        listing = self._listing(after) if self._recorder.splits else b''
        made = self.engine.ask(self.engine.change, after, encode(event), listing)
        self._follow_change(before, after)
        try:
            self._waits = str(made.result(ANSWER_TIMEOUT_S).result)
        except TimeoutError:
            self._waits = 'the rig is busy: the change is made as soon as it goes on'
        except NotNowError:
            pass  # it is shutting down

    def _follow_change(self, before: NodeParameters, after: NodeParameters) -> None:
        """Make the consequences of a change other than the motion of the rig."""
        self._describe(after)
        self._diagnostics.factor = after.real_time_factor
        if hint := frequency_hint(after.rig, before.rig):
            self.get_logger().warning(hint)
        if after.predict_motion != before.predict_motion:
            self._theory.enable(after.predict_motion)
            self._follow_theory()
        if after.record and not before.record:
            self._recorder.begin(self._listing(after), encode(self._description))
            self.get_logger().info(f'recording to {self._recorder.path}')
        elif before.record and not after.record:
            summary = self._recorder.finish()
            if self._recorder.error:
                self.get_logger().error(f'{summary}; the rig runs on, record is false')
            else:
                self.get_logger().info(summary)

    def _describe(self, parameters: NodeParameters) -> None:
        """Publish and record the robot description, if it has changed."""
        text = _description_of(parameters)
        if text != self._description.data:
            self._description = String(text)
            self._publish('robot_description', encode(self._description))

    def _listing(self, parameters: NodeParameters) -> bytes:
        """Return the event that lists all parameters with their values."""
        values = parameters.as_dict()
        listed = [
            RecordedParameter(name, values[name])
            if name in values
            else _recorded_parameter(self.get_parameter(name))
            for name in self.list_parameters([], 0).names
        ]
        node = self.get_fully_qualified_name()
        return encode(ParameterEvent(0, node, tuple(listed), (), ()))

    def _publish(self, key: str, content: bytes) -> None:
        """Publish a message from the executor's thread; the engine records it."""
        publisher = self._topic_publishers[key]
        publisher.publish(content)
        self.engine.ask(self.engine.record, publisher.topic, content)

    # Reports

    def _report(self) -> None:
        self._follow_theory()
        engine = self.engine.status()
        recording = self._recorder.status(engine.recorded)
        motion = self._monitor.look()
        report = self._diagnostics.report(
            self.engine.stamp_ns(), engine, recording, motion, self._network.report()
        )
        self._publish('diagnostics', encode(report))

    # Theory

    def _request_theory(self, state: Mapping[str, Any]) -> None:
        """Predict the motion anew: the rig has another one."""
        self._theory.ask(state)
        self._follow_theory()

    def _on_listener(self, info: Any) -> None:
        """Let the curve over the gap be computed while the topic has subscribers."""
        self._theory.want_documents(info.current_count > 0)
        self._follow_theory()

    def _follow_theory(self) -> None:
        """Report and publish new results of the theory."""
        theory = self._theory
        if theory.document != self._document:
            self._document = theory.document
            self._theory_publisher.publish(encode(String(self._document)))
        if theory.prediction is not self._prediction:
            self._prediction = theory.prediction
            report = self._diagnostics.motion_report(self.engine.stamp_ns(), self._monitor.look())
            self._publish('diagnostics', encode(report))

    # Recording

    def _end_broken_recording(self) -> None:
        if self._parameters_set.record and self._recorder.failure():
            self.set_parameters_atomically([Parameter('record', Parameter.Type.BOOL, False)])


_MESSAGE_TYPES = {
    JOINT_STATE: JointState,
    STRING: StringMessage,
    DIAGNOSTIC_ARRAY: DiagnosticArray,
}


#: Types of `COMMAND_TOPICS`, and the functions that read their messages.
_COMMANDS = {
    'stop_commands': (JointState, read_stop_command),
    'force_command': (WrenchStamped, read_force_command),
}


def _qos(profile: QosProfile) -> QoSProfile:
    """Return the profile of rclpy; all topics of the rig are reliable."""
    durability = DurabilityPolicy.VOLATILE
    if profile.durability == 'transient_local':
        durability = DurabilityPolicy.TRANSIENT_LOCAL
    return QoSProfile(depth=profile.depth, durability=durability)


def _recorded_parameter(parameter: Parameter) -> RecordedParameter:
    value = parameter.value
    plain = value is None or isinstance(value, bool | int | float | str)
    return RecordedParameter(parameter.name, value if plain else tuple(value))


def _description_of(parameters: NodeParameters) -> str:
    return robot_description(parameters.rig, parameters.control.widest_gap)


def _run(node: SimNode, executor: SingleThreadedExecutor, ended: Sequence[int]) -> int:
    """Run the node until a signal has come, or its engine fails."""
    try:
        # The garbage collector need not visit the present objects again.
        gc.freeze()
        executor.add_node(node)
        node.start()
        while rclpy.ok() and not ended and node.engine.failure is None:
            try:
                executor.spin_once(timeout_sec=LOOK_PERIOD_S)
            except Exception:
                # A callback may fail by a malformed request, which must not stop the rig.
                node.get_logger().error(f'a callback failed:\n{traceback.format_exc()}')
    finally:
        # The terminal may be closed.
        if summary := node.finish():
            with contextlib.suppress(OSError):
                print(f'sim_node: {summary}', file=sys.stderr)
    if (failure := node.engine.failure) is not None:
        print('sim_node: the engine failed, the rig is stopped:', file=sys.stderr)
        traceback.print_exception(failure)
        return 1
    return 0


def _serve(arguments: Sequence[str], ended: Sequence[int]) -> int:
    """Run the node until it ends; return the exit code."""
    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except _rclpy.UnknownROSArgsError as error:
        # Its text is the list of them.
        return refuse(unknown_argument(next(w for w in arguments if repr(w) in str(error))))
    except Exception as error:
        return refuse(argument_fault(error, arguments))
    node = None
    try:
        if (code := answer_foreign(remove_ros_args(arguments)[1:])) is not None:
            return code
        try:
            executor = SingleThreadedExecutor()
            node = SimNode(arguments, executor)
        except Exception as error:
            return refuse(error)
        return _run(node, executor, ended)
    finally:
        with contextlib.suppress(Exception):
            if node is not None:
                node.destroy_node()
            rclpy.try_shutdown()


def main(argv: Sequence[str] | None = None) -> int:
    """
    Run the node.

    rclpy's own signal handler shuts ROS down from a thread of its own, and a second signal meets
    guard conditions that are just being freed. Here a signal is only noted. Signals are ignored
    from the end on, so that a repeated one does not change the exit code.
    """
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    ended: list[int] = []
    for number in SIGNALS:
        # SIGHUP, of a closed terminal, is ignored if the process was started so, as by nohup.
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda number, _: ended.append(number))
    try:
        return _serve(sys.argv if argv is None else argv, ended)
    finally:
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)


if __name__ == '__main__':
    sys.exit(main())
