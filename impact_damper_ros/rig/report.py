"""Events, made of the rows that `event_rows` writes; its kernels run as plain Python here."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

from .event import Event, EventKind
from .event_codes import CONTACT_1, CONTACT_2
from .event_rows import MOST_ROWS, stop_under, support_code, write_event, write_transition
from .mode import Machine
from .origin import Origin
from .transition import Transition

__all__ = ['impact_events', 'make_event', 'quiet', 'support_events', 'transition_events']

# The table that the kernels write into, by row and column: floats and codes together
_Table = dict[tuple[int, int], Any]
# The fields of `Event` in a row
_ROWS = [
    itemgetter(*[(row, column) for column in (0, 8, 9, 1, 2, 3, 4, 5, 6, 7)])
    for row in range(MOST_ROWS)
]
_KINDS = {int(kind): kind for kind in EventKind}


def _event(table: _Table, row: int) -> Event:
    """Return a row of the table as an event."""
    time, kind, *others = _ROWS[row](table)
    return Event(time, _KINDS[kind], *others)


def quiet(origin: Origin, stop: int = 0) -> Transition:
    """Return a transition that leaves all velocities as they are."""
    velocity, relative_velocity = origin.velocity, origin.relative_velocity
    return Transition(origin, stop, velocity, relative_velocity, velocity, relative_velocity)


def make_event(kind: EventKind, stop: int, transition: Transition) -> Event:
    """Return an event without impulse, of a transition."""
    table: _Table = {}
    before, after = transition.velocity_before, transition.velocity_after
    write_event(
        table,
        table,
        0,
        kind,
        stop,
        transition.origin,
        before,
        after,
        before + transition.relative_velocity_before,
        after + transition.relative_velocity_after,
        0.0,
    )
    return _event(table, 0)


def impact_events(machine: Machine, damper_mass: float, transition: Transition) -> list[Event]:
    """Report an impact on a standing stop, and the rest that a plastic one leads to."""
    standing = transition.origin._replace(stop_velocity_1=0.0, stop_velocity_2=0.0)
    kind = CONTACT_1 if transition.stop == 1 else CONTACT_2
    return transition_events(machine, damper_mass, kind, standing, transition)


def support_events(mode_before: int, transition: Transition) -> list[Event]:
    """Report what a stop that has come up to m at rest, or left it, makes of its rest."""
    mode = transition.origin.mode
    code = support_code(mode_before, mode)
    if code == 0:
        return []
    kind = EventKind(code)
    rested = mode if kind is EventKind.REST else mode_before
    return [make_event(kind, stop_under(rested), transition)]


def transition_events(
    machine: Machine, damper_mass: float, kind: int, before: Origin, transition: Transition
) -> list[Event]:
    """
    Report the event that ended a flight.

    Parameters
    ----------
    machine : Machine
        The rig.
    damper_mass : float
        Its loose mass, kg.
    kind : int
        The event, as `contact.first_event` names it.
    before : Origin
        Origin of the flight that it ended.
    transition : Transition
        What it did.

    Returns
    -------
    list of Event
        None to three of them.
    """
    table: _Table = {}
    rows = write_transition(machine, damper_mass, kind, before, transition, table, table, 0)
    return [_event(table, row) for row in range(rows)]
