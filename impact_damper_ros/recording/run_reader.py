"""Reading a recorded run, finished or cut short, without ROS."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import BinaryIO, NamedTuple

import yaml

from .bag_metadata import listed_files
from .cdr import CdrError
from .errors import RecordingError
from .mcap_scan import read_block, scan_file
from .messages import DECODABLE, JointStateDecoder, Message, decode
from .topic import load_yaml

__all__ = ['Decoded', 'Record', 'RecordedTopic', 'RunReader', 'bag_files']

_JOINT_STATE = 'sensor_msgs/msg/JointState'


class Record(NamedTuple):
    """A recorded message, still serialised."""

    topic: str
    type: str
    stamp_ns: int
    content: bytes


class Decoded(NamedTuple):
    """A recorded message."""

    topic: str
    stamp_ns: int
    message: Message


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a bag."""

    name: str
    type: str
    message_count: int


def bag_files(path: Path | str) -> list[Path]:
    """
    Return the MCAP files of a bag, in order: its own path, or those in the directory.

    Raises
    ------
    RecordingError
        If there are none, or the bag is of another storage format.
    """
    path = Path(path)
    if path.is_file():
        return [path]
    if not path.is_dir():
        cause = 'there is no such file or directory'
        raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')
    if found := sorted(path.glob('*.mcap'), key=_file_number):
        return found
    if any(path.glob('*.db3')):
        remedy = 'convert it with: ros2 bag convert'
        raise RecordingError('read', path, 'the bag is stored in SQLite, not MCAP', remedy)
    cause = 'there is no .mcap file in this directory'
    raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')


def _file_number(path: Path) -> tuple[int, str]:
    """Order ``run_10.mcap`` after ``run_9.mcap``."""
    number = path.stem.rpartition('_')[2]
    return (int(number) if number.isdecimal() else -1, path.name)


class RunReader:
    """
    A recorded run.

    Parameters
    ----------
    path : Path or str
        A bag directory or a single ``.mcap`` file. It may have been cut short, by ``kill -9`` or a
        power cut; then what is whole is read, and `complete` is False.

    Attributes
    ----------
    path : Path
        As given.
    topics : dict of str to RecordedTopic
        By name.
    start_ns, end_ns : int or None
        Earliest and latest stamp; None without messages.
    complete : bool
        Whether the bag was finished and is all there.
    unusable : int
        Bytes at the end of a cut file that belong to no whole record.
    custom : dict of str to str
        The recorder's notes.

    Raises
    ------
    RecordingError
        If it is no bag written by ROS 2 or by `RunWriter`.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.scans = [scan_file(file) for file in bag_files(self.path)]
        for scan in self.scans:
            if scan.profile not in ('ros2', '') or (scan.finished and not scan.profile):
                cause = f'its MCAP profile is {scan.profile!r}, not ros2: ROS 2 did not write it'
                raise RecordingError('read', scan.path, cause)
        self.unusable = sum(scan.unusable for scan in self.scans)
        self.complete = all(scan.finished for scan in self.scans)
        if self.path.is_dir():
            found = {scan.path.name for scan in self.scans}
            self.complete = self.complete and listed_files(self.path) == found
        blocks = [block for scan in self.scans for block in scan.blocks]
        self.start_ns: int | None = min((block.start_ns for block in blocks), default=None)
        self.end_ns: int | None = max((block.end_ns for block in blocks), default=None)
        self.topics: dict[str, RecordedTopic] = {}
        for scan in self.scans:
            for number, channel in scan.channels.items():
                schema = scan.schemas.get(channel.schema_id)
                interface = schema.name if schema else ''
                earlier = self.topics.get(channel.topic)
                count = scan.counts.get(number, 0) + (earlier.message_count if earlier else 0)
                self.topics[channel.topic] = RecordedTopic(channel.topic, interface, count)
        self.custom = self._custom()

    def _custom(self) -> dict[str, str]:
        notes: dict[str, str] = {}
        for scan in self.scans:
            for record in scan.metadata:
                if record.name == 'rosbag2':
                    with suppress(yaml.YAMLError, AttributeError, KeyError, TypeError):
                        content = load_yaml(record.metadata['serialized_metadata'])
                        notes |= content.get('custom_data') or {}
        return notes

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return sum(topic.message_count for topic in self.topics.values())

    def topic(self, name: str) -> str:
        """
        Return the full name of the one topic that ends in `name`.

        A run of a node in a namespace has ``/lab/joint_states``; this finds it by
        ``'joint_states'``.

        Raises
        ------
        RecordingError
            If there is none, or more than one.
        """
        wanted = '/' + name.strip('/')
        found = [topic for topic in self.topics if ('/' + topic.strip('/')).endswith(wanted)]
        if name in self.topics:
            return name
        if len(found) == 1:
            return found[0]
        held = ', '.join(sorted(self.topics)) or 'none'
        cause = f'{len(found) or "no"} topics end in {wanted!r} (topics: {held})'
        raise RecordingError('read', self.path, cause, 'give the full name of a topic')

    def __iter__(self) -> Iterator[Record]:
        return self.records()

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Record]:
        """
        Yield the messages in the order of their stamps, and as written where these are equal.

        Only blocks that overlap in time are in memory together.

        Parameters
        ----------
        topics : collection of str, optional
            Full names of those wanted; all if not given.
        start_ns, end_ns : int, optional
            Earliest stamp wanted, and latest (inclusive).

        Raises
        ------
        RecordingError
            If a part of the bag is damaged.
        """
        first = -1 if start_ns is None else start_ns
        last = 2**64 if end_ns is None else end_ns
        names = [
            {
                number: (channel.topic, self.topics[channel.topic].type)
                for number, channel in scan.channels.items()
                if topics is None or channel.topic in topics
            }
            for scan in self.scans
        ]
        pairs = [(index, block) for index, scan in enumerate(self.scans) for block in scan.blocks]
        queue = sorted(
            (block.start_ns, place, index, block)
            for place, (index, block) in enumerate(pairs)
            if block.end_ns >= first and block.start_ns <= last
        )
        # Sorted by stamp and place in the bag; holds what later blocks may still precede.
        pending: list[tuple[int, int, int, Record]] = []
        with ExitStack() as stack:
            streams = [stack.enter_context(_open(scan.path)) for scan in self.scans]
            for start, place, index, block in queue:
                ready = bisect_left(pending, start, key=itemgetter(0))
                yield from (entry[3] for entry in pending[:ready])
                del pending[:ready]
                for number, message in enumerate(
                    read_block(self.scans[index], streams[index], block)
                ):
                    named = names[index].get(message.channel)
                    if named and first <= message.stamp_ns <= last:
                        record = Record(*named, message.stamp_ns, message.content)
                        pending.append((message.stamp_ns, place, number, record))
                pending.sort()
            yield from (entry[3] for entry in pending)

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
    ) -> Iterator[Decoded]:
        """
        Yield the messages decoded; otherwise as `records`.

        Without `topics`, those of types that are not decoded here are left out.

        Raises
        ------
        RecordingError
            If a part of the bag is damaged, or a topic asked for cannot be decoded.
        """
        if topics is None:
            topics = [topic.name for topic in self.topics.values() if topic.type in DECODABLE]
        decoders: dict[str, JointStateDecoder] = {}
        for topic, interface, stamp_ns, content in self.records(topics, start_ns, end_ns):
            try:
                if interface == _JOINT_STATE:
                    if topic not in decoders:
                        decoders[topic] = JointStateDecoder()
                    message: Message = decoders[topic].decode(content)
                else:
                    message = decode(interface, content)
            except CdrError as error:
                cause = f'the message of {topic} at {stamp_ns} ns cannot be decoded: {error}'
                raise RecordingError('read', self.path, cause) from error
            yield Decoded(topic, stamp_ns, message)


def _open(path: Path) -> BinaryIO:
    try:
        return path.open('rb')
    except OSError as error:
        raise RecordingError.from_os_error('read', path, error) from error
