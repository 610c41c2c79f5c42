"""
A node under load for long: overruns, periods, memory; beside a page, a recorder, subscribers.

    python benchmarks/soak.py [--minutes 30] [--json FILE]

First one rig at 1 kHz, recorded, with a parameter changed each second, a page that takes frames,
and two subscribers; then two rigs at 500 Hz for a tenth of the time. Overruns are counted by the
node, periods are between source timestamps (`node.py`), memory is what is a process's own.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from contextlib import ExitStack
from itertools import cycle
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from node_process import (
    WARM_UP_S,
    Listener,
    anonymous_kib,
    cpu_seconds,
    deviations,
    node_command,
    quantile,
    running,
    say,
)
from page import clients, server
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

SUBSCRIBER = Path(__file__).resolve().parents[1] / 'examples' / 'subscriber.py'
GAPS = 0.022, 0.026, 0.023, 0.024


class Pacing:
    """What the nodes report of their pacing, by the name of the status."""

    def __init__(self, listener: Listener) -> None:
        """Subscribe."""
        self.values: dict[str, dict[str, str]] = {}
        listener.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 10)

    def _take(self, array: Any) -> None:
        for status in array.status:
            if status.name.endswith(': pacing'):
                self.values[status.name] = {pair.key: pair.value for pair in status.values}

    def overruns(self) -> int:
        """Return the overruns of all nodes since their start."""
        return sum(int(values['Overruns']) for values in self.values.values())


def measure_one(listener: Listener, pacing: Pacing, seconds: float, place: str) -> dict[str, Any]:
    """Return how one rig at 1 kHz runs under load."""
    rate, began_ns = 1000, time.time_ns()
    setter = listener.node.create_client(SetParameters, '/sim_node/set_parameters')
    with ExitStack() as stack:
        process = stack.enter_context(
            running(node_command(rate, record=True, bag_directory=place))
        )
        listener.first(process, began_ns)
        stack.enter_context(running([sys.executable, str(SUBSCRIBER)]))
        _, port = stack.enter_context(server(place))
        pages = stack.enter_context(clients(port, 1, seconds))
        listener.listen(2.0 * WARM_UP_S)
        gaps, periods, memory = cycle(GAPS), [], []
        cpu, begin, overruns = cpu_seconds(process.pid), time.monotonic(), pacing.overruns()
        while (spent := time.monotonic() - begin) < seconds:
            parameter = Parameter('gap', value=next(gaps)).to_parameter_msg()
            setter.call_async(SetParameters.Request(parameters=[parameter]))
            periods += deviations(listener.listen(1.0), rate)
            memory.append(anonymous_kib(process.pid))
        cpu = cpu_seconds(process.pid) - cpu
        frames = sum(len(one['sizes']) for one in pages())
        overruns = pacing.overruns() - overruns
    periods.sort()
    return {
        'seconds': spent,
        'overruns_per_s': overruns / spent,
        'p50_us': quantile(periods, 0.5),
        'p99_us': quantile(periods, 0.99),
        'max_us': periods[-1],
        'cpu_percent': 100.0 * cpu / spent,
        'memory_early_kib': memory[len(memory) // 6],
        'memory_late_kib': memory[-1],
        'frames_per_s': frames / spent,
    }


def measure_two(listener: Listener, pacing: Pacing, seconds: float) -> dict[str, Any]:
    """Return how two rigs at 500 Hz run side by side."""
    pacing.values.clear()
    with ExitStack() as stack:
        for name in ('left', 'right'):
            command = [*node_command(500, predict_motion=False), '-r', f'__ns:=/{name}']
            stack.enter_context(running(command))
        while len(pacing.values) < 2:
            listener.listen(0.5)
        listener.listen(2.0 * WARM_UP_S)
        before = pacing.overruns()
        listener.listen(seconds)
        rates = [float(v['Events since startup']) for v in pacing.values.values()]
        return {'overruns_per_s': (pacing.overruns() - before) / seconds, 'samples': rates}


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--minutes', type=float, default=30.0)
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(30 + os.getpid() % 60))
    seconds, load = 60.0 * arguments.minutes, os.getloadavg()[0]
    rclpy.init()
    listener = Listener()
    pacing = Pacing(listener)
    with tempfile.TemporaryDirectory(prefix='soak_') as place:
        say(f'one rig at 1 kHz, {seconds:g} s')
        one = measure_one(listener, pacing, seconds, place)
    listener.until_alone()
    say(f'two rigs at 500 Hz, {0.1 * seconds:g} s')
    two = measure_two(listener, pacing, 0.1 * seconds)
    rclpy.try_shutdown()
    print(
        f'one rig at 1 kHz for {one["seconds"]:.0f} s: {one["overruns_per_s"]:.3f} overruns/s, '
        f'|period - nominal| p50 {one["p50_us"]:.0f}, p99 {one["p99_us"]:.0f}, max '
        f'{one["max_us"]:.0f} us; CPU {one["cpu_percent"]:.0f} %; memory after a sixth of the '
        f'time {one["memory_early_kib"] / 1024:.1f}, at the end '
        f'{one["memory_late_kib"] / 1024:.1f} MiB; {one["frames_per_s"]:.0f} frames/s to a page\n'
        f'two rigs at 500 Hz: {two["overruns_per_s"]:.3f} overruns/s\n'
        f'load average when this began: {load:.1f} on {os.cpu_count()} cores'
    )
    if arguments.json:
        arguments.json.write_text(json.dumps({'one': one, 'two': two, 'load': load}) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
