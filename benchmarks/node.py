"""
CPU share, period jitter and start-up time of `sim_node` against bare rclpy publishers.

Every candidate is a process of its own that publishes joint_states; this one subscribes, in the
same way to all of them, and measures from outside. The candidates take turns within one run.

    python benchmarks/node.py [--quick] [--json FILE]

Periods are those between the source timestamps, which the middleware sets in the publisher's
process when a message is published: the subscriber's own lateness is not in them. Losses are gaps
in the publisher's sequence numbers. CPU time is that of all threads, from /proc/<pid>/stat.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

HERE = Path(__file__).resolve().parent
RIG = HERE.parent / 'config' / 'bench_rig.yaml'
TICKS_PER_S = os.sysconf('SC_CLK_TCK')
WARM_UP_S = 2.0
DEADLINE_S = 30.0
#: Set in the environment by the ROS 2 wheels once Python has been started anew with the paths of
#: their libraries; without it a child does so itself, as when a user starts it.
BOOTSTRAP_MARK = '_ROS_WHEELS_BOOTSTRAP_COMPLETE'

RECORDING = 'sim_node, recording'
#: Compared with; the first.
BASE = 'bare, thread'
CANDIDATES = (BASE, 'bare, rclpy timer', 'sim_node', RECORDING)


class Arrival(NamedTuple):
    """A message: when it was published and received, and its number."""

    source_ns: int
    received_s: float
    number: int


class Listener:
    """The one subscriber."""

    def __init__(self) -> None:
        """Subscribe."""
        self.arrivals: list[Arrival] = []
        self.node = rclpy.create_node('listener')
        # Raw, to cost as little as possible; deep, so that nothing is lost on this side.
        self.node.create_subscription(
            JointState, 'joint_states', self._take, QoSProfile(depth=10_000), raw=True
        )
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def _take(self, _: bytes, info: dict[str, int]) -> None:
        arrival = Arrival(
            info['source_timestamp'], time.monotonic(), info['publication_sequence_number']
        )
        self.arrivals.append(arrival)

    def listen(self, seconds: float) -> list[Arrival]:
        """Return what arrives within a time."""
        self.arrivals = []
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=left)
        return self.arrivals

    def first(self, process: subprocess.Popen[bytes], began_ns: int) -> Arrival:
        """Wait for a message from a process that was started at a system time."""
        self.arrivals = []
        end = time.monotonic() + DEADLINE_S
        # What an earlier process sent may still wait to be taken.
        while not self.arrivals or self.arrivals[-1].source_ns < began_ns:
            if process.poll() is not None:
                raise SystemExit(f'{process.args!r} ended with code {process.returncode}')
            if time.monotonic() > end:
                raise SystemExit(f'{process.args!r} has sent nothing for {DEADLINE_S:g} s')
            self.executor.spin_once(timeout_sec=0.1)
        return self.arrivals[-1]

    def until_alone(self) -> None:
        """Wait until no publisher is left."""
        end = time.monotonic() + DEADLINE_S
        while self.node.count_publishers('joint_states'):
            if time.monotonic() > end:
                raise SystemExit('somebody else publishes joint_states in this ROS domain')
            self.executor.spin_once(timeout_sec=0.05)


def command(candidate: str, rate: int, bags: Path) -> list[str]:
    """Return what starts a candidate."""
    if candidate.startswith('bare'):
        pace = 'thread' if candidate == BASE else 'timer'
        return [sys.executable, str(HERE / 'bare_publisher.py'), pace, str(rate)]
    recording = ['-p', 'record:=true', '-p', f'bag_directory:={bags}']
    return [
        *(sys.executable, '-m', 'impact_damper_ros.nodes.sim_node'),
        *('--ros-args', '--params-file', str(RIG), '-p', f'state_rate:={rate}.0'),
        *(recording if candidate == RECORDING else []),
    ]


@contextlib.contextmanager
def running(candidate: str, rate: int, bags: Path) -> Iterator[subprocess.Popen[bytes]]:
    """Start a candidate, and end it by its own handle."""
    environment = {name: v for name, v in os.environ.items() if name != BOOTSTRAP_MARK}
    process = subprocess.Popen(
        command(candidate, rate, bags), env=environment, stderr=subprocess.DEVNULL
    )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def cpu_seconds(pid: int) -> float:
    """Return the CPU time that a process has used, all threads."""
    # The name in parentheses may hold spaces; user and system time are fields 14 and 15.
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS_PER_S


def quantile(ordered: list[float], share: float) -> float:
    """Return a quantile of sorted values."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def measure_running(
    listener: Listener, candidate: str, rate: int, seconds: float, bags: Path
) -> dict[str, float]:
    """Return how one candidate ran for a while."""
    listener.until_alone()
    began_ns = time.time_ns()
    with running(candidate, rate, bags) as process:
        listener.first(process, began_ns)
        listener.listen(WARM_UP_S)
        cpu, began = cpu_seconds(process.pid), time.monotonic()
        arrivals = listener.listen(seconds)
        cpu, spent = cpu_seconds(process.pid) - cpu, time.monotonic() - began
    if len(arrivals) < 10:
        raise SystemExit(f'{candidate} sent {len(arrivals)} messages in {seconds:g} s')
    nominal_us = 1e6 / rate
    pairs = itertools.pairwise(arrivals)
    # Across a loss there is no period to be seen.
    deviations = sorted(
        abs((b.source_ns - a.source_ns) * 1e-3 - nominal_us)
        for a, b in pairs
        if b.number == a.number + 1
    )
    count = arrivals[-1].number - arrivals[0].number
    return {
        'cpu_percent': 100.0 * cpu / spent,
        'rate': count / ((arrivals[-1].source_ns - arrivals[0].source_ns) * 1e-9),
        'p50_us': quantile(deviations, 0.5),
        'p99_us': quantile(deviations, 0.99),
        'max_us': deviations[-1],
        'lost': count + 1 - len(arrivals),
    }


def measure_start(listener: Listener, candidate: str, rate: int, bags: Path) -> dict[str, float]:
    """Return the time from the start of a process to its first message here."""
    listener.until_alone()
    began, began_ns = time.monotonic(), time.time_ns()
    with running(candidate, rate, bags) as process:
        first = listener.first(process, began_ns)
        cpu = cpu_seconds(process.pid)
    seconds = first.received_s - began
    # What had been published before the two sides knew of each other was lost on the way.
    unheard = (first.number - 1) / rate
    return {'seconds': seconds, 'discovery_seconds': unheard, 'cpu_seconds': cpu}


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def medians(rounds: list[dict[str, float]]) -> dict[str, float]:
    """Return the median of each quantity."""
    return {key: median(r[key] for r in rounds) for key in rounds[0]}


def against_base(rounds: dict[str, list[dict[str, float]]], candidate: str, key: str) -> float:
    """Return the median over the rounds of the ratio to the base in the same round."""
    pairs = zip(rounds[candidate], rounds[BASE], strict=True)
    return median(a[key] / b[key] if b[key] else float('nan') for a, b in pairs)


def summary(rounds: dict[str, list[dict[str, float]]], keys: tuple[str, ...]) -> dict[str, Any]:
    """Return medians, ratios and the rounds themselves, for each candidate."""
    return {
        name: {
            **medians(rounds[name]),
            'ratios': {key: against_base(rounds, name, key) for key in keys},
            'rounds': rounds[name],
        }
        for name in rounds
    }


def table(results: dict[str, Any]) -> str:
    """Return the results as text."""
    lines = []
    for rate, rows in results['running'].items():
        lines += [
            '',
            f'{rate} Hz, {results["seconds"]:g} s each, median of {results["rounds"]} rounds '
            'in turns',
            f'  {"":20}{"CPU":>8}{"ratio":>7}{"rate":>9}'
            f'{"|period - nominal|: p50":>25}{"p99":>8}{"max":>8}{"p99 ratio":>11}'
            f'{"least p99":>11}{"lost":>6}',
        ]
        for name, row in rows.items():
            lines.append(
                f'  {name:20}{row["cpu_percent"]:>6.1f} %{row["ratios"]["cpu_percent"]:>7.2f}'
                f'{row["rate"]:>9.2f}{row["p50_us"]:>22.0f} us{row["p99_us"]:>8.0f}'
                f'{row["max_us"]:>8.0f}{row["ratios"]["p99_us"]:>11.2f}'
                f'{min(r["p99_us"] for r in row["rounds"]):>11.0f}'
                f'{sum(r["lost"] for r in row["rounds"]):>6.0f}'
            )
    lines += [
        '',
        f'start-up, {results["start_rounds"]} rounds in turns: process start to first message',
        f'  {"":20}{"median":>9}{"best":>8}{"worst":>8}{"ratio":>7}{"CPU":>9}'
        f'{"discovery":>12}{"worst":>8}{"worst without":>15}',
    ]
    for name, row in results['start'].items():
        waits = [r['seconds'] for r in row['rounds']]
        unheard = [r['discovery_seconds'] for r in row['rounds']]
        own = [a - b for a, b in zip(waits, unheard, strict=True)]
        lines.append(
            f'  {name:20}{row["seconds"]:>7.2f} s{min(waits):>8.2f}{max(waits):>8.2f}'
            f'{row["ratios"]["seconds"]:>7.2f}{row["cpu_seconds"]:>7.2f} s'
            f'{row["discovery_seconds"]:>10.2f} s{max(unheard):>8.2f}{max(own):>13.2f} s'
        )
    lines += [
        'discovery: publishing already, but not yet known to the subscriber; a part of the above.',
        '',
        f'ratio: to "{BASE}" in the same round, median. CPU in per cent of one core. lost: in all '
        'rounds.',
        f'load average when this began: {results["load"]:.1f} on {os.cpu_count()} cores.',
    ]
    return '\n'.join(lines)


def measure(
    listener: Listener,
    rates: list[int],
    seconds: float,
    rounds: int,
    start_rounds: int,
    bags: Path,
) -> dict[str, Any]:
    """Measure everything, in turns."""
    results: dict[str, Any] = {
        'load': os.getloadavg()[0],
        'seconds': seconds,
        'rounds': rounds,
        'start_rounds': start_rounds,
        'running': {},
    }
    for rate in rates:
        runs: dict[str, list[dict[str, float]]] = {name: [] for name in CANDIDATES}
        for turn in range(rounds):
            for name in CANDIDATES:
                say(f'{rate} Hz, round {turn + 1} of {rounds}: {name}')
                runs[name].append(measure_running(listener, name, rate, seconds, bags))
        results['running'][rate] = summary(runs, ('cpu_percent', 'p99_us'))
    starts: dict[str, list[dict[str, float]]] = {name: [] for name in CANDIDATES}
    for turn in range(start_rounds):
        say(f'start-up, round {turn + 1} of {start_rounds}')
        for name in CANDIDATES:
            starts[name].append(measure_start(listener, name, rates[0], bags))
    results['start'] = summary(starts, ('seconds',))
    return results


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--quick', action='store_true', help='one short round')
    parser.add_argument('--seconds', type=float, help='how long each candidate is measured')
    parser.add_argument('--rounds', type=int, help='rounds of all candidates in turns')
    parser.add_argument('--start-rounds', type=int, help='the same for the start-up time')
    parser.add_argument('--rates', type=int, nargs='+', default=[200, 1000], metavar='HZ')
    parser.add_argument(
        '--bags', type=Path, metavar='DIR', help='record there; a temporary directory if not given'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    quick = arguments.quick
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    # A domain of its own, so that no other node on this machine takes part.
    os.environ.setdefault('ROS_DOMAIN_ID', str(30 + os.getpid() % 60))
    rclpy.init()
    with tempfile.TemporaryDirectory(prefix='bench_', dir=arguments.bags) as bags:
        results = measure(
            Listener(),
            arguments.rates,
            arguments.seconds or (3.0 if quick else 10.0),
            arguments.rounds or (1 if quick else 3),
            arguments.start_rounds or (3 if quick else 7),
            Path(bags),
        )
    rclpy.try_shutdown()
    print(table(results))
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
