"""
What a change of parameters, and the prediction that it sets off, do to the pace of the node.

The gap is changed once a second, or ten times, while the node runs at 1 kHz; with its theory
asked for at each change and without, in turns within one run, next to a node that nobody touches;
and the node of another checkout beside it, if there is one.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from statistics import median
from typing import Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from node_process import (
    RIG,
    WARM_UP_S,
    Listener,
    cpu_seconds,
    deviations,
    node_command,
    quantile,
    running,
    say,
    tree_kib,
)
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from impact_damper_ros import find_orbits, load_parameters

__all__ = ['measure_changes', 'text_of']

BENCH = load_parameters(RIG)[0]
#: The gaps that are set, and the largest |X| that theory has for each.
X_MAX = {
    gap: find_orbits(BENCH.replace(gap=gap), (1, 2)).orbits[0].x_max
    for gap in (0.022, 0.026, 0.023, 0.024)
}


class Variant(NamedTuple):
    """How the node runs: with theory or without, changes per second, and of which checkout."""

    predicting: bool
    changes: int
    beside: bool = False


VARIANTS = {
    'untouched, no prediction': Variant(False, 0),
    '1 change/s, no prediction': Variant(False, 1),
    '1 change/s, predicting': Variant(True, 1),
    '10 changes/s, no prediction': Variant(False, 10),
    '10 changes/s, predicting': Variant(True, 10),
}
BESIDE = {
    f'{name}, other': variant._replace(beside=True)
    for name, variant in VARIANTS.items()
    if variant.predicting
}


class Operator:
    """Who turns the knob, and looks at the diagnostics."""

    def __init__(self, listener: Listener) -> None:
        """Connect to the node."""
        self._listener = listener
        node = listener.node
        self._client = node.create_client(SetParameters, '/sim_node/set_parameters')
        self._subscription = node.create_subscription(
            DiagnosticArray, '/diagnostics', self._take, 10
        )
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._theory = node.create_subscription(String, 'theory', self._read, latched)
        self.overruns = 0
        self.latencies: list[float] = []
        self._changed_at = self._awaited = 0.0

    def close(self) -> None:
        """Disconnect."""
        self._listener.node.destroy_client(self._client)
        self._listener.node.destroy_subscription(self._subscription)
        self._listener.node.destroy_subscription(self._theory)

    def change(self, gap: float) -> None:
        """Set the gap."""
        parameter = Parameter('gap', value=gap).to_parameter_msg()
        self._client.call_async(SetParameters.Request(parameters=[parameter]))
        self._changed_at, self._awaited = time.monotonic(), X_MAX[gap]

    def _take(self, array: Any) -> None:
        for status in array.status:
            values = {v.key: v.value for v in status.values}
            if status.name.endswith('pacing'):
                self.overruns = int(values['Overruns'])

    def _read(self, theory: Any) -> None:
        x_max = (json.loads(theory.data)['orbit'] or {}).get('x_max') or 0.0
        if self._awaited and abs(x_max / self._awaited - 1.0) < 1e-6:
            self.latencies.append(time.monotonic() - self._changed_at)
            self._awaited = 0.0


def _schedule(seconds: float, changes: int) -> Iterator[tuple[float, float | None]]:
    """Yield stretches of time, and the gap to be set after each."""
    if not changes:
        yield seconds, None
        return
    for k in range(round(seconds * changes)):
        yield 1.0 / changes, list(X_MAX)[k % len(X_MAX)]


def measure_variant(
    listener: Listener, variant: Variant, rate: int, seconds: float, beside: str
) -> dict[str, Any]:
    """Return how the node ran for a while."""
    listener.until_alone()
    began_ns = time.time_ns()
    python = beside if variant.beside else sys.executable
    with running(node_command(rate, python, predict_motion=variant.predicting)) as process:
        operator = Operator(listener)
        listener.first(process, began_ns)
        listener.listen(2.0 * WARM_UP_S)
        overruns, cpu = operator.overruns, cpu_seconds(process.pid)
        began, arrivals, memory = time.monotonic(), [], [0]
        for stretch, gap in _schedule(seconds, variant.changes):
            arrivals += listener.listen(stretch)
            memory.append(tree_kib(process.pid))
            if gap is not None:
                operator.change(gap)
        cpu, spent = cpu_seconds(process.pid) - cpu, time.monotonic() - began
        listener.listen(1.1)
        operator.close()
    periods = deviations(arrivals, rate)
    return {
        'p50_us': quantile(periods, 0.5),
        'p99_us': quantile(periods, 0.99),
        'p999_us': quantile(periods, 0.999),
        'max_us': periods[-1],
        'overruns_per_s': (operator.overruns - overruns) / spent,
        'cpu_percent': 100.0 * cpu / spent,
        'memory_mib': memory[-1] / 1024,
        'most_mib': max(memory) / 1024,
        'latencies': operator.latencies if variant.changes == 1 else [],
    }


def measure_changes(
    listener: Listener, rate: int, seconds: float, rounds: int, beside: str = ''
) -> dict[str, Any]:
    """Measure all variants in turns; `beside` is the Python of another checkout, if any."""
    variants = VARIANTS | (BESIDE if beside else {})
    runs: dict[str, list[dict[str, Any]]] = {name: [] for name in variants}
    for turn in range(rounds):
        for name, variant in variants.items():
            say(f'changes at {rate} Hz, round {turn + 1} of {rounds}: {name}')
            runs[name].append(measure_variant(listener, variant, rate, seconds, beside))
    return {'rate': rate, 'seconds': seconds, 'rounds': rounds, 'variants': runs}


def _ratio(runs: dict[str, list[dict[str, Any]]], name: str, key: str, base: str) -> float:
    pairs = zip(runs[name], runs[base], strict=True)
    return median(a[key] / b[key] for a, b in pairs)


def text_of(results: dict[str, Any]) -> str:
    """Return the results as text."""
    runs = results['variants']
    base = next(iter(runs))
    lines = [
        '',
        f'changes while it runs, {results["rate"]} Hz, {results["seconds"]:g} s each, median of '
        f'{results["rounds"]} rounds in turns',
        f'  {"":30}{"p50":>7}{"p99":>8}{"p99.9":>8}{"max":>8}{"p99 ratio":>11}{"to without":>12}'
        f'{"overruns/s":>12}{"CPU":>8}{"memory":>8}{"most":>8}{"answer after":>20}',
    ]
    for name, rows in runs.items():
        variant = (VARIANTS | BESIDE)[name]
        mid = {key: median(r[key] for r in rows) for key in rows[0] if key != 'latencies'}
        plain = Variant(False, variant.changes)
        without = next(n for n, v in VARIANTS.items() if v == plain)
        late = sorted(1e3 * latency for row in rows for latency in row['latencies'])
        told = f'{median(late):.0f}, {quantile(late, 0.95):.0f} ms' if late else ''
        lines.append(
            f'  {name:30}{mid["p50_us"]:>7.0f}{mid["p99_us"]:>8.0f}{mid["p999_us"]:>8.0f}'
            f'{mid["max_us"]:>8.0f}{_ratio(runs, name, "p99_us", base):>11.2f}'
            f'{_ratio(runs, name, "p99_us", without):>12.2f}{mid["overruns_per_s"]:>12.2f}'
            f'{mid["cpu_percent"]:>6.1f} %{mid["memory_mib"]:>8.0f}{mid["most_mib"]:>8.0f}'
            f'{told:>20}'
        )
    lines += [
        '|period - nominal| in us. p99 ratio: to the first row. to without: to the row with as '
        'many changes and no prediction.',
        'memory: MiB of the node and its processes, at the end and at most. answer after: from '
        'the change to the first document with its motion, median and 95 %.',
    ]
    return '\n'.join(lines)
