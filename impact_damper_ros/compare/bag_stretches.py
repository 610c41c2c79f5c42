"""
A bag as stretches with constant parameters, in arrays.

The run is cut where its parameters change and where it is reset, at the instants that the
snapshots or else the parameter events name. A pause is no cut: rig time stands still during it.

Memory stays bounded: of the joint states the last ones are kept, of very many impacts the first
and the last ones. The check of the flights, the envelope of X and the numbers over the whole
stretch see all of them, part by part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.messages import JointStateColumns, JointStateTable
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS, IMPACT_JOINTS, JOINTS
from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.replay.recorded_run import RecordedChange, RecordedRun
from impact_damper_ros.replay.recorded_snapshot import RecordedSnapshot
from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

from .flight_check import FaultSearch
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
    def of_dump(cls, values: Mapping[str, Any]) -> Self | None:
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
#: Harmonics of the force, times intervals, that are checked: those of a long multisine in part.
_MOST_LINES = 30_000_000


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

    The period of the joint states, in s, is learnt if it is 0. A recorder is `lossy` if it may
    have lost single messages unnoticed. With `checks`, the flights are checked against the
    equations of motion; `search` is the check.
    """

    def __init__(
        self,
        number: int,
        begins: Beginning,
        cause: str,
        start: float,
        rig: LoggedRig,
        state_period: float = 0.0,
        *,
        lossy: bool = False,
        checks: bool = True,
    ) -> None:
        self.search = None
        if rig.clock is not None and checks:
            closed_form = rig.stops_move or rig.parameters.multisine_level > 0.0
            self.search = FaultSearch(rig.clock, in_closed_form=closed_form)
        self._number, self._begins, self._cause, self._start = number, begins, cause, start
        self._rig, self._last_stop, self._end = rig, rig.last_stop, start
        self._states: list[RecordedStates] = []
        self._impacts: list[RecordedImpacts] = []
        self._first_impacts: list[RecordedImpacts] = []
        self._kept = self._kept_impacts = self._kept_first = 0
        self._state_count = self._impact_count = self._missing = 0
        self._state_period, self._lossy = state_period, lossy
        self._last_state: float | None = None
        self._gaps: list[tuple[float, float]] = []
        self._envelope = _Envelope()
        self._totals = SwingAndEnergy(rig.parameters, rig.clock)

    def take(
        self, states: RecordedStates, impacts: RecordedImpacts, *, final: bool = False
    ) -> None:
        """Take the next part."""
        knots = knots_of(self._rig.parameters, states, impacts, self._last_stop)
        lines = len(self._rig.parameters.harmonics[0])
        if self.search is not None and self.search.intervals * lines <= _MOST_LINES:
            self.search.take(knots, final=final)
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

    def finish(self, end: float | None = None) -> RecordedStretch:
        """Return the stretch."""
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
            lossy=self._lossy,
            gaps=tuple(self._gaps),
            envelope=self._envelope.finish(),
            overall=self._totals.overall(end - self._start),
        )


# The messages of one topic


_STOPS = {'stop_1': 1.0, 'stop_2': 2.0}


def _some(table: JointStateTable, rows: slice | NDArray[np.bool_]) -> JointStateTable:
    return JointStateTable(table.stamps_ns[rows], table.numbers[rows], table.frames[rows], ())


class _TopicReader:
    """Reads the messages of one topic as columns, sorted by rig time, ns."""

    def __init__(self, joints: Sequence[tuple[str, ...]], counts: tuple[int, int, int]) -> None:
        # The first reasons, and numbers of messages: unreadable, with NaN or infinite numbers,
        # and twice or after a later one had been passed on
        self.unreadable: list[str] = []
        self.unreadable_count = self.not_numbers = self.misplaced = 0
        self._columns = JointStateColumns(joints, counts)
        self._contents: list[bytes] = []
        self._offset_ns = 0
        self._rows = self._columns.read([])
        self._taken_ns: int | None = None

    @property
    def unread(self) -> int:
        """Number of messages that wait to be read."""
        return len(self._contents)

    def put(self, content: bytes, offset_ns: int) -> None:
        """Take a message; rig time is its stamp less the offset."""
        if offset_ns != self._offset_ns:
            self.read()
            self._offset_ns = offset_ns
        self._contents.append(content)

    def read(self) -> None:
        """Read the messages that wait."""
        contents, self._contents = self._contents, []
        if not contents:
            return
        table = self._columns.read(contents)
        self.unreadable_count += len(table.unreadable)
        self.unreadable += [reason for _, reason in table.unreadable[: 3 - len(self.unreadable)]]
        finite = np.isfinite(table.numbers).all(axis=1)
        self.not_numbers += int((~finite).sum())
        held = self._rows
        time = np.concatenate([held.stamps_ns, table.stamps_ns[finite] - self._offset_ns])
        numbers = np.concatenate([held.numbers, table.numbers[finite]])
        frames = np.concatenate([held.frames, table.frames[finite]])
        order = np.argsort(time, kind='stable')
        time, numbers, frames = time[order], numbers[order], frames[order]
        keep = np.ones(len(time), dtype=np.bool_)
        same = time[1:] == time[:-1]
        impacts = any(frame in _STOPS for frame in self._columns.frames)
        if impacts:
            # Chatters may have several impacts in a nanosecond, but the same one twice only if
            # something is done to the rig between, where what waits is read.
            new = order >= len(held.stamps_ns)
            same &= (numbers[1:] == numbers[:-1]).all(axis=1) & new[1:] & new[:-1]
        keep[1:] &= ~same
        if self._taken_ns is not None:
            keep &= time >= self._taken_ns + (not impacts)
        self.misplaced += int((~keep).sum())
        self._rows = _some(JointStateTable(time, numbers, frames, ()), keep)

    def take(self, until_ns: int | None) -> JointStateTable:
        """Hand out the rows read up to an instant, inclusive; all of them if it is None."""
        count = len(self._rows.stamps_ns)
        if until_ns is not None:
            count = int(np.searchsorted(self._rows.stamps_ns, until_ns, side='right'))
        taken = _some(self._rows, slice(count))
        self._rows = _some(self._rows, slice(count, None))
        if count:
            self._taken_ns = int(taken.stamps_ns[-1])
        return taken

    def drop(self, instant_ns: int) -> None:
        """Drop the row at an instant: it may be from before or after a change."""
        self._rows = _some(self._rows, self._rows.stamps_ns != instant_ns)

    def stops(self, table: JointStateTable) -> Array:
        """Return the stop that the frame of each impact names."""
        stops: Array = np.array(
            [_STOPS.get(frame, 0.0) for frame in self._columns.frames] or [0.0]
        )
        return stops[table.frames]

    def faults(self) -> list[str]:
        """Return the faults of the messages."""
        found = []
        if self.unreadable_count:
            first = self.unreadable[0]
            found.append(f'that cannot be read: {self.unreadable_count} (the first: {first})')
        if self.not_numbers:
            found.append(f'with NaN or infinite numbers, left out: {self.not_numbers}')
        if self.misplaced:
            found.append(f'with stamps from before others, or twice, left out: {self.misplaced}')
        return found


# The bag


#: Messages that are read at once.
_BATCH = 16_384
_NEVER_NS = 2**62


class CheckedStretch(NamedTuple):
    """A stretch, and the check of its flights."""

    stretch: RecordedStretch
    search: FaultSearch | None


class BagStretches:
    """
    Reads the stretches of a bag; iterate over it once.

    `parameters` are those of the rig, for a bag that does not name them. Raises `RecordingError`
    if the bag cannot be read, or holds no rig.
    """

    def __init__(
        self,
        path: Path,
        node: str | None = None,
        parameters: RigParameters | None = None,
    ) -> None:
        self.recorded = RecordedRun(path, node, purpose='compare', snapshot_needed=False)
        #: How many were read so far
        self.samples = self.impacts = 0
        #: Rig times of the first and last joint state
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        #: Whether the flights are checked against the equations of motion
        self.checks = True
        #: Called now and then with the rig time reached, s
        self.progress: Callable[[float], object] = float
        self._given, self._snapshots = parameters, 0
        self._pauses = self._slips = self._unlogged = self._early = 0
        self._faults: list[str] = []
        self._states = _TopicReader((JOINTS, AXIS_JOINTS), (4, 4, 0))
        self._hits = _TopicReader((IMPACT_JOINTS,), (2, 2, 2))
        self._offset_ns = self.recorded.start.offset_ns
        self._period = 0.0
        self._pending: list[RecordedChange] = []
        self._announced: set[str] = set()
        # Whether the parameter events of this node are recorded
        self._hears = False
        self._builder: StretchBuilder | None = None
        self._number = 0
        self._begins, self._causes = Beginning.START, ['start of the bag']
        self._cut_ns: int | None = None
        self._rig = LoggedRig(parameters) if parameters is not None else None
        start = self.recorded.start
        if start.reason in ('record', 'start'):
            # Announced where nothing changes: it holds for what came before, too.
            self._rig = self._rig_of(start)

    def _rig_of(self, snapshot: RecordedSnapshot) -> LoggedRig:
        try:
            return LoggedRig.of_snapshot(snapshot.state)
        except (ValueError, TypeError, KeyError) as error:
            cause = (
                f'its snapshot at rig time {snapshot.time_ns / 1e9:.9g} s cannot be used: {error}'
            )
            remedy = 'use the version of impact_damper_ros that recorded the bag'
            raise RecordingError('compare', self.recorded.reader.path, cause, remedy) from error

    def __iter__(self) -> Iterator[CheckedStretch]:
        """Read the bag; yield each stretch as soon as it ends."""
        topics = self.recorded.topics
        readers = {topics.joint_states: self._states, topics.impacts: self._hits}
        for item in self.recorded.walk(early=True):
            if isinstance(item, list):
                for record in item:
                    if self._pending and record.stamp_ns > self._pending[-1].stamp_ns:
                        yield from self._carry_out()
                    reader = readers.get(record.topic)
                    if reader is not None:
                        reader.put(record.content, self._offset_ns)
                        if reader.unread >= _BATCH:
                            self._hand_on()
            elif isinstance(item, RecordedChange):
                self._take_change(item)
            else:
                yield from self._take_snapshot(item)
        yield from self._carry_out()
        yield from self._end_stretch(None)
        if self._rig is None:
            cause = 'it does not hold the parameters of the rig: no snapshot, and no list of all'
            remedy = 'record the topic snapshot too, or give the rig with --params FILE.yaml'
            raise RecordingError('compare', self.recorded.reader.path, cause, remedy)

    def faults(self) -> list[str]:
        """Return why the bag could be used in part only, after it was read."""
        found = [*self.recorded.faults(), *self._faults]
        topics = self.recorded.topics
        for topic, reader in ((topics.joint_states, self._states), (topics.impacts, self._hits)):
            found += [f'messages of {topic} {text}' for text in reader.faults()]
        if self._unlogged:
            found.append(
                f'{self._unlogged} changes of parameters that the snapshots show have no '
                'parameter event'
            )
        return found

    def remarks(self) -> list[str]:
        """Return other facts about the recording, after it was read."""
        found = self.recorded.remarks()
        if not self.recorded.topics.impacts:
            found.append('the topic of the impacts was not recorded: there are only samples')
        for count, what in (
            (self._pauses, 'the rig was paused {}; rig time did not advance meanwhile'),
            (self._slips, 'the machine stalled {}, and the stamps were moved on'),
        ):
            if count:
                found.append(what.format('once' if count == 1 else f'{count} times'))
        if self._given is not None and self._snapshots:
            found.append('the bag holds the parameters of its rig: --params was not used')
        if self._early:
            found.append(
                f'{self._early} messages from before the parameters are known were left out'
            )
        return found

    # What is done to the rig

    def _take_change(self, change: RecordedChange) -> None:
        self._hears = True
        rate = change.values.get('state_rate')
        if isinstance(rate, float) and rate > 0.0:
            self._period = 1.0 / rate
        if change.dump:
            if self._rig is None:
                self._rig = LoggedRig.of_dump(change.values)
            return
        self._announced |= change.values.keys()
        if change.exact and any(name in PARAMETER_SPECS for name in change.values):
            # All that came before it happened before it.
            self._hand_on()
            self._pending.append(change)

    def _carry_out(self) -> Iterator[CheckedStretch]:
        """Carry out changes that no snapshot followed."""
        pending, self._pending = self._pending, []
        for change in pending:
            if self._rig is None:
                continue
            at_ns = change.stamp_ns - self._offset_ns
            try:
                rig = self._rig.changed(change.values, at_ns / 1e9)
            except ParameterError as error:
                self._faults.append(f'the change at rig time {at_ns / 1e9:.9g} s: {error}')
                continue
            if self._rig.changed_names(rig):
                yield from self._cut(at_ns, Beginning.CHANGE, rig)

    def _take_snapshot(self, snapshot: RecordedSnapshot) -> Iterator[CheckedStretch]:
        rig = self._rig_of(snapshot)
        self._snapshots += 1
        self._pauses += snapshot.reason == 'resume'
        self._slips += snapshot.reason == 'slip'
        if not self._pending:
            self._hand_on()
        self._pending = []
        announced, self._announced = self._announced, set()
        names = set() if self._rig is None else self._rig.changed_names(rig)
        if self._rig is None:
            # What came before the parameters are known is left out.
            for reader in (self._states, self._hits):
                reader.read()
                self._early += len(reader.take(None).stamps_ns)
            self._rig = rig
        elif self._rig.clock is None and not names and self._builder is None:
            self._rig = rig
        else:
            if names - announced and self.recorded.stamped and self._hears:
                self._unlogged += 1
            if names or snapshot.reason == 'reset':
                begins = {'reset': Beginning.RESET, 'resume': Beginning.RESUME}
                yield from self._cut(
                    snapshot.time_ns, begins.get(snapshot.reason, Beginning.CHANGE), rig
                )
            else:
                # Parameters of a control that is off may have changed.
                self._rig = replace(self._rig, control=rig.control)
        self._offset_ns = snapshot.offset_ns

    def _cut(self, time_ns: int, begins: Beginning, rig: LoggedRig) -> Iterator[CheckedStretch]:
        """End the present stretch at an instant, and begin the next one."""
        assert self._rig is not None
        cause = 'reset' if begins is Beginning.RESET else ''
        cause = ', '.join(filter(None, [cause, self._rig.differences(rig)]))
        yield from self._end_stretch(time_ns)
        if self._cut_ns != time_ns or self._builder is not None:
            self._causes = []
        self._causes.append(cause)
        self._begins, self._rig, self._cut_ns = begins, rig, time_ns

    # What the rig does

    def _hand_on(self) -> None:
        """Pass the waiting messages to the present stretch."""
        for reader in (self._states, self._hits):
            reader.read()
        if self._rig is None:
            return
        if not self.recorded.stamped and self._cut_ns is not None and self._builder is None:
            # A joint state of that instant may be from before the change, or from after it.
            self._states.drop(self._cut_ns)
        states = self._states.take(None)
        if len(states.stamps_ns):
            self._give(states, self._hits.take(int(states.stamps_ns[-1])))

    def _give(self, states: JointStateTable, impacts: JointStateTable) -> None:
        times_ns, hits_ns = states.stamps_ns, impacts.stamps_ns
        if self._builder is None:
            first_ns = [int(stamps[0]) for stamps in (times_ns, hits_ns) if len(stamps)]
            if not first_ns:
                return
            self._builder = self._begun(min(first_ns))
        self.samples += len(times_ns)
        self.impacts += len(hits_ns)
        if len(times_ns):
            self.start_ns = int(times_ns[0]) if self.start_ns is None else self.start_ns
            self.end_ns = int(times_ns[-1])
            self.progress(self.end_ns / 1e9)
        assert self._rig is not None
        # Recorded positions count from that of M without weight, those here from its equilibrium.
        rest = self._rig.parameters.static_deflection
        x, z, stop_1, stop_2 = states.numbers[:, :4].T - rest
        velocity, damper_velocity, *stop_velocities = states.numbers[:, 4:8].T
        hit_x, hit_z = impacts.numbers[:, :2].T - rest
        self._builder.take(
            RecordedStates(
                times_ns / 1e9, x, velocity, z, damper_velocity, stop_1, stop_2, *stop_velocities
            ),
            RecordedImpacts(
                hits_ns / 1e9, self._hits.stops(impacts), hit_x, hit_z, *impacts.numbers[:, 2:6].T
            ),
        )

    def _begun(self, first_ns: int) -> StretchBuilder:
        """Begin a stretch."""
        rig = self._rig
        assert rig is not None
        self._number += 1
        start_ns = first_ns if self._cut_ns is None else self._cut_ns
        return StretchBuilder(
            self._number,
            self._begins,
            ', '.join(dict.fromkeys(filter(None, self._causes))) or self._begins.value,
            start_ns / 1e9,
            rig,
            self._period,
            lossy=not self.recorded.stamped,
            checks=self.checks,
        )

    def _end_stretch(self, time_ns: int | None) -> Iterator[CheckedStretch]:
        """End the present stretch, if there is one."""
        if time_ns is None:
            self._hand_on()
        if self._rig is not None:
            # Impacts between the last joint state and the end
            self._hits.read()
            until_ns = None if time_ns is None else time_ns - 1
            self._give(self._states.take(-_NEVER_NS), self._hits.take(until_ns))
        if self._builder is not None:
            builder, self._builder = self._builder, None
            builder.take(RecordedStates.none(), RecordedImpacts.none(), final=True)
            end = None if time_ns is None else time_ns / 1e9
            yield CheckedStretch(builder.finish(end), builder.search)
