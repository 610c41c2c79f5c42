# SPDX-License-Identifier: Apache-2.0
"""Print each new largest |X| of a running rig, and the impact before it."""

import signal

import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState

# The signals only set a flag: one that reaches rclpy at work ends in a traceback.
rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
ended = []
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda number, _: ended.append(number))
node, largest, stop = rclpy.create_node('subscriber'), 0.0, 'no impact yet'


def look(states):
    """Keep the largest |X|."""
    global largest
    x = abs(states.position[states.name.index('primary')])
    if x > 1.01 * largest:
        largest = x
        node.get_logger().info(f'{1e3 * x:.2f} mm, {stop}')


def note(impact):
    """Keep the last impact."""
    global stop
    stop = f'after {impact.header.frame_id} with {abs(impact.effort[1]):.3f} N s'


node.create_subscription(JointState, 'joint_states', look, 10)
node.create_subscription(JointState, 'impacts', note, 10)
while not ended:
    rclpy.spin_once(node, timeout_sec=0.1)
