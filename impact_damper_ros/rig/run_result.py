# SPDX-License-Identifier: Apache-2.0
"""The result of a run: how it ended, its events and samples, and the tables that grow in it."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum
from math import inf
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from impact_damper_ros.motion.event import (
    EVENT_TYPE,
    ROWS_AT_ONCE,
    Event,
    EventKind,
    EventRow,
    events_of,
    events_of_table,
    table_of_events,
)
from impact_damper_ros.motion.next_event import DONE, RUNAWAY, SPENT
from impact_damper_ros.motion.records import dtype_of
from impact_damper_ros.parameters.quoting import plural

from .runaway import REMEDY

#: Initial rows of the table of a run; rows in 4 MB; most rows by which a table grows at once.
FIRST_ROWS = 4096
_LARGE = 2**22 // EVENT_TYPE.itemsize + 1
_MOST_AHEAD = 1_000_000
Events = npt.NDArray[np.void]
_BYTES = np.dtype((np.void, EVENT_TYPE.itemsize))
_row_fields = attrgetter(*EventRow.__dataclass_fields__)
_NO_ROWS = np.empty(0, dtype_of(EventRow))


def one_table(*tables: Events) -> Events:
    """Return the rows of tables one after another; numpy alone copies field by field."""
    rows: Events = np.concatenate([table.view(_BYTES) for table in tables]).view(EVENT_TYPE)
    return rows


def rows_where(chosen: npt.NDArray[np.bool_], table: Events) -> Events:
    """Return some rows of a table, ten times as fast as an index by booleans."""
    rows: Events = table.take(np.flatnonzero(chosen))
    return rows


class Outcome(IntEnum):
    """
    How a run ended.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> Rig(RigParameters(gravity=0.0)).run(60.0, most_events=3).outcome.name
    'TOO_MANY_EVENTS'
    """

    #: The requested time was reached.
    COMPLETE = DONE
    #: The most events were reached; the rig may go on.
    TOO_MANY_EVENTS = SPENT
    #: More events than allowed happened in one period of the fastest of spring and force.
    RUNAWAY = RUNAWAY

    def reason(self, happened: int, since: float, time: float, mode: str) -> str:
        """Return why a run ended before its time, and the remedy."""
        if self is Outcome.TOO_MANY_EVENTS:
            return (
                f'{happened} events from {since!r} s to {time!r} s, the last of them in mode '
                f'{mode}: allow more events, or make the stops less elastic'
            )
        return (
            f'the rig had {happened} events from {since:.9g} s to {time:.9g} s, the last in mode '
            f'{mode}: {REMEDY}'
        )


class RunResult(NamedTuple):
    """
    Result of a run.

    Attributes
    ----------
    outcome : Outcome
        Whether the requested time was reached.
    reason : str
        If not, why, and the remedy; else empty.
    time : float
        Time reached, s.
    samples : ndarray of SAMPLE_TYPE
        Motion at each of the requested instants that were reached.
    events : ndarray of EVENT_TYPE
        Events in order; empty if they were not recorded.
    event_count : int
        Number of transitions, recorded or not; an impact that ends in rest is one.
    time_in_mode : ndarray of float, shape (8,)
        Time spent in each `Mode`, s.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> result = Rig(RigParameters(gravity=0.0)).run(60.0, instants=[0.0, 30.0, 60.0])
    >>> result.outcome.name, len(result.impacts()), round(float(result.samples['x'][1]), 6)
    ('COMPLETE', 7, -2.605725)
    """

    outcome: Outcome
    reason: str
    time: float
    samples: npt.NDArray[np.void]
    events: Events
    event_count: int
    time_in_mode: npt.NDArray[np.float64]

    def __repr__(self) -> str:
        """Return a summary in one line."""
        reached = 'complete' if not self.reason else self.reason
        return (
            f'<RunResult: {reached} at {self.time:.9g} s, {plural(len(self.samples), "sample")}, '
            f'{plural(self.event_count, "event")}>'
        )

    def impacts(self, stop: int = 0) -> Events:
        """Return the impacts among the events; those with one stop, if one is given."""
        chosen = self.events['kind'] == EventKind.IMPACT
        if stop:
            chosen &= self.events['stop'] == stop
        return self.events if chosen.all() else rows_where(chosen, self.events)


class RunTables:
    """
    The events, and the acts of the control, of a run from `since` to `end`, s, if `keep`.

    With `listed` the events, written by plain kernels, are kept as a list.
    """

    def __init__(self, *, keep: bool, since: float, end: float, listed: bool = False) -> None:
        self.keep, self._since, self._end = keep, since, end
        self._rows: Any = _NO_ROWS
        self._written = 0
        self._list: list[Event] | None = [] if listed else None
        #: The acts so far, as rows
        self.acts: list[tuple[Any, ...]] = []

    @property
    def events(self) -> Events:
        """The events so far."""
        events: Events = self._rows[: self._written].view(EVENT_TYPE)
        return events

    def event_list(self) -> list[Event]:
        """Return the events so far as a list."""
        if self._list is not None:
            return self._list
        return events_of_table(self._rows[: self._written]) if self._written else []

    def add(self, *events: Event) -> None:
        """Add events."""
        if self._list is not None:
            self._list += events
        elif self.keep and events:
            self.room(events[-1].time, len(events))[: len(events)] = table_of_events(events)
            self._written += len(events)

    def take(self, rows: Sequence[EventRow], count: int) -> None:
        """Add the first rows of another table."""
        if self._list is not None:
            self._list += events_of(rows, count)
        elif self.keep and count:
            self.room(rows[count - 1].time, count)[:count] = list(map(_row_fields, rows[:count]))
            self._written += count

    def wrote(self, count: int) -> None:
        """Count rows that have been written into the room."""
        self._written += count if self.keep else 0

    def take_acts(self, acts: list[tuple[Any, ...]]) -> None:
        """Add acts; the last one of the previous table may be repeated as the first one."""
        self.acts += acts[self.acts[-1:] == acts[:1] :]

    def room(self, now: float, least: int = ROWS_AT_ONCE) -> Any:
        """Return the free rows, some at least."""
        if self.keep and self._written + least > len(self._rows):
            done = now - self._since
            wanted = 1.1 * self._written * (self._end - self._since) / done if done > 0.0 else inf
            double = max(2 * len(self._rows), self._written + least, FIRST_ROWS)
            size = int(min(max(wanted if self._written else 0.0, double), double + _MOST_AHEAD))
            # numpy asks for large pages from 4 MB on; small ones cost as much as the run.
            if size > _LARGE // 8:
                size = max(size, _LARGE)
            larger = np.empty(size, dtype_of(EventRow))
            larger[: self._written] = self._rows[: self._written]
            self._rows = larger
        return self._rows[self._written :]
