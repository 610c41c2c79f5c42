# SPDX-License-Identifier: Apache-2.0
"""A rig at an instant: how it begins, what it holds, and its record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import inf
from typing import Any, Self

from impact_damper_ros.control.act import ActRow, ControlAct
from impact_damper_ros.control.controller import (
    begin_sampling,
    control_of,
    next_sample,
    sensor_sample,
)
from impact_damper_ros.control.own_law import Law, LawError, OwnLaw
from impact_damper_ros.control.state import Control, Measurement
from impact_damper_ros.measured.record import BASE_RECORD, MeasuredRecord
from impact_damper_ros.motion.event import (
    ROWS_AT_ONCE,
    Event,
    EventRow,
    Sample,
    View,
    events_of,
    sample_at,
    view_at,
)
from impact_damper_ros.motion.flight import begin_flight, move_to, oscillator_of
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.motion.records import copy_of
from impact_damper_ros.motion.state import Mode, Moving, Run, Wave, constants_of, starting_fields
from impact_damper_ros.motion.transition import begin_from, report_support
from impact_damper_ros.motion.zero_passage import set_side
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import as_float, check_kind, whole_number
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters, check_rig
from impact_damper_ros.rig.snapshot import LATEST, SAME_TIME, Snapshot
from impact_damper_ros.rig.stepped_sine import SteppedSine, rig_at

from .acts import NO_TIMES, Schedule, hold_base
from .compiled_run import Records
from .playback import Playback
from .run_result import Outcome

#: Rows that plain kernels write between two looks at their tables.
_PLAIN_ROWS = 64


class RigState:
    """A rig at an instant, with or without gap control: what `Rig` lets run and changes."""

    #: Measured records that act; below, what the loop is given of them, plain and packed.
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
                f'the rig cannot start at {quote(time)} s: give a number from {-LATEST:g} to '
                f'{LATEST:g} s'
            )
        for record in records:
            check_kind('records', record, MeasuredRecord, 'a sequence of MeasuredRecord')
        self._law = own_law_of(law)
        self._gap_control = control or GapControlParameters(
            gap_control='off' if law is None else 'timed'
        )
        check_kind('control', self._gap_control, GapControlParameters, 'GapControlParameters')
        self._parameters = parameters
        self.compiled = self._may_compile() if compiled is None else compiled
        self._play([Playback.begin(record, start) for record in records])
        self._start(initial or InitialConditions(), start)

    def _may_compile(self) -> bool:
        return has_numba() and (self._law is None or self._law.compiles)

    def _start(self, initial: InitialConditions, time: float) -> None:
        check_kind('initial', initial, InitialConditions, 'InitialConditions')
        parameters = self._parameters
        initial.check_within(parameters)
        self._sweep = SteppedSine.at(parameters, time, 0, time, 0.0)
        self._tune()
        fields = starting_fields(initial, self._constants.half_gap, parameters.one_sided)
        self._run = Run(time=time, now=time, counted_from=time, **fields)
        self._waves = [Wave() for _ in range(self._constants.harmonics)]
        self._play([Playback.begin(p.record, time) for p in self._playbacks])
        for playback in self._playbacks:
            if playback.record.quantity == BASE_RECORD:
                hold_base(self._run, playback.values[0])
            else:
                self._run.recorded_force = playback.values[0]
        # Acts of the last call; those of a run as rows of the loop
        self._acts: Sequence[tuple[Any, ...]] = []
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
        count = ROWS_AT_ONCE if self.compiled else _PLAIN_ROWS
        self._scratch = [EventRow() for _ in range(count)], [ActRow() for _ in range(count)]

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

    def _move_origin(self, time: float, *, same_x: bool = True) -> None:
        """Move the origin of the flight to a time; `same_x` is false if X jumps there."""
        side = self._run.crossing_side
        move_to(self._moving(), time)
        self._run.now = time
        if side and same_x:
            set_side(self._moving(), side)

    def _begin(self, before: int | None = None) -> list[Event]:
        """
        Begin from a state of unknown mode; return what happens there.

        Given the mode before, that m has lost its support or has come to rest is an event, too.
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
    def acts(self) -> list[ControlAct]:
        """What the control did in the last call of `advance`, `run`, `change` or `order`."""
        return [act if isinstance(act, ControlAct) else ControlAct.of(act) for act in self._acts]

    @property
    def measured_records(self) -> tuple[MeasuredRecord, ...]:
        """The measured records that act, or have ended."""
        return tuple(playback.record for playback in self._playbacks)

    @property
    def moves_stops(self) -> bool:
        """Whether a control moves the stops, or stops are on their way by it."""
        return self._control.active or bool(self._control.controller.returning)

    def mark(self) -> dict[str, Any]:
        """Return a mark for `go_back`; far cheaper than a snapshot."""
        state = self.__dict__.copy()
        # All the rest of it is immutable, or made anew by `advance`.
        state['_run'] = copy_of(self._run)
        state['_waves'] = list(map(copy_of, self._waves))
        if self._gap_control.active or not self._control.idles or self._law is not None:
            state['_control'] = self._control.copy()
        return state

    def go_back(self, mark: dict[str, Any]) -> None:
        """Undo all that `advance` or `run` did since a mark; each may be used once."""
        self.__dict__.update(mark)
        self._acts = []

    def measure(self, index: int) -> tuple[Measurement, tuple[float, float]]:
        """
        Return what the sensors see now, and the velocities of the stops in M, m/s.

        The index of the sample chooses the noise.
        """
        view = self._view()
        sensors = self._control.settings, self._control.estimates
        seen = sensor_sample(*sensors, index, self.time, *view[:4], view.stop_1, view.stop_2)
        return seen, (view.stop_rate_1, view.stop_rate_2)

    def _waves_now(self) -> list[Wave]:
        """Return the harmonics with the angles that they have turned at the present time."""
        run = self._run
        tau = max(0.0, (run.now - run.time) - run.time_low)
        return [
            Wave(math.fmod(wave.angle + line.frequency * tau, math.tau))
            for wave, line in zip(self._waves, self._lines, strict=False)
        ]

    def _reason_of(self, outcome: Outcome, happened: int = 0, since: float = 0.0) -> str:
        """Return why a run ended with an outcome."""
        if outcome is Outcome.COMPLETE:
            return ''
        run, mode = self._run, self.mode.name.lower().replace('_', ' ')
        if outcome is Outcome.RUNAWAY:
            happened, since = run.in_period, run.counted_from
        return outcome.reason(happened, since, self.time, mode)

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
            copy_of(self._run),
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
        stored: dict[str, Any] = {
            'parameters': self._gap_control.as_dict(),
            'state': control.as_dict(),
        }
        if self._law is not None:
            memory = [float(v) if abs(v) < inf else str(float(v)) for v in control.memory]
            stored['law'] = {
                'name': self._law.name,
                'digest': self._law.digest,
                'memory': memory,
            }
        return {**self.state().as_dict(), 'gap_control': stored}

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
        rig._run, rig._waves = copy_of(state.run), [Wave(a) for a in state.angles]
        rig._acts, rig._unreported = [], list(state.unreported)
        rig._play(state.playbacks)
        kept = state.run
        begin_flight(rig._moving())
        rig._run.searched, rig._run.crossing_side = kept.searched, kept.crossing_side
        rig._run.watched, rig._run.crossing = kept.watched, kept.crossing
        rig._run.counted_from = kept.now
        rig._run.counted = (kept.now - kept.time) - kept.time_low
        rig._gap_control, rig._control = _restored_control(control, rig)
        return rig


def own_law_of(law: Law | None) -> OwnLaw | None:
    """Return a law of the user's own, with its name."""
    return law if law is None or isinstance(law, OwnLaw) else OwnLaw(law)


def _restored_control(
    stored: dict[str, Any] | None, rig: RigState
) -> tuple[GapControlParameters, Control]:
    """Return the control of a snapshot; off, if it has none."""
    try:
        parameters = GapControlParameters(**(stored['parameters'] if stored else {}))
        control = control_of(parameters, rig.parameters, rig.own_law)
        if stored is None:
            return parameters, control
        control = control.restore(stored['state'])
        kept = stored.get('law')
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
