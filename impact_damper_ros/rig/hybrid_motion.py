"""
The hybrid motion of a live rig: the run loop as plain Python, with events one by one.

A rig that runs in real time may be interrupted at any event and within a long search, and sampled
ahead of the present time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import ceil, inf, ulp
from typing import Any, ClassVar

from .arguments import as_float
from .contact import ALL_STEPS, flight_end
from .crossing import sided
from .event import MOST_TOGETHER, Event, EventKind, EventRows, Sample, make_event
from .flight import NO_EVENT, Flight, end_at
from .forcing import SteppedSine, frequency_at
from .mode import Mode, RigConstants, rig_constants
from .origin import Origin, advance_time, carried, stop_rates
from .parameters import RigParameters
from .quoting import shown
from .run_loop import (
    DONE,
    FULL,
    MOST_AT_ONCE,
    PAUSED,
    RUNAWAY,
    SPENT,
    go_on,
    open_flight,
    started,
    state_at,
    write_sample,
)
from .state_checks import LATEST

#: Steps of a search between two calls of `interrupted`; few flights take more.
_STEPS_AT_A_STRETCH = 8
#: From this number of harmonics on, a sample takes long.
_MANY_HARMONICS = 32
#: Events between two looks at the table of them, in which there is room for more.
_EVENTS_AT_A_STRETCH = 64
_REMEDY = 'give a wider gap, a restitution below 1, or a slower start'


class RunawayError(RuntimeError):
    """A rig has events without end at one instant; it cannot go on."""

    def __init__(self, count: int, time: float) -> None:
        super().__init__(
            f'the rig has more than {count} events at once, at {time:.15g} s, and cannot be '
            f'followed any further: {_REMEDY}'
        )


def number_of_events(most_events: float) -> float:
    """Return a number of events, rounded up, or infinity; or raise a ValueError."""
    number = as_float(most_events)
    if not number >= 0.0:
        raise ValueError(
            f'most_events is {shown(most_events)}: give a number from 0 on, infinity for no limit'
        )
    return number if number == inf else ceil(number)


def starting_time(time: float) -> float:
    """Return the time at which a rig starts, s; or raise a ValueError."""
    start = as_float(time)
    if not -LATEST <= start <= LATEST:
        raise ValueError(
            f'the rig cannot start at {shown(time)} s: give a number from {-LATEST:g} to '
            f'{LATEST:g} s'
        )
    return start


def later_time(time: float, now: float) -> float:
    """Return a time to which a rig can run, s; or raise a ValueError."""
    end = as_float(time)
    if not now <= end < inf:
        raise ValueError(
            f'cannot advance to {shown(time)} s: give a finite time not before {now!r} s'
        )
    if end > LATEST:
        raise ValueError(f'cannot advance to {end!r} s: give a time up to {LATEST:g} s')
    return end


def origin_at_step(rig: RigConstants, origin: Origin, flight: Flight, instant: float) -> Origin:
    """Return the origin of the first flight after a step."""
    tau = max(0.0, (instant - origin.time) - origin.time_low)
    there = carried(origin, flight, end_at(flight, NO_EVENT, tau))
    return sided(rig.free, origin, flight, there._replace(time=instant, time_low=0.0))


def step_event(origin: Origin) -> Event:
    """Return the event as which a step is reported."""
    return make_event(EventKind.FREQUENCY_STEP, 0, origin)


class HybridMotion:
    """
    The motion of one rig between changes of its parameters and stops.

    A subclass sets the rig up and changes it between two advances.
    """

    _parameters: RigParameters
    _constants: RigConstants
    _time: float
    _unreported: list[Event]
    _sweep: SteppedSine
    _step_due: float
    #: Account of the modes; long runs have one that is read.
    _in_mode: ClassVar = [0.0] * len(Mode)

    def snapshot(self) -> dict[str, Any]:
        """Return all that the rig's future depends on."""
        raise NotImplementedError

    def _begin(self, origin: Origin) -> None:
        """Begin the flight of an origin."""
        self._here = open_flight(self._constants, origin, self._time)

    def _begin_all(self, origin: Origin) -> list[Event]:
        """Begin from a state of unknown mode, with the impact of m that moves into its stop."""
        rows = EventRows()
        mass = self._parameters.damper_mass
        origin, written = started(self._constants, mass, origin, rows, rows, 0)
        self._begin(origin)
        return rows.events(written)

    @property
    def _origin(self) -> Origin:
        return self._here.origin

    @property
    def _flight(self) -> Flight:
        return self._here.flight

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._time

    @property
    def parameters(self) -> RigParameters:
        """The rig's present parameters."""
        return self._parameters

    @property
    def mode(self) -> Mode:
        """Present mode, after any event at the present time."""
        return Mode(self._origin.mode)

    @property
    def force_frequency(self) -> float:
        """Present circular frequency of the first harmonic, rad/s; a sweep changes it."""
        return self._constants.free.harmonics[0].frequency

    @property
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        present = self._present()
        return present.stop_1, present.stop_2

    @property
    def stop_velocities(self) -> tuple[float, float]:
        """Present velocities of stop 1 and stop 2 relative to M, m/s."""
        return stop_rates(self._origin, self._flight, self._present().relative_velocity)

    def _present(self) -> Origin:
        """Return the present state as an origin, without making it one."""
        return state_at(self._here, self._time)

    def mark(self) -> dict[str, Any]:
        """Return a mark for `go_back`; far cheaper than a snapshot."""
        state = self.__dict__.copy()
        # All the rest of it is immutable.
        state['_unreported'] = self._unreported.copy()
        return state

    def go_back(self, mark: dict[str, Any]) -> None:
        """Undo all that `advance` did since a mark; each may be used once."""
        self.__dict__.update(mark)

    def advance(
        self,
        time: float,
        most_events: float = inf,
        interrupted: Callable[[], bool] | None = None,
    ) -> list[Event]:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.
        most_events : float, optional
            After so many events (rounded up) the rig stops, at an event, if more are due before
            that time; it may go on from there.
        interrupted : callable, optional
            Called now and then; once it returns true, the rig stops.

        Returns
        -------
        list of Event
            All events after the present time up to and including the new one.

        Raises
        ------
        ValueError
            If the time is before the present one or after 1e13 s, or the number of events is
            negative or NaN.
        RunawayError
            If the rig has events without end at one instant; `go_back` undoes the advance.
        """
        return self._run(time, most_events, interrupted, watch=False)

    def advance_to_crossing(
        self,
        time: float,
        most_events: float = inf,
        interrupted: Callable[[], bool] | None = None,
    ) -> list[Event]:
        """
        Let the rig run until X passes through zero, or to a later time; as `advance` otherwise.

        Notes
        -----
        The motion is that of `advance`, to the last bit. X has to change its sign: a touch of
        zero, or an excursion beyond it within round-off, is no passage; neither is a change of
        parameters that moves the static equilibrium, from which X is measured.
        """
        return self._run(time, most_events, interrupted, watch=True)

    def _run(
        self,
        time: float,
        most_events: float,
        interrupted: Callable[[], bool] | None,
        *,
        watch: bool,
    ) -> list[Event]:
        """Advance to a time, or to the first passage of X through zero."""
        time = later_time(time, self._time)
        most_events = number_of_events(most_events)
        events, self._unreported = self._unreported, []
        while True:
            most = int(min(_EVENTS_AT_A_STRETCH, most_events - len(events)))
            steps = ALL_STEPS if interrupted is None else _STEPS_AT_A_STRETCH
            status, new = self._go(time, most, steps, watch=watch)
            events += new
            if status == RUNAWAY:
                raise RunawayError(MOST_AT_ONCE, self._here.instant)
            if status == PAUSED:
                assert interrupted is not None
                if self._time == time:
                    # All events of an instant that has been reached belong to it.
                    interrupted = None
                elif interrupted():
                    return events
            elif status in (SPENT, FULL) and len(events) < most_events:
                continue
            elif status != DONE or self._step_due > time or len(events) >= most_events:
                return events
            else:
                events += self._step_frequency()

    def _go(self, time: float, most: int, steps: int, *, watch: bool) -> tuple[int, list[Event]]:
        """Run to a time or the next step of the frequency; return the status and events."""
        rows, until = EventRows(), min(time, self._step_due)
        status, self._time, self._here, written, _ = go_on(
            self._constants,
            self._parameters.damper_mass,
            self._here,
            self._time,
            until,
            until,
            watch,
            most,
            steps,
            rows,
            rows,
            MOST_TOGETHER,
            0,
            self._in_mode,
        )
        return status, rows.events(written)

    def _step_frequency(self) -> list[Event]:
        """Go on to the next frequency of the stepped sine, at an exact instant."""
        there = origin_at_step(self._constants, self._origin, self._flight, self._step_due)
        self._sweep = SteppedSine(self._sweep.start, self._sweep.step + 1)
        self._step_due = self._sweep.due(self._parameters)
        frequency = frequency_at(self._parameters, self._sweep.step)
        self._constants = rig_constants(self._parameters, frequency)
        self._begin(there)
        return [step_event(there)]

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        return self._sample_at(self._time)

    def preview(
        self, times: Sequence[float], interrupted: Callable[[], bool] | None = None
    ) -> list[Sample]:
        """Return the motion at those of the later instants that the present flight reaches."""
        if not hasattr(times, '__len__'):
            raise TypeError(f'times is {shown(times)}: give a list of instants, s')
        times = [as_float(time) for time in times]
        until = min(self._foresee(max(times, default=-inf), interrupted), self._step_due)
        if interrupted is None or len(self._constants.phases) < _MANY_HARMONICS:
            return [self._sample_at(time) for time in times if time < until]
        samples = []
        for time in times:
            if not time < until:
                break
            samples.append(self._sample_at(time))
            if interrupted():
                break
        return samples

    def _foresee(self, time: float, interrupted: Callable[[], bool] | None) -> float:
        """Return up to when the present flight goes on; infinity if beyond that time."""
        here = self._here
        if here.due < inf:
            return here.due
        limit = (time - here.origin.time) - here.origin.time_low + 4.0 * ulp(time)
        steps = ALL_STEPS if interrupted is None else _STEPS_AT_A_STRETCH
        ending = here.ending
        while ending.kind == NO_EVENT and ending.tau <= limit:
            ending = flight_end(here.flight, ending.tau, limit, steps)
            if interrupted is not None and interrupted():
                break
        reached = advance_time(here.origin.time, here.origin.time_low, ending.tau)[0]
        if ending.kind != NO_EVENT:
            self._here = here._replace(ending=ending, due=reached)
            return reached
        self._here = here._replace(ending=ending)
        return inf if ending.tau > limit else reached - 4.0 * ulp(reached)

    def _sample_at(self, time: float) -> Sample:
        """Return the motion at an instant of the present flight."""
        row = EventRows()
        write_sample(row, 0, self._here, time)
        return Sample(*row.values())
