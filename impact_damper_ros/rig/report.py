"""Reports: the events that a transition of the rig is told as."""

from __future__ import annotations

from .contact import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    STOP_ARRIVED_1,
    STOP_ARRIVED_2,
)
from .event import Event, EventKind
from .mode import CHATTER_1, CHATTER_2, REST_1, REST_2, STICK, Machine
from .origin import Origin, offset_of
from .transition import Transition, impulse_of

__all__ = ['impact_events', 'make_event', 'quiet', 'support_events', 'transition_events']

_RESTING = {REST_1: 1, REST_2: 2}


def quiet(origin: Origin, stop: int = 0) -> Transition:
    """Return a transition that leaves all velocities as they are."""
    velocity, relative_velocity = origin.velocity, origin.relative_velocity
    return Transition(origin, stop, velocity, relative_velocity, velocity, relative_velocity)


def make_event(kind: EventKind, stop: int, transition: Transition, impulse: float = 0.0) -> Event:
    """Return the event of a transition."""
    origin = transition.origin
    before, after = transition.velocity_before, transition.velocity_after
    return Event(
        origin.time,
        kind,
        stop,
        origin.x,
        offset_of(origin.clearance_1, origin.clearance_2, origin.stop_1, origin.stop_2),
        before,
        after,
        before + transition.relative_velocity_before,
        after + transition.relative_velocity_after,
        impulse,
    )


def impact_events(machine: Machine, damper_mass: float, transition: Transition) -> list[Event]:
    """Report an impact, and the rest that a plastic one leads to."""
    stop = transition.stop
    push = impulse_of(machine, damper_mass, transition)
    events = [make_event(EventKind.IMPACT, stop, transition, push)]
    if transition.origin.mode in _RESTING:
        still = transition._replace(
            velocity_before=transition.velocity_after, relative_velocity_before=0.0
        )
        events.append(make_event(EventKind.REST, stop, still))
    return events


def support_events(mode_before: int, transition: Transition) -> list[Event]:
    """Report what a stop that has come up to m at rest, or left it, makes of its rest."""
    mode = transition.origin.mode
    if mode_before >= STICK > mode:
        stop = {CHATTER_1: 1, CHATTER_2: 2, **_RESTING}.get(mode_before, 0)
        return [make_event(EventKind.RELEASE, stop, transition)]
    if mode in _RESTING and (mode_before < STICK or mode_before >= CHATTER_1):
        return [make_event(EventKind.REST, _RESTING[mode], transition)]
    return []


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
        One or two events, or none.
    """
    origin = transition.origin
    mode = origin.mode
    if kind in (CONTACT_1, CONTACT_2):
        speed = before.stop_velocity_1 if kind == CONTACT_1 else before.stop_velocity_2
        if speed == 0.0:
            return impact_events(machine, damper_mass, transition)
        return _meeting_events(machine, damper_mass, before.mode, transition)
    if kind in (STOP_ARRIVED_1, STOP_ARRIVED_2):
        stop = 1 if kind == STOP_ARRIVED_1 else 2
        return [make_event(EventKind.STOP_ARRIVED, stop, transition)]
    if kind == ARRIVAL:
        stop = 1 if origin.clearance_1 == 0.0 else 2
        return [make_event(EventKind.STOP_ARRIVED, stop, transition)]
    if kind in (RELEASE_UP, RELEASE_DOWN):
        return [make_event(EventKind.RELEASE, _RESTING.get(before.mode, 0), transition)]
    # A reversal, or the end of a chatter
    if mode in _RESTING:
        return [make_event(EventKind.REST, _RESTING[mode], transition)]
    if mode == STICK:
        return [make_event(EventKind.STICK, 0, transition)]
    if kind == REVERSAL:
        return [make_event(EventKind.REVERSAL, 0, transition)]
    return []


def _meeting_events(
    machine: Machine, damper_mass: float, mode_before: int, transition: Transition
) -> list[Event]:
    """Report that a moving stop has met m, and the impact if m hit it."""
    stop = transition.stop
    met = transition._replace(
        velocity_after=transition.velocity_before,
        relative_velocity_after=transition.relative_velocity_before,
    )
    events = [make_event(EventKind.STOP_TOUCHED, stop, met)]
    outward = transition.relative_velocity_before * (1.0 if stop == 1 else -1.0)
    if outward > 0.0:
        return events + impact_events(machine, damper_mass, transition)
    return events + support_events(mode_before, transition)
