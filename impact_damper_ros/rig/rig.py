# SPDX-License-Identifier: Apache-2.0
"""The rig: its motion from event to event, exactly, with or without gap control."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
import numpy.typing as npt

from impact_damper_ros.control.act import ActRow, act_fields
from impact_damper_ros.control.actuator import MOST_ORDERS, next_command
from impact_damper_ros.control.controller import has_law, next_sample, packed_control
from impact_damper_ros.motion.event import SAMPLE_TYPE, Event, EventKind, EventRow, Sample
from impact_damper_ros.motion.flight import begin_flight
from impact_damper_ros.motion.next_event import (
    ALL_STEPS,
    COMMANDS_FULL,
    DONE,
    FULL,
    LAW_FAILED,
    PAUSED,
    RUNAWAY,
    SPENT,
    STEP_DUE,
    count_modes,
)
from impact_damper_ros.motion.oscillator import Line
from impact_damper_ros.motion.records import dtype_of, pack_rows, unpack
from impact_damper_ros.motion.state import Mode, RigConstants, Run, Wave
from impact_damper_ros.parameters.parameter_spec import ParameterError, check_kind
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD, RunawayError

from .acts import Schedule, next_step, quiet_until
from .compiled_run import NO_ACTS, NO_STROBES, run_compiled
from .loop import run_to
from .order import Order
from .rig_changes import RigChanges
from .run_arguments import MOST, later_time, most_of, times_between
from .run_result import FIRST_ROWS, Outcome, RunResult, RunTables
from .strobe import CYCLES_OF_A_LOOK, Strobe, goes_on, next_look

#: Steps of a search between two calls of `interrupted`; few flights take more. Compiled code takes
#: longer to begin than for thousands.
_STEPS, _COMPILED_STEPS = 4, 20_000

_NO_INSTANTS: npt.NDArray[np.float64] = np.empty(0)


class Rig(RigChanges):
    """
    A rig in motion.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    time : float, optional
        Time at the start, s; from -1e13 to 1e13.
    control : GapControlParameters, optional
        Its gap control; off, if not given.
    law : callable, optional
        A law of your own, `law(seen, memory) -> (stop_1, stop_2)`, that moves the stops in place
        of the law that `gap_control` names, unless `gap_control` is off; see `own_law.LawInput`.
        With a law and no `control` the control is on.
    compiled : bool, optional
        Whether compiled code runs; plain Python, if not given. None stands for compiled code where
        numba is installed and has compiled the law, if there is one. The motion is the same, to
        the last bit.
    records : sequence of MeasuredRecord, optional
        Measured force on M, which adds to that of the parameters, and measured acceleration of the
        base: at most one of each. They begin at the start and at each reset.

    Raises
    ------
    TypeError
        If the parameters are no `RigParameters`.
    ParameterError
        If m would not start between the stops.
    ValueError
        If the time is out of range.
    LawError
        If the law cannot be called with two arguments.
    ImportError
        If `compiled` without numba.

    Examples
    --------
    >>> from impact_damper_ros.parameters.rig_parameters import RigParameters
    >>> rig = Rig(RigParameters(gravity=0.0))
    >>> first = rig.advance(45.0)[0]
    >>> first.stop, round(first.time, 9)
    (1, 43.622660097)
    >>> settled = rig.run(2000.0, record=False)
    >>> stretch = rig.run(2100.0, instants=np.arange(2000.0, 2100.0))
    >>> len(stretch.samples), len(stretch.impacts(stop=1))
    (100, 16)

    Notes
    -----
    Each sample of a record is held from the middle of the interval before it to the middle of the
    next one, exactly; after the last one the force, or the acceleration, is 0. The acceleration of
    the base is followed in coordinates that move with it: -M b'' acts on M and -m b'' on m, which
    are constant while a sample is held, so that each flight stays a closed formula. Samples and
    events have absolute positions and velocities: those of the base are the exact integrals of
    what is held, from rest. Control and its sensors see X relative to that base.
    """

    def advance(
        self,
        time: float,
        most_in_period: float = MOST_IN_PERIOD,
        interrupted: Callable[[], bool] | None = None,
    ) -> list[Event]:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s, from the present one on.
        most_in_period : float, optional
            Most events within one period of the fastest of spring and force (rounded up), counted
            anew after each change of the rig. Impacts of elastic stops to which m is pressed have
            no end; the rig then stops at the last event allowed.
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
            If the rig has more events than allowed; the error holds those that it had.
        LawError
            If a law of the user's own fails; the rig is then where it was.
        """
        time = later_time(time, self.time)
        most = most_of(most_in_period, 'most_in_period')
        if self._is_quiet(time):
            self._run.now, self._acts = time, []
            count_modes(self._run, [0.0] * len(Mode))
            return []
        tables = RunTables(keep=True, since=self.time, end=time, listed=not self.compiled)
        status, _ = self._run_to(time, tables, most_in_period=most, interrupted=interrupted)
        events = tables.event_list()
        if status == RUNAWAY:
            raise RunawayError(self._reason_of(Outcome.RUNAWAY), events)
        return events

    def _is_quiet(self, time: float) -> bool:
        """Return whether nothing happens up to a time, as far as the flight has been searched."""
        run, control = self._run, self._control
        if self._unreported or time >= min(self._sweep.due, next_step(run, self._schedule)):
            return False
        run.watch = has_law(control)
        return time < min(quiet_until(run), next_sample(control), next_command(control))

    def _run_to(
        self,
        time: float,
        tables: RunTables,
        *,
        most: int = MOST,
        most_in_period: int = MOST_IN_PERIOD,
        interrupted: Callable[[], bool] | None = None,
        when: npt.NDArray[np.float64] = _NO_INSTANTS,
        samples: Any = (),
        in_mode: Any = None,
        strobe: Strobe | None = None,
    ) -> tuple[int, int]:
        """
        Let the loop run to a time, plain or compiled; return why it stopped, and how many events.

        The loop returns where a table is full, now and then so that the run can be interrupted,
        and for each step of the sine, which changes constants of the rig. After an error the rig
        is where it was.
        """
        before, run, happened = self.mark(), self._run, 0
        tables.add(*self._unreported)
        self._unreported, run.most_in_period, run.sampled = [], most_in_period, 0
        if in_mode is None:
            in_mode = np.zeros(len(Mode)) if self.compiled else [0.0] * len(Mode)
        instants = when if self.compiled else when.tolist()
        schedule = self._schedule._replace(instants=instants, samples=samples)
        steps = _COMPILED_STEPS if self.compiled else _STEPS
        try:
            while True:
                run.most, run.happened = most - happened, 0
                run.steps = ALL_STEPS if interrupted is None else steps
                run.sweep_due = self._sweep.due
                if self.compiled:
                    status = self._run_compiled(in_mode, schedule, time, tables, strobe)
                else:
                    rows, acts = self._scratch
                    control = self._control if self.moves_stops else None
                    self._open_tables(len(rows), len(acts) if tables.keep else 0)
                    status = run_to(self._moving(rows), in_mode, control, acts, schedule, time)
                    tables.take(rows, run.written)
                    recorded = acts[: self._control.controller.recorded]
                    tables.take_acts(list(map(act_fields, recorded)))
                happened += run.happened
                if status == COMMANDS_FULL:
                    self._control = self._control.with_more_room()
                if status == LAW_FAILED:
                    assert self._law is not None
                    raise self._law.refusal(self._control)
                if status in (FULL, COMMANDS_FULL, PAUSED):
                    if self.time == time:
                        # All events of an instant that has been reached belong to it.
                        interrupted = None
                    if interrupted is None or not interrupted():
                        continue
                count_modes(run, in_mode)
                if status != STEP_DUE:
                    break
                events = self._step_sweep()
                tables.add(*events)
                happened += len(events)
        except BaseException:
            self.go_back(before)
            raise
        self._acts = tables.acts
        return status, happened

    def _open_tables(self, rows: int, acts: int) -> None:
        """Let the loop write into empty tables of events and of acts."""
        controller = self._control.controller
        self._run.room, self._run.written = rows, 0
        controller.room, controller.recorded = acts, 0

    def _step_sweep(self) -> list[Event]:
        """Make the step of the stepped sine that is due, at its exact instant."""
        before = self._run.mode
        self._move_origin(self._sweep.due)
        self._sweep = self._sweep.following(self._parameters)
        self._tune()
        caused: list[Event] = []
        if self._present.swept == 'base' and self._present.damping:
            # The force of the dashpot jumps with the velocity of the base.
            caused = self._begin(before)
        else:
            begin_flight(self._moving())
        return [self._force_event(EventKind.FREQUENCY_STEP), *caused]

    def run(
        self,
        time: float,
        instants: npt.ArrayLike = (),
        *,
        record: bool = True,
        most_events: float = 1_000_000,
        most_in_period: float = MOST_IN_PERIOD,
    ) -> RunResult:
        """
        Let the rig run to a later time; as `advance`, but events and samples are arrays.

        Parameters
        ----------
        time : float
            Time to reach, s, from the present one on.
        instants : array_like of float, optional
            Instants at which to sample, s: ascending, from the present time to the one to reach.
        record : bool, optional
            Whether to return the events, and to have the acts of the control in `acts`.
        most_events : float, optional
            Most events of the run (rounded up), the steps of a stepped sine among them. With
            elastic stops to which m is pressed they may have no end; the run then ends here, or
            where `advance` raises an error, as the outcome says.
        most_in_period : float, optional
            Most events within a period, see `advance`.

        Returns
        -------
        RunResult
            Samples and events, and whether the time was reached.

        Raises
        ------
        ValueError
            If a time is before the present one, not finite, or not in order, or the number of
            events is negative or NaN.
        LawError
            If a law of the user's own fails; the rig is then where it was.
        """
        most, time, since = most_of(most_events), later_time(time, self.time), self.time
        when = times_between(since, time, instants)
        samples = np.empty((len(when), len(Sample._fields)))
        in_mode = np.zeros(len(Mode))
        tables = RunTables(keep=record, since=since, end=time)
        status, happened = self._run_to(
            *(time, tables),
            most=most,
            most_in_period=most_of(most_in_period, 'most_in_period'),
            when=when,
            samples=samples,
            in_mode=in_mode,
        )
        outcome = Outcome(status)
        return RunResult(
            outcome,
            self._reason_of(outcome, happened, since),
            self.time,
            samples[: self._run.sampled].view(SAMPLE_TYPE).reshape(-1),
            tables.events,
            happened,
            in_mode,
        )

    def run_until_return(
        self,
        cycle: float,
        rate: float,
        cycles: int,
        tolerance: float,
        *,
        most_events: int,
        interrupted: Callable[[], bool] = lambda: False,
    ) -> tuple[int, int]:
        """
        Run until the state at the end of a cycle equals that at the end of an earlier cycle.

        Parameters
        ----------
        cycle, rate : float
            Duration of a cycle, s, and the circular frequency that makes velocities comparable
            with displacements, rad/s.
        cycles : int
            Most cycles.
        tolerance : float
            Distance of two states, over the size of the motion, below which they are the same.
        most_events : int
            Most events of the run.
        interrupted : callable, optional
            Called now and then; once it returns true, the run ends.

        Returns
        -------
        cycles, events : int
            Cycles and events of the run.

        Raises
        ------
        RunawayError
            If the rig has more events than allowed.
        """
        start, happened = self.time, 0
        strobe = Strobe(start, cycle, rate, tolerance, cycles, most_events)
        looks = self._schedule._replace(
            instants=np.empty(CYCLES_OF_A_LOOK),
            samples=np.empty((CYCLES_OF_A_LOOK, len(Sample._fields))),
        )
        while True:
            # Compiled code compares the states itself.
            end = inf if self.compiled else next_look(self._run, looks, strobe)
            status, count = self._run_to(
                *(end, RunTables(keep=False, since=start, end=end)),
                most=most_events - happened,
                interrupted=interrupted,
                when=looks.instants,
                samples=looks.samples,
                strobe=strobe,
            )
            happened += count
            if self.compiled or status != DONE or not goes_on(self._run, looks, strobe):
                break
        if status in (SPENT, RUNAWAY):
            since = start + strobe.cycles * cycle
            reason = self._reason_of(Outcome(status), happened - strobe.happened, since)
            raise RunawayError(reason)
        return strobe.cycles, happened

    def _run_compiled(
        self,
        in_mode: Any,
        schedule: Schedule,
        time: float,
        tables: RunTables,
        strobe: Strobe | None,
    ) -> int:
        """Run the loop compiled; the rig changes at the end only."""
        run, control, controlled = self._run, self._control, self.moves_stops
        if self._packed is None:
            harmonics = pack_rows(self._lines, Line)
            self._packed = pack_rows([self._constants], RigConstants), harmonics[np.newaxis]
        if self._packed_records is None:
            self._packed_records = tuple(map(np.array, self._schedule[2:]))
        rows, acts = tables.room(run.now), NO_ACTS
        if not tables.keep and (controlled or self._playbacks):
            # The control reads the motion of the stops in the table of events, a step their
            # number.
            rows = np.empty(FIRST_ROWS, dtype_of(EventRow))
        elif controlled:
            acts = np.empty(FIRST_ROWS, dtype_of(ActRow))
        self._open_tables(len(rows), len(acts))
        state, waves = pack_rows([run], Run), pack_rows(self._waves, Wave)
        acting = packed_control(control) if controlled else None
        strobes = NO_STROBES if strobe is None else pack_rows([strobe], Strobe)
        outcomes = np.zeros(1, np.int64)
        run_compiled(
            (*self._packed, state),
            waves[np.newaxis],
            rows,
            in_mode[np.newaxis],
            acting,
            time,
            schedule.instants,
            outcomes,
            np.reshape(schedule.samples, (1, -1, len(Sample._fields))),
            acts=acts,
            records=self._packed_records,
            strobes=strobes,
        )
        unpack(state[0], run)
        if strobe is not None:
            unpack(strobes[0], strobe)
        self._waves = [Wave(*row) for row in waves.tolist()]
        if acting is not None:
            self._control = control.unpack(acting)
            tables.take_acts(acts[: self._control.controller.recorded].tolist())
        tables.wrote(run.written)
        return int(outcomes[0])

    def order(self, order: Order) -> list[Event]:
        """
        Carry out what a controller outside the rig commands, from the present time on.

        Parameters
        ----------
        order : Order
            Stops go to their places by the actuators, with their delay and speed. The force on M
            is constant until the next order with a force.

        Returns
        -------
        list of Event
            Events at the present time, which a change of the force may cause. `acts` has the
            order.

        Raises
        ------
        ParameterError
            If `gap_control` is not external or a number is not admissible; nothing changes then.
        """
        check_kind('order', order, Order, 'an Order, such as Order(stop_1=0.01)')
        if self._gap_control.gap_control != 'external' or self._law is not None:
            raise ParameterError(
                'gap_control',
                f'the stops are moved by gap_control {self.law}: set gap_control to external',
            )
        order.check(self._control)
        order.issue(self._control, self.time)
        act = order.as_act(self._control, self.time)
        if self._control.actuators.waiting + MOST_ORDERS > len(self._control.commands):
            self._control = self._control.with_more_room()
        events = self._apply_force(order.force) if order.force == order.force else []
        # Stops that move at once are there now.
        events += self.advance(self.time)
        self._acts = [act, *self._acts]
        return events
