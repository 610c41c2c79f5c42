# SPDX-License-Identifier: Apache-2.0
"""Changes of a rig at the present time: of its parameters, of its stops, of the force, a reset."""

from __future__ import annotations

from math import inf, nan

from impact_damper_ros.control.act import Action, ActRow, ControlAct, act_fields
from impact_damper_ros.control.actuator import settle_stops
from impact_damper_ros.control.controller import (
    forget_all,
    relearn_laws,
    settings_of,
    with_new_settings,
)
from impact_damper_ros.motion.event import ROWS_AT_ONCE, Event, EventKind, EventRow, events_of
from impact_damper_ros.motion.moving_stops import move_stops, place_stops_at_gap
from impact_damper_ros.motion.state import carried_to
from impact_damper_ros.parameters.base_motion import wait_for_change
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import as_float, check_kind
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters, check_rig
from impact_damper_ros.rig.stepped_sine import SteppedSine, rig_at, sweep_of

from .acts import write_act
from .rig_state import RigState
from .run_arguments import check_target
from .stepped_sine import waves_after


class RigChanges(RigState):
    """A rig at an instant, which can be changed there."""

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
        The angle turned by each harmonic is continuous, so that a change of frequency does not
        jump the force; an added harmonic starts at its phase. A new motion of the base begins at
        one of its upward zeros, unless its lines continue at their angles; see `wait_for_change`.
        A change of a parameter of the stepped sine starts it anew, any other change leaves its
        step alone. The position of M in the laboratory is continuous where its static deflection
        changes.

        Another `gap` or `one_sided` sends both stops to half the gap from the middle, at once, as
        `move_stops` does, and ends their movements. An active law moves the stops from there.
        Switching the control off sends them back to the gap by the actuators. Another law begins
        anew, with the present amplitude.
        """
        check_rig('parameters', parameters)
        if control is not None:
            check_kind('control', control, GapControlParameters, 'GapControlParameters')
        self._acts = []
        before, old, own = self._parameters, self._gap_control, self._law is not None
        settings = None
        if control is not None and control != old:
            settings = settings_of(control, parameters, own=own)
        events = self._change(parameters) if parameters != before else []
        here = self._control._replace(settings=settings_of(old, parameters, own=own))
        self._control = here
        if (parameters.gap, parameters.one_sided) != (before.gap, before.one_sided):
            settle_stops(here)
            relearn_laws(here)
            here.controller.returning = False
            if old.active:
                rows = [ActRow()]
                here.controller.recorded, here.controller.room = 0, 1
                write_act(here, rows, Action.COMMAND, self.time)
                self._acts = [ControlAct.of(act_fields(rows[0]))]
            else:
                forget_all(here)
        if control is not None and settings is not None:
            self._gap_control = control
            self._control = with_new_settings(self._control, settings, self.time)
            if control.gap_control != 'external':
                events += self._apply_force(0.0)
        return events

    def check_change(self, parameters: RigParameters, control: GapControlParameters) -> None:
        """Raise what `change` would raise now; the rig stays as it is."""
        mark = {**self.mark(), '_control': self._control.copy()}
        try:
            self.change(parameters, control)
        finally:
            self.go_back(mark)

    def _change(self, parameters: RigParameters) -> list[Event]:
        before, run = self._parameters, self._run
        shift = before.static_deflection - parameters.static_deflection
        self._move_origin(run.now, same_x=shift == 0.0)
        self._parameters = parameters
        run.counted_from, run.in_period = run.now, 0
        start, step = run.now, 0
        if sweep_of(parameters) == sweep_of(before):
            start, step, _ = self._sweep
        present = rig_at(parameters, step)
        self._waves = waves_after(self._present, self._waves, present)
        angle = self._waves[0].angle
        self._sweep = SteppedSine.at(parameters, start, step, run.now, angle)
        self._tune()
        # An impact of the last reset is reported later, with X from the new equilibrium.
        self._unreported = [event._replace(x=event.x + shift) for event in self._unreported]
        if (parameters.gap, parameters.one_sided) != (before.gap, before.one_sided):
            place_stops_at_gap(self._constants, run)
        run.x += shift
        return self._begin()

    def wait_for_change(self, parameters: RigParameters) -> float:
        """
        Return how long a `change` of the rig has to wait so that its base moves continuously, s.

        The time is 0 where the motion of the base does not change, or is continuous anyway.
        Otherwise the change waits until the base passes zero upwards, where the new motion begins,
        too.
        """
        again = sweep_of(parameters) == sweep_of(self._parameters)
        after = rig_at(parameters, self._sweep.step if again else 0)
        angles = [wave.angle for wave in self._waves_now()[self._present.base_rows]]
        return wait_for_change(self._present.base_motion, angles, after.base_motion)

    def move_stops(
        self, stop_1: float | None, stop_2: float | None, speed: float = inf
    ) -> list[Event]:
        """
        Move stops to other places in M, from the present time on.

        Parameters
        ----------
        stop_1, stop_2 : float or None
            Target Y of each stop, m; None leaves the stop as it is, or moving.
        speed : float, optional
            Speed relative to M, m/s; if infinite, the stops are there at once.

        Returns
        -------
        list of Event
            Events at the present time. A movement ends with `STOP_ARRIVED`, now or later, unless
            another command comes before.

        Raises
        ------
        ParameterError
            If there is no such stop or a number is not admissible; nothing changes then.

        Notes
        -----
        A stop goes to its target as far as m lets it, and never does work. Where the stop meets m,
        m blocks it (`STOP_TOUCHED`): if m moves outwards, m hits the standing stop (`IMPACT`); if
        inwards, the stop follows in contact with m, and moves by itself again once m is faster
        (`STOP_STARTED`). A stop that moves at once is placed at m, where m is in its way, and then
        follows m however fast. A stop that moves away from m at rest on it leaves m without
        support: friction holds m, or m leaves (`RELEASE`) and may catch up with the stop. Between
        two stops that both touch it, m cannot move in M, and the impact that ends its motion there
        is plastic.
        """
        speed = as_float(speed)
        for stop, target in ((1, stop_1), (2, stop_2)):
            if target is not None:
                check_target(self._constants.one_sided, stop, target, speed)
        rows = [EventRow() for _ in range(ROWS_AT_ONCE)]
        self._run.room, self._run.written = len(rows), 0
        move_stops(
            self._moving(rows),
            nan if stop_1 is None else float(stop_1),
            nan if stop_2 is None else float(stop_2),
            speed,
        )
        return events_of(rows, self._run.written)

    def _force_event(self, kind: EventKind, force: float = 0.0) -> Event:
        """Return a change of the force at the origin of the flight, where nothing jumps."""
        run = self._run
        x, velocity = run.x, run.velocity
        damper = velocity + run.relative_velocity
        if run.carried:
            base, speed = carried_to(run, run.time)
            x, velocity, damper = x + base, velocity + speed, damper + speed
        y = self.sample().z - x
        speeds = velocity, velocity, damper, damper
        return Event(run.time, kind, 0, x, y, *speeds, force, run.mode)

    def _apply_force(self, force: float) -> list[Event]:
        """Let an active force act on M, in a flight of its own."""
        run, before = self._run, self._run.mode
        if force == run.force:
            return []
        self._move_origin(run.now)
        run.force = force
        caused = self._begin(before)
        return [self._force_event(EventKind.FORCE_STEP, force), *caused]

    def reset(self, initial: InitialConditions | None = None) -> None:
        """
        Put the rig back to its initial conditions; the force starts anew, time goes on.

        Raises
        ------
        ParameterError
            If m would not start between the stops; the rig then runs on as before.
        """
        self._start(initial or InitialConditions(), self.time)
