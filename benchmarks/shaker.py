"""
What a rig on a shaker costs: one line of a base, a random base, the live node on it, a record.

    python benchmarks/shaker.py [--quick] [--json FILE]

Shares are CPU time over rig time, of a rig in plain Python, as commands and node run it, that is
sampled at 200 Hz. The node is a process of its own with one subscriber; its share is from
/proc/<pid>/stat.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from timing import in_turns, options, ratio, say, seconds_of, table, write_results

from impact_damper_ros import Rig, RigParameters, load_parameters
from impact_damper_ros.measured.random_motion import random_lines
from impact_damper_ros.measured.record import MeasuredRecord

HERE = Path(__file__).resolve().parent
TABLE = HERE.parent / 'config' / 'random_base.csv'
RATE = 200.0
LINES = (50, 200, 400)
#: Rig time of a run, and wall time for which a node is looked at, s.
DURATION, WATCHED = 2.0, 10.0


def bench(**changes: Any) -> RigParameters:
    """Return the bench rig with changes."""
    return load_parameters('bench_rig')[0].replace(**changes)


def on_random_base(count: int) -> RigParameters:
    """Return the bench rig on a random base."""
    lines = random_lines(TABLE, count, seed=3)
    return bench(force_amplitudes=0.0, **lines.values())


def sampled(rig: RigParameters) -> None:
    """Run a rig and sample it."""
    moving = Rig(rig)
    for k in range(int(DURATION * RATE)):
        moving.advance(k / RATE)
        moving.sample()


def minute_of_force() -> MeasuredRecord:
    """Return a noisy sine at 1 kHz for a minute."""
    times = np.arange(0.0, 60.0, 1e-3)
    noise = 0.3 * np.random.default_rng(1).normal(size=len(times))
    return MeasuredRecord('force', times, 1.2 * np.sin(31.416 * times) + noise, 'minute.csv')


def follow(record: MeasuredRecord) -> None:
    """Let the bench rig follow a record to its end."""
    Rig(bench(force_amplitudes=0.0), records=[record]).advance(record.duration)


def node_share(rig: RigParameters, directory: Path) -> float:
    """Return the share of a core that the node takes."""
    import rclpy
    from node_process import WARM_UP_S, Listener, cpu_seconds, node_command, running

    from impact_damper_ros.parameters.parameters_file import rig_yaml

    path = directory / 'rig.yaml'
    path.write_text(rig_yaml(rig, 'random base'), encoding='utf-8')
    command = node_command(int(RATE), predict_motion=False)
    command[command.index('--params-file') + 1] = str(path)
    rclpy.init()
    try:
        listener = Listener()
        listener.until_alone()
        began_ns = time.time_ns()
        with running(command) as process:
            listener.first(process, began_ns)
            listener.listen(WARM_UP_S)
            cpu, began = cpu_seconds(process.pid), time.monotonic()
            arrivals = listener.listen(WATCHED)
            cpu, spent = cpu_seconds(process.pid) - cpu, time.monotonic() - began
        listener.node.destroy_node()
    finally:
        rclpy.shutdown()
    say(f'{len(rig.harmonics[0])} lines: {len(arrivals) / spent:.1f} messages a second')
    return cpu / spent


def main() -> int:
    """Measure and print."""
    arguments = options(__doc__ or '', rounds=6).parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(100 + os.getpid() % 100))
    force = bench()
    base = bench(force_amplitudes=0.0, base_amplitudes=0.6, base_frequencies=31.416)
    rigs = {'force, 1 line': force, 'base, 1 line': base}
    rigs |= {f'base, {count} lines': on_random_base(count) for count in LINES}
    calls: dict[str, Callable[[], object]] = {
        name: partial(sampled, rig) for name, rig in rigs.items()
    }
    times = in_turns(calls, arguments.rounds)
    first = times['force, 1 line']
    with tempfile.TemporaryDirectory() as directory:
        nodes = {name: node_share(rig, Path(directory)) for name, rig in rigs.items()}
    record = seconds_of(partial(follow, minute_of_force()), process_time)
    print(f'60 s of a force record at 1 kHz: {record:.2f} s, {record / 60e-3:.1f} us a sample\n')
    rows = [
        (
            name,
            f'{min(own) / DURATION:.4f}',
            f'{ratio(first, own):.2f}',
            f'{nodes[name]:.3f}',
        )
        for name, own in times.items()
    ]
    print(table(('200 Hz', 'rig [core]', 'to force', 'node [core]'), rows))
    write_results(arguments.json, {'rigs': times, 'nodes': nodes, 'record': record})
    return 0


if __name__ == '__main__':
    sys.exit(main())
