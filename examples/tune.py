# SPDX-License-Identifier: Apache-2.0
"""
Set the gap of a running rig to each value of a list, and print what motion it settles into.

    python examples/tune.py 0.012 0.024 0.034
"""

import sys

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

#: Longest time for which a motion is awaited, s.
PATIENCE_S = 60.0


class Tuner(Node):
    """A client of the parameters and the diagnostics of `sim_node`."""

    def __init__(self):
        super().__init__('tune')
        self._rig = AsyncParameterClient(self, 'sim_node')
        self._rig.wait_for_services(10.0)
        self._motion = {}
        self.create_subscription(DiagnosticArray, '/diagnostics', self._look, 10)

    def _look(self, report):
        for status in report.status:
            if status.name.endswith('sim_node: measured motion'):
                self._motion = {pair.key: pair.value for pair in status.values}

    def settle(self, gap):
        """Set the gap, and return the motion that the rig settles into."""
        request = self._rig.set_parameters([Parameter('gap', value=gap)])
        rclpy.spin_until_future_complete(self, request)
        (result,) = request.result().results
        if not result.successful:
            raise SystemExit(result.reason)
        self._motion = {}
        end = self.get_clock().now().nanoseconds + PATIENCE_S * 1e9
        while self.get_clock().now().nanoseconds < end:
            rclpy.spin_once(self, timeout_sec=1.0)
            if self._motion.get('State') in ('periodic', 'without impacts'):
                break
        return self._motion


def main():
    """Print a table."""
    rclpy.init()
    tuner = Tuner()
    print('gap [m]  motion      stops      largest X [m]')
    for gap in map(float, sys.argv[1:]):
        motion = tuner.settle(gap)
        x_max = float(motion['Largest X [m]'] or 'nan')
        print(
            f'{gap:<8g} {motion["State"]:11} {motion["Stop sequence"]:10} {x_max:.6f}', flush=True
        )
    rclpy.shutdown()


if __name__ == '__main__':
    main()
