# SPDX-License-Identifier: Apache-2.0
"""
A recorded run: the commands that a rig was given, and the rows of messages between them.

A bag that the node wrote itself stamps every message with rig time, in the order of the run. A bag
of ``ros2 bag record`` is stamped with the times of arrival, in which topics overtake each other;
there the stamps in the messages give the order.
"""

from __future__ import annotations

import heapq
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.bag import (
    ParameterEvent,
    RecordedMessage,
    RecordingError,
    RunReader,
    String,
)
from impact_damper_ros.bag.messages import (
    JOINT_STATE,
    PARAMETER_EVENT,
    STRING,
    CdrError,
    JointStateRows,
    decode,
    header_ns,
)
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS, PAUSED_FRAME
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.control.record import CONTROL_JOINTS
from impact_damper_ros.parameters.rig_parameters import (
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
)

from .command import Command, parsed, read_command
from .rows import Ints, Messages

#: Parameters that a walk reports.
_REPORTED = {*PARAMETER_SPECS, *INITIAL_SPECS, *GAP_CONTROL_SPECS, 'state_rate', 'record'}
#: Largest number of messages of the rig that are yielded together.
_MOST_AT_ONCE = 16_384
#: Messages within which topics may overtake each other on their way to a recorder.
_OVERTAKING = 2000
#: Messages of a topic that show how a bag is stamped.
_EXAMINED = 20
#: Joints of the topics of rows, and their positions, velocities and efforts that are read.
_LAYOUTS: dict[str, tuple[tuple[str, ...], tuple[int, int, int]]] = {
    'joint_states': (JOINTS, (7, 7, 0)),
    'impacts': (IMPACT_JOINTS, (2, 2, 2)),
    'gap_control': (CONTROL_JOINTS, (3, 3, 3)),
}


class Rows(NamedTuple):
    """Messages between which nothing is done to the rig."""

    states: Messages
    impacts: Messages
    acts: Messages


class StatedParameters(NamedTuple):
    """A parameter event of the rig, in a bag that its node recorded."""

    stamp_ns: int
    log_ns: int
    #: Parameters of the rig, of its gap control and of the recording, by name.
    values: Mapping[str, Any]
    listing: bool  # whether it lists the values of all parameters and changes none


Item = Rows | Command | StatedParameters


#: What may be wrong with a message.
TWICE, LATE = 'twice', 'out of order'
MISDATED, UNREADABLE = 'whose own stamp is not that of the bag', 'that cannot be read'


class Disorder:
    """Misplaced messages: how many by what is wrong and topic, and the stamp of the first."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()
        self._first_ns: int | None = None

    def note(self, wrong: str, topic: str, stamps_ns: Sequence[int] | Ints) -> None:
        """Count misplaced messages."""
        if len(stamps_ns):
            self._counts[wrong, topic] += len(stamps_ns)
            if self._first_ns is None:
                self._first_ns = int(stamps_ns[0])

    def faults(self) -> Iterator[str]:
        """Yield what is wrong."""
        for kind in (TWICE, LATE, MISDATED, UNREADABLE):
            for (wrong, topic), count in self._counts.items():
                if wrong == kind:
                    text = f'messages of {topic} {wrong}: {count}'
                    yield f'{text} (first at stamp {self._first_ns} ns)'


class RecordedRun:
    """
    The recorded run of one rig; `walk` through it once.

    Parameters
    ----------
    path : Path or str
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    purpose : str, optional
        Purpose of the reading, as a verb for messages.
    snapshot_needed : bool, optional
        Whether to refuse a bag without a snapshot.
    law : OwnLaw, optional
        The law that moves the stops, for a rig with one of the user's own.

    Attributes
    ----------
    reader : RunReader
        The bag.
    topics : RigTopics
        The topics of the rig.
    start : Command or None
        The first snapshot.
    stamped : bool
        Whether the bag is stamped with rig time, as the node itself records it.
    disorder : Disorder
        Misplaced messages met so far.
    early : int
        Joint states, impacts and acts from before `start`, left out of the walk.
    damage : RecordingError or None
        Why the walk ended before the end of the bag.

    Raises
    ------
    RecordingError
        If the bag cannot be read, or holds no such run.
    """

    def __init__(
        self,
        path: Path | str,
        node: str | None = None,
        *,
        purpose: str = 'replay',
        snapshot_needed: bool = True,
        law: OwnLaw | None = None,
    ) -> None:
        self.reader = RunReader(path)
        self._purpose, self._law = purpose, law
        if not self.reader.message_count:
            cause = 'it holds no whole message'
            raise RecordingError(purpose, path, cause, 'record a run with record:=true')
        self.topics, first = _find_rig(
            self.reader, node, purpose, law, snapshot_needed=snapshot_needed
        )
        self.disorder = Disorder()
        self.early = 0
        self.damage: RecordingError | None = None
        self.start, at_once = None, True
        if first is not None:
            self.start = read_command(first, self.reader.path, purpose, law)
            at_once = self.start.stamp_ns == first.stamp_ns
        if not self.reader.topics[self.topics.joint_states, JOINT_STATE].message_count:
            cause = f'there is no message on {self.topics.joint_states}: nothing to compare'
            raise RecordingError(purpose, path, cause)
        self.stamped = self.reader.own or (at_once and self._has_rig_stamps())

    def _has_rig_stamps(self) -> bool:
        """
        Return whether most of the first samples and impacts are logged at their own stamps.

        A recorder that runs by the rig's clock logs them at its ticks.
        """
        for topic in {self.topics.joint_states, self.topics.impacts} - {''}:
            different = 0
            # The walk reports messages that cannot be read.
            with suppress(RecordingError, CdrError):
                for record in islice(self.reader.records([(topic, JOINT_STATE)]), _EXAMINED):
                    different += 1 if record.stamp_ns != header_ns(record.content) else -1
            if different > 0:
                return False
        return True

    def remarks(self) -> list[str]:
        """Return what else a user should know of the recording."""
        return self.reader.remarks()

    def faults(self) -> list[str]:
        """Return why only a part of the bag could be used; complete after the walk."""
        found = [*self.disorder.faults()]
        if self.damage is not None:
            found.append(f'{self.damage}; the remainder was not compared')
        found += self.reader.faults()
        if not self.reader.complete:
            cut = self.reader.unusable
            cause = self.reader.missing or (
                'its recording was cut short, or a file is missing (recover_run makes a complete '
                'bag of the rest)'
            )
            found.append(
                f'the bag is not complete: {cause}'
                + (f' ({cut} bytes at its end belong to no whole message)' if cut else '')
            )
        return found

    def walk(self) -> Iterator[Item]:
        """
        Yield the run in order, from the first snapshot on.

        Of a damaged bag, everything before the damage; `damage` is set then.

        Yields
        ------
        Rows
            Consecutive joint states, impacts and acts of the gap control: nothing was done to the
            rig between them.
        Command
            What was done to the rig, and its state.
        StatedParameters
            A parameter event; those of a bag stamped with times of arrival are left out, as they
            may come late.
        """
        tables = _Tables(self)
        began = self.start is None
        items = self._items()
        for item in items if self.stamped else _in_order(items):
            if isinstance(item, RecordedMessage):
                if not began:
                    self.early += 1
                    continue
                tables.waiting.append(item)
                if len(tables.waiting) >= _MOST_AT_ONCE:
                    yield tables.rows()
                continue
            if tables.waiting:
                yield tables.rows()
            began = began or isinstance(item, Command)
            if began:
                yield item
        if tables.waiting:
            yield tables.rows()

    def _items(self) -> Iterator[_Single]:
        """Yield the messages one by one, in the order of the bag."""
        names = self.topics
        rows = {names.joint_states, names.impacts, names.gap_control} - {''}
        wanted = {(topic, JOINT_STATE) for topic in rows}
        wanted |= {(names.snapshot, STRING), (names.parameter_events, PARAMETER_EVENT)}
        record = None
        try:
            for record in self.reader.records(wanted):
                if record.topic in rows:
                    yield record
                elif record.topic == names.snapshot:
                    command = read_command(record, self.reader.path, self._purpose, self._law)
                    self._check_stamp(record, command.stamp_ns)
                    yield command
                elif self.stamped and (stated := self._stated(record)) is not None:
                    yield stated
        except RecordingError as error:
            self.damage = error
        except CdrError as error:
            assert record is not None
            cause = f'the message of {record.topic} at {record.stamp_ns} ns is damaged: {error}'
            self.damage = RecordingError('read', self.reader.path, cause)

    def _check_stamp(self, record: RecordedMessage, within_ns: int) -> None:
        """Note a message of the node's own bag whose stamps contradict each other."""
        if self.stamped and within_ns != record.stamp_ns:
            self.disorder.note(MISDATED, record.topic, [record.stamp_ns])

    def _stated(self, record: RecordedMessage) -> StatedParameters | None:
        """Return a parameter event of the rig; None for one of another node."""
        event = decode(PARAMETER_EVENT, record.content)
        assert isinstance(event, ParameterEvent)
        if self.topics.node and event.node != self.topics.node:
            return None
        self._check_stamp(record, event.stamp_ns)
        listing = not event.changed_parameters
        listed = event.new_parameters if listing else event.changed_parameters
        values = {p.name: p.value for p in listed if p.name in _REPORTED}
        return StatedParameters(event.stamp_ns, record.stamp_ns, values, listing)


_Single = RecordedMessage | Command | StatedParameters


def _in_order(items: Iterator[_Single]) -> Iterator[_Single]:
    """Yield items in the order of the stamps in them, though some were logged out of order."""
    pending: list[tuple[int, bool, int, _Single]] = []
    for number, item in enumerate(items):
        message = isinstance(item, RecordedMessage)
        stamp_ns = header_ns(item.content) if isinstance(item, RecordedMessage) else item.stamp_ns
        # At one instant the cause comes before its effects.
        entry = (stamp_ns, message, number, item)
        if len(pending) < _OVERTAKING:
            heapq.heappush(pending, entry)
        else:
            yield heapq.heappushpop(pending, entry)[3]
    while pending:
        yield heapq.heappop(pending)[3]


class _Tables:
    """Collects the messages of the topics of rows, and reads them as tables."""

    def __init__(self, run: RecordedRun) -> None:
        self._run = run
        self._topics = {key: getattr(run.topics, key) for key in _LAYOUTS}
        self._columns = {
            key: JointStateRows(joints, counts) for key, (joints, counts) in _LAYOUTS.items()
        }
        self._last: dict[str, tuple[int, bytes]] = {}
        self.waiting: list[RecordedMessage] = []

    def rows(self) -> Rows:
        """Return the waiting messages."""
        rows = Rows(*(self._table(key) for key in _LAYOUTS))
        self.waiting.clear()
        return rows

    def _table(self, key: str) -> Messages:
        columns, topic, disorder = self._columns[key], self._topics[key], self._run.disorder
        records = [record for record in self.waiting if record.topic == topic]
        rows, readable = columns.read([r.content for r in records], [r.stamp_ns for r in records])
        if not readable.all():
            disorder.note(UNREADABLE, topic, rows['log_ns'][~readable])
            rows = rows[readable]
            records = [r for r, good in zip(records, readable, strict=True) if good]
        if not len(rows):
            return rows
        stamps_ns, log_ns = rows['stamp_ns'], rows['log_ns']
        if self._run.stamped:
            disorder.note(MISDATED, topic, log_ns[stamps_ns != log_ns])
        # A paused rig repeats its joint states; the node does not record them, others may.
        kept = rows['frame'] != PAUSED_FRAME
        before_ns, before = self._last.get(topic, (None, b''))
        steps = np.diff(stamps_ns, prepend=stamps_ns[0] - 1)
        steps[0] = 1 if before_ns is None else stamps_ns[0] - before_ns
        for i in np.flatnonzero((steps <= 0) & kept):
            if records[i].content == (records[i - 1].content if i else before):
                # Changes may repeat an impact or an act while the rig is paused.
                if key == 'joint_states':
                    disorder.note(TWICE, topic, log_ns[i : i + 1])
                    kept[i] = False
            elif steps[i] < 0:
                disorder.note(LATE, topic, log_ns[i : i + 1])
        self._last[topic] = int(stamps_ns[-1]), records[-1].content
        return rows if kept.all() else rows[kept]


# The topics of a rig in a bag


@dataclass(frozen=True)
class RigTopics:
    """The topics of one rig by their full names; empty for those that are not in the bag."""

    node: str
    snapshot: str
    joint_states: str
    impacts: str = ''
    gap_control: str = ''
    parameter_events: str = ''

    @property
    def namespace(self) -> str:
        """The namespace of the node, with a slash at its end."""
        return (self.snapshot or self.joint_states).rpartition('/')[0] + '/'

    @property
    def name(self) -> str:
        """The node, for messages to the user."""
        return self.node or f'of unknown name in the namespace {self.namespace}'


def _by_snapshots(
    reader: RunReader, purpose: str, law: OwnLaw | None
) -> Iterator[tuple[RigTopics, RecordedMessage]]:
    """Yield the rigs whose snapshots are in a bag, each with its first one."""
    for (name, kind), topic in sorted(reader.topics.items()):
        if kind != STRING or not topic.message_count:
            continue
        record = next(reader.records([(name, kind)]), None)
        if record is None:
            continue
        try:
            message = decode(STRING, record.content)
            assert isinstance(message, String)
            if 'stamp_offset_ns' not in parsed(message.data):
                continue
        except ValueError:
            if name.rpartition('/')[2] != 'snapshot' and reader.custom.get('snapshot') != name:
                continue
        command = read_command(record, reader.path, purpose, law)
        there = {
            key: topic if (topic, kind) in reader.topics else ''
            for key, kind in (
                *((key, JOINT_STATE) for key in _LAYOUTS),
                ('parameter_events', PARAMETER_EVENT),
            )
            for topic in (command.topics.get(key, ''),)
        }
        yield RigTopics(command.node, name, **there), record


def _by_names(reader: RunReader) -> Iterator[tuple[RigTopics, None]]:
    """Yield the rigs whose joint states have their usual name, in any namespace."""
    topics = reader.topics
    events = next((t.name for t in topics.values() if t.type == PARAMETER_EVENT), '')
    for name, kind in sorted(topics):
        space, _, last = name.rpartition('/')
        if last == 'joint_states' and kind == JOINT_STATE:
            others = (f'{space}/{key}' for key in ('impacts', 'gap_control'))
            there = [other if (other, JOINT_STATE) in topics else '' for other in others]
            node = reader.custom.get('node', '')
            yield RigTopics(node, '', name, there[0], there[1], events), None


def _held(reader: RunReader) -> str:
    """Return the topics of a bag with their types, for messages to the user."""
    topics = (f'{name} of {kind or "no type"}' for name, kind in sorted(reader.topics))
    return f'topics: {", ".join(topics) or "none"}'


def _find_rig(
    reader: RunReader,
    node: str | None,
    purpose: str,
    law: OwnLaw | None,
    *,
    snapshot_needed: bool,
) -> tuple[RigTopics, RecordedMessage | None]:
    """Return the topics of the rig as its snapshots name them, and the first snapshot."""
    found: list[tuple[RigTopics, RecordedMessage | None]] = [*_by_snapshots(reader, purpose, law)]
    if not found and not snapshot_needed:
        found += _by_names(reader)
    chosen = [
        (rig, first)
        for rig, first in found
        if node is None or node in (rig.node, rig.namespace, rig.namespace.rstrip('/'))
    ]
    if len(chosen) == 1:
        if not chosen[0][0].joint_states:
            cause = (
                'the joint states that its snapshots name are not in it, or of another type than '
                f'{JOINT_STATE} ({_held(reader)})'
            )
            raise RecordingError(purpose, reader.path, cause, 'record this topic too')
        return chosen[0]
    if not found:
        wanted = 'no message of a snapshot' if snapshot_needed else 'no topic joint_states'
        cause = f'no rig is recorded in it: {wanted} ({_held(reader)})'
        remedy = 'give a bag that sim_node has recorded, or record the topic snapshot too'
        raise RecordingError(purpose, reader.path, cause, remedy)
    names = ', '.join(rig.node or rig.namespace for rig, _ in found)
    if node is not None and not chosen:
        raise RecordingError(purpose, reader.path, f'it holds no node {node!r}; it has {names}')
    cause = f'it holds several rigs: {names}'
    raise RecordingError(purpose, reader.path, cause, 'choose one with --node')
