"""
A recorded run: which topics are those of the rig, and its messages in the order of the run.

A bag that the node wrote itself stamps every message with rig time, and holds the parameter events
at the very instants of the changes. A bag of ``ros2 bag record`` is stamped with the times of
arrival, in which topics overtake each other; there the stamps in the messages give the order, and
the parameter events (of rclpy, with their own stamps) only name the parameters that were changed.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros.bag import (
    JointState,
    Message,
    Parameter,
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
    decode,
    header_ns,
)
from impact_damper_ros.bag.rig_topics import AXIS_JOINTS, IMPACT_JOINTS, JOINTS, is_paused
from impact_damper_ros.control import CONTROL_JOINTS, GAP_CONTROL_SPECS
from impact_damper_ros.rig import INITIAL_SPECS, PARAMETER_SPECS

from .recorded_snapshot import RecordedSnapshot, parsed, read_snapshot

#: Parameters that nodes of other packages hardly have.
_RIG_PARAMETERS = frozenset(PARAMETER_SPECS) | {'gap_control'}
#: Parameters that the walk reports.
_REPORTED = {*PARAMETER_SPECS, *INITIAL_SPECS, *GAP_CONTROL_SPECS, 'state_rate', 'record'}
#: Largest number of messages of the rig that are yielded together.
_MOST_AT_ONCE = 8192
#: Messages within which topics may overtake each other on their way to a recorder.
_OVERTAKING = 2000
#: Messages of a topic that show how a bag is stamped.
_EXAMINED = 20


class RecordedChange(NamedTuple):
    """A parameter event."""

    stamp_ns: int
    #: Parameters of the rig, of its gap control and of the recording, by name.
    values: Mapping[str, Any]
    #: Whether the stamp is the instant of the change; otherwise the rough time of its arrival.
    exact: bool
    dump: bool  # whether it lists the values of all parameters and changes none


#: What a walk yields: joint states, impacts and acts of the gap control in a row, a change of
#: parameters, or a snapshot.
Item = list[RecordedMessage] | RecordedChange | RecordedSnapshot


@dataclass
class Disorder:
    """Misplaced messages: how many by topic, and the stamp of the first."""

    doubled: dict[str, int] = field(default_factory=dict)
    late: dict[str, int] = field(default_factory=dict)
    misdated: dict[str, int] = field(default_factory=dict)
    first_ns: int | None = None

    def note(self, counts: dict[str, int], topic: str, stamp_ns: int) -> None:
        """Count a misplaced message."""
        counts[topic] = counts.get(topic, 0) + 1
        if self.first_ns is None:
            self.first_ns = stamp_ns

    def __bool__(self) -> bool:
        return bool(self.doubled or self.late or self.misdated)


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

    Attributes
    ----------
    reader : RunReader
        The bag.
    topics : RigTopics
        The topics of the rig.
    start : RecordedSnapshot
        Where the run begins. Of a bag without a snapshot, an empty one at rig time 0, which is
        the first stamp, and of the present format.
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
    ) -> None:
        self.reader = RunReader(path)
        self._purpose = purpose
        if not self.reader.message_count:
            cause = 'it holds no whole message'
            raise RecordingError(purpose, path, cause, 'record a run with record:=true')
        self.topics = _find_topics(self.reader, node, purpose, snapshot_needed=snapshot_needed)
        self.disorder = Disorder()
        self.early = 0
        self.damage: RecordingError | None = None
        first = next(self.reader.records([self.topics.snapshot]), None)
        if first is None and snapshot_needed:
            cause = f'there is no message on {self.topics.snapshot}: the start is not known'
            remedy = 'sim_node records one first; with ros2 bag record, record this topic too'
            raise RecordingError(purpose, path, cause, remedy)
        if not self.reader.topics[self.topics.joint_states].message_count:
            cause = f'there is no message on {self.topics.joint_states}: nothing to compare'
            raise RecordingError(purpose, path, cause)
        if first is None:
            self.start, self.stamped = self._start_without_snapshot()
            return
        self.start = read_snapshot(first, self.reader.path, purpose)
        # The node's own recorder leaves notes; its first snapshot may be damaged.
        noted = self.reader.custom.get('joint_states') == self.topics.joint_states
        self.stamped = self._has_rig_stamps() and (noted or first.stamp_ns == self.start.stamp_ns)

    def _has_rig_stamps(self) -> bool:
        """
        Return whether most of the first samples and impacts are logged at their own stamps.

        A recorder that runs by the rig's clock logs them at its ticks.
        """
        for topic in {self.topics.joint_states, self.topics.impacts} - {''}:
            records = self.reader.records([topic])
            different = 0
            # The walk reports messages that cannot be read.
            with suppress(RecordingError, CdrError):
                for record in islice(records, _EXAMINED):
                    different += 1 if record.stamp_ns != header_ns(record.content) else -1
            if different > 0:
                return False
        return True

    def _start_without_snapshot(self) -> tuple[RecordedSnapshot, bool]:
        record = next(self.reader.records([self.topics.joint_states]))
        try:
            first_ns = header_ns(record.content)
        except CdrError as error:
            cause = f'the first message of {record.topic} is damaged: {error}'
            raise RecordingError(self._purpose, self.reader.path, cause) from error
        return RecordedSnapshot(first_ns, first_ns, 0, 'none', {}), record.stamp_ns == first_ns

    def remarks(self) -> list[str]:
        """Return what else a user should know of the recording."""
        return self.reader.remarks()

    def faults(self) -> list[str]:
        """Return why only a part of the bag could be used; complete after the walk."""
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

    def walk(self, *, early: bool = False) -> Iterator[Item]:
        """
        Yield the run in order, from the first snapshot on.

        Of a damaged bag, everything before the damage; `damage` is set then.

        Parameters
        ----------
        early : bool, optional
            Whether to yield messages from before the first snapshot, too.

        Yields
        ------
        list of RecordedMessage
            Consecutive joint states, impacts and acts of the gap control: the run has no change
            and no snapshot between them. Of a bag stamped with times of arrival, their
            `stamp_ns` is that of their header.
        RecordedChange
            A change of parameters.
        RecordedSnapshot
            A snapshot of the rig.
        """
        began = early
        waiting: list[RecordedMessage] = []
        items = self._items()
        for item in items if self.stamped else _in_order(items):
            if isinstance(item, RecordedMessage):
                if not began:
                    self.early += 1
                    continue
                waiting.append(item)
                if len(waiting) < _MOST_AT_ONCE:
                    continue
            if waiting:
                yield waiting
                waiting = []
            if not isinstance(item, RecordedMessage):
                began = began or isinstance(item, RecordedSnapshot)
                yield item
        if waiting:
            yield waiting

    def _items(self) -> Iterator[_Single]:
        """Yield the messages one by one, in the order of the bag."""
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
                    # No sample of the motion; the node does not record it, others may.
                    continue
                if topic in rig:
                    within_ns = header_ns(content)
                    before = last.get(topic)
                    if before is not None and within_ns <= before[0]:
                        # Changes may repeat an impact or an act while the rig is paused.
                        if topic == names.joint_states and content == before[1]:
                            self.disorder.note(self.disorder.doubled, topic, stamp_ns)
                            continue
                        if within_ns < before[0]:
                            self.disorder.note(self.disorder.late, topic, stamp_ns)
                    last[topic] = (within_ns, content)
                    self._check_stamp(topic, stamp_ns, within_ns)
                    now_ns = stamp_ns if stamped else within_ns
                    yield record if stamped else record._replace(stamp_ns=within_ns)
                elif topic == names.snapshot:
                    snapshot = read_snapshot(record, self.reader.path, self._purpose)
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

    def _change(self, record: RecordedMessage, now_ns: int) -> RecordedChange | None:
        """Return a parameter event of the rig; None for one of another node."""
        event = decode(PARAMETER_EVENT, record.content)
        assert isinstance(event, ParameterEvent)
        node = self.topics.node
        if event.node != node and (
            node or event.node.rpartition('/')[0] + '/' != self.topics.namespace
        ):
            return None
        dump = not event.changed_parameters
        parameters: tuple[Parameter, ...] = (
            event.new_parameters if dump else event.changed_parameters
        )
        values = {p.name: p.value for p in parameters if p.name in _REPORTED}
        if not values:
            return None
        self._check_stamp(record.topic, record.stamp_ns, event.stamp_ns)
        exact = record.stamp_ns == event.stamp_ns
        return RecordedChange(event.stamp_ns if exact else now_ns, values, exact, dump)


_Single = RecordedMessage | RecordedChange | RecordedSnapshot


def _in_order(items: Iterator[_Single]) -> Iterator[_Single]:
    """Yield items in the order of their stamps, though some were logged out of order."""
    pending: list[tuple[int, bool, int, _Single]] = []
    for number, item in enumerate(items):
        # At one instant the cause comes before its effects.
        entry = (item.stamp_ns, isinstance(item, RecordedMessage), number, item)
        if len(pending) < _OVERTAKING:
            heapq.heappush(pending, entry)
        else:
            yield heapq.heappushpop(pending, entry)[3]
    while pending:
        yield heapq.heappop(pending)[3]


# The topics of a rig in a bag


@dataclass(frozen=True)
class RigTopics:
    """The topics of one rig by their full names; empty for those that are not in the bag."""

    node: str
    snapshot: str
    joint_states: str
    impacts: str = ''
    parameter_events: str = ''
    gap_control: str = ''

    @property
    def namespace(self) -> str:
        """The namespace of the node, with a slash at its end."""
        return (self.snapshot or self.joint_states).rpartition('/')[0] + '/'

    @property
    def name(self) -> str:
        """The node, for messages to the user."""
        return self.node or f'of unknown name in the namespace {self.namespace}'


def _noted(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rig that the recorder's notes name."""
    topics, notes = reader.topics, reader.custom
    names = {
        name: notes[name] if notes.get(name) in topics else ''
        for name in ('snapshot', 'joint_states', 'impacts', 'gap_control')
    }
    if not names['joint_states'] or (snapshot_needed and not names['snapshot']):
        return []
    return [RigTopics(notes.get('node', ''), **names, parameter_events=events)]


def _named(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rigs whose topics have their usual names, in any namespace."""
    topics, found = reader.topics, []
    for topic in sorted(topics):
        space, _, name = topic.rpartition('/')
        if name != 'joint_states' or topics[topic].type != JOINT_STATE:
            continue
        snapshot = f'{space}/snapshot'
        there = snapshot in topics and topics[snapshot].type == STRING
        if not there and snapshot_needed:
            continue
        impacts, control = (
            name if name in topics else '' for name in (f'{space}/impacts', f'{space}/gap_control')
        )
        found.append(RigTopics('', snapshot if there else '', topic, impacts, events, control))
    return found


def _role(message: Message) -> str:
    """Return the topic of a rig to which a message belongs; empty for other messages."""
    if isinstance(message, JointState):
        if message.name in (JOINTS, AXIS_JOINTS):
            return 'joint_states'
        if message.name == IMPACT_JOINTS and message.frame_id in ('stop_1', 'stop_2'):
            return 'impacts'
        if message.name == CONTROL_JOINTS:
            return 'gap_control'
    elif isinstance(message, String):
        try:
            held = parsed(message.data)
        except ValueError:
            return ''
        if 'stamp_offset_ns' in held:
            return 'snapshot'
    return ''


def _roles(reader: RunReader, topics: list[str]) -> dict[str, list[str]]:
    """Return topics by the role that the first message of each has in a rig."""
    found: dict[str, list[str]] = {}
    for name in topics:
        if reader.topics[name].type not in (JOINT_STATE, STRING):
            continue
        if not reader.topics[name].message_count:
            continue
        record = next(reader.records([name]), None)
        if record is None:
            continue
        try:
            role = _role(decode(record.type, record.content))
        except CdrError:
            continue
        found.setdefault(role, []).append(name)
    return found


def _by_content(reader: RunReader, events: str, *, snapshot_needed: bool) -> list[RigTopics]:
    """Return the rig whose topics were remapped, by their contents."""
    found = _roles(reader, list(reader.topics))
    wanted = ('snapshot', 'joint_states', 'impacts', 'gap_control')
    names = {role: found[role][0] for role in wanted if len(found.get(role, ())) == 1}
    if 'joint_states' not in names or (snapshot_needed and 'snapshot' not in names):
        return []
    names.setdefault('snapshot', '')
    return [RigTopics('', **names, parameter_events=events)]


def _completed(reader: RunReader, rigs: list[RigTopics]) -> list[RigTopics]:
    """Add topics that were remapped while others of the rig have their usual names."""
    taken = {name for rig in rigs for name in (rig.snapshot, rig.joint_states)}
    taken |= {name for rig in rigs for name in (rig.impacts, rig.gap_control)}
    if all(rig.snapshot and rig.impacts and rig.gap_control for rig in rigs):
        return rigs
    roles = _roles(reader, [name for name in reader.topics if name not in taken])
    for role in ('snapshot', 'impacts', 'gap_control'):
        left = roles.get(role, [])
        lacking = [rig for rig in rigs if not getattr(rig, role)]
        for rig in lacking:
            near = [name for name in left if name.rpartition('/')[0] + '/' == rig.namespace]
            # Of several rigs, each has its own in its own namespace.
            near = near or (left if len(lacking) == 1 else [])
            if len(near) == 1:
                rigs = [replace(r, **{role: near[0]}) if r == rig else r for r in rigs]
    return rigs


def _named_node(reader: RunReader, rig: RigTopics) -> RigTopics:
    """Add the name of the node: the one in the namespace with parameters of a rig."""
    if rig.node or not rig.parameter_events:
        return rig
    nodes: set[str] = set()
    try:
        for record in reader.records([rig.parameter_events]):
            try:
                event = decode(PARAMETER_EVENT, record.content)
            except CdrError:
                continue
            assert isinstance(event, ParameterEvent)
            named = {p.name for p in (*event.new_parameters, *event.changed_parameters)}
            if event.node.rpartition('/')[0] + '/' == rig.namespace and named & _RIG_PARAMETERS:
                nodes.add(event.node)
    except RecordingError:  # reported by the walk
        pass
    return replace(rig, node=nodes.pop()) if len(nodes) == 1 else rig


def _chosen(found: list[RigTopics], node: str) -> list[RigTopics]:
    """Return the rigs of a node, by its name or namespace."""
    chosen = [t for t in found if node in (t.node, t.namespace, t.namespace.rstrip('/'))]
    # A node is in the namespace of its topics.
    return chosen or [
        t for t in found if not t.node and node.rpartition('/')[0] + '/' == t.namespace
    ]


def _find_topics(
    reader: RunReader, node: str | None, purpose: str, *, snapshot_needed: bool
) -> RigTopics:
    """Find the topics of the rig by the recorder's notes, by their names or by their contents."""
    topics = reader.topics
    events = next((t.name for t in topics.values() if t.type == PARAMETER_EVENT), '')
    found: list[RigTopics] = []
    for search in (_noted, _named, _by_content):
        found = found or search(reader, events, snapshot_needed=snapshot_needed)
    found = [_named_node(reader, rig) for rig in _completed(reader, found)]
    chosen = found if node is None else _chosen(found, node)
    if len(chosen) == 1:
        return chosen[0]
    if not found:
        held = ', '.join(sorted(topics)) or 'none'
        wanted = 'snapshot and joint_states' if snapshot_needed else 'joint_states'
        cause = f'no rig is recorded in it: no topics {wanted} (topics: {held})'
        remedy = 'give a bag that sim_node has recorded, or record these topics too'
        raise RecordingError(purpose, reader.path, cause, remedy)
    names = ', '.join(t.node or t.namespace for t in found)
    if node is not None and not chosen:
        raise RecordingError(purpose, reader.path, f'it holds no node {node!r}; it has {names}')
    cause = f'it holds several rigs: {names}'
    raise RecordingError(purpose, reader.path, cause, 'choose one with --node')
