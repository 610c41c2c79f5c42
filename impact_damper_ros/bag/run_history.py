"""
What a bag tells of one rig, in the order in which it happened.

A bag that the node wrote itself stamps every message with rig time, and holds the parameter events
at the very instants of the changes. One recorded by ``ros2 bag record`` is stamped with the times
of arrival, in which topics overtake each other; there the stamps in the messages give the order,
and the parameter events (of rclpy, with their own stamps) only tell what was changed one by one.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros.control import GAP_CONTROL_SPECS, completed
from impact_damper_ros.rig import INITIAL_SPECS, PARAMETER_SPECS
from impact_damper_ros.rig.published import FORMAT
from impact_damper_ros.rig.quoting import as_line, shown
from impact_damper_ros.rig.simulator import ARITHMETIC, FORMATS, upgraded

from .errors import RecordingError
from .messages import CdrError, Parameter, ParameterEvent, String, decode
from .rig_messages import header_ns, is_paused
from .rig_topics import PARAMETER_EVENT, STRING, checked_state, find_topics, parsed
from .run_reader import Record, RunReader

__all__ = ['Change', 'Disorder', 'Item', 'RunHistory', 'SnapshotRecord', 'StateRecord']


#: Formats of the messages that this version reads; see `rig.published.FORMAT`.
_FORMATS = (1, FORMAT)
#: Stamps of ROS have 32 bits of seconds, with a sign.
_LATEST_NS = 2**31 * 10**9
#: Messages among which those of one topic may overtake another's on their way to a recorder.
_OVERTAKING = 2000
#: Messages of a topic by which it is found out how a bag is stamped.
_LOOKED_AT = 20


class StateRecord(NamedTuple):
    """A recorded JointState, still serialised: of the rig, of an impact, or of its control."""

    stamp_ns: int
    content: bytes
    topic: str


class Change(NamedTuple):
    """
    A parameter event.

    `exact` tells whether it is stamped with the instant at which the rig was changed (else
    `stamp_ns` is roughly when it came); `dump` whether it lists the values that all parameters
    have, without changing any.
    """

    stamp_ns: int
    values: Mapping[str, Any]
    exact: bool
    dump: bool


class SnapshotRecord(NamedTuple):
    """
    A snapshot of the simulator: its state, and how rig time and stamps are related.

    `arithmetic` is that of the version which has recorded it, see `rig.snapshot.ARITHMETIC`, and
    `version` the format of its messages, see `rig.published.FORMAT`.
    """

    stamp_ns: int
    offset_ns: int
    time_ns: int
    reason: str
    state: dict[str, Any]
    arithmetic: int = ARITHMETIC
    version: int = FORMAT


Item = StateRecord | Change | SnapshotRecord


@dataclass
class Disorder:
    """Messages that are not where they belong: how many by topic, and the stamp of the first."""

    doubled: dict[str, int] = field(default_factory=dict)
    late: dict[str, int] = field(default_factory=dict)
    misdated: dict[str, int] = field(default_factory=dict)
    first_ns: int | None = None

    def note(self, counts: dict[str, int], topic: str, stamp_ns: int) -> None:
        """Count one."""
        counts[topic] = counts.get(topic, 0) + 1
        if self.first_ns is None:
            self.first_ns = stamp_ns

    def __bool__(self) -> bool:
        return bool(self.doubled or self.late or self.misdated)


class RunHistory:
    """
    The history of a recorded rig.

    Parameters
    ----------
    path : Path or str
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    purpose : str, optional
        What the bag is read for, as a verb: for messages.
    snapshot_needed : bool, optional
        Whether a bag without a snapshot is refused.

    Attributes
    ----------
    reader : RunReader
        The bag.
    topics : RigTopics
        What is read of it.
    start : SnapshotRecord
        Where the history begins. Of a bag without a snapshot, an empty one at rig time 0, which
        is the first stamp, and of the present format.
    stamped : bool
        Whether the bag is stamped with rig time, as the node itself records it.
    disorder : Disorder
        What was out of order, so far.
    early : int
        Joint states and impacts from before `start`, which cannot be replayed.
    damage : RecordingError or None
        Why `items` ended before the end of the bag.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or cannot be replayed.
    """

    def __init__(
        self,
        path: Path | str,
        node: str | None = None,
        *,
        purpose: str = 'replay',
        snapshot_needed: bool = True,
    ) -> None:
        self.reader = RunReader(path)
        self._purpose = purpose
        if not self.reader.message_count:
            cause = 'it holds no whole message'
            raise RecordingError(purpose, path, cause, 'record a run with record:=true')
        self.topics = find_topics(
            self.reader, node, purpose=purpose, snapshot_needed=snapshot_needed
        )
        self.disorder = Disorder()
        self.early = 0
        self.damage: RecordingError | None = None
        first = next(self.reader.records([self.topics.snapshot], by_index=True), None)
        if first is None and snapshot_needed:
            cause = f'there is no message on {self.topics.snapshot}: the start is not known'
            remedy = 'sim_node records one first; with ros2 bag record, record this topic too'
            raise RecordingError(purpose, path, cause, remedy)
        if not self.reader.topics[self.topics.joint_states].message_count:
            cause = f'there is no message on {self.topics.joint_states}: nothing to compare'
            raise RecordingError(purpose, path, cause)
        if first is not None:
            self.start = self._snapshot(first)
            # The node's own recorder leaves notes; its first snapshot may be damaged.
            noted = self.reader.custom.get('joint_states') == self.topics.joint_states
            self.stamped = self._has_rig_stamps() and (
                noted or first.stamp_ns == self.start.stamp_ns
            )
        else:
            self._start_without_snapshot()

    def _has_rig_stamps(self) -> bool:
        """
        Return whether most of the first samples and impacts are logged at their own stamps.

        A recorder that runs by the rig's clock logs them at its ticks.
        """
        for topic in {self.topics.joint_states, self.topics.impacts} - {''}:
            records = self.reader.records([topic], by_index=True)
            different = 0
            # What cannot be read is met again by whoever reads on.
            with suppress(RecordingError, CdrError):
                for record in islice(records, _LOOKED_AT):
                    different += 1 if record.stamp_ns != header_ns(record.content) else -1
            if different > 0:
                return False
        return True

    def remarks(self) -> list[str]:
        """Return what else is to be known of the recording."""
        return self.reader.remarks()

    def faults(self) -> list[str]:
        """Return why the bag could be used in part only, after its items were read."""
        disorder = self.disorder
        found = [
            f'messages of {topic} {text}: {count} (first at stamp {disorder.first_ns} ns)'
            for text, counts in (
                ('twice', disorder.doubled),
                ('out of order', disorder.late),
                ('whose own stamp is not that of the bag', disorder.misdated),
            )
            for topic, count in counts.items()
        ]
        if self.damage is not None:
            found.append(f'{self.damage}; what follows was not compared')
        found += self.reader.faults()
        if not self.reader.complete:
            cut = self.reader.unusable
            cause = self.reader.missing or (
                'its recording was cut short, or a file is missing (recover_run makes a whole bag '
                'of what is there)'
            )
            found.append(
                f'the bag is not complete: {cause}'
                + (f' ({cut} bytes at its end belong to no whole message)' if cut else '')
            )
        return found

    def _start_without_snapshot(self) -> None:
        record = next(self.reader.records([self.topics.joint_states]))
        try:
            first_ns = header_ns(record.content)
        except CdrError as error:
            cause = f'the first message of {record.topic} is damaged: {error}'
            raise RecordingError(self._purpose, self.reader.path, cause) from error
        self.start = SnapshotRecord(first_ns, first_ns, 0, 'none', {})
        self.stamped = record.stamp_ns == first_ns

    def items(self, *, early: bool = False) -> Iterator[Item]:
        """
        Yield what the bag holds, from the first snapshot on.

        Of a bag that turns out to be damaged, all before the damage; `damage` is set then.

        Parameters
        ----------
        early : bool, optional
            Whether to yield what is before the first snapshot, too.
        """
        began = early
        items = self._raw_items()
        for item in items if self.stamped else _sorted(items):
            began = began or isinstance(item, SnapshotRecord)
            if began or isinstance(item, Change):
                yield item
            else:
                self.early += 1

    def _raw_items(self) -> Iterator[Item]:
        """Yield the messages as items, as stored."""
        names = self.topics
        rig = {names.joint_states, names.impacts, names.gap_control}
        wanted = {names.snapshot, names.parameter_events, *rig}
        last: dict[str, tuple[int, bytes]] = {}
        stamped = self.stamped
        now_ns = self.start.stamp_ns
        record = None
        try:
            for record in self.reader.records(wanted - {''}):
                topic, _, stamp_ns, content = record
                if topic == names.joint_states and is_paused(content):
                    # No sample of the motion; only others than the node record it.
                    continue
                if topic in rig:
                    within_ns = header_ns(content)
                    before = last.get(topic)
                    if before is not None and within_ns <= before[0]:
                        if content == before[1]:
                            self.disorder.note(self.disorder.doubled, topic, stamp_ns)
                            continue
                        if within_ns < before[0]:
                            self.disorder.note(self.disorder.late, topic, stamp_ns)
                    last[topic] = (within_ns, content)
                    self._check_stamp(topic, stamp_ns, within_ns)
                    now_ns = stamp_ns if stamped else within_ns
                    yield StateRecord(now_ns, content, topic)
                elif topic == names.snapshot:
                    snapshot = self._snapshot(record)
                    self._check_stamp(topic, stamp_ns, snapshot.stamp_ns)
                    yield snapshot
                elif (change := self._change(record, now_ns)) is not None:
                    yield change
        except RecordingError as error:
            self.damage = error
        except CdrError as error:
            assert record is not None
            cause = f'the message of {record.topic} at {record.stamp_ns} ns is damaged: {error}'
            self.damage = RecordingError('read', self.reader.path, cause)

    def _check_stamp(self, topic: str, stamp_ns: int, within_ns: int) -> None:
        """Note a message of the node's own bag whose stamps contradict each other."""
        if self.stamped and within_ns != stamp_ns:
            self.disorder.note(self.disorder.misdated, topic, stamp_ns)

    def _snapshot(self, record: Record) -> SnapshotRecord:
        where = f'the snapshot of {record.topic} at {record.stamp_ns} ns'
        try:
            message = decode(STRING, record.content)
            assert isinstance(message, String)
            held = parsed(message.data)
            version = held.get('format')
        except ValueError as error:
            cause = f'{where} cannot be read: {error}'
            raise RecordingError(self._purpose, self.reader.path, cause) from error
        found, known = version, _FORMATS
        if version in _FORMATS and isinstance(held.get('state'), dict):
            found, known = held['state'].get('format'), FORMATS
        if found not in known:
            formats = ' and '.join(map(str, known))
            cause = f'{where} is of format {shown(found)}; this version reads format {formats}'
            remedy = 'use the version of impact_damper_ros that recorded the bag'
            raise RecordingError(self._purpose, self.reader.path, cause, remedy)
        try:
            offset_ns, time_ns = held['stamp_offset_ns'], held['time_ns']
            if type(offset_ns) is not int or type(time_ns) is not int or time_ns < 0:
                text = f'stamp_offset_ns is {shown(offset_ns)} and time_ns {shown(time_ns)}'
                raise ValueError(f'{text}: whole numbers of nanoseconds are allowed')
            if abs(offset_ns) + time_ns >= _LATEST_NS:
                raise ValueError(
                    f'stamp_offset_ns is {offset_ns} and time_ns {time_ns}: stamps of ROS end at '
                    f'{_LATEST_NS} ns'
                )
            reason, state = as_line(str(held['reason'])), completed(upgraded(held['state']))
            checked_state(state, time_ns / 1e9)
            arithmetic = held['state'].get('arithmetic', 1)
            if type(arithmetic) is not int:
                raise ValueError(f'arithmetic is {shown(arithmetic)}: a whole number is allowed')
        except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
            said = str(error) if isinstance(error, ValueError) else repr(error)
            what = 'cannot be used' if isinstance(error, ValueError) else 'is not complete'
            cause = f'{where} {what}: {said}'
            raise RecordingError(self._purpose, self.reader.path, cause) from error
        stamp_ns = offset_ns + time_ns
        return SnapshotRecord(
            stamp_ns, offset_ns, time_ns, reason, state, arithmetic, int(held['format'])
        )

    def _change(self, record: Record, now_ns: int) -> Change | None:
        """Return what a parameter event says of the rig; None if nothing."""
        event = decode(PARAMETER_EVENT, record.content)
        assert isinstance(event, ParameterEvent)
        node = self.topics.node
        if event.node != node and (
            node or event.node.rpartition('/')[0] + '/' != self.topics.namespace
        ):
            return None
        dump = not event.changed_parameters
        values = _rig_values(event.new_parameters if dump else event.changed_parameters)
        exact = record.stamp_ns == event.stamp_ns
        if not values:
            return None
        self._check_stamp(record.topic, record.stamp_ns, event.stamp_ns)
        return Change(event.stamp_ns if exact else now_ns, values, exact, dump)


def _rig_values(parameters: tuple[Parameter, ...]) -> dict[str, Any]:
    known = (*PARAMETER_SPECS, *INITIAL_SPECS, *GAP_CONTROL_SPECS, 'state_rate', 'record')
    return {p.name: p.value for p in parameters if p.name in known}


def _sorted(items: Iterator[Item]) -> Iterator[Item]:
    """Put items in the order of their stamps that overtook each other on their way."""
    pending: list[tuple[int, bool, int, Item]] = []
    for number, item in enumerate(items):
        # At one instant the cause comes before what it does.
        entry = (item.stamp_ns, isinstance(item, StateRecord), number, item)
        if len(pending) < _OVERTAKING:
            heapq.heappush(pending, entry)
        else:
            yield heapq.heappushpop(pending, entry)[3]
    while pending:
        yield heapq.heappop(pending)[3]
