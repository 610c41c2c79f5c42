# SPDX-License-Identifier: Apache-2.0
"""
The score of a controlled run: motion of M, settling time, and energy of the control.

It is compared with two computed runs of the same history, one with a fixed gap, which is that of
the rig or a given one, and one with M alone. No control acts in these, neither on the stops nor on
M.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS
from impact_damper_ros.replay import RecordedRun, Replay, WhatIf
from impact_damper_ros.replay.command import Command
from impact_damper_ros.replay.replay import RunPart
from impact_damper_ros.replay.rows import NO_EVENTS

from .result import Array, Overall
from .stretches import RecordedStretch, Stretches

#: Mass ratio of M alone: so small a mass does not move M.
_ALONE = 1e-9
#: Points of a cycle at which |X| is evaluated, and fewest cycles that show a settling time.
_POINTS, _FEWEST = 48, 8
#: Share of the replay in the work of a score, and share of the first other run in the rest.
_REPLAYED, _FIRST = 0.5, 0.75
#: Share of the final amplitude within which the amplitude has settled.
SETTLED_WITHIN = 0.05


@dataclass(frozen=True)
class Score:
    """Score of a stretch of a run, or of the whole run, with a fixed gap, and of M alone."""

    start: float  # rig time, s
    end: float
    cause: str  # why the stretch begins; empty for a whole run
    control: str  # the law in effect, or 'off'
    #: Time after which the amplitude of X stays within 5 % of its final range, s; None if it still
    #: changes at the end, and for a whole run.
    settling_time: float | None
    run: Overall
    fixed_gap: Overall
    alone: Overall


@dataclass(frozen=True)
class RunScore:
    """The scores of a recorded run."""

    bag: str
    node: str
    gap: float  # the fixed gap of the compared run, m
    stretches: tuple[Score, ...]
    overall: Score
    differences: int  # number of values of the log that differ from the replay
    faults: tuple[str, ...]  # why the bag could be used in part only
    #: Middle of each cycle of the force, s, and largest |X| in it, m: in the run, and with the
    #: fixed gap.
    amplitude: tuple[Array, Array]
    fixed_amplitude: tuple[Array, Array]
    #: Number of the run, and of all runs of the rig in the recording.
    number: int = 1
    run_count: int = 1

    @property
    def exit_code(self) -> int:
        """1 if the log differs from its replay, 3 if the bag is not whole, else 0."""
        return 1 if self.differences else 3 if self.faults else 0

    def as_dict(self) -> dict[str, Any]:
        """Return all but the amplitudes in types of JSON; unknown values are None."""
        found: dict[str, Any] = as_plain(vars(self), without=('amplitude', 'fixed_amplitude'))
        return found


def amplitudes(stretch: RecordedStretch) -> tuple[Array, Array]:
    """Return the middle of each cycle of the force, s, and the largest |X| in it, m."""
    cycle = cycle_of(stretch.parameters)
    flights = stretch.flights
    count = int((stretch.end - float(flights.rows['time'][0])) / cycle) if len(flights) else 0
    if not count:
        return np.empty(0), np.empty(0)
    begin = stretch.end - count * cycle
    time, x, *_ = flights.curve(_POINTS / cycle)
    edges = np.searchsorted(time, begin + cycle * np.arange(count))
    size: Array = np.abs(x)
    largest: Array = np.maximum.reduceat(size, np.minimum(edges, len(x) - 1))
    half = 0.5 * cycle
    return np.linspace(begin + half, stretch.end - half, count), largest


def settling_time(stretch: RecordedStretch) -> float | None:
    """
    Return how long a stretch takes to settle, s; None if its amplitude still changes at its end.

    A motion has settled if its amplitude stays within the range of the second half of the stretch,
    or within 5 % of its mean if that is more. It still changes if the means of the last two
    quarters differ by more than that.
    """
    time, largest = amplitudes(stretch)
    if len(time) < _FEWEST:
        return None
    late = largest[len(largest) // 2 :]
    third, fourth = (float(part.mean()) for part in np.array_split(late, 2))
    level, band = float(late.mean()), SETTLED_WITHIN * float(late.mean())
    if abs(fourth - third) > band:
        return None
    low, high = min(float(late.min()), level - band), max(float(late.max()), level + band)
    far = np.flatnonzero((largest < low) | (largest > high))
    if not len(far):
        return 0.0
    return float(time[far[-1]]) + 0.5 * cycle_of(stretch.parameters) - stretch.start


class _History:
    """The commands of a run, repeated for a rig with other parameters."""

    def __init__(self, start: Command, *, compiled: bool) -> None:
        self._start, self._compiled = start, compiled
        self._parts: list[RunPart] = []
        #: Rig times at which the stretches of the recorded run begin, s
        self.begins: tuple[float, ...] = ()

    def recorded_parts(self, parts: Iterable[RunPart]) -> Iterator[RunPart]:
        """Yield the parts of the recorded run, and keep their commands."""
        for part in parts:
            if len(part.samples) or part.command is not None or part.before:
                # The part ends at its last sample.
                last = part.samples[-1:]
                self._parts.append(RunPart(last, NO_EVENTS, part.command, part.steps, part.before))
            yield part

    def run(self, overrides: Mapping[str, Any]) -> list[RecordedStretch]:
        """Return the stretches of a run with some parameters overridden, or raise RunawayError."""
        other = WhatIf(self._start, {'gap_control': 'off', **overrides}, compiled=self._compiled)
        start, *cuts = self.begins
        stretches = Stretches(other.rig.snapshot(), start=start, cuts=cuts)
        return list(stretches.of(map(other.follow, self._parts)))


def _overall_of(stretches: Sequence[RecordedStretch]) -> Overall:
    return Overall.join([stretch.overall for stretch in stretches])


def score_run(
    recorded: RecordedRun,
    *,
    gap: float | None = None,
    progress: Callable[[float], object] = float,
) -> RunScore:
    """
    Score a recorded run, and the same run with a fixed gap and with M alone.

    Without a given fixed gap, m, the run with a fixed gap has that of the beginning. `progress` is
    called now and then with the share of the work that is done.
    """
    reader = recorded.reader
    span = reader.span or 1.0
    replay = Replay(recorded)
    found = Stretches(replay.start.state, replay.period)
    history = _History(replay.start, compiled=recorded.is_long)
    stretches = []
    for stretch in found.of(history.recorded_parts(replay)):
        progress(_REPLAYED * min(1.0, max(0.0, stretch.end - replay.start.time) / span))
        stretches.append((stretch, settling_time(stretch), amplitudes(stretch)))
    if not stretches:
        raise RecordingError('score', reader.path, 'it holds no motion of the rig')
    findings = replay.findings
    parts = [stretch for stretch, _, _ in stretches]
    history.begins = tuple(stretch.start for stretch in parts)
    rig = parts[0].parameters
    gap = rig.gap if gap is None else gap
    fixed = history.run({'gap': gap})
    progress(_FIRST)
    alone = history.run(
        {
            'damper_mass': _ALONE * rig.primary_mass,
            'friction': 0.0,
            'air_force': 0.0,
            # The gap is the widest one, so that m meets no stop.
            'gap': PARAMETER_SPECS['gap'].high,
        }
    )

    def within(others: Sequence[RecordedStretch], stretch: RecordedStretch) -> Overall:
        """Return the sums of another run from the begin to the end of a stretch."""
        return _overall_of([one for one in others if stretch.start <= one.start < stretch.end])

    scores = tuple(
        Score(
            stretch.start,
            stretch.end,
            stretch.cause,
            str(stretch.control['gap_control']),
            settled,
            stretch.overall,
            within(fixed, stretch),
            within(alone, stretch),
        )
        for stretch, settled, _ in stretches
    )
    laws = ', '.join(dict.fromkeys(score.control for score in scores))
    return RunScore(
        str(reader.path),
        recorded.topics.name,
        gap,
        scores,
        Score(
            *(parts[0].start, parts[-1].end, '', laws, None),
            *(_overall_of(run) for run in (parts, fixed, alone)),
        ),
        findings.difference_count,
        tuple(findings.faults),
        _series([swing for _, _, swing in stretches]),
        _series([amplitudes(stretch) for stretch in fixed]),
        recorded.number,
        recorded.run_count,
    )


def _series(parts: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    times, values = zip(*parts, strict=True)
    return np.concatenate(times), np.concatenate(values)
