# SPDX-License-Identifier: Apache-2.0
"""
A run as stretches with constant parameters.

A run is cut where its parameters change and where it is reset. A pause is no cut: rig time stands
still during it. The motion is that of the replay, with the full digits.

Between two events the motion is a closed formula. Where a measured record acts on the rig, the
motion is known at samples and events only.

Memory stays bounded: the last flights and samples are kept. The envelope of X and the numbers over
the whole stretch see all of them, part by part.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.motion.state import STICK
from impact_damper_ros.orbits.flight_arrays import (
    STATE,
    Drive,
    Flights,
    FlightStart,
    rows_of_samples,
)
from impact_damper_ros.orbits.flight_integrals import Integrals
from impact_damper_ros.parameters.all_parameters import unit_of
from impact_damper_ros.parameters.quoting import setting
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.replay import RunPart
from impact_damper_ros.replay.command import Command
from impact_damper_ros.replay.rows import NO_SAMPLES, Events, Samples, impacts_of
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.snapshot import Snapshot
from impact_damper_ros.rig.stepped_sine import rig_at

from .result import Array, Beginning, LoggedStretch, Overall

# The rig


@dataclass(frozen=True)
class LoggedRig:
    """A rig as logged."""

    parameters: RigParameters
    #: Snapshot of the rig
    state: Mapping[str, Any]

    @classmethod
    def of_snapshot(cls, state: Mapping[str, Any]) -> Self:
        """Return the rig of a snapshot."""
        return cls(Snapshot.from_dict(dict(state)).parameters, state)

    @property
    def control(self) -> dict[str, Any]:
        """The parameters of its gap control."""
        return dict(self.state['gap_control']['parameters'])

    def changed_names(self, other: LoggedRig) -> set[str]:
        """Return the names of the parameters in which another rig differs."""
        before, after = self.parameters.as_dict(), other.parameters.as_dict()
        names = {name for name in before if before[name] != after[name]}
        if self.control['gap_control'] == other.control['gap_control'] == 'off':
            # The parameters of a control that is off do not matter.
            return names
        was, now = self.control, other.control
        return names | {name for name in was if was[name] != now[name]}

    def differences(self, other: LoggedRig) -> str:
        """Return in words how another rig differs from this one."""
        before = {**self.control, **self.parameters.as_dict()}
        after = {**other.control, **other.parameters.as_dict()}
        parts = []
        for name in sorted(self.changed_names(other)):
            now, was = (
                f'{setting(values.get(name), 9)} {unit_of(name, values)}'.rstrip()
                for values in (after, before)
            )
            parts.append(f'{name} = {now} (was {was})')
        return ', '.join(parts)


# One stretch


_MOST_SAMPLES = _MOST_ROWS = 200_000
_MOST_PIECES = 2000
#: An interval longer than the usual one by this factor has missing samples.
_WIDE = 1.5

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
        """Return the ranges; a rest that does not fill a piece belongs to the last one."""
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
    envelope: Array  # range of X, as in `StretchCurves`
    overall: Overall
    #: State of the rig at the end
    at_end: Mapping[str, Any] = field(default_factory=dict)

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.end - self.start

    @property
    def drive(self) -> Drive | None:
        """The force; None if it is swept, or a measured record acts, too."""
        return self.flights.drive if self.parameters.sweep_mode == 'off' else None

    @property
    def controlled(self) -> bool:
        """Whether a control may move the stops."""
        return bool(self.control['gap_control'] != 'off')


class StretchBuilder:
    """
    Builds a stretch from its samples and events, part by part.

    `period` is the time from one sample to the next, s; 0 if none can be missing.
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
        self._samples: list[Samples] = []
        self._parts: list[Flights] = []
        self._count = self._missing = 0
        self._hits = [0, 0]
        self._impulses = [0.0, 0.0]
        self._last_time = math.nan
        self._envelope = Envelope()
        self._totals = Integrals(*[0.0] * len(Integrals._fields))
        self._largest = math.nan
        snapshot = Snapshot.from_dict(dict(rig.state))
        self._sweep, self._active = snapshot.sweep, snapshot.run.force
        self._row = _state_row(rig.state)
        self._drive: Drive | None = None
        if not snapshot.playbacks:
            self._drive = _drive_of(snapshot, float(self._row['time'][0]))
        self._squares = 0.0

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
        self._squares += float(np.sum(samples['x'] ** 2))
        # The last sample ends a part without events.
        since = max(float(rows['time'][-1]) for rows in (events, self._row) if len(rows))
        states = samples[-1:][samples['time'][-1:] > since]
        if self._drive is None:
            states = samples[samples['time'] > self._row['time'][0]]
        rows = np.concatenate([events, rows_of_samples(states)])
        self._follow(rows[np.argsort(rows['time'], kind='stable')])
        self._samples.append(samples)
        _forget(self._samples, _MOST_SAMPLES)

    def _follow(self, rows: Events) -> None:
        """Take the flights up to the next rows."""
        rows = np.concatenate([self._row, rows])
        if len(rows) < 2:
            self._row = rows
            return
        parameters, steps = self._rig.parameters, None
        if parameters.sweep_mode != 'off':
            sweeps = [self._sweep]
            for _ in range((rows['kind'][1:] == EventKind.FREQUENCY_STEP).sum()):
                sweeps.append(sweeps[-1].following(parameters))
            steps = np.array([rig_at(parameters, s.step).first_harmonic for s in sweeps])
            self._sweep = sweeps[-1]
        flights = Flights.between(parameters, rows, self._drive, steps, self._active)
        self._active = float(flights.active[-1])
        if rows['time'][0] < self._start:
            # A recorder that joined later received an earlier snapshot.
            flights = flights.cut(self._start, math.inf)
        found, largest = flights.integrals()
        self._totals = Integrals(*map(sum, zip(self._totals, found, strict=True)))
        self._largest = largest if math.isnan(self._largest) else max(self._largest, largest)
        self._parts.append(flights)
        _forget(self._parts, _MOST_ROWS)
        self._row = rows[-1:].copy()
        self._row['kind'] = STATE
        self._row['mode'] = STICK * flights.together[-1]
        self._row['stop'] = flights.stop[-1]
        if steps is not None:
            self._drive = flights.drive_after()

    def _look_for_gaps(self, time: Array) -> None:
        steps = np.diff(time, prepend=self._last_time)
        self._last_time = float(time[-1]) if len(time) else self._last_time
        if self._period:
            wide = steps[steps > _WIDE * self._period]
            self._missing += int((np.round(wide / self._period) - 1).sum())

    def finish(
        self, end: float | None = None, at_end: Mapping[str, Any] | None = None
    ) -> RecordedStretch:
        """Return the stretch, up to an instant, s, and the state of the rig then, if known."""
        if at_end:
            row = _state_row(at_end)
            if row['time'][0] > self._row['time'][0]:
                self._follow(row)
        elif end is not None and end > self._row['time'][0] and self._drive is not None:
            # The last flight goes on.
            rows = np.concatenate([self._row, self._row])
            rows['time'][1] = end
            present = rig_at(self._rig.parameters, self._sweep.step)
            flights = Flights.between(present, rows, self._drive, active=self._active)
            self._follow(flights.state_at(0, end))
        end = self._end if end is None else end
        rig = rig_at(self._rig.parameters, self._sweep.step)
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
            flights=Flights.join(parts),
            samples=np.concatenate([NO_SAMPLES, *self._samples]),
            counts=(self._count, self._missing, sum(self._hits)),
            envelope=self._envelope.finish(),
            overall=self._overall(end - self._start, at_end),
            at_end=at_end or {},
        )

    def _overall(self, duration: float, at_end: Mapping[str, Any] | None) -> Overall:
        totals = self._totals
        x_rms = totals.x_rms
        if self._drive is None and self._count:
            x_rms = math.sqrt(self._squares / self._count)
        spent = math.nan
        if at_end:
            spent = _spent(at_end) - _spent(self._rig.state)
        return Overall(
            duration=duration,
            x_max=self._largest,
            x_rms=x_rms,
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
        )


def _drive_of(snapshot: Snapshot, time: float) -> Drive:
    """Return the force of a snapshot at an instant of its flight, s."""
    present = rig_at(snapshot.parameters, snapshot.sweep.step)
    origin, rates = snapshot.run.time + snapshot.run.time_low, present.harmonics[1]
    pairs = zip(snapshot.angles, rates, strict=True)
    return Drive(time, tuple(angle + rate * (time - origin) for angle, rate in pairs), rates)


def _spent(state: Mapping[str, Any]) -> float:
    """Return the energy that the actuators of the stops have spent up to a snapshot, J."""
    actuators = state['gap_control']['state']['actuators']
    return float(actuators['energy_1'] + actuators['energy_2'])


def _state_row(state: Mapping[str, Any]) -> Events:
    """Return the state of a snapshot as a row."""
    return FlightStart.of(Rig.resume(Snapshot.from_dict(dict(state)))).row


def _forget(parts: list[Any], most: int) -> None:
    """Drop the first parts, as long as the others have enough rows."""
    while sum(map(len, parts[1:])) >= most:
        parts.pop(0)


# The run


def _begins(command: Command) -> Beginning:
    if command.resets:
        return Beginning.RESET
    return Beginning.RESUME if command.reason == 'resume' else Beginning.CHANGE


class Stretches:
    """
    The stretches of a run, whose parts are taken one after the other.

    Parameters
    ----------
    state : mapping
        State of the rig at the start of the run.
    period : float, optional
        Time from one sample to the next, s; 0 if none can be missing.
    start : float, optional
        Rig time at which the stretches begin, s; the first sample or event by default.
    cuts : collection of float, optional
        Rig times of commands with which a stretch begins though nothing has changed, s.

    Attributes
    ----------
    start, end : float
        Rig times of the first and last sample, s; NaN without any.
    """

    def __init__(
        self,
        state: Mapping[str, Any],
        period: float = 0.0,
        start: float | None = None,
        cuts: Collection[float] = (),
    ) -> None:
        self._rig = LoggedRig.of_snapshot(state)
        self._period = period
        self._number = 0
        self._builder: StretchBuilder | None = None
        self._begins, self._causes = Beginning.START, ['start of the bag']
        self._cut = start
        self._cuts = cuts
        self._before: Mapping[str, Any] = {}
        self.start = self.end = math.nan

    def of(self, parts: Iterable[RunPart]) -> Iterator[RecordedStretch]:
        """Yield each stretch of a whole run as soon as it ends."""
        for part in parts:
            yield from self.take(part)
        yield from self.finish()

    def take(self, part: RunPart) -> Iterator[RecordedStretch]:
        """Take the next part of the run; yield the stretch that it ends, if it does."""
        command = part.command
        self._before = part.before or self._before
        early = part.events['time'] < (math.inf if command is None else command.time)
        self._continue(part.samples, part.events[early])
        if command is not None:
            yield from self._change(command)
            self._continue(part.samples[:0], part.events[~early])

    def finish(self) -> Iterator[RecordedStretch]:
        """Yield the last stretch."""
        if self._builder is not None:
            yield self._builder.finish(at_end=self._before)

    def _change(self, command: Command) -> Iterator[RecordedStretch]:
        rig, begins = LoggedRig.of_snapshot(command.state), _begins(command)
        cut = begins is Beginning.RESET or command.time in self._cuts
        if not (cut or self._rig.changed_names(rig)):
            # Parameters of a control that is off may have changed.
            self._rig = replace(self._rig, state=rig.state)
            return
        begun, self._builder = self._builder, None
        if begun is not None:
            yield begun.finish(command.time, self._before)
        if self._cut != command.time or begun is not None:
            self._causes = []
        cause = 'reset' if begins is Beginning.RESET else ''
        self._causes.append(', '.join(filter(None, [cause, self._rig.differences(rig)])))
        self._begins, self._rig, self._cut = begins, rig, command.time

    def _continue(self, samples: Samples, events: Events) -> None:
        first = [float(rows['time'][0]) for rows in (samples, events) if len(rows)]
        if not first:
            return
        if len(samples):
            self.start = float(samples['time'][0]) if math.isnan(self.start) else self.start
            self.end = float(samples['time'][-1])
        if self._builder is None:
            self._number += 1
            self._builder = StretchBuilder(
                self._number,
                self._begins,
                ', '.join(dict.fromkeys(filter(None, self._causes))) or self._begins.value,
                min(first) if self._cut is None else self._cut,
                self._rig,
                self._period,
            )
        self._builder.take(samples, events)
