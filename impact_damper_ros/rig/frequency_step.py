"""One step of a sweep: the motion goes on at another frequency, from an exact instant on."""

from __future__ import annotations

from .contact import NO_EVENT
from .crossing import sided
from .event import Event, EventKind
from .flight import Flight, end_at
from .mode import Machine
from .origin import Origin, carried
from .report import make_event, quiet

__all__ = ['origin_at_step', 'step_event']


def origin_at_step(machine: Machine, origin: Origin, flight: Flight, instant: float) -> Origin:
    """
    Return the origin of the first flight after a step.

    Parameters
    ----------
    machine : Machine
        The rig before the step.
    origin, flight : Origin, Flight
        The flight with its origin, on which nothing happens up to the step.
    instant : float
        When the frequency changes, s.
    """
    tau = max(0.0, (instant - origin.time) - origin.time_low)
    there = carried(origin, flight, end_at(flight, NO_EVENT, tau))
    return sided(machine.free, origin, flight, there._replace(time=instant, time_low=0.0))


def step_event(origin: Origin) -> Event:
    """Return the event as which a step is reported."""
    return make_event(EventKind.FREQUENCY_STEP, 0, quiet(origin))
