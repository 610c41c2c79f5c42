# SPDX-License-Identifier: Apache-2.0
"""
The score of a controlled run: how much M moved, how soon it settled, and what the control spent.

Beside it are two runs of the same history, computed by the engine: with the best fixed gap, and
with M alone. In them no control acts, neither on the stops nor on M.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from typing import Any

import numpy as np

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS
from impact_damper_ros.replay import RecordedRun, Replay, WhatIf
from impact_damper_ros.replay.command import Command, Setting
from impact_damper_ros.replay.replay import Part
from impact_damper_ros.replay.rows import NO_EVENTS
from impact_damper_ros.rig.runaway import RunawayError

from .result import Array, Overall
from .stretches import RecordedStretch, Stretches

#: The gaps that are tried, as shares of the gap that would be optimal for M alone, how many of the
#: best are refined by how many tries at most, and the tolerance of that, relative.
_REFINED, _MOST_TRIES = 4, 20
_NARROW, _WIDE, _TOLERANCE = np.geomspace(3e-3, 0.19, 20), np.linspace(0.2, 1.5, 131), 1e-3
#: Restitution that counts at most in that gap: without losses at impacts it would be infinite.
_MOST_RESTITUTION = 0.95
#: M alone: what is left of m does not move it.
_ALONE = 1e-9
#: Cycles of a run from which on compiled code is worth its loading time.
_COMPILED_FROM = 50
#: Points of a cycle at which |X| is looked up, and fewest cycles that show a settling time.
_POINTS, _FEWEST = 48, 8
#: Share of the work of a score that its replay is.
_REPLAYED = 0.1
#: Share of the final amplitude within which it has settled.
SETTLED_WITHIN = 0.05


@dataclass(frozen=True)
class Score:
    """A stretch of a run, or all of it, beside the same with the best fixed gap and M alone."""

    start: float  # rig time, s
    end: float
    cause: str  # why it begins; empty of a whole run
    control: str  # the law in effect, or 'off'
    #: Time after which the amplitude of X stays within 5 % of its final range, s; None if it still
    #: changes at the end, and of a whole run.
    settling_time: float | None
    run: Overall
    fixed_gap: Overall
    alone: Overall


@dataclass(frozen=True)
class RunScore:
    """The scores of a recorded run."""

    bag: str
    node: str
    best_gap: float  # the fixed gap with which the rms of X over the whole run is least, m
    stretches: tuple[Score, ...]
    overall: Score
    differences: int  # numbers of the log that are not those of its replay
    faults: tuple[str, ...]  # why the bag could be used in part only
    #: Middle of each cycle of the force, s, and largest |X| in it, m: of the run, and with the
    #: best fixed gap.
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
        """Return all but the amplitudes in types of JSON; what is not known is None."""
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

    Settled is a motion whose amplitude stays within the range of the second half of the stretch,
    or 5 % of its mean if that is more. It still changes if the means of the last two quarters
    differ by more than that.
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
    """What was done to a rig in a run, done again to it with other parameters."""

    def __init__(self, start: Command) -> None:
        self._start = start
        self._parts: list[Part] = []
        #: Rig times at which the stretches of the recorded run begin, s
        self.begins: tuple[float, ...] = ()
        self.compiled = False

    def recorded(self, parts: Iterable[Part]) -> Iterator[Part]:
        """Yield the parts of the recorded run, and keep what was done in them."""
        for part in parts:
            if len(part.samples) or part.command is not None or part.before:
                # The last sample shows how far the part goes.
                last = part.samples[-1:]
                self._parts.append(Part(last, NO_EVENTS, part.command, part.steps, part.before))
            yield part

    def of_every_gap(self) -> str:
        """Return all that a run with a fixed gap depends on beside the gap, as a text."""

        def text(step: Any) -> str:
            return repr(step.rig.replace(gap=1.0) if isinstance(step, Setting) else step)

        here = WhatIf(self._start, {'gap_control': 'off'})
        begun = self._start.initial if here.from_initial else json.dumps(self._start.state)
        parts = [
            (
                part.samples['time'].tolist(),
                part.command and part.command.time_ns,
                [(time_ns, text(step)) for time_ns, step in part.steps],
            )
            for part in self._parts
        ]
        start = self._start.time_ns, text(Setting.of(self._start.state))
        return repr((begun, start, self.begins, parts))

    def run(self, held: Mapping[str, Any]) -> list[RecordedStretch]:
        """Return the stretches of a run with some parameters held, or raise RunawayError."""
        other = WhatIf(self._start, {'gap_control': 'off', **held}, compiled=self.compiled)
        start, *cuts = self.begins
        stretches = Stretches(other.rig.snapshot(), start=start, cuts=cuts)
        return list(stretches.of(map(other.follow, self._parts)))


def _joined(stretches: Sequence[RecordedStretch]) -> Overall:
    return Overall.joined([stretch.overall for stretch in stretches])


def _best_gap(
    history: _History,
    alone: Overall,
    rig: Any,
    own: set[float],
    known: dict[float, float],
    progress: Callable[[float], object],
) -> float:
    """
    Return the fixed gap with which the rms of X over a history is least, m.

    `known` has the rms over the logarithm of gaps that were tried, and gets what is tried here.

    Over the gap the rms is not smooth: the gaps of the run itself are tried, too, and there may be
    better ones between those that are tried.
    """
    from scipy.optimize import minimize_scalar

    bounce = min(max(rig.restitution_1, rig.restitution_2), _MOST_RESTITUTION)
    share = math.pi * (1.0 + bounce) / ((1.0 - bounce) * (1.0 + rig.mass_ratio))

    tries = count(1)
    most = len(_NARROW) + len(_WIDE) + len(own) + _REFINED * _MOST_TRIES

    def rms(log_gap: float) -> float:
        progress(min(1.0, next(tries) / most))
        if log_gap not in known:
            try:
                known[log_gap] = _joined(history.run({'gap': math.exp(log_gap)})).x_rms
            except RunawayError:
                known[log_gap] = math.inf
        return known[log_gap]

    ideal = math.log(share * alone.x_max)
    tried = ideal + np.log([*_NARROW, *_WIDE])
    found = [rms(log_gap) for log_gap in tried.tolist()]
    gaps = {gap: rms(math.log(gap)) for gap in own}
    for best in np.argsort(found)[:_REFINED].tolist():
        around = tried[max(best - 1, 0)], tried[min(best + 1, len(tried) - 1)]
        refined = minimize_scalar(
            rms,
            bounds=around,
            method='bounded',
            options={'xatol': _TOLERANCE, 'maxiter': _MOST_TRIES},
        )
        gaps |= {math.exp(tried[best]): found[best], math.exp(refined.x): refined.fun}
    return min(gaps, key=lambda gap: gaps[gap])


#: For each history that was scored the rms of X, m, over the logarithm of the gaps tried.
Tried = defaultdict[str, dict[float, float]]


def score_run(
    recorded: RecordedRun,
    *,
    tried: Tried | None = None,
    progress: Callable[[float], object] = float,
) -> RunScore:
    """
    Score a recorded run, beside the same run with the best fixed gap and with M alone.

    `tried` keeps what was tried, for other recordings of the same history. `progress` is called
    now and then with the share of the work that is done.
    """
    reader = recorded.reader
    span = reader.span or 1.0
    replay = Replay(recorded)
    found = Stretches(replay.start.state, replay.period)
    history = _History(replay.start)
    stretches = []
    for stretch in found.of(history.recorded(replay)):
        progress(_REPLAYED * min(1.0, max(0.0, stretch.end - replay.start.time) / span))
        stretches.append((stretch, settling_time(stretch), amplitudes(stretch)))
    if not stretches:
        raise RecordingError('score', reader.path, 'it holds no motion of the rig')
    findings = replay.findings
    parts = [stretch for stretch, _, _ in stretches]
    history.begins = tuple(stretch.start for stretch in parts)
    rig = parts[0].parameters
    alone = history.run(
        {
            'damper_mass': _ALONE * rig.primary_mass,
            'friction': 0.0,
            'air_force': 0.0,
            # As wide as it may be, so that what is left of m meets no stop
            'gap': PARAMETER_SPECS['gap'].high,
        }
    )
    if parts[-1].end - parts[0].start >= _COMPILED_FROM * cycle_of(rig):
        history.compiled = True
    own = {one.parameters.gap for one in parts if one.control['gap_control'] == 'off'}
    gap = rig.gap
    if _joined(alone).x_max:
        gap = _best_gap(
            *(history, _joined(alone), rig, own),
            {} if tried is None else tried[history.of_every_gap()],
            lambda share: progress(_REPLAYED + (1.0 - _REPLAYED) * share),
        )
    fixed = history.run({'gap': gap})

    def within(others: Sequence[RecordedStretch], stretch: RecordedStretch) -> Overall:
        """Return what adds up in another run from the begin to the end of a stretch."""
        return _joined([one for one in others if stretch.start <= one.start < stretch.end])

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
            *(_joined(run) for run in (parts, fixed, alone)),
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
