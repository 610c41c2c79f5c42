"""
A stretch of a run as it is read, part by part: checked at once, and kept as far as it is needed.

Memory stays bounded: of the joint states the last ones are kept, of very many impacts the first
and the last ones; the check of the flights, the envelope of X and the numbers over the whole
stretch have seen all of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from impact_damper_ros.rig import RigParameters

from .fault_search import FaultSearch
from .flight_check import knots_of
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, RecordedStretch
from .run_comparison import Beginning
from .run_curves import Array, SwingEnvelope
from .stretch_totals import StretchTotals

__all__ = ['StretchMeter']


_MOST_STATES = 200_000
_FIRST_IMPACTS, _LAST_IMPACTS = 100_000, 200_000
_MOST_PIECES = 2000
_MOST_GAPS = 1000
_WIDE = 1.5
_LEARNT_FROM = 20
#: Harmonics of the force, times intervals, that are checked: those of a long multisine in part.
_MOST_LINES = 30_000_000


class _Envelope:
    """Least and greatest X in consecutive pieces, merged by twos as they become too many."""

    def __init__(self) -> None:
        self._size = 1
        self._time, self._low, self._high = (np.empty(0) for _ in range(3))
        self._rest: list[tuple[Array, Array]] = []
        self._waiting = 0

    def take(self, time: Array, x: Array) -> None:
        self._rest.append((time, x))
        self._waiting += len(time)
        if self._waiting >= self._size:
            self._put(self._waiting // self._size * self._size)

    def _put(self, count: int) -> None:
        time = np.concatenate([t for t, _ in self._rest])
        x = np.concatenate([x for _, x in self._rest])
        self._rest = [(time[count:], x[count:])]
        self._waiting = len(time) - count
        starts = np.arange(0, count, self._size)
        self._time = np.concatenate([self._time, time[starts]])
        self._low = np.concatenate([self._low, np.minimum.reduceat(x[:count], starts)])
        self._high = np.concatenate([self._high, np.maximum.reduceat(x[:count], starts)])
        while len(self._time) > _MOST_PIECES:
            starts = np.arange(0, len(self._time), 2)
            self._time = self._time[starts]
            self._low = np.minimum.reduceat(self._low, starts)
            self._high = np.maximum.reduceat(self._high, starts)
            self._size *= 2

    def finish(self) -> SwingEnvelope:
        if self._waiting:
            self._put(self._waiting)
        return SwingEnvelope(self._time, self._low, self._high)


class StretchMeter:
    """
    Takes what was recorded of one stretch.

    Parameters
    ----------
    number : int
        Counted from 1.
    begins, cause : Beginning, str
        Why the stretch begins, and the same in words.
    start : float
        Rig time, s.
    parameters : RigParameters
        As logged.
    control : mapping of str to value
        Gap-control parameters as logged.
    clock : ForceClock or None
        The force; None if its phase is not known, or its frequency not constant.
    last_stop : int
        Stop hit last before the stretch; 0 for none.
    state_period : float
        Time from one joint state to the next, s; 0 if not known, and to be learnt.
    lossy : bool, optional
        Whether the recorder may have lost messages one by one, unnoticed.
    stops_move : bool, optional
        Whether stops are on their way, moved by a control or back from there.
    checks : bool, optional
        Whether to check the flights against the equations of motion.

    Attributes
    ----------
    search : FaultSearch or None
        What was checked, and found to be wrong; None if nothing was checked.
    last_stop : int
        Stop hit last so far.
    """

    def __init__(
        self,
        number: int,
        begins: Beginning,
        cause: str,
        start: float,
        parameters: RigParameters,
        control: Mapping[str, Any],
        clock: ForceClock | None,
        last_stop: int,
        state_period: float,
        *,
        lossy: bool = False,
        stops_move: bool = False,
        checks: bool = True,
    ) -> None:
        self.search = None
        if clock is not None and checks:
            unfollowed = stops_move or parameters.multisine_level > 0.0
            self.search = FaultSearch(clock, in_closed_form=unfollowed)
        self._lines = len(parameters.harmonics[0])
        self.last_stop = self._stop_before = last_stop
        self.parameters = parameters
        self.clock = clock
        self._head = (number, begins, cause, start, dict(control))
        self._end = start
        self._states: list[RecordedStates] = []
        self._impacts: list[RecordedImpacts] = []
        self._first_impacts: list[RecordedImpacts] = []
        self._kept = self._kept_impacts = self._kept_first = 0
        self._state_count = self._impact_count = self._missing = 0
        self._state_period, self._lossy = state_period, lossy
        self._last_state: float | None = None
        self._gaps: list[tuple[float, float]] = []
        self._envelope = _Envelope()
        self._totals = StretchTotals(parameters, clock)

    @property
    def empty(self) -> bool:
        """Whether nothing was taken so far."""
        return not self._state_count and not self._impact_count

    def take(
        self, states: RecordedStates, impacts: RecordedImpacts, *, final: bool = False
    ) -> None:
        """Take the next part."""
        knots = knots_of(self.parameters, states, impacts, self.last_stop)
        if self.search is not None and self.search.intervals * self._lines <= _MOST_LINES:
            self.search.look(knots, final=final)
        if len(impacts):
            self.last_stop = int(impacts.stop[-1])
        self._state_count += len(states)
        self._impact_count += len(impacts)
        self._look_for_gaps(states.time)
        self._totals.take(knots, impacts, _WIDE * self._state_period or math.inf)
        self._envelope.take(states.time, states.x)
        ends = [float(part.time[-1]) for part in (states, impacts) if len(part)]
        self._end = max([self._end, *ends])
        self._keep(states, impacts)

    def _look_for_gaps(self, time: Array) -> None:
        if not self._state_period and len(time) >= _LEARNT_FROM:
            self._state_period = float(np.median(np.diff(time)))
        if self._last_state is not None:
            time = np.concatenate([[self._last_state], time])
        if not self._state_period or not len(time):
            return
        self._last_state = float(time[-1])
        steps = np.diff(time)
        wide = np.flatnonzero(steps > _WIDE * self._state_period)
        self._missing += int((np.round(steps[wide] / self._state_period) - 1).sum())
        for index in wide[: _MOST_GAPS - len(self._gaps)]:
            self._gaps.append((float(time[index]), float(time[index + 1])))

    def _keep(self, states: RecordedStates, impacts: RecordedImpacts) -> None:
        self._states.append(states)
        self._kept += len(states)
        while self._kept - len(self._states[0]) >= _MOST_STATES:
            self._kept -= len(self._states.pop(0))
        if self._kept_first < _FIRST_IMPACTS:
            self._first_impacts.append(impacts)
            self._kept_first += len(impacts)
            return
        self._impacts.append(impacts)
        self._kept_impacts += len(impacts)
        while self._kept_impacts - len(self._impacts[0]) >= _LAST_IMPACTS:
            self._kept_impacts -= len(self._impacts.pop(0))

    def finish(self, end: float | None = None) -> RecordedStretch:
        """Return the stretch."""
        number, begins, cause, start, control = self._head
        impacts = RecordedImpacts.joined([*self._first_impacts, *self._impacts])
        left_out = self._impact_count - len(impacts)
        end = self._end if end is None else end
        return RecordedStretch(
            number=number,
            start=start,
            end=end,
            begins=begins,
            cause=cause,
            parameters=self.parameters,
            control=control,
            clock=self.clock,
            states=RecordedStates.joined(self._states),
            impacts=impacts,
            last_stop=self._stop_before,
            skipped=self._kept_first if left_out else 0,
            state_count=self._state_count,
            impact_count=self._impact_count,
            missing_states=self._missing,
            lossy=self._lossy,
            gaps=tuple(self._gaps),
            envelope=self._envelope.finish(),
            overall=self._totals.finish(end - start),
        )
