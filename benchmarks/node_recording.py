"""
What recording costs the node: the processor at 1 kHz, and memory over an hour of the rig.

The writer has threads of its own, which come to be when `record` is set while the node runs: so
its cost is told from that of the rest. The hour is simulated as fast as possible.
"""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from node_process import (
    WARM_UP_S,
    Listener,
    anonymous_kib,
    node_command,
    running,
    say,
    thread_seconds,
)
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter

__all__ = ['hour_text', 'measure_hour', 'measure_writing', 'writing_text']

HOUR_S = 3600.0
#: The memory counts from here on, rig time: what is loaded and allocated first does not grow.
SETTLED_S = 600.0


def _spent(listener: Listener, pid: int, seconds: float) -> tuple[dict[int, float], int]:
    """Return the CPU time of each thread over a while, and the messages received."""
    before = thread_seconds(pid)
    arrivals = listener.listen(seconds)
    after = thread_seconds(pid)
    count = arrivals[-1].number - arrivals[0].number + 1
    return {thread: after[thread] - before.get(thread, 0.0) for thread in after}, count


def measure_writing(
    listener: Listener, rate: int, seconds: float, rounds: int, bags: Path
) -> dict[str, Any]:
    """Return what recording costs for each tick, in microseconds of CPU time."""
    rows = []
    client = listener.node.create_client(SetParameters, '/sim_node/set_parameters')

    def record(value: bool) -> None:
        parameter = Parameter('record', value=value).to_parameter_msg()
        client.call_async(SetParameters.Request(parameters=[parameter]))
        listener.listen(1.0)

    listener.until_alone()
    began_ns = time.time_ns()
    command = node_command(rate, bag_directory=bags, predict_motion=False)
    with running(command) as process:
        listener.first(process, began_ns)
        listener.listen(WARM_UP_S)
        for turn in range(rounds):
            say(f'recording at {rate} Hz, round {turn + 1} of {rounds}')
            without, ticks = _spent(listener, process.pid, seconds)
            record(True)
            recording, recorded = _spent(listener, process.pid, seconds)
            record(False)
            writers = [thread for thread in recording if thread not in without]
            if not writers:
                raise SystemExit('the node did not begin to record')
            engine = max(without, key=lambda thread: without[thread])
            rows.append(
                {
                    'engine_us': 1e6 * without[engine] / ticks,
                    'engine_recording_us': 1e6 * recording[engine] / recorded,
                    'writer_us': 1e6 * sum(recording[thread] for thread in writers) / recorded,
                    'all_us': 1e6 * sum(without.values()) / ticks,
                    'all_recording_us': 1e6 * sum(recording.values()) / recorded,
                }
            )
    listener.node.destroy_client(client)
    return {'rate': rate, 'seconds': seconds, 'rounds': rows}


def writing_text(results: dict[str, Any]) -> str:
    """Return as text what recording costs."""
    rows = results['rounds']
    mid = {key: median(row[key] for row in rows) for key in rows[0]}
    tick_us = 1e6 / results['rate']
    added = median(row['engine_recording_us'] - row['engine_us'] for row in rows)
    return '\n'.join(
        [
            '',
            f'recording at {results["rate"]} Hz: CPU time for each tick of {tick_us:g} us, '
            f'median of {len(rows)} rounds of {results["seconds"]:g} s',
            f'  engine thread {mid["engine_us"]:.0f} us, recording '
            f'{mid["engine_recording_us"]:.0f} us ({added:+.1f}); all threads '
            f'{mid["all_us"]:.0f} us, recording {mid["all_recording_us"]:.0f} us',
            f'  writing to MCAP (its own threads) {mid["writer_us"]:.1f} us: '
            f'{mid["writer_us"] / tick_us:.1%} of the tick; with what it adds to the engine '
            f'{(mid["writer_us"] + added) / tick_us:.1%}',
        ]
    )


def measure_hour(listener: Listener, rate: int, bags: Path) -> dict[str, Any]:
    """Return the memory of the node over an hour of the rig, recording."""
    said: list[float] = []

    def take(array: Any) -> None:
        for status in array.status:
            said.extend(float(v.value) for v in status.values if v.key == 'Time [s]')

    listener.until_alone()
    subscription = listener.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    parameters = {'real_time_factor': 0.0, 'record': True, 'bag_directory': bags / 'hour'}
    rows: list[tuple[float, int]] = []
    began = time.monotonic()
    # Unheard by the subscriber, which would not keep up
    unheard = ['-r', 'joint_states:=unheard']
    with running([*node_command(rate, **parameters), *unheard]) as process:
        while not said or said[-1] < HOUR_S:
            if process.poll() is not None:
                raise SystemExit(f'the node ended with code {process.returncode}')
            listener.executor.spin_once(timeout_sec=1.0)
            if said and (not rows or said[-1] > rows[-1][0]):
                rows.append((said[-1], anonymous_kib(process.pid)))
                say(f'an hour at {rate} Hz: {rows[-1][0]:.0f} s, {rows[-1][1] / 1024:.1f} MiB')
        spent = time.monotonic() - began
    listener.node.destroy_subscription(subscription)
    size = sum(path.stat().st_size for path in (bags / 'hour').rglob('*.mcap'))
    return {'rate': rate, 'rows': rows, 'seconds': spent, 'bag_bytes': size}


def _slope(rows: list[tuple[float, int]]) -> float:
    """Return the growth of memory by least squares, MiB per hour of the rig."""
    n = len(rows)
    mean_t, mean_m = sum(t for t, _ in rows) / n, sum(m for _, m in rows) / n
    spread = sum((t - mean_t) ** 2 for t, _ in rows)
    return sum((t - mean_t) * (m - mean_m) for t, m in rows) / spread * HOUR_S / 1024


def hour_text(results: dict[str, Any]) -> str:
    """Return as text how the memory went."""
    rows = [(t, m) for t, m in results['rows'] if t >= SETTLED_S] or results['rows'][-2:]
    memory = [m / 1024 for _, m in rows]
    return '\n'.join(
        [
            '',
            f'memory over an hour of the rig at {results["rate"]} Hz, recording '
            f'({results["bag_bytes"] / 2**20:.0f} MiB), in {results["seconds"]:.0f} s of the '
            'clock',
            f'  after {rows[0][0] / 60:.0f} min {memory[0]:.1f} MiB, at the end '
            f'{memory[-1]:.1f} MiB, least {min(memory):.1f}, most {max(memory):.1f}; '
            f'trend {_slope(rows):+.1f} MiB per hour',
        ]
    )
