# SPDX-License-Identifier: Apache-2.0
"""
A run as stretches with constant parameters.

A run is cut where its parameters change and where it is reset. A pause is no cut: rig time stands
still during it. The motion is that of the replay, with the full digits; of a bag without a
snapshot, which cannot be replayed, it is that of the recorded numbers.

Memory stays bounded: the last flights and samples are kept. The envelope of X and the numbers over
the whole stretch see all of them, part by part.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import STICK
from impact_damper_ros.orbits.flight_arrays import (
    SAMPLE,
    STATE,
    Drive,
    Flights,
    Integrals,
    rows_of_samples,
)
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import (
    GAP_CONTROL_SPECS,
    PARAMETER_SPECS,
    RigParameters,
)
from impact_damper_ros.replay import RecordedRun, Replay, Rows
from impact_damper_ros.replay.command import Command
from impact_damper_ros.replay.replay import Step
from impact_damper_ros.replay.rows import (
    NO_EVENTS,
    NO_SAMPLES,
    Events,
    Samples,
    impacts_of,
    recorded_impacts,
    recorded_samples,
    samples_as_rows,
)
from impact_damper_ros.replay.run import StatedParameters
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.rig.stepped_sine import frequency_at, frequency_steps

from .drive import fitted_drive
from .result import Array, Beginning, LoggedStretch, Overall

# The rig


@dataclass(frozen=True)
class LoggedRig:
    """A rig as logged."""

    parameters: RigParameters
    control: Mapping[str, Any] = field(default_factory=lambda: {'gap_control': 'off'})
    #: Its snapshot; None if the bag has none.
    state: Mapping[str, Any] | None = None

    @classmethod
    def of_listing(cls, values: Mapping[str, Any]) -> Self | None:
        """Return the rig of a list of all parameters; None if it lacks some."""
        if not values.keys() >= PARAMETER_SPECS.keys():
            return None
        return cls(RigParameters(**{n: values[n] for n in PARAMETER_SPECS}), _control_of(values))

    @classmethod
    def of_snapshot(cls, state: Mapping[str, Any]) -> Self:
        """Return the rig of a snapshot."""
        parameters = Snapshot.from_dict(dict(state)).parameters
        return cls(parameters, _control_of(state['gap_control']['parameters']), state)

    def changed_names(self, other: LoggedRig) -> set[str]:
        """Return the names of the parameters in which another rig differs."""
        before, after = self.parameters.as_dict(), other.parameters.as_dict()
        names = {name for name in before if before[name] != after[name]}
        if self.control['gap_control'] == other.control['gap_control'] == 'off':
            # The parameters of a control that is off do not matter.
            return names
        # A list of all parameters of an older version knows no control.
        known = self.control.keys() & other.control.keys()
        return names | {name for name in known if self.control[name] != other.control[name]}

    def differences(self, other: LoggedRig) -> str:
        """Return in words how another rig differs from this one."""
        before = {**self.control, **self.parameters.as_dict()}
        after = {**other.control, **other.parameters.as_dict()}
        parts = []
        for name in sorted(self.changed_names(other)):
            spec = PARAMETER_SPECS.get(name)
            unit = f' {spec.unit}' if spec is not None and spec.unit else ''
            was, now = _shown(before.get(name)), _shown(after.get(name))
            parts.append(f'{name} = {now}{unit} (was {was}{unit})')
        return ', '.join(parts)


def _control_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the gap control in a set of parameters; off if they do not name it."""
    return {'gap_control': 'off', **{n: values[n] for n in GAP_CONTROL_SPECS if n in values}}


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(map(_shown, value))}]'
    return f'{value:.9g}' if isinstance(value, float) else str(value).lower()


# One stretch


_MOST_SAMPLES = _MOST_ROWS = 200_000
_MOST_PIECES = 2000
#: An interval longer than the usual one by this factor has missing samples.
_WIDE = 1.5
_LEARNT_FROM = 20
#: Error by the steps of the friction between samples, in (W h)^3.
_STEPS = 1.0 / 50.0

_least, _most = np.minimum.reduceat, np.maximum.reduceat


class Envelope:
    """Range of X in consecutive pieces; pairs are merged when there are too many."""

    def __init__(self) -> None:
        self._size = 1
        self._pieces, self._rest = np.empty((3, 0)), np.empty((2, 0))

    def take(self, time: Array, x: Array) -> None:
        """Take the next samples."""
        self._rest = np.concatenate([self._rest, [time, x]], axis=1)
        whole = self._rest.shape[1] // self._size * self._size
        if not whole:
            return
        (time, x), self._rest = self._rest[:, :whole], self._rest[:, whole:]
        starts = np.arange(0, whole, self._size)
        pieces = [time[starts], _least(x, starts), _most(x, starts)]
        self._pieces = np.concatenate([self._pieces, pieces], axis=1)
        while self._pieces.shape[1] > _MOST_PIECES:
            time, low, high = self._pieces
            starts = np.arange(0, len(time), 2)
            self._pieces = np.array([time[starts], _least(low, starts), _most(high, starts)])
            self._size *= 2

    def finish(self) -> Array:
        """Return the ranges; what does not fill a piece belongs to the last one."""
        (time, low, high), (times, x) = self._pieces, self._rest
        if not len(time):
            return np.array([times[:1], x[:1], x[:1]])
        if len(x):
            low[-1], high[-1] = min(low[-1], x.min()), max(high[-1], x.max())
        return self._pieces


@dataclass(frozen=True, kw_only=True)
class RecordedStretch(LoggedStretch):
    """A stretch of a run, with its motion."""

    flights: Flights  # the last ones
    samples: Samples  # the last ones
    counts: tuple[int, int, int]  # samples, missing samples, impacts
    envelope: Array  # of X, as of `StretchCurves`
    overall: Overall
    #: State of the rig at the end; empty if it was not replayed.
    at_end: Mapping[str, Any] = field(default_factory=dict)
    last: bool = False  # whether the run ends with it

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.end - self.start

    @property
    def drive(self) -> Drive | None:
        """The force; None if its phase is not known, or it is swept."""
        return self.flights.drive if self.parameters.sweep_mode == 'off' else None

    @property
    def controlled(self) -> bool:
        """Whether a control may move the stops."""
        return bool(self.control['gap_control'] != 'off')


class StretchBuilder:
    """
    Builds a stretch from its samples and events, part by part.

    A rig without a state is one as recorded: its samples begin flights, and the phase of its force
    is found from the first of them. The period of the samples, s, is learnt if it is 0.
    """

    def __init__(
        self,
        number: int,
        begins: Beginning,
        cause: str,
        start: float,
        rig: LoggedRig,
        period: float = 0.0,
    ) -> None:
        self._number, self._begins, self._cause, self._start = number, begins, cause, start
        self._rig, self._period, self._end = rig, period, start
        self._replayed = rig.state is not None
        self._samples: list[Samples] = []
        self._parts: list[Flights] = []
        self._count = self._missing = 0
        self._hits = [0, 0]
        self._impulses = [0.0, 0.0]
        self._last_time = math.nan
        self._envelope = Envelope()
        self._totals = Integrals(*[0.0] * len(Integrals._fields))
        self._largest, self._longest = math.nan, 0.0
        self._drive: Drive | None = None
        self._active = 0.0
        self._step = 0
        self._row = NO_EVENTS
        if rig.state is not None:
            snapshot = Snapshot.from_dict(dict(rig.state))
            self._step, self._active = snapshot.sweep.step, snapshot.run.force
            self._row = _state_row(rig.state)
            self._drive = _drive_of(snapshot, float(self._row['time'][0]))

    def take(self, samples: Samples, events: Events) -> None:
        """Take the next part."""
        hits = impacts_of(events)
        self._count += len(samples)
        for stop in (1, 2):
            self._hits[stop - 1] += int((hits['stop'] == stop).sum())
        total, largest = self._impulses
        impulses = hits['impulse']
        self._impulses = [
            total + float(impulses.sum()),
            max(largest, float(impulses.max(initial=0.0))),
        ]
        self._look_for_gaps(samples['time'])
        self._envelope.take(samples['time'], samples['x'])
        ends = [float(rows['time'][-1]) for rows in (samples, events) if len(rows)]
        self._end = max([self._end, *ends])
        if self._replayed:
            # The last sample ends a part without events.
            since = max(float(rows['time'][-1]) for rows in (events, self._row) if len(rows))
            late = samples[-1:][samples['time'][-1:] > since]
            self._follow(np.concatenate([events, rows_of_samples(late, STATE)]))
        else:
            if not self._parts:
                self._drive = fitted_drive(self._rig.parameters, samples)
            rows = np.concatenate([hits, rows_of_samples(samples)])
            # A sample shows the motion after an impact at the same instant.
            self._follow(rows[np.lexsort((rows['kind'] == SAMPLE, rows['time']))])
        self._samples.append(samples)
        _forget(self._samples, _MOST_SAMPLES)

    def _follow(self, rows: Events) -> None:
        """Take the flights up to the next rows."""
        rows = np.concatenate([self._row, rows])
        if len(rows) < 2:
            self._row = rows
            return
        parameters = self._rig.parameters
        more = range(self._step + 1, frequency_steps(parameters) + 1)
        steps = np.array([frequency_at(parameters, step) for step in more])
        flights = Flights.between(parameters, rows, self._drive, steps, self._active)
        self._active = float(flights.active[-1])
        if self._replayed and rows['time'][0] < self._start:
            # A recorder that joined later got an earlier snapshot.
            flights = flights.cut(self._start, math.inf)
        longest = math.inf
        if self._period and not self._replayed:
            longest = _WIDE * self._period
        found, largest = flights.measured(longest)
        self._totals = Integrals(*map(sum, zip(self._totals, found, strict=True)))
        self._largest = largest if math.isnan(self._largest) else max(self._largest, largest)
        spans = flights.spans[flights.spans <= longest]
        self._longest = max(self._longest, float(spans.max(initial=0.0)))
        self._parts.append(flights)
        _forget(self._parts, _MOST_ROWS)
        self._row = rows[-1:].copy()
        self._row['kind'] = STATE if self._replayed else SAMPLE
        self._row['mode'] = max(rows['mode'][-1], STICK * flights.together[-1])
        self._row['stop'] = flights.stop[-1]
        if len(steps):
            self._step += int((rows['kind'] == EventKind.FREQUENCY_STEP).sum())
            self._drive = flights.drive_after()

    def _look_for_gaps(self, time: Array) -> None:
        if not self._period and len(time) >= _LEARNT_FROM:
            self._period = float(np.median(np.diff(time)))
        steps = np.diff(time, prepend=self._last_time)
        self._last_time = float(time[-1]) if len(time) else self._last_time
        if self._period:
            wide = steps[steps > _WIDE * self._period]
            self._missing += int((np.round(wide / self._period) - 1).sum())

    def finish(
        self, end: float | None = None, at_end: Mapping[str, Any] | None = None
    ) -> RecordedStretch:
        """Return the stretch, up to an instant, s, at which the rig had a state if it is known."""
        if at_end and self._replayed:
            row = _state_row(at_end)
            if row['time'][0] > self._row['time'][0]:
                self._follow(row)
        elif self._replayed and end is not None and end > self._row['time'][0]:
            # The last flight goes on.
            rows = np.concatenate([self._row, self._row])
            rows['time'][1] = end
            flights = Flights.between(self._rig.parameters, rows, self._drive, active=self._active)
            self._follow(flights.state_at(0, end))
        end = self._end if end is None else end
        rig = self._rig.parameters
        still = Flights.between(rig, self._row, self._drive, active=self._active)
        parts = self._parts or [still]
        return RecordedStretch(
            number=self._number,
            start=self._start,
            end=end,
            begins=self._begins,
            cause=self._cause,
            parameters=self._rig.parameters,
            control=dict(self._rig.control),
            flights=Flights.joined(parts),
            samples=np.concatenate([NO_SAMPLES, *self._samples]),
            counts=(self._count, self._missing, sum(self._hits)),
            envelope=self._envelope.finish(),
            overall=self._overall(end - self._start, at_end),
            at_end=at_end or {},
        )

    def _overall(self, duration: float, at_end: Mapping[str, Any] | None) -> Overall:
        rig, totals = self._rig.parameters, self._totals
        accuracy = 0.0
        if not self._replayed and rig.friction * rig.gravity > 0.0:
            turned = max([rig.omega, *rig.harmonics[1]]) * self._longest
            accuracy = _STEPS * rig.mass_ratio * turned**3
        known = totals.covered > 0.0
        spent = math.nan
        if at_end and self._rig.state is not None:
            spent = _spent(at_end) - _spent(self._rig.state)
        return Overall(
            duration=duration,
            covered=totals.covered,
            x_max=self._largest,
            x_rms=math.sqrt(totals.squares / totals.covered) if known else math.nan,
            impacts=sum(self._hits),
            impacts_on_stop_1=self._hits[0],
            impacts_on_stop_2=self._hits[1],
            impact_energy=totals.impact_energy,
            impact_loss=totals.impact_loss,
            dashpot_energy=totals.dashpot,
            force_work=totals.force,
            active_work=totals.active,
            actuator_energy=spent,
            total_impulse=self._impulses[0],
            largest_impulse=self._impulses[1],
            accuracy=accuracy,
        )


def _drive_of(snapshot: Snapshot, time: float) -> Drive:
    """Return the force of a snapshot at an instant of its flight, s."""
    parameters, origin = snapshot.parameters, snapshot.run.time + snapshot.run.time_low
    rates = (frequency_at(parameters, snapshot.sweep.step), *parameters.harmonics[1][1:])
    pairs = zip(snapshot.angles, rates, strict=True)
    return Drive(time, tuple(angle + rate * (time - origin) for angle, rate in pairs), rates)


def builder_at(state: Mapping[str, Any], start: float = -math.inf) -> StretchBuilder:
    """Return the builder of a part of a run, given a state before it, from there or a start, s."""
    rig = LoggedRig.of_snapshot(state)
    return StretchBuilder(0, Beginning.START, '', max(start, float(state['time'])), rig)


def _spent(state: Mapping[str, Any]) -> float:
    """Return the energy that the actuators of the stops have spent up to a snapshot, J."""
    actuators = state['gap_control']['state']['actuators']
    return float(actuators['energy_1'] + actuators['energy_2'])


def _state_row(state: Mapping[str, Any]) -> Events:
    """Return the state of a snapshot as a row."""
    rig = Rig.resume(Snapshot.from_dict(dict(state)))
    row = rows_of_samples(samples_as_rows([rig.sample()]), STATE)
    row['mode'], row['stop'] = rig.mode, rig.state().run.last_stop
    return row


def _forget(parts: list[Any], most: int) -> None:
    """Forget the first parts, as long as the others have enough rows."""
    while sum(map(len, parts[1:])) >= most:
        parts.pop(0)


# The run


class _Piece(NamedTuple):
    """A piece of a run, and the rig from its end on if that is another one."""

    samples: Samples
    events: Events
    time_ns: int = 0
    rig: LoggedRig | None = None
    begins: Beginning = Beginning.CHANGE
    before: Mapping[str, Any] = {}
    steps: Sequence[tuple[int, Step]] = ()


def _begins(command: Command) -> Beginning:
    if command.resets:
        return Beginning.RESET
    return Beginning.RESUME if command.reason == 'resume' else Beginning.CHANGE


def _replayed_pieces(replay: Replay) -> Iterator[_Piece]:
    """Yield the pieces of a replayed run."""
    for part in replay:
        command, rig = part.command, None
        if command is not None:
            rig = LoggedRig.of_snapshot(command.state)
        piece = _Piece(part.samples, part.events, before=part.before, steps=part.steps)
        if command is not None:
            piece = piece._replace(time_ns=command.time_ns, rig=rig, begins=_begins(command))
        yield piece


class RecordedPieces:
    """
    The pieces of a run without a snapshot, as recorded; iterate over it once.

    `parameters` are those of the rig, for a bag that does not name them.
    """

    def __init__(self, recorded: RecordedRun, parameters: RigParameters | None) -> None:
        self._recorded = recorded
        self.rig = LoggedRig(parameters) if parameters is not None else None
        self.faults: list[str] = []
        #: Messages from before the parameters are known
        self.early = 0
        self.samples = self.impacts = 0
        self.period = 0.0
        self._last_ns = -(2**62)

    def __iter__(self) -> Iterator[_Piece]:
        for item in self._recorded.walk():
            if isinstance(item, StatedParameters):
                rate = item.values.get('state_rate')
                self.period = 1.0 / rate if isinstance(rate, float) and rate > 0.0 else self.period
                if item.listing:
                    self.rig = self.rig or LoggedRig.of_listing(item.values)
                elif self.rig is not None and item.values.keys() & PARAMETER_SPECS.keys():
                    yield from self._change(item)
            elif isinstance(item, Rows) and self.rig is not None:
                yield self._piece(item, self.rig.parameters)
            elif isinstance(item, Rows):
                self.early += sum(map(len, item))

    def _change(self, stated: StatedParameters) -> Iterator[_Piece]:
        assert self.rig is not None
        named = {n: value for n, value in stated.values.items() if n in PARAMETER_SPECS}
        try:
            rig = replace(self.rig, parameters=self.rig.parameters.replace(**named))
        except ParameterError as error:
            self.faults.append(f'the change at stamp {stated.stamp_ns} ns: {error}')
            return
        if self.rig.changed_names(rig):
            self.rig = rig
            yield _Piece(NO_SAMPLES, NO_EVENTS, stated.stamp_ns, rig)

    def _piece(self, rows: Rows, rig: RigParameters) -> _Piece:
        states, impacts = (
            held[np.isfinite(held['numbers']).all(axis=1)] for held in (rows.states, rows.impacts)
        )
        states = states[np.diff(states['stamp_ns'], prepend=self._last_ns) > 0]
        self._last_ns = int(states['stamp_ns'][-1]) if len(states) else self._last_ns
        self.samples += len(states)
        self.impacts += len(impacts)
        return _Piece(
            recorded_samples(states, rig, states['stamp_ns'] / 1e9),
            recorded_impacts(impacts, rig, impacts['stamp_ns'] / 1e9),
        )


class Stretches:
    """The stretches of a run; iterate over it once."""

    def __init__(self, source: Replay | RecordedPieces) -> None:
        self._source = source
        self._number = 0
        self._builder: StretchBuilder | None = None
        self._begins, self._causes = Beginning.START, ['start of the bag']
        self._cut: float | None = None
        self._rig: LoggedRig | None = None
        #: Rig times of the first and last sample, s; NaN without any
        self.start = self.end = math.nan
        #: Changes and resets so far, each with its rig time, ns; of a replayed run
        self.steps: list[tuple[int, Step]] = []

    def __iter__(self) -> Iterator[RecordedStretch]:
        """Yield each stretch as soon as it ends."""
        source = self._source
        before: Mapping[str, Any] = {}
        if isinstance(source, Replay):
            self._rig = LoggedRig.of_snapshot(source.start.state)
        for piece in _replayed_pieces(source) if isinstance(source, Replay) else source:
            if isinstance(source, RecordedPieces) and self._rig is None:
                self._rig = source.rig
            before = piece.before or before
            self.steps += piece.steps
            time = piece.time_ns / 1e9 if piece.rig is not None else math.inf
            early = piece.events['time'] < time
            self._take(piece.samples, piece.events[early])
            if piece.rig is not None:
                yield from self._change(piece, piece.rig)
                self._take(piece.samples[:0], piece.events[~early])
        if self._builder is not None:
            yield replace(self._builder.finish(at_end=before), last=True)

    def _change(self, piece: _Piece, rig: LoggedRig) -> Iterator[RecordedStretch]:
        assert self._rig is not None
        if not (self._rig.changed_names(rig) or piece.begins is Beginning.RESET):
            # Parameters of a control that is off may have changed.
            self._rig = replace(self._rig, control=rig.control)
            return
        time = piece.time_ns / 1e9
        begun, self._builder = self._builder, None
        if begun is not None:
            yield begun.finish(time, piece.before)
        if self._cut != time or begun is not None:
            self._causes = []
        cause = 'reset' if piece.begins is Beginning.RESET else ''
        self._causes.append(', '.join(filter(None, [cause, self._rig.differences(rig)])))
        self._begins, self._rig, self._cut = piece.begins, rig, time

    def _take(self, samples: Samples, events: Events) -> None:
        first = [float(rows['time'][0]) for rows in (samples, events) if len(rows)]
        if not first:
            return
        if len(samples):
            self.start = float(samples['time'][0]) if math.isnan(self.start) else self.start
            self.end = float(samples['time'][-1])
        if self._builder is None:
            assert self._rig is not None
            self._number += 1
            self._builder = StretchBuilder(
                self._number,
                self._begins,
                ', '.join(dict.fromkeys(filter(None, self._causes))) or self._begins.value,
                min(first) if self._cut is None else self._cut,
                self._rig,
                self._source.period,
            )
        self._builder.take(samples, events)
