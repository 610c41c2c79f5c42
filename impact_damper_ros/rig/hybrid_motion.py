"""
The hybrid motion: flight, event, next flight.

A flight is never re-originated to sample, watch or pause it. Hence the motion does not depend on
the sampling rate or on how a run is cut into pieces, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from math import inf, nextafter, ulp
from typing import Any

from .changes import supports
from .contact import chatter_end, flight_end
from .crossing import CrossingWatch, SearchInterruptedError, sided
from .event import Event, EventKind, Sample, impact_events, make_event, quiet, transition_events
from .flight import NO_EVENT, Flight, FlightEnd, end_at, motion_at
from .forcing import SteppedSine, frequency_at
from .mode import CHATTER_1, Mode, RigConstants, launch, rig_constants
from .origin import Origin, advance_time, carried, offset_of, placed, stop_rates
from .parameters import RigParameters
from .transition import at_rest, moving_mode, resolve, struck

# More events than any chatter has, within this part of a radian of the natural vibration.
_MOST_EVENTS_AT_ONCE = 10_000
_AT_ONCE = 1e-9
#: Steps of a search between two calls of `interrupted`; few flights take more.
_STEPS_AT_A_STRETCH = 8
#: From this number of harmonics on, a sample takes long.
_MANY_HARMONICS = 32
_REMEDY = 'give a wider gap, a restitution below 1, or a slower start'


class RunawayError(RuntimeError):
    """A rig has events without end at one instant; it cannot go on."""

    def __init__(self, count: int, time: float) -> None:
        super().__init__(
            f'the rig has more than {count} events at once, at {time:.15g} s, and cannot be '
            f'followed any further: {_REMEDY}'
        )


def origin_at_step(rig: RigConstants, origin: Origin, flight: Flight, instant: float) -> Origin:
    """Return the origin of the first flight after a step."""
    tau = max(0.0, (instant - origin.time) - origin.time_low)
    there = carried(origin, flight, end_at(flight, NO_EVENT, tau))
    return sided(rig.free, origin, flight, there._replace(time=instant, time_low=0.0))


def step_event(origin: Origin) -> Event:
    """Return the event as which a step is reported."""
    return make_event(EventKind.FREQUENCY_STEP, 0, quiet(origin))


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

    def snapshot(self) -> dict[str, Any]:
        """Return all that the rig's future depends on."""
        raise NotImplementedError

    def _begin(self, origin: Origin) -> None:
        """Begin the flight of an origin."""
        self._origin = origin
        self._flight = launch(self._constants, origin)
        self._searched = 0.0
        self._clear = -inf
        self._due = inf
        self._watch: CrossingWatch | None = None
        if origin.mode >= CHATTER_1:
            self._expect(chatter_end(self._flight, origin.chatter_left))

    def _expect(self, end: FlightEnd) -> None:
        """Note the event that ends the flight, and its instant."""
        self._end = end
        self._due = advance_time(self._origin.time, self._origin.time_low, end.tau)[0]

    def _begin_all(self, origin: Origin) -> list[Event]:
        """Begin from a state of unknown mode, with the impact of m that moves into its stop."""
        if origin.relative_velocity == 0.0:
            self._begin(at_rest(self._constants, origin))
            return []
        on_1, on_2 = supports(origin)
        if (on_1 and origin.relative_velocity > 0.0) or (on_2 and origin.relative_velocity < 0.0):
            stop = 1 if origin.relative_velocity > 0.0 else 2
            transition = struck(self._constants, origin, stop)
            self._begin(transition.origin)
            return impact_events(self._constants, self._parameters.damper_mass, transition)
        mode = moving_mode(self._constants, origin.relative_velocity)
        self._begin(origin._replace(mode=mode, chatter_left=0.0))
        return []

    def _sided(self, origin: Origin) -> Origin:
        """Return the next origin, with the side of X if X is zero to round-off."""
        return sided(self._constants.free, self._origin, self._flight, origin)

    def _crossings(self) -> CrossingWatch:
        """Return the present flight's passages through X = 0."""
        if self._watch is None:
            self._watch = CrossingWatch(self._origin, self._flight)
        return self._watch

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
        return self._constants.free.frequencies[0]

    @property
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        here = self._here()
        return here.stop_1, here.stop_2

    @property
    def stop_velocities(self) -> tuple[float, float]:
        """Present velocities of stop 1 and stop 2 relative to M, m/s."""
        return stop_rates(self._origin, self._flight, self._here().relative_velocity)

    def _tau(self, time: float) -> float:
        return (time - self._origin.time) - self._origin.time_low

    def _here(self) -> Origin:
        """Return the present state as an origin, without making it one."""
        tau = max(0.0, self._tau(self._time))
        return carried(self._origin, self._flight, end_at(self._flight, NO_EVENT, tau))

    def mark(self) -> dict[str, Any]:
        """Return a mark for `go_back`; far cheaper than a snapshot."""
        state = self.__dict__.copy()
        # All the rest of it is immutable.
        state['_unreported'] = self._unreported.copy()
        if self._watch is not None:
            state['_watch'] = copy(self._watch)
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
            After so many events the rig stops, at an event, if more are due before that time; it
            may go on from there.
        interrupted : callable, optional
            Called now and then; once it returns true, the rig stops.

        Returns
        -------
        list of Event
            All events after the present time up to and including the new one.

        Raises
        ------
        ValueError
            If the time is before the present one or not finite.
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
        if not self._time <= time < inf:
            raise ValueError(
                f'cannot advance to {time!r} s: give a finite time not before {self._time!r} s'
            )
        events, self._unreported = self._unreported, []
        instant, at_once = -inf, 0
        until, passing = time, False
        while True:
            stretch = until if until < self._step_due else self._step_due
            if (
                self._due == inf
                and stretch >= self._clear
                and not self._search(stretch, interrupted)
            ):
                there = max(self._time, self._origin.time)
                if there < until:
                    until = there
                    break
                # All events of an instant that has been reached belong to it.
                interrupted = None
                continue
            due = self._due if self._due <= self._step_due else self._step_due
            if watch and not passing:
                try:
                    crossing = self._crossings().after(self._time, min(due, until), interrupted)
                except SearchInterruptedError:
                    there = max(self._time, self._origin.time)
                    if there < until:
                        until = there
                        break
                    interrupted = None
                    continue
                if crossing is not None:
                    # Other events of that instant come first.
                    until, passing, interrupted = crossing, True, None
            if due > until:
                break
            if len(events) >= most_events and not passing:
                until = max(self._time, self._origin.time)
                break
            events += self._pass_event() if self._due <= due else self._step_frequency()
            if self._origin.time > instant + _AT_ONCE / self._constants.joint.frequency:
                instant, at_once = self._origin.time, 0
            at_once += 1
            if at_once > _MOST_EVENTS_AT_ONCE:
                raise RunawayError(_MOST_EVENTS_AT_ONCE, instant)
            if interrupted is not None and self._origin.time < until and interrupted():
                until = max(self._time, self._origin.time)
                break
        self._time = until
        if passing:
            events.append(
                make_event(EventKind.CROSSING, 0, quiet(self._here()))._replace(time=until)
            )
        return events

    def _search(self, time: float, interrupted: Callable[[], bool] | None = None) -> bool:
        """Search for the event that ends the flight up to a time; false if interrupted."""
        # An event that rounds to that time belongs to it.
        limit = self._tau(nextafter(time, inf))
        while True:
            if interrupted is None:
                end = flight_end(self._flight, self._searched, limit)
            else:
                end = flight_end(self._flight, self._searched, limit, _STEPS_AT_A_STRETCH)
            if end.kind != NO_EVENT:
                self._expect(end)
                return True
            self._searched = end.tau
            # No event up to here, less a digit
            reached = advance_time(self._origin.time, self._origin.time_low, end.tau)[0]
            self._clear = reached - 4.0 * ulp(reached)
            if interrupted is None or not end.tau <= limit:
                return True
            if interrupted():
                return False

    def _step_frequency(self) -> list[Event]:
        """Go on to the next frequency of the stepped sine, at an exact instant."""
        there = origin_at_step(self._constants, self._origin, self._flight, self._step_due)
        self._sweep = SteppedSine(self._sweep.start, self._sweep.step + 1)
        self._step_due = self._sweep.due(self._parameters)
        frequency = frequency_at(self._parameters, self._sweep.step)
        self._constants = rig_constants(self._parameters, frequency)
        self._begin(there)
        return [step_event(there)]

    def _pass_event(self) -> list[Event]:
        """Resolve the event that ends the flight, and begin the next flight."""
        kind, before = self._end.kind, self._origin
        transition = resolve(self._constants, before, self._flight, self._end)
        self._begin(self._sided(transition.origin))
        mass = self._parameters.damper_mass
        return transition_events(self._constants, mass, kind, before, transition)

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        return self._sample_at(self._time)

    def preview(
        self, times: Sequence[float], interrupted: Callable[[], bool] | None = None
    ) -> list[Sample]:
        """Return the motion at those of the later instants that the present flight reaches."""
        last = max(times, default=-inf)
        until = min(self._due, self._step_due)
        if self._due == inf and last >= self._clear:
            decided = self._search(last, interrupted)
            until = min(self._due, self._step_due)
            if not decided:
                until = min(until, self._clear)
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

    def _sample_at(self, time: float) -> Sample:
        """Return the motion at an instant of the present flight."""
        origin, flight = self._origin, self._flight
        tau = max(0.0, self._tau(time))
        motion = motion_at(flight, tau)
        place = placed(origin, flight, tau, motion.travel)
        _, _, stop_1, stop_2 = place
        speed = 0.0 if flight.joint else motion.relative_velocity
        rate_1, rate_2 = stop_rates(origin, flight, speed)
        x, velocity = motion.x, motion.velocity
        return Sample(
            time,
            x,
            velocity,
            x + offset_of(*place),
            velocity + speed,
            x + stop_1,
            x + stop_2,
            velocity + rate_1,
            velocity + rate_2,
        )
