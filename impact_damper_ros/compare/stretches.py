"""
A run as stretches with constant parameters, in arrays.

A run is cut where its parameters change and where it is reset. A pause is no cut: rig time stands
still during it. The motion is that of the replay, with the full digits; of a bag without a
snapshot, which cannot be replayed, it is that of the recorded numbers.

Memory stays bounded: of the joint states the last ones are kept, of very many impacts the first
and the last ones. The envelope of X and the numbers over the whole stretch see all of them, part
by part.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, Self

import numpy as np

from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.replay import RecordedRun, Replay, Rows
from impact_damper_ros.replay.command import Command
from impact_damper_ros.replay.rows import (
    NO_EVENTS,
    NO_SAMPLES,
    Events,
    Samples,
    impacts_of,
    recorded_impacts,
    recorded_samples,
)
from impact_damper_ros.replay.run import StatedParameters
from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .measured_motion import SwingAndEnergy
from .recorded_stretch import (
    ForceClock,
    RecordedImpacts,
    RecordedStates,
    RecordedStretch,
    knots_of,
)
from .result import Array, Beginning, SwingEnvelope

# The rig


_OFF = 'off'
_NO_CONTROL = {'gap_control': _OFF}


@dataclass(frozen=True)
class LoggedRig:
    """
    A rig as logged.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    clock : ForceClock or None
        The force; None if its phase is not known, or its frequency is swept.
    last_stop : int
        Stop hit last, 0 for none.
    control : mapping of str to value
        Gap-control parameters.
    stops_move : bool
        Whether stops are moving, by a control or back to the gap.
    """

    parameters: RigParameters
    clock: ForceClock | None = None
    last_stop: int = 0
    control: Mapping[str, Any] = field(default_factory=lambda: dict(_NO_CONTROL))
    stops_move: bool = False

    @classmethod
    def of_listing(cls, values: Mapping[str, Any]) -> Self | None:
        """Return the rig of a list of all parameters; None if it lacks some."""
        if not values.keys() >= PARAMETER_SPECS.keys():
            return None
        rig = RigParameters(**{n: values[n] for n in PARAMETER_SPECS})
        return cls(rig, control=_control_of(values))

    @classmethod
    def of_snapshot(cls, state: Mapping[str, Any]) -> Self:
        """Return the rig of a snapshot."""
        snapshot = Snapshot.from_dict(dict(state))
        run, clock = snapshot.run, None
        if snapshot.parameters.sweep_mode == 'off':
            clock = ForceClock(snapshot.parameters, run.time + run.time_low, snapshot.angles)
        held = state['gap_control']
        control = _control_of(held['parameters'])
        moving = _active(control) or held['state']['returning']
        return cls(snapshot.parameters, clock, run.last_stop, control, moving)

    def changed(self, values: Mapping[str, Any], time: float) -> LoggedRig:
        """Return the rig after a change at an instant, s; the harmonics keep their angles."""
        named = {name: value for name, value in values.items() if name in PARAMETER_SPECS}
        parameters = self.parameters.replace(**named)
        clock = self.clock
        if clock is not None:
            turned = clock.angles_at(np.array([time]))[:, 0] - self.parameters.harmonics[2]
            before, own = len(self.parameters.force_phases), len(parameters.force_phases)
            lines = len(parameters.harmonics[2]) - own
            # By the index in the force arrays, and among the lines of a multisine
            parts = (turned[:before], own), (turned[before:], lines)
            angles = [(*part.tolist(), *[0.0] * count)[:count] for part, count in parts]
            swept = parameters.sweep_mode != 'off'
            clock = None if swept else ForceClock(parameters, time, angles[0] + angles[1])
        return replace(self, parameters=parameters, clock=clock)

    def changed_names(self, other: LoggedRig) -> set[str]:
        """Return the names of the parameters in which another rig differs."""
        before, after = self.parameters.as_dict(), other.parameters.as_dict()
        names = {name for name in before if before[name] != after[name]}
        if not (_active(self.control) or _active(other.control)):
            # The parameters of a control that is off do not matter.
            return names
        # A list of all parameters of an older version knows no control.
        known = self.control.keys() & other.control.keys()
        return names | {n for n in known if self.control[n] != other.control[n]}

    def differences(self, other: LoggedRig) -> str:
        """Return in words how another rig differs from this one."""
        parts = []
        for name in sorted(self.changed_names(other)):
            if name in PARAMETER_SPECS:
                unit = PARAMETER_SPECS[name].unit
                was, now = getattr(self.parameters, name), getattr(other.parameters, name)
            else:
                unit, was, now = '', self.control.get(name), other.control.get(name)
            unit = f' {unit}' if unit else ''
            parts.append(f'{name} = {_shown(now)}{unit} (was {_shown(was)}{unit})')
        return ', '.join(parts)


def _control_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the gap control in a set of parameters; off if they do not name it."""
    return {**_NO_CONTROL, **{n: values[n] for n in GAP_CONTROL_SPECS if n in values}}


def _active(control: Mapping[str, Any]) -> bool:
    return bool(control['gap_control'] != _OFF)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(_shown(entry) for entry in value)}]'
    return f'{value:.9g}' if isinstance(value, float) else str(value).lower()


# One stretch


_MOST_STATES = 200_000
_FIRST_IMPACTS, _LAST_IMPACTS = 100_000, 200_000
_MOST_PIECES = 2000
_MOST_GAPS = 1000
#: An interval longer than the usual one by this factor has missing samples.
_WIDE = 1.5
_LEARNT_FROM = 20


class _Envelope:
    """Range of X in consecutive pieces; pairs are merged when there are too many."""

    def __init__(self) -> None:
        self._size = 1
        self._time, self._low, self._high = (np.empty(0) for _ in range(3))
        self._rest: list[tuple[Array, Array]] = []
        self._waiting = 0

    def take(self, time: Array, x: Array) -> None:
        self._rest.append((time, x))
        self._waiting += len(time)
        if self._waiting >= self._size:
            self._put(self._waiting // self._size * self._size)

    def _put(self, count: int) -> None:
        time = np.concatenate([t for t, _ in self._rest])
        x = np.concatenate([x for _, x in self._rest])
        self._rest = [(time[count:], x[count:])]
        self._waiting = len(time) - count
        starts = np.arange(0, count, self._size)
        self._time = np.concatenate([self._time, time[starts]])
        self._low = np.concatenate([self._low, np.minimum.reduceat(x[:count], starts)])
        self._high = np.concatenate([self._high, np.maximum.reduceat(x[:count], starts)])
        while len(self._time) > _MOST_PIECES:
            starts = np.arange(0, len(self._time), 2)
            self._time = self._time[starts]
            self._low = np.minimum.reduceat(self._low, starts)
            self._high = np.maximum.reduceat(self._high, starts)
            self._size *= 2

    def finish(self) -> SwingEnvelope:
        if self._waiting:
            self._put(self._waiting)
        return SwingEnvelope(self._time, self._low, self._high)


class StretchBuilder:
    """
    Builds a stretch from its records, part by part.

    The period of the joint states, in s, is learnt if it is 0.
    """

    def __init__(
        self,
        number: int,
        begins: Beginning,
        cause: str,
        start: float,
        rig: LoggedRig,
        state_period: float = 0.0,
    ) -> None:
        self._number, self._begins, self._cause, self._start = number, begins, cause, start
        self._rig, self._last_stop, self._end = rig, rig.last_stop, start
        self._states: list[RecordedStates] = []
        self._impacts: list[RecordedImpacts] = []
        self._first_impacts: list[RecordedImpacts] = []
        self._kept = self._kept_impacts = self._kept_first = 0
        self._state_count = self._impact_count = self._missing = 0
        self._state_period = state_period
        self._last_state: float | None = None
        self._gaps: list[tuple[float, float]] = []
        self._envelope = _Envelope()
        self._totals = SwingAndEnergy(rig.parameters, rig.clock)

    def take(self, states: RecordedStates, impacts: RecordedImpacts) -> None:
        """Take the next part."""
        knots = knots_of(self._rig.parameters, states, impacts, self._last_stop)
        if len(impacts):
            self._last_stop = int(impacts.stop[-1])
        self._state_count += len(states)
        self._impact_count += len(impacts)
        self._look_for_gaps(states.time)
        self._totals.take(knots, impacts, _WIDE * self._state_period or math.inf)
        self._envelope.take(states.time, states.x)
        ends = [float(part.time[-1]) for part in (states, impacts) if len(part)]
        self._end = max([self._end, *ends])
        self._keep(states, impacts)

    def _look_for_gaps(self, time: Array) -> None:
        if not self._state_period and len(time) >= _LEARNT_FROM:
            self._state_period = float(np.median(np.diff(time)))
        if self._last_state is not None:
            time = np.concatenate([[self._last_state], time])
        if not self._state_period or not len(time):
            return
        self._last_state = float(time[-1])
        steps = np.diff(time)
        wide = np.flatnonzero(steps > _WIDE * self._state_period)
        self._missing += int((np.round(steps[wide] / self._state_period) - 1).sum())
        for index in wide[: _MOST_GAPS - len(self._gaps)]:
            self._gaps.append((float(time[index]), float(time[index + 1])))

    def _keep(self, states: RecordedStates, impacts: RecordedImpacts) -> None:
        self._states.append(states)
        self._kept += len(states)
        while self._kept - len(self._states[0]) >= _MOST_STATES:
            self._kept -= len(self._states.pop(0))
        if self._kept_first < _FIRST_IMPACTS:
            self._first_impacts.append(impacts)
            self._kept_first += len(impacts)
            return
        self._impacts.append(impacts)
        self._kept_impacts += len(impacts)
        while self._kept_impacts - len(self._impacts[0]) >= _LAST_IMPACTS:
            self._kept_impacts -= len(self._impacts.pop(0))

    def finish(
        self, end: float | None = None, at_end: Mapping[str, Any] | None = None
    ) -> RecordedStretch:
        """Return the stretch, up to an instant, s, at which the rig had a state if it is known."""
        end = self._end if end is None else end
        return RecordedStretch(
            number=self._number,
            start=self._start,
            end=end,
            begins=self._begins,
            cause=self._cause,
            parameters=self._rig.parameters,
            control=dict(self._rig.control),
            clock=self._rig.clock,
            states=RecordedStates.joined(self._states),
            impacts=RecordedImpacts.joined([*self._first_impacts, *self._impacts]),
            last_stop=self._rig.last_stop,
            state_count=self._state_count,
            impact_count=self._impact_count,
            missing_states=self._missing,
            gaps=tuple(self._gaps),
            envelope=self._envelope.finish(),
            overall=self._totals.overall(end - self._start),
            at_end=at_end or {},
        )


# The run


class _Piece(NamedTuple):
    """A piece of a run, and the rig from its end on if that is another one."""

    samples: Samples
    events: Events
    time_ns: int = 0
    rig: LoggedRig | None = None
    begins: Beginning = Beginning.CHANGE
    before: Mapping[str, Any] = {}


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
        piece = _Piece(part.samples, part.events, before=part.before)
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
                self.early += sum(table.size for table in item)

    def _change(self, stated: StatedParameters) -> Iterator[_Piece]:
        assert self.rig is not None
        try:
            rig = self.rig.changed(stated.values, stated.stamp_ns / 1e9)
        except ParameterError as error:
            self.faults.append(f'the change at stamp {stated.stamp_ns} ns: {error}')
            return
        if self.rig.changed_names(rig):
            self.rig = rig
            yield _Piece(NO_SAMPLES, NO_EVENTS, stated.stamp_ns, rig)

    def _piece(self, rows: Rows, rig: RigParameters) -> _Piece:
        states, impacts = (
            table[np.isfinite(table.numbers).all(axis=1)] for table in (rows.states, rows.impacts)
        )
        states = states[np.diff(states.stamp_ns, prepend=self._last_ns) > 0]
        self._last_ns = int(states.stamp_ns[-1]) if states.size else self._last_ns
        self.samples += states.size
        self.impacts += impacts.size
        return _Piece(
            recorded_samples(states, rig, states.stamp_ns / 1e9),
            recorded_impacts(impacts, rig, impacts.stamp_ns / 1e9),
        )


class Stretches:
    """
    The stretches of a run; iterate over it once.

    Attributes
    ----------
    start, end : float
        Rig times of the first and last sample, s; NaN without any.
    """

    def __init__(self, source: Replay | RecordedPieces) -> None:
        self._source = source
        self._number = 0
        self._builder: StretchBuilder | None = None
        self._begins, self._causes = Beginning.START, ['start of the bag']
        self._cut: float | None = None
        self._rig: LoggedRig | None = None
        self.start = self.end = math.nan

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
        hits = impacts_of(events)
        first = [float(rows['time'][0]) for rows in (samples, hits) if len(rows)]
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
        self._builder.take(RecordedStates.of_samples(samples), RecordedImpacts.of_rows(hits))
