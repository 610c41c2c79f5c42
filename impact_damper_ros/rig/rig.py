# SPDX-License-Identifier: Apache-2.0
"""The rig: its motion from event to event, exactly, with or without gap control."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import chain, repeat
from math import ceil, inf, nan
from operator import attrgetter
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from impact_damper_ros.control.actuator import MOST_ORDERS, next_command, settle_stops
from impact_damper_ros.control.controller import (
    begin_sampling,
    control_of,
    forget_all,
    has_law,
    measured,
    next_sample,
    packed_control,
    relearn_laws,
    settings_of,
    switched,
)
from impact_damper_ros.control.own_law import Law, LawError, OwnLaw
from impact_damper_ros.control.record import Action, ActRow, ControlRecord
from impact_damper_ros.control.state import Control, Measurement
from impact_damper_ros.measured.record import BASE_RECORD, MeasuredRecord
from impact_damper_ros.motion.compiled import copied, dtype_of, has_numba, packed_rows, unpack
from impact_damper_ros.motion.event import (
    ROWS_AT_ONCE,
    SAMPLE_TYPE,
    Event,
    EventKind,
    EventRow,
    Sample,
    View,
    events_of,
    sample_at,
    view_at,
)
from impact_damper_ros.motion.flight import begin_flight, move_to, oscillator_of
from impact_damper_ros.motion.next_event import (
    ALL_STEPS,
    COMMANDS_FULL,
    FULL,
    LAW_FAILED,
    PAUSED,
    RUNAWAY,
    STEP_DUE,
    count_modes,
)
from impact_damper_ros.motion.oscillator import Line
from impact_damper_ros.motion.state import (
    Mode,
    Moving,
    RigConstants,
    Run,
    Wave,
    carried_to,
    constants_of,
    starting_fields,
)
from impact_damper_ros.motion.transition import (
    begin_from,
    move_stops,
    place_stops_at_gap,
    report_support,
)
from impact_damper_ros.motion.zero_passage import set_side
from impact_damper_ros.parameters.base_motion import angles_after, wait_for_change
from impact_damper_ros.parameters.parameter_spec import ParameterError, as_float, whole_number
from impact_damper_ros.parameters.quoting import shown
from impact_damper_ros.parameters.rig_parameters import (
    GapControlParameters,
    InitialConditions,
    RigParameters,
    check_rig,
)
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD, RunawayError
from impact_damper_ros.rig.snapshot import LATEST, SAME_TIME, Snapshot
from impact_damper_ros.rig.stepped_sine import SteppedSine, rig_at, sweep_of

from .loop import (
    NO_ACTS,
    NO_TIMES,
    Records,
    Schedule,
    hold_base,
    next_step,
    quiet_until,
    run_compiled,
    run_to,
    write_act,
)
from .order import Order
from .playback import Playback
from .run_result import (
    FIRST_ROWS,
    Events as Events,
    Outcome as Outcome,
    RunResult as RunResult,
    RunTables,
)

#: Steps of a search between two calls of `interrupted`; few flights take more. Compiled code takes
#: longer to begin than for thousands.
_STRETCH, _COMPILED_STRETCH = 4, 20_000
#: Rows that plain kernels write between two looks at their tables.
_PLAIN_ROWS = 64
#: More events than any run has.
_MOST = 2**62
_FARTHEST = 1e9
_SLOWEST = 1e-9

_act_fields = attrgetter(*ActRow.__dataclass_fields__)
_NO_INSTANTS: npt.NDArray[np.float64] = np.empty(0)


def waves_after(before: RigParameters, waves: Sequence[Wave], after: RigParameters) -> list[Wave]:
    """
    Return the harmonics with which a rig goes on with other parameters.

    A harmonic keeps its angle by its index in its group, an added one begins with zero; those of
    the base go on as `angles_after` says.
    """
    groups: dict[str, list[float]] = {}
    first = 0
    for name, (amplitudes, _, _) in before.harmonic_groups.items():
        groups[name] = [wave.angle for wave in waves[first : first + len(amplitudes)]]
        first += len(amplitudes)
    base, other = before.base_motion, after.base_motion
    if base != other:
        groups['base'] = angles_after(base, groups.get('base', []), other)
    angles = [
        angle
        for name, (amplitudes, _, _) in after.harmonic_groups.items()
        for angle, _ in zip(chain(groups.get(name, []), repeat(0.0)), amplitudes, strict=False)
    ]
    return list(map(Wave, angles))


def most_of(most_events: float, name: str = 'most_events') -> int:
    """Round a number of events up; raise a ValueError if it is negative or NaN."""
    number = as_float(most_events)
    if not number >= 0.0:
        raise ValueError(
            f'{name} is {shown(most_events)}: give a number from 0 on, infinity for no limit'
        )
    return _MOST if number >= _MOST else ceil(number)


def later_time(time: float, now: float) -> float:
    """Return a time (s) as a float; raise a ValueError if a rig cannot run to it."""
    end = as_float(time)
    if not now <= end < inf:
        raise ValueError(
            f'cannot advance to {shown(time)} s: give a finite time not before {now!r} s'
        )
    if end > LATEST:
        raise ValueError(f'cannot advance to {end!r} s: give a time up to {LATEST:g} s')
    return end


def times_between(since: float, end: float, instants: Any) -> npt.NDArray[np.float64]:
    """Return instants as an array; raise a ValueError if they are not in order or range."""
    try:
        when = np.array(instants, dtype=float).reshape(-1)
    except (OverflowError, TypeError, ValueError) as error:
        raise ValueError(f'instants are {shown(instants)}: give a list of times, s') from error
    in_order = bool(np.all(when[1:] >= when[:-1]))
    if len(when) and not (in_order and when[0] >= since and when[-1] <= end):
        raise ValueError(
            f'instants must ascend from {since!r} s to {end!r} s: sort them, and leave out those '
            'before and after'
        )
    return when


def _check_target(one_sided: bool, stop: int, target: float, speed: float) -> None:
    """Check the target and speed of a stop."""
    name = f'stop_{stop}'
    if stop == 2 and one_sided:
        raise ParameterError(
            name,
            f'{name} is {target!r} m but the rig is one-sided: give None, or one_sided: false',
        )
    if not -_FARTHEST <= as_float(target) <= _FARTHEST:
        raise ParameterError(
            name,
            f'{name} is {shown(target)} m: give the place Y where it is to go, a number from '
            f'{-_FARTHEST:g} to {_FARTHEST:g} m',
        )
    if not speed >= _SLOWEST:
        raise ParameterError(
            'speed',
            f'speed is {speed!r} m/s: give a number from {_SLOWEST:g} m/s, or inf for at once',
        )


def own_law_of(law: Law | None) -> OwnLaw | None:
    """Return a law of the user's own, with its name."""
    return law if law is None or isinstance(law, OwnLaw) else OwnLaw(law)


class Rig:
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
        of the one that `gap_control` names, unless that is off; see `own_law.LawInput`. The
        control is on, if it is not given.
    compiled : bool, optional
        Whether compiled code runs; plain Python, if not given. None stands for wherever numba is
        installed and, with a law of your own, has compiled that. The motion is the same, to the
        last bit.
    records : sequence of MeasuredRecord, optional
        Measured force on M, beside that of the parameters, and acceleration of the base: one of
        each at most, from the start and anew from each reset.

    Raises
    ------
    TypeError
        If the parameters are no `RigParameters`.
    ParameterError
        If m would not start between the stops.
    ValueError
        If the time is out of range.
    LawError
        If the law cannot be called so.
    ImportError
        If `compiled` without numba.

    Examples
    --------
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

    #: Measured records that act, and what of them the loop is given, also packed.
    _playbacks: list[Playback]
    _schedule: Schedule
    _packed_records: Records | None

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        time: float = 0.0,
        control: GapControlParameters | None = None,
        law: Law | None = None,
        *,
        compiled: bool | None = False,
        records: Sequence[MeasuredRecord] = (),
    ) -> None:
        """Start the rig."""
        check_rig('parameters', parameters)
        start = as_float(time)
        if not -LATEST <= start <= LATEST:
            raise ValueError(
                f'the rig cannot start at {shown(time)} s: give a number from {-LATEST:g} to '
                f'{LATEST:g} s'
            )
        self._law = own_law_of(law)
        default = GapControlParameters(gap_control='off' if law is None else 'timed')
        self._gap_control = control or default
        self._parameters = parameters
        self.compiled = self._may_compile() if compiled is None else compiled
        self._play([Playback.begun(record, start) for record in records])
        self._start(initial or InitialConditions(), start)

    def _may_compile(self) -> bool:
        return has_numba() and (self._law is None or self._law.compiles)

    def _start(self, initial: InitialConditions, time: float) -> None:
        parameters = self._parameters
        initial.check_within(parameters)
        self._sweep = SteppedSine.at(parameters, time, 0, time, 0.0)
        self._tune()
        fields = starting_fields(initial, self._constants.half_gap, parameters.one_sided)
        self._run = Run(time=time, now=time, counted_from=time, **fields)
        self._waves = [Wave() for _ in range(self._constants.harmonics)]
        self._play([Playback.begun(p.record, time) for p in self._playbacks])
        for playback in self._playbacks:
            if playback.record.quantity == BASE_RECORD:
                hold_base(self._run, playback.values[0])
            else:
                self._run.recorded_force = playback.values[0]
        # Acts of the last call; those of a run as rows of the loop
        self._records: Sequence[tuple[Any, ...]] = []
        # An impact at the very start, of m that moves into the stop it is on
        self._unreported: list[Event] = []
        self._unreported = self._begin()
        self._control = control_of(self._gap_control, parameters, self._law)
        if self._gap_control.active:
            begin_sampling(self._control, time)

    def _tune(self) -> None:
        """Take the constants of the rig as it is at the present step of its schedule."""
        self._present = rig_at(self._parameters, self._sweep.step)
        self._constants, self._lines = constants_of(self._present)
        self._packed: Any = None
        self._scratch = (
            [EventRow() for _ in range(_PLAIN_ROWS)],
            [ActRow() for _ in range(_PLAIN_ROWS)],
        )

    def _play(self, playbacks: Sequence[Playback]) -> None:
        """Let measured records act."""
        self._playbacks = list(playbacks)
        columns: dict[str, Any] = {'force': (NO_TIMES, ()), 'base': (NO_TIMES, ())}
        columns |= {p.record.quantity: (p.instants, p.values) for p in playbacks}
        self._schedule = Schedule((), (), *columns['force'], *columns['base'])
        self._packed_records = None

    def _moving(self, log: Sequence[EventRow] = ()) -> Moving:
        """Return what the kernels of the motion are given, with a table for the events."""
        return Moving(self._constants, self._lines, self._run, self._waves, log)

    def _cut(self, time: float, *, same_x: bool = True) -> None:
        """Move the origin of the flight to a time, where X stays what it is."""
        side = self._run.crossing_side
        move_to(self._moving(), time)
        self._run.now = time
        if side and same_x:
            set_side(self._moving(), side)

    def _begin(self, before: int | None = None) -> list[Event]:
        """
        Begin from a state of unknown mode; return what happens there.

        After another mode, m may have lost its support by that, or have come to rest.
        """
        rows, run = self._scratch[0], self._run
        run.room, run.written = len(rows), 0
        begin_from(self._moving(rows))
        if before is not None and not run.written:
            report_support(run, rows, before)
        return events_of(rows, run.written)

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._run.now

    @property
    def parameters(self) -> RigParameters:
        """The present parameters."""
        return self._parameters

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._gap_control

    @property
    def law(self) -> str:
        """Name of the law that moves the stops; off, if none does."""
        own = self._law if self._gap_control.active else None
        return self._gap_control.gap_control if own is None else own.name

    @property
    def own_law(self) -> OwnLaw | None:
        """The control law of the user, or None."""
        return self._law

    @property
    def mode(self) -> Mode:
        """Mode of the motion at the present time, after any event at that time."""
        return Mode(self._run.mode)

    @property
    def force_frequency(self) -> float:
        """Present circular frequency of the first harmonic, rad/s; a sweep changes it."""
        return self._lines[0].frequency

    @property
    def sweep(self) -> SteppedSine:
        """How far the stepped sine has come."""
        return self._sweep

    def _view(self) -> View:
        return view_at(self._moving(), self._run.now)

    @property
    def stops(self) -> tuple[float, float]:
        """Present positions Y of stop 1 and stop 2, m."""
        view = self._view()
        return view.stop_1, view.stop_2

    @property
    def amplitude(self) -> float:
        """The controller's estimate of the amplitude of X, m."""
        return self._control.estimates.amplitude

    @property
    def force(self) -> float:
        """Active force on M, N."""
        return self._run.force

    @property
    def energies(self) -> tuple[float, float]:
        """Energy spent by the actuator of each stop since the start or the last reset, J."""
        actuators = self._control.actuators
        return actuators.energy_1, actuators.energy_2

    @property
    def records(self) -> list[ControlRecord]:
        """What the control did in the last call of `advance`, `run`, `change` or `order`."""
        return [
            record if isinstance(record, ControlRecord) else ControlRecord.of(record)
            for record in self._records
        ]

    @property
    def measured_records(self) -> tuple[MeasuredRecord, ...]:
        """The measured records that act, or have ended."""
        return tuple(playback.record for playback in self._playbacks)

    @property
    def acts(self) -> bool:
        """Whether a control moves the stops, or stops are on their way by it."""
        control = self._control
        return bool(control.active or control.controller.returning or control.actuators.waiting)

    def mark(self) -> dict[str, Any]:
        """Return a mark for `go_back`; far cheaper than a snapshot."""
        state = self.__dict__.copy()
        # All the rest of it is immutable, or made anew by `advance`.
        state['_run'] = copied(self._run)
        state['_waves'] = list(map(copied, self._waves))
        if self._gap_control.active or not self._control.idles or self._law is not None:
            state['_control'] = self._control.copied()
        return state

    def go_back(self, mark: dict[str, Any]) -> None:
        """Undo all that `advance` or `run` did since a mark; each may be used once."""
        self.__dict__.update(mark)
        self._records = []

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
            no end; the rig then stops at the last one that it may have.
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
            If the rig has more events than it may have; those that it had are in the error.
        LawError
            If a law of the user's own fails; the rig is then where it was.
        """
        time = later_time(time, self.time)
        most = most_of(most_in_period, 'most_in_period')
        if self._is_quiet(time):
            self._run.now, self._records = time, []
            count_modes(self._run, [0.0] * len(Mode))
            return []
        tables = RunTables(keep=True, since=self.time, end=time, listed=not self.compiled)
        status, _ = self._run_to(time, tables, most_in_period=most, interrupted=interrupted)
        events = tables.listed()
        if status == RUNAWAY:
            raise RunawayError(self._reason(Outcome.RUNAWAY), events)
        return events

    def _is_quiet(self, time: float) -> bool:
        """Return whether nothing happens up to a time, as far as the flight has been searched."""
        run, control = self._run, self._control
        if self._unreported or time >= min(self._sweep.due, next_step(run, self._schedule)):
            return False
        run.watch = has_law(control)
        return time < min(quiet_until(run), next_sample(control), next_command(control))

    def _reason(self, outcome: Outcome, happened: int = 0, since: float = 0.0) -> str:
        """Return why a run ended with an outcome."""
        run, mode = self._run, self.mode.name.lower().replace('_', ' ')
        if outcome is Outcome.RUNAWAY:
            happened, since = run.in_period, run.counted_from
        return outcome.reason(happened, since, self.time, mode)

    def _run_to(
        self,
        time: float,
        tables: RunTables,
        *,
        most: int = _MOST,
        most_in_period: int = MOST_IN_PERIOD,
        interrupted: Callable[[], bool] | None = None,
        when: npt.NDArray[np.float64] = _NO_INSTANTS,
        samples: Any = (),
        in_mode: Any = None,
    ) -> tuple[int, int]:
        """
        Let the loop run to a time, plain or compiled; return why it stopped, and how many events.

        It comes back where a table is full, or now and then to be interrupted, and for each step
        of the sine, which changes constants of the rig. After an error the rig is where it was.
        """
        before, run, happened = self.mark(), self._run, 0
        tables.add(*self._unreported)
        self._unreported, run.most_in_period, run.sampled = [], most_in_period, 0
        if in_mode is None:
            in_mode = np.zeros(len(Mode)) if self.compiled else [0.0] * len(Mode)
        instants = when if self.compiled else when.tolist()
        schedule = self._schedule._replace(instants=instants, samples=samples)
        stretch = _COMPILED_STRETCH if self.compiled else _STRETCH
        try:
            while True:
                run.most, run.happened = most - happened, 0
                run.steps = ALL_STEPS if interrupted is None else stretch
                run.sweep_due = self._sweep.due
                if self.compiled:
                    status = self._run_compiled(in_mode, schedule, time, tables)
                else:
                    rows, acts = self._scratch
                    control = self._control if self.acts else None
                    self._open_tables(len(rows), len(acts) if tables.keep else 0)
                    status = run_to(self._moving(rows), in_mode, control, acts, schedule, time)
                    tables.take(rows, run.written)
                    recorded = acts[: self._control.controller.recorded]
                    tables.take_acts(list(map(_act_fields, recorded)))
                happened += run.happened
                if status == COMMANDS_FULL:
                    self._control = self._control.enlarged()
                if status == LAW_FAILED:
                    assert self._law is not None
                    raise self._law.refused(self._control)
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
        self._records = tables.acts
        return status, happened

    def _open_tables(self, rows: int, acts: int) -> None:
        """Let the loop write into empty tables of events and of acts."""
        controller = self._control.controller
        self._run.room, self._run.written = rows, 0
        controller.room, controller.recorded = acts, 0

    def _step_sweep(self) -> list[Event]:
        """Make the step of the stepped sine that is due, at its exact instant."""
        before = self._run.mode
        self._cut(self._sweep.due)
        self._sweep = self._sweep.following(self._parameters)
        self._tune()
        caused: list[Event] = []
        if self._present.swept == 'base' and self._present.damping:
            # The force of the dashpot jumps with the velocity of the base.
            caused = self._begin(before)
        else:
            begin_flight(self._moving())
        return [self._force_event(EventKind.FREQUENCY_STEP), *caused]

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

    def run(
        self,
        time: float,
        instants: npt.ArrayLike = (),
        *,
        record: bool = True,
        most_events: float = 1_000_000,
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
            Whether to return the events, and to have the acts of the control in `records`.
        most_events : float, optional
            Most events of the run (rounded up), the steps of a stepped sine among them. With
            elastic stops to which m is pressed they may have no end; the run then ends here, or
            where `advance` raises an error, as the outcome says.

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
            time, tables, most=most, when=when, samples=samples, in_mode=in_mode
        )
        outcome = Outcome(status)
        return RunResult(
            outcome,
            self._reason(outcome, happened, since),
            self.time,
            samples[: self._run.sampled].view(SAMPLE_TYPE).reshape(-1),
            tables.events,
            happened,
            in_mode,
        )

    def _run_compiled(
        self, in_mode: Any, schedule: Schedule, time: float, tables: RunTables
    ) -> int:
        """Run the loop compiled; the rig changes at the end only."""
        run, control, controlled = self._run, self._control, self.acts
        if self._packed is None:
            harmonics = packed_rows(self._lines, Line)
            self._packed = packed_rows([self._constants], RigConstants), harmonics[np.newaxis]
        if self._packed_records is None:
            self._packed_records = tuple(map(np.array, self._schedule[2:]))
        rows, acts = tables.room(run.now), NO_ACTS
        if not tables.keep and (controlled or self._playbacks):
            # What the stops do, and the number of events at a step, is read from the events.
            rows = np.empty(FIRST_ROWS, dtype_of(EventRow))
        elif controlled:
            acts = np.empty(FIRST_ROWS, dtype_of(ActRow))
        self._open_tables(len(rows), len(acts))
        state, waves = packed_rows([run], Run), packed_rows(self._waves, Wave)
        acting = packed_control(control) if controlled else None
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
        )
        unpack(state[0], run)
        self._waves = [Wave(*row) for row in waves.tolist()]
        if acting is not None:
            self._control = control.unpacked(acting)
            tables.take_acts(acts[: self._control.controller.recorded].tolist())
        tables.wrote(run.written)
        return int(outcomes[0])

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
        jump the force; an added harmonic starts at its phase. Another motion of the base begins at
        an upward zero of its own, unless its lines go on continuously with their angles; see
        `wait_for_change`. A change of a parameter of the stepped sine starts it anew, any other
        change leaves its step alone. The position of M in the laboratory is continuous where its
        static deflection changes.

        Another `gap` or `one_sided` sends both stops to half the gap from the middle, at once, as
        `move_stops` does, and ends their movements. An active law moves the stops from there.
        Switching the control off sends them back to the gap by the actuators. Another law begins
        anew, with the present amplitude.
        """
        self._records = []
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
                self._records = [ControlRecord.of(_act_fields(rows[0]))]
            else:
                forget_all(here)
        if control is not None and settings is not None:
            self._gap_control = control
            self._control = switched(self._control, settings, self.time)
            if control.gap_control != 'external':
                events += self._push(0.0)
        return events

    def check_change(self, parameters: RigParameters, control: GapControlParameters) -> None:
        """Raise what `change` would raise now; the rig stays as it is."""
        mark = {**self.mark(), '_control': self._control.copied()}
        try:
            self.change(parameters, control)
        finally:
            self.go_back(mark)

    def _change(self, parameters: RigParameters) -> list[Event]:
        before, run = self._parameters, self._run
        shift = before.static_deflection - parameters.static_deflection
        self._cut(run.now, same_x=shift == 0.0)
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

        0 where the motion of the base is not changed, or is continuous anyway. Elsewhere the time
        until the base next passes zero upwards: the new motion begins at such a passage, too.
        """
        again = sweep_of(parameters) == sweep_of(self._parameters)
        after = rig_at(parameters, self._sweep.step if again else 0)
        angles = [wave.angle for wave in self._waves_now()[self._present.base_rows]]
        return wait_for_change(self._present.base_motion, angles, after.base_motion)

    def _waves_now(self) -> list[Wave]:
        """Return the harmonics with the angles that they have turned at the present time."""
        run = self._run
        tau = max(0.0, (run.now - run.time) - run.time_low)
        return [
            Wave(math.fmod(wave.angle + line.frequency * tau, math.tau))
            for wave, line in zip(self._waves, self._lines, strict=False)
        ]

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
        A stop goes to its target as far as m lets it, and never does work. Where it meets m, m
        holds it up (`STOP_TOUCHED`): if m moves outwards, m hits the standing stop (`IMPACT`); if
        inwards, the stop follows m, touching it, and goes on by itself once m is faster
        (`STOP_STARTED`). A stop that moves at once is placed at m, where m is in its way, and then
        follows m however fast. A stop that moves away from m at rest on it leaves m without
        support: friction holds m, or m leaves (`RELEASE`) and may catch up with the stop. Between
        two stops that both touch it, m cannot move in M, and the impact that ends its motion there
        is plastic.
        """
        speed = as_float(speed)
        for stop, target in ((1, stop_1), (2, stop_2)):
            if target is not None:
                _check_target(self._constants.one_sided, stop, target, speed)
        rows = [EventRow() for _ in range(ROWS_AT_ONCE)]
        self._run.room, self._run.written = len(rows), 0
        move_stops(
            self._moving(rows),
            nan if stop_1 is None else float(stop_1),
            nan if stop_2 is None else float(stop_2),
            speed,
        )
        return events_of(rows, self._run.written)

    def measure(self, index: int) -> tuple[Measurement, tuple[float, float]]:
        """
        Return what the sensors see now, and the velocities of the stops in M, m/s.

        The index of the sample chooses the noise.
        """
        view = self._view()
        sensors = self._control.settings, self._control.estimates
        seen = measured(*sensors, index, self.time, *view[:4], view.stop_1, view.stop_2)
        return seen, (view.stop_rate_1, view.stop_rate_2)

    def order(self, order: Order) -> list[Event]:
        """
        Carry out what a controller outside the rig commands, from the present time on.

        Parameters
        ----------
        order : Order
            Stops go to their places by the actuators, with their delay and speed. The force on M
            is constant until the next one.

        Returns
        -------
        list of Event
            Events at the present time, which a change of the force may cause. `records` has the
            order.

        Raises
        ------
        ParameterError
            If `gap_control` is not external or a number is not admissible; nothing changes then.
        """
        if self._gap_control.gap_control != 'external' or self._law is not None:
            raise ParameterError(
                'gap_control',
                f'the stops are moved by gap_control {self.law}: set gap_control to external',
            )
        order.check(self._control)
        order.issue(self._control, self.time)
        record = order.record(self._control, self.time)
        if self._control.actuators.waiting + MOST_ORDERS > len(self._control.commands):
            self._control = self._control.enlarged()
        events = self._push(order.force) if order.force == order.force else []
        # Stops that move at once are there now.
        events += self.advance(self.time)
        self._records = [record, *self._records]
        return events

    def _push(self, force: float) -> list[Event]:
        """Let an active force act on M, in a flight of its own."""
        run, before = self._run, self._run.mode
        if force == run.force:
            return []
        self._cut(run.now)
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

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        return self._sample(self.time)

    def _sample(self, time: float) -> Sample:
        return Sample(*sample_at(self._moving(), time))

    def drive(self) -> tuple[float, float]:
        """
        Return the present force on M, N, and X'', m/s^2, after any event at that time.

        The force is without that of the spring and the dashpot, also where their base moves.
        """
        run, lines, view = self._run, self._lines, self._view()
        tau = max(0.0, (run.now - run.time) - run.time_low)
        sines = [
            math.sin(wave.angle + line.frequency * tau + line.phase)
            for line, wave in zip(lines, self._waves, strict=False)  # alone; those with m follow
        ]
        sines_of_force = list(enumerate(sines))
        del sines_of_force[self.parameters.base_rows]
        force = sum(lines[j].force * sine for j, sine in sines_of_force)
        moving = sum(lines[run.first + j].force * sine for j, sine in enumerate(sines))
        oscillator = oscillator_of(self._constants, run)
        held = 2.0 * oscillator.decay * view.velocity + oscillator.omega_squared * view.x
        force = self.parameters.primary_mass * force + run.force + run.recorded_force
        return force, run.constant + moving - held + run.base_acceleration

    def state(self) -> Snapshot:
        """Return the motion of the rig, without its control, as a record."""
        return Snapshot(
            self._parameters,
            copied(self._run),
            tuple(wave.angle for wave in self._waves),
            tuple(self._unreported),
            self._sweep,
            tuple(self._playbacks),
        )

    def __repr__(self) -> str:
        """Return time and state of the rig in a line."""
        sample, control = self.sample(), ''
        if self.control.active:
            control = f', gap control {self.law}'
        return (
            f'<Rig at {self.time:.9g} s: X = {sample.x:.6g} m, Y = {sample.z - sample.x:.6g} m, '
            f'mode {self.mode.name.lower()}{control}>'
        )

    def snapshot(self) -> dict[str, Any]:
        """
        Return all that the future of rig and control depends on.

        Returns
        -------
        dict
            The origin of the present flight, the parameters and the time reached, and under
            `gap_control` the control; JSON keeps it exactly.
        """
        control = self._control
        held: dict[str, Any] = {
            'parameters': self._gap_control.as_dict(),
            'state': control.as_dict(),
        }
        if self._law is not None:
            memory = [float(v) if abs(v) < inf else str(float(v)) for v in control.memory]
            held['law'] = {
                'name': self._law.name,
                'digest': self._law.digest,
                'memory': memory,
            }
        return {**self.state().as_dict(), 'gap_control': held}

    @classmethod
    def restore(
        cls, snapshot: dict[str, Any], law: Law | None = None, *, compiled: bool | None = False
    ) -> Self:
        """
        Continue from a snapshot, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or is of a rig with a law of
            the user's own that is not given.
        """
        return cls.resume(
            Snapshot.from_dict(snapshot), snapshot.get('gap_control'), law, compiled=compiled
        )

    @classmethod
    def resume(
        cls,
        state: Snapshot,
        control: dict[str, Any] | None = None,
        law: Law | None = None,
        *,
        compiled: bool | None = False,
    ) -> Self:
        """Continue from a result of `state`, with the control of a snapshot or none."""
        rig = cls.__new__(cls)
        rig._law, rig._parameters, rig._sweep = own_law_of(law), state.parameters, state.sweep
        rig.compiled = rig._may_compile() if compiled is None else compiled
        rig._tune()
        rig._run, rig._waves = copied(state.run), [Wave(a) for a in state.angles]
        rig._records, rig._unreported = [], list(state.unreported)
        rig._play(state.playbacks)
        kept = state.run
        begin_flight(rig._moving())
        rig._run.searched, rig._run.crossing_side = kept.searched, kept.crossing_side
        rig._run.watched, rig._run.crossing = kept.watched, kept.crossing
        rig._run.counted_from = kept.now
        rig._run.counted = (kept.now - kept.time) - kept.time_low
        rig._gap_control, rig._control = _restored(control, rig)
        return rig


def _restored(held: dict[str, Any] | None, rig: Rig) -> tuple[GapControlParameters, Control]:
    """Return the control of a snapshot; off, if it has none."""
    try:
        parameters = GapControlParameters(**(held['parameters'] if held else {}))
        control = control_of(parameters, rig.parameters, rig.own_law)
        if held is None:
            return parameters, control
        control = control.restored(held['state'])
        kept = held.get('law')
        if kept is not None:
            if rig.own_law is None:
                raise LawError(
                    f'its stops were moved by the law {kept["name"]}, which it only names: give '
                    'the law, too'
                )
            control.memory[:] = map(float, kept['memory'])
        index = control.controller.sample_index
        whole_number('sample_index', index, -(2**63), 2**63 - 1)
        if next_sample(control) < rig.time - SAME_TIME:
            raise ValueError(
                f'sample_index is {index}, a sample at {index / parameters.gap_control_rate!r} '
                f's: it must be the next one after time, {rig.time!r} s'
            )
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f'gap_control is not complete: {error}') from error
    return parameters, control
