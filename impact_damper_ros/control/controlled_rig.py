"""
The rig under gap control: the simulator with sensors, controller and actuators.

With the control off it is the simulator, bit for bit. Samples lie on the grid k/rate, crossings
and the starts of stops at their own exact instants, so that the motion does not depend on how a
run is cut into pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf
from typing import Any, Self

from impact_damper_ros.rig import (
    Event,
    EventKind,
    GapControlParameters,
    InitialConditions,
    Mode,
    RigParameters,
    Sample,
    Simulator,
)
from impact_damper_ros.rig.simulator import Snapshot

from .controller import Action, Controller, ControlRecord
from .law import damper_of
from .sensors import measured

_ACTIONS = {EventKind.STOP_ARRIVED: Action.ARRIVED, EventKind.STOP_TOUCHED: Action.TOUCHED}


def completed(snapshot: dict[str, Any]) -> dict[str, Any]:
    """Return a snapshot with the state of the control; off, if it is an older one without."""
    if 'gap_control' in snapshot:
        return snapshot
    return {**snapshot, 'gap_control': ControlledRig.restore(snapshot).snapshot()['gap_control']}


class ControlledRig:
    """
    A rig and its gap control; used as a `Simulator`.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts.
    time : float, optional
        Time at the start, s.
    control : GapControlParameters, optional
        The control; off, if not given.

    Raises
    ------
    ParameterError
        If m would not start between the stops.

    Examples
    --------
    >>> from impact_damper_ros.rig import RigParameters
    >>> rig = ControlledRig(
    ...     RigParameters(gravity=0.0),
    ...     control=GapControlParameters(gap_control='timed', gap_control_rate=5.0),
    ... )
    >>> events = rig.advance(900.0)
    >>> round(rig.amplitude, 1), rig.parameters.response_amplitude
    (2.7, 100.0)
    """

    #: Class of the rig itself.
    _simulator: type[Simulator] = Simulator

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
        control: GapControlParameters | None = None,
    ) -> None:
        """Start the rig."""
        self._rig = self._simulator(parameters, initial, time)
        self._control = control or GapControlParameters()
        self._records: list[ControlRecord] = []
        self._start()

    def _start(self) -> None:
        self._controller = Controller()
        self._controller.actuators.settle(self._half_gap)
        if self._control.active:
            self._controller.begin(self._control, self._rig.time)
        self._describe()

    def _describe(self) -> None:
        self._damper = damper_of(self._rig.parameters)

    @property
    def _half_gap(self) -> float:
        return 0.5 * self._rig.parameters.gap

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._rig.time

    @property
    def parameters(self) -> RigParameters:
        """The rig's present parameters."""
        return self._rig.parameters

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._control

    @property
    def mode(self) -> Mode:
        """Present mode, after any event at the present time."""
        return self._rig.mode

    @property
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        return self._rig.stops

    @property
    def amplitude(self) -> float:
        """The controller's estimate of the amplitude of X, m."""
        return self._controller.observer.amplitude

    @property
    def energies(self) -> tuple[float, float]:
        """Energy spent by the actuator of each stop since the start or the last reset, J."""
        energies = self._controller.actuators.energies
        return energies[0], energies[1]

    @property
    def records(self) -> list[ControlRecord]:
        """Records of the last call of `advance`, `change` or `reset`."""
        return self._records

    @property
    def plain(self) -> Snapshot | None:
        """State of the rig if no control acts on it; else None."""
        controller = self._controller
        if self._control.active or controller.returning or controller.actuators.due is not None:
            return None
        return self._rig.state()

    def gone_on(self, rig: Simulator) -> None:
        """Continue from another simulator of the `plain` rig."""
        self._rig, self._records = rig, []

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        return self._rig.sample()

    def preview(
        self, times: Sequence[float], interrupted: Callable[[], bool] | None = None
    ) -> list[Sample]:
        """Return the motion at later instants, as `Simulator.preview` does; none under control."""
        return [] if self.plain is None else self._rig.preview(times, interrupted)

    def mark(self) -> tuple[dict[str, Any], Controller]:
        """Return a mark for `go_back`, as `Simulator.mark` does."""
        controller = self._controller
        if self._control.active or not controller.idles:
            controller = controller.copied()
        return self._rig.mark(), controller

    def go_back(self, mark: tuple[dict[str, Any], Controller]) -> None:
        """Undo all that `advance` did since a mark; each may be used once."""
        state, self._controller = mark
        self._rig.go_back(state)
        self._records = []

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
            After about so many events the rig stops, at an event, if more are due before that
            time; it may go on from there.
        interrupted : callable, optional
            Called now and then; once it returns true, the rig stops.

        Returns
        -------
        list of Event
            All events after the present time up to and including the new one; under control also
            the passages of X through zero, and what the stops do.

        Raises
        ------
        ValueError
            If the time is before the present one or not finite.
        RunawayError
            If the rig has events without end at one instant; `go_back` undoes the advance.
        """
        self._records = []
        rig = self._rig
        if not rig.time <= time < inf:
            return rig.advance(time)
        events: list[Event] = []
        while True:
            controller, active = self._controller, self._control.active
            command, sample = controller.actuators.due, inf
            if active or controller.returning:
                sample = controller.sample_index / self._control.gap_control_rate
            # A command may be due in the past, after the delay has been shortened.
            until = max(rig.time, min(inf if command is None else command, sample, time))
            run = rig.advance_to_crossing if active else rig.advance
            new = run(until, most_events - len(events), interrupted)
            events += self._noted(new)
            if new and new[-1].kind is EventKind.CROSSING:
                self._cross(new[-1])
            elif rig.time < until:
                return events
            elif command is not None and command <= until:
                events += self._carry_out()
            elif sample <= until:
                self._look()
            else:
                return events
            if interrupted is not None and rig.time < time and interrupted():
                return events

    def _cross(self, event: Event) -> None:
        controller = self._controller
        if controller.observer.holds_off(event.time):
            return
        rising = event.primary_velocity_after > 0.0
        # Indices of their own, so that no noise is used twice
        sample = measured(self._rig.sample(), -1 - controller.trigger_index, self._control)
        controller.cross(sample, rising, self._half_gap, self._damper, self._control)
        self._record(Action.CROSSING, event.time)

    def _look(self) -> None:
        """Take the sample that is due, and act on it."""
        controller, control, rig = self._controller, self._control, self._rig
        if control.active:
            sample = measured(rig.sample(), controller.sample_index, control)
            controller.see(sample, self._damper, control)
        if controller.returning:
            controller.send_back(rig.time, rig.stops, self._half_gap, control)
        controller.sample_index += 1
        if not (control.active or controller.returning):
            self._controller = self._controller.idle()

    def _carry_out(self) -> list[Event]:
        """Carry out the command that is due."""
        rig, control = self._rig, self._control
        targets = self._controller.actuators.start(rig.stops, control)
        if rig.parameters.one_sided:
            targets = targets[0], None
        self._record(Action.COMMAND, rig.time)
        return self._noted(rig.move_stops(*targets, speed=control.actuator_speed or inf))

    def _noted(self, events: list[Event]) -> list[Event]:
        """Record the stops that have arrived or met m, and return the events."""
        for event in events:
            action = _ACTIONS.get(event.kind)
            if action is not None:
                # Not the Y of the event, which is that of m: the encoder shows the target.
                targets = self._controller.actuators.targets
                arrived = action is Action.ARRIVED
                place = targets[event.stop - 1] if arrived else event.y
                self._controller.actuators.stopped(event.stop, place)
                self._record(action, event.time)
        return events

    def _record(self, action: Action, time: float) -> None:
        controller = self._controller
        record = ControlRecord.of(action, time, controller.actuators, controller.observer)
        # Stops that arrive together make one record.
        if self._records[-1:] != [record]:
            self._records.append(record)

    def change(
        self, parameters: RigParameters, control: GapControlParameters | None = None
    ) -> list[Event]:
        """
        Let new parameters take effect at the present time, exactly.

        Parameters
        ----------
        parameters : RigParameters
            The new rig.
        control : GapControlParameters, optional
            The new control; as it was, if not given.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.

        Notes
        -----
        Another `gap` places both stops there at once, as without control, and ends their
        movements; an active law moves them from there. Switching the control off sends them back
        to the gap by the actuators. Another law begins anew, with the present amplitude.
        """
        self._records = []
        before, old = self._rig.parameters, self._control
        events = self._rig.change(parameters)
        self._describe()
        if (parameters.gap, parameters.one_sided) != (before.gap, before.one_sided):
            self._controller.actuators.settle(self._half_gap)
            self._controller.relearn()
            self._controller.returning = False
            if old.active:
                self._record(Action.COMMAND, self._rig.time)
            else:
                self._controller = self._controller.idle()
        if control is not None and control != old:
            self._control = control
            self._controller = self._controller.switched(
                old, control, self._rig.time, self._half_gap
            )
        return events

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        self._rig.reset(initial)
        self._records = []
        self._start()

    def snapshot(self) -> dict[str, Any]:
        """
        Return all that the future of rig and control depends on.

        Returns
        -------
        dict
            The simulator's snapshot, and under `gap_control` that of the control; JSON keeps it
            exactly.
        """
        control = {
            'parameters': self._control.as_dict(),
            'state': self._controller.as_dict(),
        }
        return {**self._rig.snapshot(), 'gap_control': control}

    @classmethod
    def restore(cls, snapshot: dict[str, Any]) -> Self:
        """
        Continue from a snapshot, bit for bit; one of a plain `Simulator` has no control.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        rig = cls.__new__(cls)
        rig._rig = cls._simulator.restore(
            {k: v for k, v in snapshot.items() if k != 'gap_control'}
        )
        rig._records = []
        stored = snapshot.get('gap_control')
        if stored is None:
            rig._control = GapControlParameters()
            rig._start()
            return rig
        try:
            rig._control = GapControlParameters(**stored['parameters'])
            rig._controller = Controller.from_dict(stored['state'])
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f'snapshot is not complete: gap_control: {error}') from error
        rig._describe()
        return rig
