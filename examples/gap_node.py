# SPDX-License-Identifier: Apache-2.0
"""
Hold the gap of a running rig at a share of the best one, from `joint_states` and `impacts` alone.

    python examples/gap_node.py [FORCE]

FORCE in N is set first, if given. The node ends when the gap no longer changes.
"""

import sys
from math import pi, sqrt

import rclpy
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from sensor_msgs.msg import JointState

SHARE, MASS_RATIO, RESTITUTION = 0.6, 0.05, 0.6


class GapNode(Node):
    """A client of the parameter `gap` that measures the amplitude of M."""

    def __init__(self):
        super().__init__('gap_node')
        self.rig = AsyncParameterClient(self, 'sim_node')
        self.rig.wait_for_services()
        self.states = []  # time, position of M
        self.hit = set()
        self.create_subscription(JointState, 'joint_states', self._see_state, 1000)
        self.create_subscription(JointState, 'impacts', self._see_impact, 1000)

    def _see_state(self, message):
        stamp = message.header.stamp
        self.states.append((stamp.sec + 1e-9 * stamp.nanosec, message.position[0]))

    def _see_impact(self, message):
        self.hit.add(message.header.frame_id)

    def wait(self, future):
        """Return the result of a request."""
        rclpy.spin_until_future_complete(self, future)
        return future.result()

    def set(self, name, value):
        """Set a parameter of the rig, and begin to listen anew."""
        answer = self.wait(self.rig.set_parameters([Parameter(name, value=value)])).results[0]
        if not answer.successful:
            raise SystemExit(answer.reason)
        self.states, self.hit = [], set()

    def amplitude(self, duration):
        """Return the amplitude of M in the second half of a duration, s."""
        while not self.states or self.states[-1][0] - self.states[0][0] < duration:
            rclpy.spin_once(self)
        late = [x for t, x in self.states if t > self.states[-1][0] - 0.5 * duration]
        mean = sum(late) / len(late)
        return sqrt(2.0 * sum((x - mean) ** 2 for x in late) / len(late))


def main():
    """Move the gap a part of the way once a second, until it is steady."""
    rclpy.init()
    node = GapNode()
    if len(sys.argv) > 1:
        node.set('force_amplitudes', [float(sys.argv[1])])
    gap = node.wait(node.rig.get_parameters(['gap'])).values[0].double_value
    steady = 0
    while steady < 3:
        amplitude = node.amplitude(1.0)
        best = pi * amplitude * (1.0 + RESTITUTION) / ((1.0 - RESTITUTION) * (1.0 + MASS_RATIO))
        missed = len(node.hit) < 2
        wanted = 0.8 * gap if missed else gap + 0.3 * (SHARE * best - gap)
        steady = steady + 1 if not missed and abs(wanted - gap) < 0.0005 * gap else 0
        print(f'M moves {1e3 * amplitude:5.2f} mm, gap {1e3 * gap:6.2f} mm', flush=True)
        gap = wanted
        node.set('gap', gap)
    print(f'settled at a gap of {1e3 * gap:.1f} mm')


if __name__ == '__main__':
    main()
