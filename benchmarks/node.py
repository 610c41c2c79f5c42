"""
CPU share, period jitter, start-up time and memory of `sim_node` against bare rclpy publishers.

Every candidate is a process of its own that publishes joint_states; this one subscribes, in the
same way to all of them, and measures from outside. The candidates take turns within one run.

    python benchmarks/node.py [--quick] [--json FILE]

Periods are those between the source timestamps, which the middleware sets in the publisher's
process when a message is published: the subscriber's own lateness is not in them. Losses are gaps
in the publisher's sequence numbers. CPU time is that of all threads, from /proc/<pid>/stat.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import Any

import rclpy
from node_changes import measure_changes, text_of as changes_text
from node_process import (
    WARM_UP_S,
    Listener,
    bare_command,
    cpu_seconds,
    deviations,
    node_command,
    quantile,
    running,
    say,
)
from node_recording import hour_text, measure_hour, measure_writing, writing_text

RECORDING = 'sim_node, recording'
#: Scheduled as the bare publishers are; the node takes a real-time priority where it is permitted.
ORDINARY = 'sim_node, ordinary'
#: Compared with; the first.
BASE = 'bare, thread'
#: The same without serialising anything.
BYTES = 'bare, bytes'
#: The same again, with the real-time priority that the node takes where it is permitted.
FIRST = 'bare, first in line'
#: A period that is off by more is not within what is asked for.
SHARE_OFF = 0.1
PARTS = ('running', 'start', 'changes', 'writing', 'hour')
PACES = {BASE: 'thread', 'bare, rclpy timer': 'timer', BYTES: 'bytes', FIRST: 'first'}
CANDIDATES = (*PACES, 'sim_node', RECORDING, ORDINARY)


def command(candidate: str, rate: int, bags: Path) -> list[str]:
    """Return what starts a candidate."""
    if candidate in PACES:
        return bare_command(PACES[candidate], rate)
    recording = {'record': True, 'bag_directory': bags} if candidate == RECORDING else {}
    return node_command(rate, real_time_priority=0 if candidate == ORDINARY else 2, **recording)


def measure_running(
    listener: Listener, candidate: str, rate: int, seconds: float, bags: Path
) -> dict[str, Any]:
    """Return how one candidate ran for a while, and by how much each period was off."""
    listener.until_alone()
    began_ns = time.time_ns()
    with running(command(candidate, rate, bags)) as process:
        listener.first(process, began_ns)
        listener.listen(WARM_UP_S)
        cpu, began = cpu_seconds(process.pid), time.monotonic()
        arrivals = listener.listen(seconds)
        cpu, spent = cpu_seconds(process.pid) - cpu, time.monotonic() - began
    if len(arrivals) < 10:
        raise SystemExit(f'{candidate} sent {len(arrivals)} messages in {seconds:g} s')
    periods = deviations(arrivals, rate)
    count = arrivals[-1].number - arrivals[0].number
    return {
        'cpu_percent': 100.0 * cpu / spent,
        'rate': count / ((arrivals[-1].source_ns - arrivals[0].source_ns) * 1e-9),
        'p50_us': quantile(periods, 0.5),
        'p99_us': quantile(periods, 0.99),
        'max_us': periods[-1],
        'off': sum(off > SHARE_OFF * 1e6 / rate for off in periods),
        'periods': len(periods),
        'lost': count + 1 - len(arrivals),
        'deviations': periods,
    }


def pooled(rounds: list[dict[str, Any]]) -> dict[str, float]:
    """Return the quantiles of the periods of all rounds together, and drop the periods."""
    periods = sorted(off for r in rounds for off in r.pop('deviations'))
    return {'all_p50_us': quantile(periods, 0.5), 'all_p99_us': quantile(periods, 0.99)}


def measure_start(listener: Listener, candidate: str, rate: int, bags: Path) -> dict[str, float]:
    """Return the time from the start of a process to its first message here."""
    listener.until_alone()
    began, began_ns = time.monotonic(), time.time_ns()
    with running(command(candidate, rate, bags)) as process:
        first = listener.first(process, began_ns)
        cpu = cpu_seconds(process.pid)
    seconds = first.received_s - began
    # What had been published before the two sides knew of each other was lost on the way.
    unheard = (first.number - 1) / rate
    return {'seconds': seconds, 'discovery_seconds': unheard, 'cpu_seconds': cpu}


def medians(rounds: list[dict[str, Any]]) -> dict[str, float]:
    """Return the median of each quantity."""
    return {key: median(r[key] for r in rounds) for key in rounds[0]}


def against(
    base: str, rounds: dict[str, list[dict[str, float]]], candidate: str, key: str
) -> float:
    """Return the median over the rounds of the ratio to another one in the same round."""
    pairs = zip(rounds[candidate], rounds[base], strict=True)
    return median(a[key] / b[key] if b[key] else float('nan') for a, b in pairs)


def summary(rounds: dict[str, list[dict[str, float]]], keys: tuple[str, ...]) -> dict[str, Any]:
    """Return medians, ratios and the rounds themselves, for each candidate."""
    return {
        name: {
            **medians(rounds[name]),
            'ratios': {key: against(BASE, rounds, name, key) for key in keys},
            'to_bytes': {key: against(BYTES, rounds, name, key) for key in keys},
            'rounds': rounds[name],
        }
        for name in rounds
    }


def running_text(results: dict[str, Any]) -> str:
    """Return as text how the candidates ran."""
    lines = []
    for rate, rows in results['rates'].items():
        lines += [
            '',
            f'{rate} Hz, {results["seconds"]:g} s each, {results["rounds"]} rounds in turns; CPU: '
            'median of the rounds; periods: of all rounds together',
            f'  {"":20}{"CPU":>8}{"ratio":>7}{"to bytes":>10}{"rate":>9}'
            f'{"|period - nominal|: p50":>25}{"p99":>8}{"max":>8}'
            f'{"p99 of a round: least":>23}{"median":>8}{"ratio":>7}'
            f'{f"off by > {SHARE_OFF:.0%}":>21}{"lost":>6}',
        ]
        for name, row in rows.items():
            off, periods = (sum(r[key] for r in row['rounds']) for key in ('off', 'periods'))
            lines.append(
                f'  {name:20}{row["cpu_percent"]:>6.1f} %{row["ratios"]["cpu_percent"]:>7.2f}'
                f'{row["to_bytes"]["cpu_percent"]:>10.2f}'
                f'{row["rate"]:>9.2f}{row["all_p50_us"]:>22.0f} us{row["all_p99_us"]:>8.0f}'
                f'{max(r["max_us"] for r in row["rounds"]):>8.0f}'
                f'{min(r["p99_us"] for r in row["rounds"]):>23.0f}{row["p99_us"]:>8.0f}'
                f'{row["ratios"]["p99_us"]:>7.2f}{f"{off} of {periods}":>21}'
                f'{sum(r["lost"] for r in row["rounds"]):>6.0f}'
            )
    return '\n'.join(lines)


def start_text(results: dict[str, Any]) -> str:
    """Return as text how the candidates started."""
    lines = [
        '',
        f'start-up, {results["rounds"]} rounds in turns: process start to first message',
        f'  {"":20}{"median":>9}{"best":>8}{"worst":>8}{"ratio":>7}{"CPU":>9}'
        f'{"discovery":>12}{"worst":>8}{"worst without":>15}',
    ]
    for name, row in results['candidates'].items():
        waits = [r['seconds'] for r in row['rounds']]
        unheard = [r['discovery_seconds'] for r in row['rounds']]
        own = [a - b for a, b in zip(waits, unheard, strict=True)]
        lines.append(
            f'  {name:20}{row["seconds"]:>7.2f} s{min(waits):>8.2f}{max(waits):>8.2f}'
            f'{row["ratios"]["seconds"]:>7.2f}{row["cpu_seconds"]:>7.2f} s'
            f'{row["discovery_seconds"]:>10.2f} s{max(unheard):>8.2f}{max(own):>13.2f} s'
        )
    lines.append(
        'discovery: publishing already, but not yet known to the subscriber; a part of the above.'
    )
    return '\n'.join(lines)


def measure_rates(
    listener: Listener, rates: list[int], seconds: float, rounds: int, bags: Path
) -> dict[str, Any]:
    """Let all candidates run at all rates, in turns."""
    results: dict[str, Any] = {'seconds': seconds, 'rounds': rounds, 'rates': {}}
    for rate in rates:
        runs: dict[str, list[dict[str, Any]]] = {name: [] for name in CANDIDATES}
        for turn in range(rounds):
            for name in CANDIDATES:
                say(f'{rate} Hz, round {turn + 1} of {rounds}: {name}')
                runs[name].append(measure_running(listener, name, rate, seconds, bags))
        of_all = {name: pooled(rounds) for name, rounds in runs.items()}
        rows = summary(runs, ('cpu_percent', 'p99_us'))
        results['rates'][rate] = {name: {**rows[name], **of_all[name]} for name in rows}
    return results


def measure_starts(listener: Listener, rate: int, rounds: int, bags: Path) -> dict[str, Any]:
    """Start all candidates, in turns."""
    # One bare publisher starts as another does.
    names = [name for name in CANDIDATES if name != FIRST]
    starts: dict[str, list[dict[str, float]]] = {name: [] for name in names}
    for turn in range(rounds):
        say(f'start-up, round {turn + 1} of {rounds}')
        for name in names:
            starts[name].append(measure_start(listener, name, rate, bags))
    return {'rounds': rounds, 'candidates': summary(starts, ('seconds',))}


def measure(arguments: argparse.Namespace, bags: Path) -> tuple[dict[str, Any], list[str]]:
    """Measure what is asked for; return the results, also as text."""
    quick = arguments.quick
    # Rounds rather than seconds: the machine has better and worse moments.
    seconds = arguments.seconds or (3.0 if quick else 6.0)
    rounds = arguments.rounds or (1 if quick else 5)
    results: dict[str, Any] = {'load': os.getloadavg()[0]}
    texts = []
    listener = Listener()
    if 'running' in arguments.only:
        results['running'] = measure_rates(listener, arguments.rates, seconds, rounds, bags)
        texts.append(running_text(results['running']))
    if 'start' in arguments.only:
        starts = arguments.start_rounds or (3 if quick else 7)
        results['start'] = measure_starts(listener, arguments.rates[0], starts, bags)
        texts.append(start_text(results['start']))
    if 'changes' in arguments.only:
        results['changes'] = measure_changes(
            listener, arguments.rates[-1], seconds, rounds, arguments.beside
        )
        texts.append(changes_text(results['changes']))
    if 'writing' in arguments.only:
        rate = arguments.rates[-1]
        results['writing'] = measure_writing(listener, rate, seconds, rounds, bags)
        texts.append(writing_text(results['writing']))
    if 'hour' in arguments.only:
        # Some four minutes at 1 kHz
        rate = arguments.rates[0] if quick else arguments.rates[-1]
        results['hour'] = measure_hour(listener, rate, bags)
        texts.append(hour_text(results['hour']))
    texts.append(
        f'\nratio: to "{BASE}" in the same round, median, unless told otherwise. CPU in per cent '
        'of one core. lost: in all rounds.\n'
        f'load average when this began: {results["load"]:.1f} on {os.cpu_count()} cores.'
    )
    return results, texts


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--quick', action='store_true', help='one short round')
    parser.add_argument('--only', nargs='+', choices=PARTS, default=PARTS, help='these parts')
    parser.add_argument('--seconds', type=float, help='how long each candidate is measured')
    parser.add_argument('--rounds', type=int, help='rounds of all candidates in turns')
    parser.add_argument('--start-rounds', type=int, help='the same for the start-up time')
    parser.add_argument('--rates', type=int, nargs='+', default=[200, 1000], metavar='HZ')
    parser.add_argument(
        '--bags', type=Path, metavar='DIR', help='record there; a temporary directory if not given'
    )
    parser.add_argument(
        '--beside', default='', metavar='PYTHON', help='changes: that of another checkout, too'
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    # A domain of its own, so that no other node on this machine takes part.
    os.environ.setdefault('ROS_DOMAIN_ID', str(30 + os.getpid() % 60))
    rclpy.init()
    with tempfile.TemporaryDirectory(prefix='bench_', dir=arguments.bags) as bags:
        results, texts = measure(arguments, Path(bags))
    rclpy.try_shutdown()
    print('\n'.join(texts))
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
