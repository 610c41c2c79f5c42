"""
Stepped sine: the frequency of the first harmonic goes through a range, step by step.

Its phase is continuous, as a signal generator's. The steps are at exact instants, counted from the
start of the sweep, so that a long one does not drift. With fine steps it is a swept sine.
"""

from __future__ import annotations

from math import ceil, inf
from typing import NamedTuple

from .contact import NO_EVENT
from .crossing import sided
from .event import Event, EventKind
from .event_rows import make_event, quiet
from .flight import Flight, end_at
from .mode import RigConstants
from .origin import Origin, carried
from .parameters import RigParameters

__all__ = [
    'SWEEP_FIELDS',
    'Sweep',
    'frequency_at',
    'frequency_steps',
    'origin_at_step',
    'step_event',
]


#: A change of one of these starts the sweep anew.
SWEEP_FIELDS = ('sweep_mode', 'sweep_low', 'sweep_high', 'sweep_step', 'sweep_dwell')
# A range this little longer than a whole number of steps ends with the last of them.
_WHOLE = 1e-9


def frequency_steps(parameters: RigParameters) -> int:
    """Return the number of steps of a whole sweep; 0 if there is none."""
    if parameters.sweep_mode == 'off':
        return 0
    way = (parameters.sweep_high - parameters.sweep_low) / parameters.sweep_step
    once = max(1, ceil(way - _WHOLE))
    return 2 * once if parameters.sweep_mode == 'up_down' else once


def frequency_at(parameters: RigParameters, step: int) -> float:
    """
    Return the frequency of the first harmonic after a number of steps of the sweep, rad/s.

    Up and down go through the same frequencies: from the low end on in whole steps, and the high
    end, to which the last step may be a shorter one.
    """
    steps = frequency_steps(parameters)
    if not steps:
        return parameters.force_frequencies[0]
    once = steps // 2 if parameters.sweep_mode == 'up_down' else steps
    place = min(max(step, 0), steps)
    if parameters.sweep_mode == 'down':
        place = steps - place
    elif place > once:
        place = 2 * once - place
    if place == once:
        return parameters.sweep_high
    return parameters.sweep_low + place * parameters.sweep_step


class Sweep(NamedTuple):
    """
    How far a sweep has come.

    Attributes
    ----------
    start : float
        When it was started, s.
    step : int
        Steps done.
    """

    start: float
    step: int = 0

    @classmethod
    def begun(cls, parameters: RigParameters, time: float) -> Sweep:
        """Return a sweep that starts at a time; one that is off has begun at none."""
        return cls(0.0 if parameters.sweep_mode == 'off' else time)

    def due(self, parameters: RigParameters) -> float:
        """Return the instant of the next step, s; infinity after the last one."""
        if self.step >= frequency_steps(parameters):
            return inf
        return self.start + (self.step + 1) * parameters.sweep_dwell


def origin_at_step(rig: RigConstants, origin: Origin, flight: Flight, instant: float) -> Origin:
    """Return the origin of the first flight after a step."""
    tau = max(0.0, (instant - origin.time) - origin.time_low)
    there = carried(origin, flight, end_at(flight, NO_EVENT, tau))
    return sided(rig.free, origin, flight, there._replace(time=instant, time_low=0.0))


def step_event(origin: Origin) -> Event:
    """Return the event as which a step is reported."""
    return make_event(EventKind.FREQUENCY_STEP, 0, quiet(origin))
