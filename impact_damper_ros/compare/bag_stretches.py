"""
A bag as stretches with constant parameters, in arrays.

The run is cut where its parameters change and where it is reset, at the instants that the
snapshots, or else the parameter events, tell. A pause is no cut: rig time stands still meanwhile,
and so does the rig.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.rig_messages import IMPACT_JOINTS, JOINTS, JointStateColumns
from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.replay.recorded_run import RecordedChange, RecordedRun
from impact_damper_ros.replay.recorded_snapshot import RecordedSnapshot
from impact_damper_ros.rig import PARAMETER_SPECS, ParameterError, RigParameters
from impact_damper_ros.rig.simulator import Snapshot

from .fault_search import FaultSearch
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, RecordedStretch
from .run_comparison import Beginning
from .stretch_meter import StretchMeter

__all__ = [
    'BagRows',
    'BagStretches',
    'MeteredStretch',
    'RigAt',
    'Rows',
    'changed_names',
    'told_change',
]


#: Rig times in ns, stops (0 for joint states) and numbers of messages.
Rows = tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]


class BagRows:
    """
    The messages of one topic.

    Parameters
    ----------
    columns : JointStateColumns
        Reads them.

    Attributes
    ----------
    unreadable : list of str
        Why some could not be read; the first ones.
    unreadable_count, not_numbers, misplaced : int
        Messages that could not be read; that hold something that is no finite number; that came
        after a later one had been handed on, or twice.
    """

    def __init__(self, columns: JointStateColumns) -> None:
        self.unreadable: list[str] = []
        self.unreadable_count = self.not_numbers = self.misplaced = 0
        self._columns = columns
        self._contents: list[bytes] = []
        self._offset_ns = 0
        self._time = np.empty(0, dtype=np.int64)
        self._stop = np.empty(0)
        self._numbers = np.empty((0, 0))
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
        stops = np.array([_stop_of(frame) for frame in self._columns.frames] or [0.0])
        time = table.stamps_ns[finite] - self._offset_ns
        stop = stops[table.frames[finite]]
        numbers = table.numbers[finite]
        if len(self._time):
            time = np.concatenate([self._time, time])
            stop = np.concatenate([self._stop, stop])
            numbers = np.concatenate([self._numbers, numbers])
        order = np.argsort(time, kind='stable')
        time, stop, numbers = time[order], stop[order], numbers[order]
        keep = np.ones(len(time), dtype=np.bool_)
        # Chatters may have several impacts in a nanosecond, but never the same one twice.
        same = time[1:] == time[:-1]
        impacts = bool(stops.any())
        if impacts:
            same &= (numbers[1:] == numbers[:-1]).all(axis=1)
        keep[1:] &= ~same
        if self._taken_ns is not None:
            keep &= time >= self._taken_ns + (not impacts)
        self.misplaced += int((~keep).sum())
        self._time, self._stop, self._numbers = time[keep], stop[keep], numbers[keep]

    def take(self, until_ns: int | None) -> Rows:
        """Hand out the rows read up to an instant, inclusive; all of them if it is None."""
        count = len(self._time)
        if until_ns is not None:
            count = int(np.searchsorted(self._time, until_ns, side='right'))
        rows = self._time[:count], self._stop[:count], self._numbers[:count]
        self._time, self._stop = self._time[count:], self._stop[count:]
        self._numbers = self._numbers[count:]
        if count:
            self._taken_ns = int(rows[0][-1])
        return rows

    def drop(self, instant_ns: int) -> None:
        """Leave out a row of an instant: it may be from before or after what happened there."""
        kept = self._time != instant_ns
        self._time, self._stop = self._time[kept], self._stop[kept]
        self._numbers = self._numbers[kept]

    def faults(self) -> list[str]:
        """Return what was wrong with the messages."""
        found = []
        if self.unreadable_count:
            first = self.unreadable[0]
            found.append(f'that cannot be read: {self.unreadable_count} (the first: {first})')
        if self.not_numbers:
            found.append(f'with NaN or infinite numbers, left out: {self.not_numbers}')
        if self.misplaced:
            found.append(f'with stamps from before others, or twice, left out: {self.misplaced}')
        return found


def _stop_of(frame: str) -> float:
    """Return the stop that the frame of an impact names; 0 for joint states."""
    return {'stop_1': 1.0, 'stop_2': 2.0}.get(frame, 0.0)


_OFF = 'off'
_NO_CONTROL = {'gap_control': _OFF}


@dataclass(frozen=True)
class RigAt:
    """
    A rig as logged.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    clock : ForceClock or None
        The force; None if its phase is not known.
    last_stop : int
        Stop hit last, 0 for none.
    control : mapping of str to value
        Gap-control parameters.
    stops_move : bool
        Whether stops are on their way, moved by a control or back from there.
    """

    parameters: RigParameters
    clock: ForceClock | None = None
    last_stop: int = 0
    control: Mapping[str, Any] = field(default_factory=lambda: dict(_NO_CONTROL))
    stops_move: bool = False

    @classmethod
    def of_parameters(cls, parameters: RigParameters) -> Self:
        """Return a rig of which nothing else is known."""
        return cls(parameters)

    @classmethod
    def of_dump(cls, values: Mapping[str, Any]) -> Self | None:
        """Return the rig that a list of all parameters tells; None if it lacks some."""
        if not values.keys() >= PARAMETER_SPECS.keys():
            return None
        rig = RigParameters(**{n: values[n] for n in PARAMETER_SPECS})
        return cls(rig, control=_control_of(values))

    @classmethod
    def of_snapshot(cls, state: Mapping[str, Any]) -> Self:
        """Return the rig of a snapshot."""
        snapshot = Snapshot.from_dict(dict(state))
        origin = snapshot.origin
        time = origin.time + origin.time_low
        clock = None
        if snapshot.parameters.sweep_mode == 'off':
            clock = ForceClock(snapshot.parameters, time, tuple(origin.angles))
        stored = state.get('gap_control', {})
        control = _control_of(stored.get('parameters', {}))
        moving = _active(control) or bool(stored.get('state', {}).get('returning'))
        return cls(snapshot.parameters, clock, origin.last_stop, control, moving)

    def changed(self, values: Mapping[str, Any], time: float) -> RigAt:
        """Return the rig after a change at an instant, s; the harmonics keep their angles."""
        named = {name: value for name, value in values.items() if name in PARAMETER_SPECS}
        parameters = self.parameters.replace(**named)
        clock = self.clock
        if clock is not None:
            turned = clock.angles_at(np.array([time]))[:, 0] - clock.parameters.force_phases
            count = len(parameters.force_phases)
            angles = (*(float(angle) for angle in turned), *(0.0,) * count)[:count]
            clock = ForceClock(parameters, time, angles)
        return replace(self, parameters=parameters, clock=clock)

    def differences(self, other: RigAt) -> str:
        """Return in words what another rig has that this one has not."""
        parts = []
        for name in sorted(changed_names(self, other)):
            if name in PARAMETER_SPECS:
                unit = PARAMETER_SPECS[name].unit
                was, now = getattr(self.parameters, name), getattr(other.parameters, name)
            else:
                unit, was, now = '', self.control.get(name), other.control.get(name)
            unit = f' {unit}' if unit else ''
            parts.append(f'{name} = {_shown(now)}{unit} (was {_shown(was)}{unit})')
        return ', '.join(parts)


def _control_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the gap-control parameters among some; off, if there are none."""
    return {**_NO_CONTROL, **{n: values[n] for n in GAP_CONTROL_SPECS if n in values}}


def _active(control: Mapping[str, Any]) -> bool:
    return bool(control['gap_control'] != _OFF)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(_shown(entry) for entry in value)}]'
    return f'{value:.9g}' if isinstance(value, float) else str(value).lower()


def changed_names(one: RigAt, other: RigAt) -> set[str]:
    """Return the names of the parameters in which two rigs differ."""
    before, after = one.parameters.as_dict(), other.parameters.as_dict()
    names = {name for name in before if before[name] != after[name]}
    if not (_active(one.control) or _active(other.control)):
        # What the laws are set to does not matter then.
        return names
    # A list of all parameters of an older version knows no control.
    known = one.control.keys() & other.control.keys()
    return names | {n for n in known if one.control[n] != other.control[n]}


def told_change(values: Mapping[str, Any]) -> bool:
    """Return whether a parameter event changes the rig."""
    return any(name in PARAMETER_SPECS for name in values)


#: Messages that are read at once.
_BATCH = 16_384
_NEVER_NS = 2**62


class MeteredStretch(NamedTuple):
    """A stretch, and what was found when its flights were checked."""

    stretch: RecordedStretch
    search: FaultSearch | None


class BagStretches:
    """
    Reads the stretches of a bag; iterate over it once.

    Parameters
    ----------
    path : Path
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    parameters : RigParameters, optional
        The rig, for a bag that does not tell.

    Attributes
    ----------
    checks : bool
        Whether the flights are checked against the equations of motion.
    progress : callable
        Called now and then with the rig time reached, s.
    history : RecordedRun
        The bag.
    samples, impacts : int
        How many were read so far.
    start_ns, end_ns : int or None
        Rig times of the first and last joint state, ns.
    faults : list of str
        What was done to the rig and could not be understood.
    pauses, slips, unlogged, early : int
        Pauses; stalls of the machine; changes without a parameter event; messages from before the
        parameters are known.
    states_rows, impact_rows : BagRows
        The messages, with what was wrong with them.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or holds no rig.
    """

    def __init__(
        self,
        path: Path,
        node: str | None = None,
        parameters: RigParameters | None = None,
    ) -> None:
        self.history = RecordedRun(path, node, purpose='compare', snapshot_needed=False)
        self.samples = self.impacts = 0
        self.start_ns: int | None = None
        self.end_ns: int | None = None
        self.pauses = self.slips = self.unlogged = self.early = 0
        self._given, self._snapshots = parameters, 0
        self.faults: list[str] = []
        self.states_rows = BagRows(JointStateColumns(JOINTS, (4, 4, 0)))
        self.impact_rows = BagRows(JointStateColumns(IMPACT_JOINTS, (2, 2, 2)))
        self.checks = True
        self.progress: Callable[[float], object] = float
        self._offset_ns = self.history.start.offset_ns
        self._period = 0.0
        self._pending: list[RecordedChange] = []
        self._told: set[str] = set()
        # Whether the parameter events of this node are recorded
        self._hears = False
        self._meter: StretchMeter | None = None
        self._number = 0
        self._begins, self._causes = Beginning.START, ['start of the bag']
        self._cut_ns: int | None = None
        self._rig = RigAt.of_parameters(parameters) if parameters is not None else None
        start = self.history.start
        if start.reason in ('record', 'start'):
            # Announced where nothing changes: it holds for what came before, too.
            self._rig = self._rig_of(start)

    def _rig_of(self, snapshot: RecordedSnapshot) -> RigAt:
        try:
            return RigAt.of_snapshot(snapshot.state)
        except (ValueError, TypeError, KeyError) as error:
            cause = (
                f'its snapshot at rig time {snapshot.time_ns / 1e9:.9g} s is of no use: {error}'
            )
            remedy = 'use the version of impact_damper_ros that recorded the bag'
            raise RecordingError('compare', self.history.reader.path, cause, remedy) from error

    def __iter__(self) -> Iterator[MeteredStretch]:
        """Read the bag; the stretches come as soon as they end."""
        topics = self.history.topics
        kinds = {topics.joint_states: self.states_rows, topics.impacts: self.impact_rows}
        for item in self.history.walk(early=True):
            if isinstance(item, list):
                for record in item:
                    if self._pending and record.stamp_ns > self._pending[-1].stamp_ns:
                        yield from self._carry_out()
                    rows = kinds.get(record.topic)
                    if rows is not None:
                        rows.put(record.content, self._offset_ns)
                        if rows.unread >= _BATCH:
                            self._hand_on()
            elif isinstance(item, RecordedChange):
                self._take_change(item)
            else:
                yield from self._take_snapshot(item)
        yield from self._carry_out()
        yield from self._end_stretch(None)
        if self._rig is None:
            cause = 'it does not tell the parameters of the rig: no snapshot, and no list of all'
            remedy = 'record the topic snapshot too, or give the rig with --params FILE.yaml'
            raise RecordingError('compare', self.history.reader.path, cause, remedy)

    def all_faults(self) -> list[str]:
        """Return why the bag could be used in part only, after it was read."""
        found = [*self.history.faults(), *self.faults]
        topics = self.history.topics
        for topic, rows in (
            (topics.joint_states, self.states_rows),
            (topics.impacts, self.impact_rows),
        ):
            found += [f'messages of {topic} {text}' for text in rows.faults()]
        if self.unlogged:
            found.append(
                f'{self.unlogged} changes of parameters that the snapshots show have no '
                'parameter event'
            )
        return found

    def all_remarks(self) -> list[str]:
        """Return what else is to be known."""
        found = self.history.remarks()
        if not self.history.topics.impacts:
            found.append('the topic of the impacts was not recorded: there are only samples')
        for count, what in (
            (self.pauses, 'the rig was paused {}; rig time stood still meanwhile'),
            (self.slips, 'the machine stalled {}, and the stamps were moved on'),
        ):
            if count:
                found.append(what.format('once' if count == 1 else f'{count} times'))
        if self._given is not None and self._snapshots:
            found.append('the bag holds the parameters of its rig: --params was not used')
        if self.early:
            found.append(
                f'{self.early} messages from before the parameters are known were left out'
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
                self._rig = RigAt.of_dump(change.values)
            return
        self._told |= change.values.keys()
        if change.exact and told_change(change.values):
            # All that came before it happened before it.
            self._hand_on()
            self._pending.append(change)

    def _carry_out(self) -> Iterator[MeteredStretch]:
        """Carry out changes that no snapshot followed."""
        pending, self._pending = self._pending, []
        for change in pending:
            if self._rig is None:
                continue
            at_ns = change.stamp_ns - self._offset_ns
            try:
                rig = self._rig.changed(change.values, at_ns / 1e9)
            except ParameterError as error:
                self.faults.append(f'the change at rig time {at_ns / 1e9:.9g} s: {error}')
                continue
            if not changed_names(self._rig, rig):
                continue
            yield from self._cut(at_ns, Beginning.CHANGE, rig)

    def _take_snapshot(self, snapshot: RecordedSnapshot) -> Iterator[MeteredStretch]:
        rig = self._rig_of(snapshot)
        self._snapshots += 1
        self.pauses += snapshot.reason == 'resume'
        self.slips += snapshot.reason == 'slip'
        if not self._pending:
            self._hand_on()
        self._pending = []
        told, self._told = self._told, set()
        if self._rig is None:
            self._leave_out()
            self._rig = rig
        elif self._rig.clock is None and not changed_names(self._rig, rig) and self._meter is None:
            self._rig = rig
        else:
            names = changed_names(self._rig, rig)
            if names - told and self.history.stamped and self._hears:
                self.unlogged += 1
            if names or snapshot.reason == 'reset':
                begins = {'reset': Beginning.RESET, 'resume': Beginning.RESUME}
                yield from self._cut(
                    snapshot.time_ns, begins.get(snapshot.reason, Beginning.CHANGE), rig
                )
            else:
                # What a control that is off is set to may have changed.
                self._rig = replace(self._rig, control=rig.control)
        self._offset_ns = snapshot.offset_ns

    def _leave_out(self) -> None:
        """Leave out what came before the parameters are known."""
        for rows in (self.states_rows, self.impact_rows):
            rows.read()
            self.early += len(rows.take(None)[0])

    def _cut(self, time_ns: int, begins: Beginning, rig: RigAt) -> Iterator[MeteredStretch]:
        """End the present stretch at an instant, and begin the next one."""
        assert self._rig is not None
        cause = 'reset' if begins is Beginning.RESET else ''
        cause = ', '.join(filter(None, [cause, self._rig.differences(rig)]))
        yield from self._end_stretch(time_ns)
        if self._cut_ns != time_ns or self._meter is not None:
            self._causes = []
        self._causes.append(cause)
        self._begins, self._rig, self._cut_ns = begins, rig, time_ns

    # What the rig does

    def _hand_on(self) -> None:
        """Read the messages that wait, and give them to the present stretch."""
        for rows in (self.states_rows, self.impact_rows):
            rows.read()
        if self._rig is None:
            return
        if not self.history.stamped and self._cut_ns is not None and self._meter is None:
            # A joint state of that instant may be from before the change, or from after it.
            self.states_rows.drop(self._cut_ns)
        states = self.states_rows.take(None)
        if len(states[0]):
            self._give(states, self.impact_rows.take(int(states[0][-1])))

    def _give(self, states: Rows, impacts: Rows) -> None:
        time_ns = [int(rows[0][0]) for rows in (states, impacts) if len(rows[0])]
        if self._meter is None:
            if not time_ns:
                return
            self._meter = self._begun(min(time_ns))
        self.samples += len(states[0])
        self.impacts += len(impacts[0])
        if len(states[0]):
            self.start_ns = int(states[0][0]) if self.start_ns is None else self.start_ns
            self.end_ns = int(states[0][-1])
            self.progress(self.end_ns / 1e9)
        assert self._rig is not None
        rest = self._rig.parameters.static_deflection if self.history.start.version > 1 else 0.0
        self._meter.take(_states(states, rest), _impacts(impacts, rest))

    def _begun(self, first_ns: int) -> StretchMeter:
        """Begin a stretch."""
        rig = self._rig
        assert rig is not None
        self._number += 1
        start_ns = first_ns if self._cut_ns is None else self._cut_ns
        return StretchMeter(
            self._number,
            self._begins,
            ', '.join(dict.fromkeys(filter(None, self._causes))) or self._begins.value,
            start_ns / 1e9,
            rig.parameters,
            rig.control,
            rig.clock,
            rig.last_stop,
            self._period,
            lossy=not self.history.stamped,
            stops_move=rig.stops_move,
            checks=self.checks,
        )

    def _end_stretch(self, time_ns: int | None) -> Iterator[MeteredStretch]:
        """End the present stretch, if there is one."""
        if time_ns is None:
            self._hand_on()
        if self._rig is not None:
            # Between the last joint state and the end
            self.impact_rows.read()
            until_ns = None if time_ns is None else time_ns - 1
            self._give(self.states_rows.take(-_NEVER_NS), self.impact_rows.take(until_ns))
        if self._meter is not None:
            meter, self._meter = self._meter, None
            meter.take(RecordedStates.none(), RecordedImpacts.none(), final=True)
            end = None if time_ns is None else time_ns / 1e9
            yield MeteredStretch(meter.finish(end), meter.search)


def _states(rows: Rows, rest: float) -> RecordedStates:
    """Return joint states, given the recorded position of M in its static equilibrium, m."""
    time_ns, _, numbers = rows
    if not len(time_ns):
        return RecordedStates.none()
    x, z, stop_1, stop_2 = numbers[:, :4].T - rest
    velocity, damper_velocity, *stop_velocities = numbers[:, 4:8].T
    return RecordedStates(
        time_ns / 1e9, x, velocity, z, damper_velocity, stop_1, stop_2, *stop_velocities
    )


def _impacts(rows: Rows, rest: float) -> RecordedImpacts:
    """Return impacts; see `_states`."""
    time_ns, stop, numbers = rows
    if not len(time_ns):
        return RecordedImpacts.none()
    x, z = numbers[:, :2].T - rest
    return RecordedImpacts(time_ns / 1e9, stop, x, z, *numbers[:, 2:6].T)
