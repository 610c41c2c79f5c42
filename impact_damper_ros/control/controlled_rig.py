"""
The rig under gap control: the simulator with sensors, controller and actuators.

With the control off it is the simulator, bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import inf, isfinite
from typing import Any, Self

from impact_damper_ros.rig import (
    Event,
    GapControlParameters,
    InitialConditions,
    RigParameters,
    Sample,
    Simulator,
)
from impact_damper_ros.rig.arguments import need
from impact_damper_ros.rig.event import MOST_TOGETHER, EventRows
from impact_damper_ros.rig.simulator import Snapshot
from impact_damper_ros.rig.state_checks import SAME_TIME, check_whole

from .actuator import settle_stops
from .control_loop import COMMANDS_FULL, LAW_FAILED, go_under_control, write_record
from .controller import (
    LAW_STATES,
    Control,
    ControlSettings,
    forget_all,
    initial_state,
    next_sample,
    relearn_laws,
)
from .own_law import Law, LawError, OwnLaw
from .record import Action, ControlRecord


def completed(snapshot: dict[str, Any]) -> dict[str, Any]:
    """
    Return a snapshot with all that an older one does not have.

    That is the state of the control, which is off, or that of laws and parameters that did not
    exist, which are at their start and their defaults.
    """
    if 'gap_control' not in snapshot:
        restored = ControlledRig.restore(snapshot).snapshot()
        return {**snapshot, 'gap_control': restored['gap_control']}
    held, fresh = snapshot['gap_control'], initial_state()
    parameters = {**GapControlParameters().as_dict(), **held['parameters']}
    state = {**{entry: fresh[entry] for entry in LAW_STATES.values()}, **held['state']}
    return {**snapshot, 'gap_control': {**held, 'parameters': parameters, 'state': state}}


def own_law_of(law: Law | None) -> OwnLaw | None:
    """Return a law of the user's own, with its name."""
    return law if law is None or isinstance(law, OwnLaw) else OwnLaw(law)


class ControlledRig(Simulator):
    """
    A rig and its gap control.

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
    law : callable, optional
        A law of one's own, `law(seen, memory) -> (stop_1, stop_2)`, that moves the stops in place
        of the one that `gap_control` names, unless that is off; see `own_law.LawInput`. The
        control is on, if it is not given.

    Raises
    ------
    ParameterError
        If m would not start between the stops.
    LawError
        If the law cannot be called so.

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

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
        control: GapControlParameters | None = None,
        law: Law | None = None,
    ) -> None:
        """Start the rig."""
        need(GapControlParameters, or_none=True, control=control)
        self._law = own_law_of(law)
        default = GapControlParameters(gap_control='off' if law is None else 'timed')
        self._gap_control = control or default
        self._records: list[ControlRecord] = []
        super().__init__(parameters, initial, time)
        self._start_control()

    def _start_control(self) -> None:
        self._control = Control.of(self._gap_control, self._parameters, self._law)
        if self._gap_control.active:
            self._control.begin(self._time)

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._gap_control

    @property
    def law(self) -> str:
        """Name of the law that moves the stops."""
        return self._gap_control.gap_control if self._law is None else self._law.name

    @property
    def own_law(self) -> OwnLaw | None:
        """The law of the user's own, if there is one."""
        return self._law

    @property
    def control_state(self) -> Control:
        """A copy of the state of the control."""
        return self._control.copied()

    @property
    def amplitude(self) -> float:
        """The controller's estimate of the amplitude of X, m."""
        return self._control.observer.amplitude

    @property
    def energies(self) -> tuple[float, float]:
        """Energy spent by the actuator of each stop since the start or the last reset, J."""
        actuators = self._control.actuators
        return actuators.energy_1, actuators.energy_2

    @property
    def records(self) -> list[ControlRecord]:
        """Records of the last call of `advance`, `change` or `reset`."""
        return self._records

    @property
    def plain(self) -> Snapshot | None:
        """State of the rig if no control acts on it; else None."""
        control = self._control
        acts = control.active or control.controller.returning or control.actuators.waiting
        return None if acts else self.state()

    def gone_on(self, rig: Simulator) -> None:
        """Continue from another simulator of the `plain` rig."""
        self.__dict__.update(Simulator.mark(rig))
        self._records = []

    def preview(
        self, times: Sequence[float], interrupted: Callable[[], bool] | None = None
    ) -> list[Sample]:
        """Return the motion at later instants, as `Simulator.preview` does; none under control."""
        return [] if self.plain is None else super().preview(times, interrupted)

    def mark(self) -> dict[str, Any]:
        """Return a mark for `go_back`, as `Simulator.mark` does."""
        state = super().mark()
        if self._gap_control.active or not self._control.idles:
            state['_control'] = self._control.copied()
        return state

    def go_back(self, mark: dict[str, Any]) -> None:
        """Undo all that `advance` did since a mark; each may be used once."""
        super().go_back(mark)
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
            If the time is before the present one or after 1e13 s, or the number of events is
            negative or NaN.
        RunawayError
            If the rig has events without end at one instant; `go_back` undoes the advance.
        LawError
            If a law of the user's own fails; the rig is then where it was.
        """
        self._records = []
        if self._law is None:
            return super().advance(time, most_events, interrupted)
        before = self.mark()
        before['_control'] = self._control.copied()
        try:
            return super().advance(time, most_events, interrupted)
        except LawError:
            self.go_back(before)
            raise

    def _go(self, time: float, most: int, steps: int, *, watch: bool) -> tuple[int, list[Event]]:
        """Run to a time or the next step of the frequency, under control."""
        if watch:
            if self.plain is None:
                raise ValueError(
                    'a rig under control cannot stop at a passage of X through zero: `advance` '
                    'returns the passages among the events'
                )
            return super()._go(time, most, steps, watch=watch)
        events: list[Event] = []
        status = COMMANDS_FULL
        while status == COMMANDS_FULL:
            rows, table = EventRows(), EventRows()
            status, self._time, self._here, written, _, recorded = go_under_control(
                self._constants,
                self._parameters.damper_mass,
                self._control,
                self._here,
                self._time,
                time,
                self._step_due,
                most - len(events),
                steps,
                rows,
                rows,
                MOST_TOGETHER,
                0,
                self._in_mode,
                True,
                table,
                0,
            )
            events += rows.events(written)
            records = ControlRecord.rows(table, recorded)
            again = bool(records) and self._records[-1:] == records[:1]
            self._records += records[1:] if again else records
            if status == COMMANDS_FULL:
                self._control = self._control.enlarged()
            elif status == LAW_FAILED:
                assert self._law is not None
                raise self._law.refused(self._control)
        return status, events

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
        need(RigParameters, parameters=parameters)
        need(GapControlParameters, or_none=True, control=control)
        self._records = []
        before, old = self._parameters, self._gap_control
        own = self._law is not None
        settings = None
        if control is not None and control != old:
            settings = ControlSettings.of(control, parameters, own=own)
        events = super().change(parameters)
        here = self._control._replace(settings=ControlSettings.of(old, parameters, own=own))
        self._control = here
        if (parameters.gap, parameters.one_sided) != (before.gap, before.one_sided):
            settle_stops(here)
            relearn_laws(here)
            here.controller.returning = False
            if old.active:
                table = EventRows()
                written = write_record(here, Action.COMMAND, self._time, table, 0)
                self._records = ControlRecord.rows(table, written)
            else:
                forget_all(here)
        if control is not None and settings is not None:
            self._gap_control = control
            self._control = here.switched(settings, self._time)
        return events

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        super().reset(initial)
        self._records = []
        self._start_control()

    def snapshot(self) -> dict[str, Any]:
        """
        Return all that the future of rig and control depends on.

        Returns
        -------
        dict
            The simulator's snapshot, and under `gap_control` that of the control; JSON keeps it
            exactly.
        """
        return {**super().snapshot(), 'gap_control': stored(self._gap_control, self._control)}

    @classmethod
    def restore(cls, snapshot: dict[str, Any], law: Law | None = None) -> Self:
        """
        Continue from a snapshot, bit for bit; one of a plain `Simulator` has no control.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or is of a rig with a law of
            the user's own that is not given.
        """
        rig = super().restore(snapshot)
        rig._records, rig._law = [], own_law_of(law)
        rig._gap_control, rig._control = restored(snapshot, rig.parameters, rig._law)
        return rig


def stored(parameters: GapControlParameters, control: Control) -> dict[str, Any]:
    """Return what a snapshot holds of a control."""
    held: dict[str, Any] = {'parameters': parameters.as_dict(), 'state': control.as_dict()}
    if control.law is not None:
        memory = [float(v) if isfinite(v) else str(v) for v in control.memory]
        held['law'] = {'name': control.law.name, 'memory': memory}
    return held


def restored(
    snapshot: dict[str, Any], rig: RigParameters, law: OwnLaw | None
) -> tuple[GapControlParameters, Control]:
    """
    Return the control of a snapshot; off, if it has none.

    Raises
    ------
    ValueError
        If the snapshot lacks something, or a law of the user's own is not given.
    """
    held = snapshot.get('gap_control')
    if held is None:
        parameters = GapControlParameters()
        return parameters, Control.of(parameters, rig, law)
    try:
        parameters = GapControlParameters(**held['parameters'])
        control = Control.of(parameters, rig, law).restored(held['state'])
        kept = held.get('law')
        if kept is not None:
            if law is None:
                raise LawError(
                    f'its stops were moved by the law {kept["name"]}, which is no part of it: '
                    'give the law, too'
                )
            control.memory[:] = map(float, kept['memory'])
        index, begun = control.controller.sample_index, snapshot['time']
        check_whole('sample_index', index)
        if next_sample(control) < begun - SAME_TIME:
            raise ValueError(
                f'sample_index is {index}, a sample at {index / parameters.gap_control_rate!r} '
                f's: it must be the next one after time, {begun!r} s'
            )
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f'snapshot is not complete: gap_control: {error}') from error
    return parameters, control
