# SPDX-License-Identifier: Apache-2.0
"""
A base class for controllers, which answer each measurement by a command with its stamp.

>>> from impact_damper_ros.node.controller import Controller, run, stops  # doctest: +SKIP
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Mapping
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

from .rig_client import PARAMETERS, RigClient, parameter_messages

#: Longest wait for an answer of the rig, s.
_PATIENCE_S = 10.0


class Controller(Node):
    """
    A controller of a rig; a derived class defines `command`.

    Parameters
    ----------
    name : str
        Name of the node.
    topic, kind : str, type
        Topic and type of the commands.
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
        self._rig = RigClient(self, 'sim_node', PARAMETERS)
        self.create_subscription(JointState, 'measurements', self._answer, 100)
        self._stamp: Any = None
        self._command: Any = None

    def value(self, name: str) -> Any:
        """Return a parameter."""
        return self.get_parameter(name).value

    def command(self, time: float, seen: Mapping[str, tuple[float, float]]) -> Any:
        """
        Return the command to a measurement.

        Parameters
        ----------
        time : float
            Stamp of the measurement, s.
        seen : dict
            Position and velocity by joint: `primary`, `damper`, `stop_1`, `stop_2`.
        """
        raise NotImplementedError

    def set_rig(self, **parameters: Any) -> None:
        """
        Change parameters of the rig, all or none: `self.set_rig(gap=0.02)` in `command`.

        In lock-step the change is at the instant of the measurement, before the command to it.

        Raises
        ------
        TimeoutError
            If no rig answers.
        ValueError
            If no rig can have such a value, or this one refuses the change, with its reason.
        """
        asked = parameter_messages(parameters)
        answer = self._rig.call('set_parameters_atomically', _PATIENCE_S, parameters=asked)
        if not answer.result.successful:
            raise ValueError(answer.result.reason)

    def _answer(self, measurement: Any) -> None:
        stamp = measurement.header.stamp
        # In lock-step a measurement is sent again if its command is late.
        if stamp != self._stamp:
            pairs = zip(measurement.position, measurement.velocity, strict=True)
            seen = dict(zip(measurement.name, pairs, strict=True))
            command = self.command(stamp.sec + stamp.nanosec * 1e-9, seen)
            command.header.stamp = stamp
            self._stamp, self._command = stamp, command
        self._commands.publish(self._command)


def stops(**places: float) -> Any:
    """Return a command to stops: `stop_1`, `stop_2` or both, Y in m."""
    return JointState(name=list(places), position=list(places.values()))


def run_controller(controller: Callable[[], Node]) -> None:
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
