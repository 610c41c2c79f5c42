# SPDX-License-Identifier: Apache-2.0
"""What the controllers share: each measurement is answered by a command with its stamp."""

import signal
import sys

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState


class Controller(Node):
    """
    A controller of a rig.

    Parameters
    ----------
    name : str
        Name of the node.
    topic, kind : str, type
        Topic and type of its commands.
    **parameters : object
        Names and defaults of its parameters.
    """

    def __init__(self, name, topic='stop_commands', kind=JointState, **parameters):
        super().__init__(name)
        for parameter, default in parameters.items():
            self.declare_parameter(parameter, default)
        self._commands = self.create_publisher(kind, topic, 10)
        self.create_subscription(JointState, 'measurements', self._answer, 100)
        self._stamp = self._command = None

    def value(self, name):
        """Return a parameter."""
        return self.get_parameter(name).value

    def command(self, time, seen):
        """Return the command to a measurement at a time, s, given by (position, velocity)."""
        raise NotImplementedError

    def _answer(self, measurement):
        stamp = measurement.header.stamp
        # In lock-step a measurement comes again if its command is late.
        if stamp != self._stamp:
            pairs = zip(measurement.position, measurement.velocity, strict=True)
            seen = dict(zip(measurement.name, pairs, strict=True))
            command = self.command(stamp.sec + stamp.nanosec * 1e-9, seen)
            command.header.stamp = stamp
            self._stamp, self._command = stamp, command
        self._commands.publish(self._command)


def stops(**places):
    """Return a command to stops: `stop_1`, `stop_2` or both, Y in m."""
    return JointState(name=list(places), position=list(places.values()))


def stop(*_):
    """End on a signal; later ones are ignored, since `ros2 launch` may send several."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    raise KeyboardInterrupt


def run(controller):
    """Run a controller until it is interrupted."""
    rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    executor = SingleThreadedExecutor()
    try:
        executor.add_node(controller())
        while True:
            # A signal is noticed between two waits.
            executor.spin_once(timeout_sec=0.2)
    except KeyboardInterrupt:
        pass
    finally:
        rclpy.try_shutdown()
