"""
What every measurement here shares: contenders in turns, the least time, ratios, a table, options.

The contenders take turns, so that the load of the machine falls on all alike. A speed is from the
least time of the rounds; a ratio compares two times of one round, and its median is shown.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import median
from time import thread_time
from typing import Any

from impact_damper_ros.report.table import Table

#: A contender is called again within one timing until it has taken this long, s.
_SHORTEST_TIMING = 0.05


def say(text: str) -> None:
    """Report progress, apart from the results."""
    print(text, file=sys.stderr, flush=True)


def seconds_of(call: Callable[[], object], clock: Callable[[], float] = thread_time) -> float:
    """Return what one call takes by a clock, s; the CPU time of the thread if no other."""
    calls, began = 0, clock()
    while True:
        call()
        calls += 1
        spent = clock() - began
        if spent >= _SHORTEST_TIMING:
            return spent / calls


def in_turns(
    calls: Mapping[str, Callable[[], object]],
    rounds: int,
    label: str = '',
    clock: Callable[[], float] = thread_time,
) -> dict[str, list[float]]:
    """Return what each call takes in each round, s."""
    times: dict[str, list[float]] = {name: [] for name in calls}
    for turn in range(rounds):
        say(f'{label}: round {turn + 1} of {rounds}' if label else f'round {turn + 1} of {rounds}')
        for name, call in calls.items():
            times[name].append(seconds_of(call, clock))
    return times


def ratio(times: Sequence[float], others: Sequence[float]) -> float:
    """Return how many times as long the others take: the median over the rounds."""
    return median(other / own for own, other in zip(times, others, strict=True))


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in aligned columns, the numbers to the right."""
    return Table.of_rows(head, list(rows)).text()


def options(doc: str, rounds: int) -> argparse.ArgumentParser:
    """Return the parser of a benchmark, with what all of them take."""
    parser = argparse.ArgumentParser(description=doc.split('\n\n')[0].strip())
    parser.add_argument('--rounds', type=int, default=rounds, help=f'rounds in turns [{rounds}]')
    parser.add_argument(
        '--quick',
        action='store_const',
        dest='rounds',
        const=max(1, rounds // 3),
        help='a third of the rounds',
    )
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    return parser


def write_results(path: Path | None, results: Mapping[str, Any]) -> None:
    """Write the results to the file of --json, if one is given."""
    if path is not None:
        path.write_text(json.dumps(results, indent=2) + '\n', encoding='utf-8')
