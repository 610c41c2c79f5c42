"""What a long run returns: samples and events as arrays, and how far it came."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from enum import IntEnum
from math import inf
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .event import Event, EventKind, Sample
from .event_rows import MOST_ROWS
from .run_loop import DONE, RUNAWAY, SPENT

__all__ = [
    'EVENT_TYPE',
    'SAMPLE_TYPE',
    'EventTable',
    'Events',
    'Outcome',
    'Stretch',
    'event_table',
]

#: One event, as `Event`, and the mode after it.
EVENT_TYPE = np.dtype(
    [
        ('time', 'f8'),
        ('x', 'f8'),
        ('y', 'f8'),
        ('primary_velocity_before', 'f8'),
        ('primary_velocity_after', 'f8'),
        ('damper_velocity_before', 'f8'),
        ('damper_velocity_after', 'f8'),
        ('impulse', 'f8'),
        ('kind', 'i8'),
        ('stop', 'i8'),
        ('mode', 'i8'),
    ]
)
#: One sample, as `Sample`.
SAMPLE_TYPE = np.dtype([(name, 'f8') for name in Sample._fields])
#: Rows that the table of events begins with.
_ROWS = 512
#: Rows that it may be given beyond its double; memory that nothing is written to takes none.
_MOST_AHEAD = 1_000_000

Events = npt.NDArray[np.void]


class Outcome(IntEnum):
    """How an advance ended."""

    #: The time asked for was reached.
    COMPLETE = DONE
    #: The rig had as many events as it was allowed; it may go on.
    TOO_MANY_EVENTS = SPENT
    #: The rig has events without end at one instant, and cannot go on.
    RUNAWAY = RUNAWAY

    def reason(self, happened: int, since: float, time: float, mode: str) -> str:
        """
        Return why an advance ended before its time, and what helps; empty if it did not.

        Parameters
        ----------
        happened : int
            Events on the way.
        since, time : float
            Where it began and where it ended, s.
        mode : str
            The mode of the rig then.
        """
        if self is Outcome.COMPLETE:
            return ''
        if self is Outcome.TOO_MANY_EVENTS:
            return (
                f'{happened} events from {since!r} s to {time!r} s, the last of them in mode '
                f'{mode}: allow more events, or make the stops less elastic'
            )
        return (
            f'events without end at {time!r} s, in mode {mode}: make the stops less elastic, '
            'or report it with the snapshot if they are not'
        )


class Stretch(NamedTuple):
    """
    What happened in one advance.

    Attributes
    ----------
    outcome : Outcome
        Whether the time asked for was reached.
    reason : str
        If not, why not and what helps; else empty.
    time : float
        Time reached, s.
    samples : ndarray of SAMPLE_TYPE
        Motion at each of the instants asked for, as far as they were reached.
    events : ndarray of EVENT_TYPE
        Events in order; empty if they were not to be recorded.
    event_count : int
        How many times the motion changed, recorded or not; an impact that ends in rest counts
        once.
    time_in_mode : ndarray of float, shape (8,)
        Time spent in each `Mode`, s.
    """

    outcome: Outcome
    reason: str
    time: float
    samples: npt.NDArray[np.void]
    events: Events
    event_count: int
    time_in_mode: npt.NDArray[np.float64]

    def impacts(self, stop: int = 0) -> Events:
        """Return the impacts among the events; those with one stop, if one is given."""
        wanted = self.events['kind'] == EventKind.IMPACT
        if stop:
            wanted &= self.events['stop'] == stop
        if wanted.all():
            return self.events
        # A tenth of the time that an index by booleans takes with rows of this size
        found: Events = self.events.take(np.flatnonzero(wanted))
        return found


def event_table(events: Sequence[Event], modes: Iterable[int]) -> Events:
    """Return events as an array, each with the mode after it."""
    rows = [
        (event.time, *event[3:], event.kind, event.stop, mode)
        for event, mode in zip(events, modes, strict=True)
    ]
    return np.array(rows, EVENT_TYPE)


class EventTable:
    """
    The events of a run while it goes on.

    Parameters
    ----------
    record : bool
        Whether events are kept at all.
    """

    def __init__(self, *, record: bool) -> None:
        self._record = record
        self._table = np.empty(_ROWS if record else 0, EVENT_TYPE)
        self._written = 0

    @property
    def events(self) -> Events:
        """The events so far."""
        return self._table[: self._written]

    def add(self, events: Sequence[Event], mode: int) -> None:
        """Write events, after which the rig is in a mode."""
        if not self._record or not events:
            return
        rows = self._rows(len(events), 0.0)
        rows[: len(events)] = event_table(events, [mode] * len(events))
        self._written += len(events)

    def room(self, done: float) -> Events:
        """
        Return rows to write to, enough for one transition at least; none if nothing is kept.

        Parameters
        ----------
        done : float
            Part of the run that is done, from which the rows for all of it are told.
        """
        return self._rows(MOST_ROWS, done) if self._record else self._table

    def wrote(self, count: int) -> None:
        """Take note of rows that have been written."""
        self._written += count

    def _rows(self, least: int, done: float) -> Events:
        if self._written + least > len(self._table):
            wanted = 1.1 * self._written / done if done > 0.0 else inf
            double = max(2 * len(self._table), self._written + least)
            larger = np.empty(int(min(max(wanted, double), double + _MOST_AHEAD)), EVENT_TYPE)
            larger[: self._written] = self.events
            self._table = larger
        return self._table[self._written :]
