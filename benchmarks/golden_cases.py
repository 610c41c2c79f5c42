"""The golden cases, their first impacts from the oracle, and what a run of one is judged by."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from math import inf, pi
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros import EventKind, Rig, RigParameters

sys.path.insert(1, str(Path(__file__).resolve().parents[1] / 'test'))

#: Impacts whose times are compared.
COMPARED_IMPACTS = 30
#: Long enough for the oracle to see them all, s.
_LONGEST_REFERENCE = 1000.0

#: Times and stops of the impacts of a run.
Impacts = tuple[Sequence[float], Sequence[int]]


class Case(NamedTuple):
    """A rig, and its impact phases in steady state at stops 1 and 2, to some digits."""

    name: str
    changes: dict[str, Any]
    phases: tuple[float, float]
    digits: int


CASES = (
    Case('theta=0 r=1 g=0', {'gravity': 0.0}, (0.733784, 0.233784), 6),
    Case(
        'theta=45 g=1 gamma=0 r=1.02',
        {'angle': pi / 4, 'gravity': 1.0, 'force_frequencies': (1.02,)},
        (0.7513744, 0.2632173),
        7,
    ),
    Case(
        'theta=45 g=1 gamma=0.5 r=1.02',
        {'angle': pi / 4, 'gravity': 1.0, 'friction': 0.5, 'force_frequencies': (1.02,)},
        (0.7579950, 0.2697923),
        7,
    ),
)


def run_plain(parameters: RigParameters, end: float) -> Impacts:
    """Run the simulator in plain Python, as the node does."""
    impacts = [e for e in Rig(parameters).advance(end) if e.kind is EventKind.IMPACT]
    return [e.time for e in impacts], [e.stop for e in impacts]


def run_compiled(parameters: RigParameters, end: float) -> Impacts:
    """Run the simulator in compiled code."""
    impacts = Rig(parameters, compiled=True).run(end).impacts()
    return impacts['time'].tolist(), impacts['stop'].tolist()


def reference(case: Case) -> Impacts:
    """Return the first impacts of a case from the oracle, rounded to floats."""
    from oracle.hybrid_oracle import simulate

    impacts: list[Any] = []
    wanted = 2 * COMPARED_IMPACTS
    while len(impacts) < COMPARED_IMPACTS:
        events = simulate(case.changes, _LONGEST_REFERENCE, max_events=wanted)
        impacts = [e for e in events if e.kind == 'impact'][:COMPARED_IMPACTS]
        wanted *= 2
    return [float(e.time) for e in impacts], [e.stop for e in impacts]


def in_order(impacts: Impacts, exact: Impacts) -> int:
    """Return how many of the first impacts are at the right stops."""
    right = [int(a) == b for a, b in zip(impacts[1], exact[1], strict=False)]
    return right.index(False) if False in right else len(right)


def impact_error(impacts: Impacts, exact: Impacts) -> float:
    """Return the largest relative error of the first impact times; infinite if one is missed."""
    if in_order(impacts, exact) < len(exact[1]):
        return inf
    return max(abs(float(t) - e) / e for t, e in zip(impacts[0], exact[0], strict=False))


def steady_phases(impacts: Impacts, period: float) -> tuple[float, ...]:
    """Return the phase of the last impact at each stop."""
    last = dict(zip(impacts[1], impacts[0], strict=True))
    return tuple((last[stop] / period) % 1.0 for stop in (1, 2))


def phase_difference(phases: Sequence[float], others: Sequence[float]) -> float:
    """Return the largest difference of phases, in cycles."""
    return max(abs((a - b + 0.5) % 1.0 - 0.5) for a, b in zip(phases, others, strict=True))
