# SPDX-License-Identifier: Apache-2.0
"""
A recorded run: the commands that a rig was given, and the rows of messages between them.

The order is that of the stamps in the messages, which are rig time, and of the numbers of the
snapshots. The time at which a recorder received a message, and the order in which topics arrived,
do not count. Only where the stamps go back, as after a restart of a rig whose stamps begin at 0,
the first snapshot with such stamps divides the recording.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.bag import RecordedMessage, RecordingError, RunReader, String
from impact_damper_ros.bag.messages import JOINT_STATE, STRING, JointStateRows, decode, message_row
from impact_damper_ros.bag.rig_topics import IMPACT_JOINTS, JOINTS, PAUSED_FRAME
from impact_damper_ros.control.act import CONTROL_JOINTS
from impact_damper_ros.control.own_law import OwnLaw
from impact_damper_ros.parameters.quoting import plural

from .command import Command, Head, parse_snapshot, read_command, read_head
from .rows import Messages, orders_of

#: Number of messages of the rig that are read at once, and number of the latest of them that wait:
#: a message may be late by so many messages in the recording.
_READ_AT_ONCE, _WAITING = 16_384, 4000
#: Joints of the topics of rows, and their positions, velocities and efforts that are read.
_LAYOUTS: dict[str, tuple[tuple[str, ...], tuple[int, int, int]]] = {
    'joint_states': (JOINTS, (7, 7, 0)),
    'impacts': (IMPACT_JOINTS, (2, 2, 2)),
    'gap_control': (CONTROL_JOINTS, (3, 3, 3)),
}
#: Faults of messages.
REPEATED, LATE, UNREADABLE = (
    'that are there twice',
    f'recorded more than {_WAITING:,} messages late, left out',
    'that cannot be read',
)


class Rows(NamedTuple):
    """Messages between two commands, each kind in the order of its stamps."""

    states: Messages
    impacts: Messages
    acts: Messages


Item = Rows | Command


#: Joint states that plain code replays in the time in which compiled code is loaded (60 ms), and
#: in that of a call of it.
_COMPILED_FROM, _STATES_OF_A_CALL = 3_000, 15


class _Snapshot(NamedTuple):
    """A snapshot of a recording, not decoded as a whole."""

    message: RecordedMessage
    head: Head
    place: int  # number among the snapshots, in the order of the recording
    run: int  # number of its run, from 1 on
    part: int  # part of the recording within which stamps do not go back


class RecordedRun:
    """
    One run of a rig in a recording; `walk` through it once.

    Parameters
    ----------
    path : Path or str
        A bag directory or ``.mcap`` file.
    node : str, optional
        Name or namespace of the node, if there are several rigs in the bag.
    number : int, optional
        Number of the run, from 1 on, if the node was restarted while it was recorded.
    purpose : str, optional
        Purpose of the reading, as a verb for messages.
    law : OwnLaw, optional
        The law of the user's own that moves the stops, for a rig that has one.

    Attributes
    ----------
    reader : RunReader
        The bag.
    topics : RigTopics
        The topics of the rig.
    number, run_count : int
        Number of this run, and of all runs of the rig in the bag.
    start : Command
        The first snapshot of the run.
    wrong : Counter of (str, str)
        Number of messages by fault and topic, so far.
    early : int
        Joint states, impacts and acts from before the first snapshot, left out of the walk.
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
        number: int = 1,
        *,
        purpose: str = 'replay',
        law: OwnLaw | None = None,
    ) -> None:
        self.reader = RunReader(path)
        self._purpose, self._law = purpose, law
        if not self.reader.message_count:
            cause = 'it has no complete message'
            raise RecordingError(purpose, path, cause, 'record a run with record:=true')
        self.topics = _find_rig(self.reader, node, purpose, law)
        if not self.reader.topics[self.topics.joint_states, JOINT_STATE].message_count:
            cause = f'there is no message on {self.topics.joint_states}: nothing to compare'
            raise RecordingError(purpose, path, cause)
        self.wrong: Counter[tuple[str, str]] = Counter()
        self.early = 0
        self.damage: RecordingError | None = None
        #: The snapshots, and the place of the first one that cannot be read
        self._snapshots: list[_Snapshot] = []
        self._unread: tuple[int, RecordingError] | None = None
        #: Places of the snapshots from which on stamps have gone back
        self._begins: set[int] = set()
        self._find_runs()
        self.number, self.run_count = number, max(s.run for s in self._snapshots)
        if not 1 <= number <= self.run_count:
            cause = f'it holds {plural(self.run_count, "run")} of {self.topics.name}, no {number}'
            raise RecordingError(purpose, path, cause, 'give a number from 1 on as --run')
        first = next(snapshot for snapshot in self._snapshots if snapshot.run == number)
        self.start = self._command(first)
        if purpose == 'score' and self.start.state.get('records'):
            cause = 'a measured record acts on its rig, and its energy is not known'
            remedy = 'compare_run measures it without --score'
            raise RecordingError(purpose, path, cause, remedy)

    @property
    def is_long(self) -> bool:
        """Whether compiled code saves more than its loading and the calls at commands take."""
        states = self.reader.topics[self.topics.joint_states, JOINT_STATE].message_count
        return states >= _COMPILED_FROM + _STATES_OF_A_CALL * len(self._snapshots)

    def _find_runs(self) -> None:
        """Read the heads of all snapshots, and assign each to its run."""
        found: list[_Snapshot] = []
        names: dict[str, int] = {}
        contents: set[bytes] = set()
        begun_ns = -inf
        # `walk` reports the damage.
        with suppress(RecordingError):
            for place, message in enumerate(
                self.reader.messages([(self.topics.snapshot, STRING)])
            ):
                try:
                    head = read_head(message, self.reader.path, self._purpose)
                except RecordingError as error:
                    self._unread = place, error
                    break
                if message.content in contents:
                    # A recorder of several files may repeat latched messages.
                    self.wrong[REPEATED, self.topics.snapshot] += self.reader.own
                    continue
                contents.add(message.content)
                last = found[-1] if found else None
                run = names.setdefault(head.run, len(names) + 1)
                if last is None or run != last.run:
                    back, begun_ns = head.stamp_ns <= begun_ns, head.stamp_ns
                else:
                    back = head.offset_ns < last.head.offset_ns and head.number > last.head.number
                if back:
                    self._begins.add(place)
                found.append(_Snapshot(message, head, place, run, len(self._begins)))
        if not found:
            assert self._unread is not None
            raise self._unread[1]
        found.sort(key=lambda snapshot: (snapshot.part, snapshot.run, snapshot.head.number))
        self._snapshots = found

    def _command(self, snapshot: _Snapshot, acts: Messages | None = None) -> Command:
        """Return what a snapshot holds, given the acts with its stamp."""
        found = read_command(snapshot.message, self.reader.path, self._purpose, self._law)
        if acts is None or not len(acts):
            return found
        # Another recorder gets each topic on its own way.
        before = acts[acts['place'] < snapshot.place] if self.reader.own else acts[:0]
        orders, first = (orders_of(some, found.offset_ns) for some in (acts, before))
        return found._replace(orders=orders, recorded_before=len(first))

    def remarks(self) -> list[str]:
        """Return remarks for the user on the recording."""
        found = self.reader.remarks()
        if self.run_count > 1:
            found.append(
                f'the node {self.topics.name} was restarted: this is run {self.number} of '
                f'{self.run_count} in the bag, from stamp {self.start.stamp_ns} ns on'
            )
        return found

    def faults(self) -> list[str]:
        """Return why only a part of the bag could be used; complete after the walk."""
        wrong = self.wrong.items()
        found = [f'messages of {topic} {what}: {n}' for (what, topic), n in wrong if n]
        if self.early and self.reader.own:
            found.append(
                f'the bag is not complete: {self.early} messages precede its first snapshot'
            )
        if self.damage is not None:
            found.append(f'{self.damage}; the remainder was not compared')
        found += self.reader.faults()
        if not self.reader.complete:
            cut = self.reader.unusable
            cause = self.reader.missing or (
                'its recording was cut short, or its metadata.yaml is missing (recover_run makes '
                'a complete bag of the rest)'
            )
            found.append(
                f'the bag is not complete: {cause}'
                + (f' ({cut} bytes at its end belong to no whole message)' if cut else '')
            )
        return found

    def walk(self) -> Iterator[Item]:
        """
        Yield the run in order, from its first snapshot on.

        The walk of a damaged bag ends before the damage; `damage` is set then.

        Yields
        ------
        Rows
            Consecutive joint states, impacts and acts of the gap control: nothing was done to the
            rig between them. Messages at the instant of a command follow the command.
        Command
            What was done to the rig, its state, and the orders among the rows of its instant.
        """
        tables, waiting, part, run = _Tables(self), deque(self._snapshots), 0, 0
        try:
            for messages, place, ended in self._batches():
                tables.add(messages)
                until_ns = inf if ended else tables.settled_ns
                while waiting and waiting[0].part == part:
                    stamp_ns = waiting[0].head.stamp_ns
                    if stamp_ns >= until_ns or (ended and waiting[0].place > place):
                        break
                    yield from self._of_run(run, tables.take_before(stamp_ns))
                    snapshot = waiting.popleft()
                    run = snapshot.run
                    if run == self.number:
                        yield self._command(snapshot, tables.acts_at(stamp_ns))
                yield from self._of_run(run, tables.take_before(until_ns))
                part += ended
        except RecordingError as error:
            self.damage = error

    def _of_run(self, run: int, rows: Rows) -> Iterator[Rows]:
        """Yield rows of a run if that is the wanted one, and count those from before all runs."""
        count = sum(map(len, rows))
        if count and run == self.number:
            yield rows
        elif not run:
            self.early += count

    def _batches(self) -> Iterator[tuple[list[tuple[int, RecordedMessage]], int, bool]]:
        """
        Yield messages, the place of the last snapshot so far, and whether the part ends.

        Beside each message is the place of the last snapshot before it.
        """
        names = self.topics
        rows = {names.joint_states, names.impacts, names.gap_control} - {''}
        wanted = {(names.snapshot, STRING), *((topic, JOINT_STATE) for topic in rows)}
        batch: list[tuple[int, RecordedMessage]] = []
        place = -1
        try:
            for message in self.reader.messages(wanted):
                if message.topic != names.snapshot:
                    batch.append((place, message))
                    if len(batch) >= _READ_AT_ONCE:
                        yield batch, place, False
                        batch = []
                    continue
                place += 1
                if self._unread is not None and place == self._unread[0]:
                    self.damage = self._unread[1]
                    break
                if place in self._begins:
                    yield batch, place, True
                    batch = []
        except RecordingError as error:
            self.damage = error
        yield batch, place, True


def runs_of(
    path: Path | str, node: str | None, number: int | None, **options: Any
) -> list[RecordedRun]:
    """Return a run of a recording, or without a number all of them; see `RecordedRun`."""
    first = RecordedRun(path, node, number or 1, **options)
    more = range(2, first.run_count + 1) if number is None else ()
    return [first, *(RecordedRun(path, node, n, **options) for n in more)]


class _Tables:
    """Rows that wait for earlier ones, by the topics of a run."""

    def __init__(self, run: RecordedRun) -> None:
        self._wrong = run.wrong
        self._topics = {key: getattr(run.topics, key) for key in _LAYOUTS}
        self._readers = {
            key: JointStateRows(joints, counts) for key, (joints, counts) in _LAYOUTS.items()
        }
        self._rows = {
            key: np.empty(0, message_row(sum(counts))) for key, (_, counts) in _LAYOUTS.items()
        }
        self._taken_ns = -inf
        #: Earliest stamp of messages that may still come
        self.settled_ns: float = -inf

    def add(self, batch: list[tuple[int, RecordedMessage]]) -> None:
        """Take messages, each behind its place, in the order of the recording."""
        marks, messages = zip(*batch, strict=True) if batch else ((), ())
        stamps_ns = np.full(len(messages), np.iinfo(np.int64).max)
        for key, topic in self._topics.items():
            places = [i for i, message in enumerate(messages) if message.topic == topic]
            if not places:
                continue
            rows, readable = self._readers[key].read(
                [messages[i].content for i in places], [marks[i] for i in places]
            )
            late = readable & (rows['stamp_ns'] < self._taken_ns)
            self._wrong[UNREADABLE, topic] += int((~readable).sum())
            self._wrong[LATE, topic] += int(late.sum())
            used = readable & ~late
            stamps_ns[np.array(places)[used]] = rows['stamp_ns'][used]
            # A paused rig repeats its joint states, which are no samples.
            rows = np.concatenate([self._rows[key], rows[used & (rows['frame'] != PAUSED_FRAME)]])
            if (np.diff(rows['stamp_ns']) < 0).any():
                rows = rows[np.argsort(rows['stamp_ns'], kind='stable')]
            self._rows[key] = rows
        if len(messages) > _WAITING:
            self.settled_ns = int(stamps_ns[-_WAITING:].min())

    def take_before(self, before_ns: float) -> Rows:
        """Take out the rows from before a stamp."""
        found = []
        for key, rows in self._rows.items():
            count = int(np.searchsorted(rows['stamp_ns'], before_ns))
            self._rows[key] = rows[count:]
            found.append(rows[:count] if key != 'joint_states' else self._different(rows[:count]))
        self._taken_ns = -inf if before_ns == inf else max(self._taken_ns, before_ns)
        return Rows(*found)

    def acts_at(self, stamp_ns: int) -> Messages:
        """Return the acts with a stamp, without taking them."""
        rows = self._rows['gap_control']
        found: Messages = rows[rows['stamp_ns'] == stamp_ns]
        return found

    def _different(self, states: Messages) -> Messages:
        """Return joint states without repeated ones."""
        same = np.flatnonzero(np.diff(states['stamp_ns']) == 0) + 1
        again = [i for i in same.tolist() if states[i].tobytes() == states[i - 1].tobytes()]
        if not again:
            return states
        self._wrong[REPEATED, self._topics['joint_states']] += len(again)
        return np.delete(states, again)


# The topics of a rig in a bag


@dataclass(frozen=True)
class RigTopics:
    """The topics of one rig by their full names; empty for topics that are not in the bag."""

    node: str
    snapshot: str
    joint_states: str
    impacts: str = ''
    gap_control: str = ''

    @property
    def namespace(self) -> str:
        """The namespace of the node, with a slash at its end."""
        return (self.snapshot or self.joint_states).rpartition('/')[0] + '/'

    @property
    def name(self) -> str:
        """The node, for messages to the user."""
        return self.node or f'of unknown name in the namespace {self.namespace}'


def _rigs(reader: RunReader, purpose: str, law: OwnLaw | None) -> Iterator[RigTopics]:
    """Yield the rigs whose snapshots are in a bag."""
    for (name, kind), topic in sorted(reader.topics.items()):
        if kind != STRING or not topic.message_count:
            continue
        first = next(reader.messages([(name, kind)]), None)
        if first is None:
            continue
        try:
            message = decode(STRING, first.content)
            assert isinstance(message, String)
            if 'state' not in parse_snapshot(message.data):
                continue
        except ValueError:
            if name.rpartition('/')[2] != 'snapshot' and reader.custom.get('snapshot') != name:
                continue
        command = read_command(first, reader.path, purpose, law)
        there = {
            key: topic if (topic, JOINT_STATE) in reader.topics else ''
            for key in _LAYOUTS
            for topic in (command.topics.get(key, ''),)
        }
        yield RigTopics(command.node, name, **there)


def _topic_list(reader: RunReader) -> str:
    """Return the topics of a bag with their types, for messages to the user."""
    topics = (f'{name} of {kind or "no type"}' for name, kind in sorted(reader.topics))
    return f'topics: {", ".join(topics) or "none"}'


def _find_rig(reader: RunReader, node: str | None, purpose: str, law: OwnLaw | None) -> RigTopics:
    """Return the topics of the rig as its snapshots name them."""
    found = [*_rigs(reader, purpose, law)]
    chosen = [
        rig
        for rig in found
        if node is None or node in (rig.node, rig.namespace, rig.namespace.rstrip('/'))
    ]
    if len(chosen) == 1:
        if not chosen[0].joint_states:
            cause = (
                'the joint states that its snapshots name are not in it, or of another type than '
                f'{JOINT_STATE} ({_topic_list(reader)})'
            )
            raise RecordingError(purpose, reader.path, cause, 'record this topic too')
        return chosen[0]
    if not found:
        cause = f'no rig is recorded in it: no message of a snapshot ({_topic_list(reader)})'
        remedy = (
            'record the topic snapshot too: a rig publishes it latched, so that ros2 bag record '
            'gets it whenever it starts'
        )
        raise RecordingError(purpose, reader.path, cause, remedy)
    names = ', '.join(rig.node or rig.namespace for rig in found)
    if node is not None and not chosen:
        raise RecordingError(purpose, reader.path, f'it holds no node {node!r}; it has {names}')
    cause = f'it holds several rigs: {names}'
    raise RecordingError(purpose, reader.path, cause, 'choose one with --node')
