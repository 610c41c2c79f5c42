# SPDX-License-Identifier: Apache-2.0
"""
A base class for controllers of a rig: each measurement is answered by a command with its stamp.

>>> from impact_damper_ros.node.controller import Controller, run, stops  # doctest: +SKIP
"""

from __future__ import annotations

import inspect
import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

#: Longest wait for the service of the rig, s.
_PATIENCE_S = 10.0


class Controller(Node):
    """
    A controller of a rig; `command` is to be defined.

    Parameters
    ----------
    name : str
        Name of the node.
    topic, kind : str, type
        Topic and type of its commands.
    **parameters : object
        Names and defaults of its parameters.
    """

    def __init__(
        self, name: str, topic: str = 'stop_commands', kind: Any = JointState, **parameters: Any
    ) -> None:
        super().__init__(name)
        for parameter, default in parameters.items():
            self.declare_parameter(parameter, default)
        self._commands = self.create_publisher(kind, topic, 10)
        # A group of its own: an answer comes while that of the measurements waits for it.
        self._rig = self.create_client(
            SetParametersAtomically,
            'sim_node/set_parameters_atomically',
            callback_group=MutuallyExclusiveCallbackGroup(),
        )
        self.create_subscription(JointState, 'measurements', self._answer, 100)
        self._stamp: Any = None
        self._command: Any = None

    def value(self, name: str) -> Any:
        """Return a parameter."""
        return self.get_parameter(name).value

    def command(self, time: float, seen: Mapping[str, tuple[float, float]]) -> Any:
        """
        Return the command to a measurement; may be a coroutine.

        Parameters
        ----------
        time : float
            Its stamp, s.
        seen : dict
            Position and velocity by joint: `primary`, `damper`, `stop_1`, `stop_2`.
        """
        raise NotImplementedError

    async def set_rig(self, **parameters: Any) -> None:
        """
        Change parameters of the rig, all or none: `await self.set_rig(gap=0.02)` in `command`.

        In lock-step the change is at the instant of the measurement, before the command to it.

        Raises
        ------
        RuntimeError
            If there is no rig.
        ValueError
            If the rig refuses the change, with its reason.
        """
        if not self._rig.wait_for_service(_PATIENCE_S):
            raise RuntimeError(f'no rig offers {self._rig.srv_name}: start sim_node beside this')
        values = [Parameter(n, value=v).to_parameter_msg() for n, v in parameters.items()]
        answer = await self._rig.call_async(SetParametersAtomically.Request(parameters=values))
        if not answer.result.successful:
            raise ValueError(answer.result.reason)

    async def _answer(self, measurement: Any) -> None:
        stamp = measurement.header.stamp
        # In lock-step a measurement comes again if its command is late.
        if stamp != self._stamp:
            pairs = zip(measurement.position, measurement.velocity, strict=True)
            seen = dict(zip(measurement.name, pairs, strict=True))
            command = self.command(stamp.sec + stamp.nanosec * 1e-9, seen)
            if inspect.isawaitable(command):
                command = await command
            command.header.stamp = stamp
            self._stamp, self._command = stamp, command
        self._commands.publish(self._command)


def stops(**places: float) -> Any:
    """Return a command to stops: `stop_1`, `stop_2` or both, Y in m."""
    return JointState(name=list(places), position=list(places.values()))


def run(controller: Callable[[], Node]) -> None:
    """Make a controller, and run it until a signal comes."""
    ended: list[int] = []
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: ended.append(number))
    executor = SingleThreadedExecutor()
    try:
        executor.add_node(controller())
        while not ended:
            executor.spin_once(timeout_sec=0.2)
    finally:
        rclpy.try_shutdown()
