"""What the benchmarks of the node share: a process, and the subscriber that measures it."""

from __future__ import annotations

import contextlib
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

HERE = Path(__file__).resolve().parent
RIG = HERE.parent / 'config' / 'bench_rig.yaml'
TICKS_PER_S = os.sysconf('SC_CLK_TCK')
WARM_UP_S = 2.0
#: Longest time in which a program starts, with kernels to compile, beside others, s
DEADLINE_S = 300.0
#: Set in the environment by the ROS 2 wheels once Python has been started anew with the paths of
#: their libraries; without it a child does so itself, as when a user starts it.
BOOTSTRAP_MARK = '_ROS_WHEELS_BOOTSTRAP_COMPLETE'


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


def bare_command(pace: str, rate: int) -> list[str]:
    """Return what starts the bare publisher, with a pace that it knows."""
    return [sys.executable, str(HERE / 'bare_publisher.py'), pace, str(rate)]


def node_command(rate: int, python: str = sys.executable, **parameters: object) -> list[str]:
    """Return what starts the node with the bench rig and some parameters otherwise."""
    given = {'state_rate': float(rate), **parameters}
    texts = {n: str(v).lower() if isinstance(v, bool) else str(v) for n, v in given.items()}
    return [
        *(python, '-m', 'impact_damper_ros.node.sim_node'),
        *('--ros-args', '--params-file', str(RIG)),
        *(word for name, text in texts.items() for word in ('-p', f'{name}:={text}')),
    ]


@contextlib.contextmanager
def running(command: Sequence[str]) -> Iterator[subprocess.Popen[bytes]]:
    """Start a candidate, and end it by its own handle."""
    environment = {name: v for name, v in os.environ.items() if name != BOOTSTRAP_MARK}
    process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def cpu_seconds(pid: int) -> float:
    """Return the CPU time of a process and its ended children; none for process 0."""
    if not pid:
        return 0.0
    # The name in parentheses may hold spaces; the times are fields 14 to 17.
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return sum(map(int, fields[11:15])) / TICKS_PER_S


def thread_seconds(pid: int) -> dict[int, float]:
    """Return the CPU time of each thread of a process, in its order of creation."""
    found = {}
    for task in sorted(Path(f'/proc/{pid}/task').iterdir(), key=lambda path: int(path.name)):
        # In nanoseconds, unlike the ticks of `stat`
        with contextlib.suppress(FileNotFoundError):
            found[int(task.name)] = int((task / 'schedstat').read_text().split()[0]) * 1e-9
    return found


def anonymous_kib(pid: int) -> int:
    """Return the memory of a process that is its own and not a file's, KiB."""
    for line in Path(f'/proc/{pid}/status').read_text().splitlines():
        if line.startswith('RssAnon:'):
            return int(line.split()[1])
    raise ValueError(f'process {pid} has no memory')


def tree_kib(pid: int) -> int:
    """Return the memory of a process and what it has started, KiB, shared pages in parts."""
    total = 0
    with contextlib.suppress(FileNotFoundError, ProcessLookupError):
        for line in Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines():
            total += int(line.split()[1]) if line.startswith('Pss:') else 0
        for task in Path(f'/proc/{pid}/task').iterdir():
            total += sum(map(tree_kib, map(int, (task / 'children').read_text().split())))
    return total


def quantile(ordered: list[float], share: float) -> float:
    """Return a quantile of sorted values."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def deviations(arrivals: Sequence[Arrival], rate: int) -> list[float]:
    """
    Return by how much the periods differ from the nominal one, in microseconds, sorted.

    Across a loss there is no period to be seen.
    """
    nominal_us = 1e6 / rate
    return sorted(
        abs((b.source_ns - a.source_ns) * 1e-3 - nominal_us)
        for a, b in itertools.pairwise(arrivals)
        if b.number == a.number + 1
    )


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
