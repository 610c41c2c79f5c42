"""
The exact simulator: flight, event, next flight, for as long as asked.

A flight is never re-originated to sample it or to pause. Hence the motion does not depend on the
sampling rate or on how a run is cut into pieces, to the last bit.
"""

from __future__ import annotations

from math import inf, nextafter
from typing import Any

from .change import changed, offset_of
from .contact import (
    ARRIVAL,
    CONTACT_1,
    CONTACT_2,
    NO_EVENT,
    RELEASE_DOWN,
    RELEASE_UP,
    REVERSAL,
    first_event,
)
from .event import Event, EventKind, Sample
from .flight import motion_at
from .mode import (
    CHATTER_1,
    REST_1,
    REST_2,
    STICK,
    Machine,
    Mode,
    Origin,
    launch,
    make_machine,
)
from .parameters import InitialConditions, RigParameters
from .phase import advance_time
from .snapshot import Snapshot
from .transition import Transition, at_rest, carried, moving_mode, placed, resolve, struck

__all__ = ['Simulator']

# Far more events than any chatter has, in this part of a radian of the natural vibration.
_MOST_EVENTS_AT_ONCE = 100_000
_AT_ONCE = 1e-9


class Simulator:
    """
    The hybrid motion of one rig.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    time : float, optional
        Time at the start, s.

    Raises
    ------
    ParameterError
        If m would not start between the stops.

    Examples
    --------
    >>> rig = Simulator(RigParameters(gravity=0.0))
    >>> first = rig.advance(45.0)[0]
    >>> first.stop, round(first.time, 9)
    (1, 43.622660097)
    """

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
    ) -> None:
        """Start the rig."""
        self._start(parameters, make_machine(parameters), initial or InitialConditions(), time)

    def _start(
        self,
        parameters: RigParameters,
        machine: Machine,
        initial: InitialConditions,
        time: float,
    ) -> None:
        initial.check_within(parameters)
        half = machine.stop
        offset = initial.initial_damper_offset
        origin = Origin(
            time=time,
            time_low=0.0,
            mode=STICK,
            x=initial.initial_primary_position,
            velocity=initial.initial_primary_velocity,
            relative_velocity=initial.initial_damper_velocity - initial.initial_primary_velocity,
            clearance_1=half - offset,
            clearance_2=inf if machine.one_sided else half + offset,
            stop_1=half,
            stop_2=-half,
            angles=(0.0,) * len(parameters.force_phases),
            last_stop=0,
            released=False,
            chatter_left=0.0,
        )
        self._parameters = parameters
        self._machine = machine
        self._time = time
        # An impact at the very start, of m that moves into the stop it is on
        self._unreported = self._begin_all(origin)

    def _begin(self, origin: Origin) -> None:
        """Make an origin the present one."""
        self._origin = origin
        self._flight = launch(self._machine, origin)
        self._node = 0.0
        self._event: tuple[int, float] | None = None
        if origin.mode >= CHATTER_1:
            self._event = (NO_EVENT, origin.chatter_left)

    def _begin_all(self, origin: Origin) -> list[Event]:
        """Begin from a state of unknown mode; m may be about to hit the stop it is on."""
        events: list[Event] = []
        if origin.relative_velocity == 0.0:
            self._begin(at_rest(self._machine, origin))
            return events
        outward = (origin.clearance_1 == 0.0 and origin.relative_velocity > 0.0) or (
            origin.clearance_2 == 0.0 and origin.relative_velocity < 0.0
        )
        if outward:
            stop = 1 if origin.relative_velocity > 0.0 else 2
            transition = struck(self._machine, origin, stop)
            self._begin(transition.origin)
            events += self._impact(transition)
        else:
            mode = moving_mode(self._machine, origin.relative_velocity)
            self._begin(origin._replace(mode=mode, chatter_left=0.0))
        return events

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
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        here = self._here()
        return here.stop_1, here.stop_2

    def _tau(self, time: float) -> float:
        return (time - self._origin.time) - self._origin.time_low

    def _here(self) -> Origin:
        """Return the present state as an origin, without making it one."""
        return carried(self._origin, self._flight, max(0.0, self._tau(self._time)))

    def advance(self, time: float) -> list[Event]:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.

        Returns
        -------
        list of Event
            All events after the present time up to and including the new one; and an impact with
            which the rig started, or was reset.

        Raises
        ------
        ValueError
            If the time is before the present one or not finite.
        """
        if not self._time <= time < inf:
            raise ValueError(
                f'cannot advance to {time!r} s: give a finite time not before {self._time!r} s'
            )
        events, self._unreported = self._unreported, []
        instant, at_once = -inf, 0
        while True:
            if self._event is None:
                # An event that rounds to the time asked for belongs to it.
                limit = self._tau(nextafter(time, inf))
                kind, tau = first_event(self._flight, self._node, limit)
                if kind == NO_EVENT:
                    self._node = tau
                    break
                self._event = (kind, tau)
            kind, tau = self._event
            if advance_time(self._origin.time, self._origin.time_low, tau)[0] > time:
                break
            mode = self._origin.mode
            transition = resolve(self._machine, self._origin, self._flight, kind, tau)
            self._begin(transition.origin)
            events += self._report(kind, mode, transition)
            if self._origin.time > instant + _AT_ONCE / self._machine.joint.frequency:
                instant, at_once = self._origin.time, 0
            at_once += 1
            if at_once > _MOST_EVENTS_AT_ONCE:
                raise RuntimeError(
                    f'the rig has {at_once} events at {instant!r} s, which should not be '
                    f'possible; please report it with {self.snapshot()!r}'
                )
        self._time = time
        return events

    def _impact(self, transition: Transition) -> list[Event]:
        """Report an impact, and the rest that a plastic one leads to."""
        machine, parameters = self._machine, self._parameters
        stop = transition.stop
        restitution = machine.restitution_1 if stop == 1 else machine.restitution_2
        impulse = (
            parameters.damper_mass
            * (1.0 + restitution)
            / (1.0 + machine.mass_ratio)
            * abs(transition.relative_velocity_before)
        )
        events = [self._make(EventKind.IMPACT, stop, transition, impulse)]
        if transition.origin.mode in (REST_1, REST_2):
            events.append(
                self._make(
                    EventKind.REST,
                    stop,
                    transition._replace(
                        velocity_before=transition.velocity_after, relative_velocity_before=0.0
                    ),
                )
            )
        return events

    def _make(
        self, kind: EventKind, stop: int, transition: Transition, impulse: float = 0.0
    ) -> Event:
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

    def _report(self, kind: int, mode_before: int, transition: Transition) -> list[Event]:
        mode = transition.origin.mode
        if kind in (CONTACT_1, CONTACT_2):
            return self._impact(transition)
        if kind == ARRIVAL:
            stop = 1 if transition.origin.clearance_1 == 0.0 else 2
            return [self._make(EventKind.STOP_ARRIVED, stop, transition)]
        if kind in (RELEASE_UP, RELEASE_DOWN):
            stop = {REST_1: 1, REST_2: 2}.get(mode_before, 0)
            return [self._make(EventKind.RELEASE, stop, transition)]
        # A reversal, or the end of a chatter
        if mode in (REST_1, REST_2):
            return [self._make(EventKind.REST, 1 if mode == REST_1 else 2, transition)]
        if mode == STICK:
            return [self._make(EventKind.STICK, 0, transition)]
        if kind == REVERSAL:
            return [self._make(EventKind.REVERSAL, 0, transition)]
        return []

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        origin, flight = self._origin, self._flight
        motion = motion_at(flight, max(0.0, self._tau(self._time)))
        place = placed(origin, flight, motion.travel)
        _, _, stop_1, stop_2 = place
        speed = 0.0 if flight.joint else motion.relative_velocity
        x, velocity = motion.x, motion.velocity
        return Sample(
            self._time,
            x,
            velocity,
            x + offset_of(*place),
            velocity + speed,
            x + stop_1,
            x + stop_2,
        )

    def change(self, parameters: RigParameters) -> list[Event]:
        """
        Let new parameters take effect at the present time, exactly.

        Parameters
        ----------
        parameters : RigParameters
            The new rig.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.

        Notes
        -----
        The angle turned by each harmonic is continuous, so that a change of frequency does not
        jump the force; an added harmonic starts at its phase. The position of M in the laboratory
        is continuous where its static deflection changes. Stops open at once; a stop that would
        pass m comes up to it instead, is hit if m moves outwards, and follows if m moves inwards.
        """
        if parameters == self._parameters:
            return []
        machine = make_machine(parameters)
        shift = self._parameters.static_deflection - parameters.static_deflection
        origin = changed(self._here(), machine, shift)
        self._parameters = parameters
        self._machine = machine
        return self._begin_all(origin)

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        self._start(self._parameters, self._machine, initial or InitialConditions(), self._time)

    def snapshot(self) -> dict[str, Any]:
        """
        Return what the rig's future depends on.

        Returns
        -------
        dict
            The origin of the present flight, the parameters and the time reached; it goes
            through JSON without loss.
        """
        return Snapshot(
            self._parameters, self._origin, self._time, tuple(self._unreported)
        ).as_dict()

    @classmethod
    def restore(cls, snapshot: dict[str, Any]) -> Simulator:
        """
        Continue from a snapshot, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        state = Snapshot.from_dict(snapshot)
        rig = cls.__new__(cls)
        rig._parameters = state.parameters
        rig._machine = make_machine(state.parameters)
        rig._time = state.time
        rig._unreported = list(state.unreported)
        rig._begin(state.origin)
        return rig
