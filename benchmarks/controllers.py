"""
A controller in the loop: round trip, lock-step, and what measurements cost the node.

The controller is an rclpy node in a process of its own that answers each measurement at once. Its
command carries the number of the measurement in the last digits of a place, so that the order that
the rig reports names it: the round trip is the rig time from the sample to the command in effect.

    python benchmarks/controllers.py [--quick] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import rclpy
from node_process import (
    WARM_UP_S,
    cpu_seconds,
    node_command,
    quantile,
    running,
    say,
)
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

#: A place, and what is added to it for each number, m.
PLACE, STEP, NUMBERS = 0.012, 1e-9, 100_000


def stamp_ns(message: JointState) -> int:
    return int(message.header.stamp.sec) * 10**9 + int(message.header.stamp.nanosec)


def answer(rate: float) -> None:
    """Answer each measurement, until interrupted."""
    node = rclpy.create_node('echo')
    commands = node.create_publisher(JointState, 'stop_commands', 10)
    command = JointState(name=['stop_1', 'stop_2'])

    def take(seen: JointState) -> None:
        number = round(stamp_ns(seen) * 1e-9 * rate) % NUMBERS
        command.header.stamp = seen.header.stamp
        command.position = [PLACE + STEP * number, -PLACE]
        commands.publish(command)

    node.create_subscription(JointState, 'measurements', take, QoSProfile(depth=100))
    rclpy.spin(node)


class Watch:
    """Listens to what the rig publishes."""

    def __init__(self) -> None:
        self.node = rclpy.create_node('watch')
        self.samples: dict[int, int] = {}
        self.trips_ns: list[int] = []
        self.rate = 0.0
        for topic, take in (('measurements', self._measured), ('gap_control', self._acted)):
            self.node.create_subscription(JointState, topic, take, QoSProfile(depth=10_000))

    def _measured(self, seen: JointState) -> None:
        number = round(stamp_ns(seen) * 1e-9 * self.rate) % NUMBERS
        self.samples[number] = stamp_ns(seen)

    def _acted(self, act: JointState) -> None:
        if act.name[-1] == 'order':
            number = round((act.position[0] - PLACE) / STEP)
            if number in self.samples:
                self.trips_ns.append(stamp_ns(act) - self.samples[number])

    def listen(self, seconds: float) -> float:
        """Listen for a time; return how long it was."""
        begun = time.monotonic()
        while time.monotonic() < begun + seconds:
            rclpy.spin_once(self.node, timeout_sec=0.1)
        return time.monotonic() - begun


def in_the_loop(watch: Watch, rate: int, seconds: float, *, lock_step: bool) -> dict[str, Any]:
    """Return the round trip in real time, or how fast the rig runs in lock-step."""
    node = node_command(
        rate,
        gap_control='external',
        measurement_rate=float(rate),
        predict_motion=False,
        publish_clock=True,
        real_time_priority=2,
        actuator_speed=0.0,
        actuator_delay=0.0,
        **({'lock_step': 'stop_commands', 'real_time_factor': 0.0} if lock_step else {}),
    )
    watch.rate, watch.samples, watch.trips_ns = float(rate), {}, []
    with running(node), running([sys.executable, __file__, '--echo', str(rate)]):
        watch.listen(WARM_UP_S)
        end = time.monotonic() + 30.0
        while not watch.trips_ns and time.monotonic() < end:
            watch.listen(0.1)
        watch.samples, watch.trips_ns = {}, []
        spent = watch.listen(seconds)
    if lock_step:
        return {'samples per second': len(watch.trips_ns) / spent}
    trips = sorted(watch.trips_ns)
    return {
        'rate': rate,
        'commands': len(trips),
        'of measurements': len(watch.samples),
        'median ms': median(trips) * 1e-6,
        'p99 ms': quantile(list(map(float, trips)), 0.99) * 1e-6,
    }


def cost(rate: int, seconds: float) -> dict[str, Any]:
    """Return the share of a processor that the node takes, without and with measurements."""
    shares = {}
    for name, measured in (('without', 0.0), ('with', float(rate))):
        with running(node_command(rate, measurement_rate=measured)) as process:
            time.sleep(WARM_UP_S + 2.0)
            cpu, begun = cpu_seconds(process.pid), time.monotonic()
            time.sleep(seconds)
            shares[name] = (cpu_seconds(process.pid) - cpu) / (time.monotonic() - begun)
    return {'rate': rate, **shares}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--quick', action='store_true', help='a few seconds of each')
    parser.add_argument('--json', type=Path, help='write the numbers to a file')
    parser.add_argument('--echo', type=float, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    rclpy.init()
    if arguments.echo:
        answer(arguments.echo)
        return 0
    seconds = 4.0 if arguments.quick else 30.0
    watch = Watch()
    found: dict[str, Any] = {'round trip': [], 'cost': []}
    for rate in (200, 1000):
        found['round trip'].append(in_the_loop(watch, rate, seconds, lock_step=False))
        say(f'round trip: {found["round trip"][-1]}')
    found['lock-step'] = in_the_loop(watch, 200, seconds, lock_step=True)
    say(f'lock-step: {found["lock-step"]}')
    for rate in (200, 1000):
        found['cost'].append(cost(rate, seconds))
        say(f'share of a processor: {found["cost"][-1]}')
    if arguments.json:
        arguments.json.write_text(json.dumps(found, indent=1))
    return 0


if __name__ == '__main__':
    sys.exit(main())
