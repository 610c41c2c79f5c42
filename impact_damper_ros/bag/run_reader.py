# SPDX-License-Identifier: Apache-2.0
"""A recorded run, finished or cut short, of one file or several, read without ROS."""

from __future__ import annotations

import math
from bisect import bisect_left, insort
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from heapq import merge
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from impact_damper_ros.parameters.quoting import shown

from .errors import RecordingError
from .foreign import Unpacked
from .mcap_file import ZSTD, McapFile, open_file, plain_content
from .metadata import (
    listed_files,
    listing_faults,
    listing_remarks,
    notes_of,
    read_listing,
)
from .topics import load_yaml


class RecordedMessage(NamedTuple):
    """A recorded message, still serialised."""

    topic: str
    type: str
    stamp_ns: int
    content: bytes


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a bag."""

    name: str
    type: str
    message_count: int


_STAMP = itemgetter(2)
#: Bytes of messages, with what each takes in memory, that overlap in time and are held together.
_MOST_HELD = 512 * 1024 * 1024
_HELD_EACH = 250
#: Topics that the node has recorded from its first version on.
_NOTED = ('joint_states', 'impacts', 'snapshot')


def bag_files(path: Path | str) -> list[Path]:
    """Return the files of a bag, in order: its own path, or those in the directory."""
    path = Path(path)
    if not path.is_dir():
        if not path.exists():
            cause = 'there is no such file or directory'
            raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')
        return [path]
    for kind in ('*.mcap', '*.mcap.zstd', '*.db3', '*.db3.zstd'):
        if found := sorted(path.glob(kind), key=_file_number):
            packed = path.glob('*.mcap.zstd') if kind == '*.mcap' else ()
            # The last file of a recording that was cut short is not compressed.
            found += [file for file in packed if file.with_suffix('') not in found]
            return sorted(found, key=_file_number)
    cause = 'there is no .mcap file in this directory'
    raise RecordingError('read', path, cause, 'name a bag directory or a .mcap file')


def _file_number(path: Path) -> tuple[int, str]:
    """Order ``run_10.mcap`` after ``run_9.mcap``."""
    number = path.name.partition('.')[0].rpartition('_')[2]
    return (int(number) if number.isdecimal() and len(number) < 20 else -1, path.name)


def _is_empty(path: Path) -> bool:
    return path.is_file() and path.stat().st_size == 0


class RunReader:
    """
    A recorded run.

    Parameters
    ----------
    path : Path or str
        A bag directory or a single ``.mcap`` file. It may have been cut short, by ``kill -9`` or a
        power cut; then its whole messages are read, and `complete` is False.

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
    files : list of McapFile
        Its files, in order.

    Raises
    ------
    RecordingError
        If it is no bag written by ROS 2 or by `RunWriter`.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._unpacked = Unpacked()
        self.files: list[McapFile] = []
        self._empty: list[str] = []
        paths = bag_files(self.path)
        for name in paths:
            if len(self._empty) < len(paths) - 1 and _is_empty(name):
                # A recorder of several files was killed before it wrote to its last one.
                self._empty.append(name.name)
                continue
            file = McapFile(self._unpacked.file(name), name)
            if file.profile not in ('ros2', '') or (file.finished and not file.profile):
                cause = f'its MCAP profile is {file.profile!r}, not ros2: ROS 2 did not write it'
                raise RecordingError('read', name, cause)
            self.files.append(file)
        self.unusable = sum(file.unusable for file in self.files)
        self.complete = all(file.finished for file in self.files) and not self._empty
        self._listing: Mapping[str, Any] | None = None
        self._listing_error = ''
        if self.path.is_dir():
            found = {file.source.name for file in self.files}
            try:
                self._listing = read_listing(self.path)
            except RecordingError as error:
                self._listing_error = str(error)
            whole = self._listing is not None and listed_files(self._listing) == found
            self.complete = self.complete and whole
        blocks = [block for file in self.files for block in file.blocks]
        self.start_ns: int | None = min((block.start_ns for block in blocks), default=None)
        self.end_ns: int | None = max((block.end_ns for block in blocks), default=None)
        self.topics: dict[str, RecordedTopic] = {}
        for file in self.files:
            for number, channel in file.channels.items():
                schema = file.schemas.get(channel.schema_id)
                interface = schema.name if schema else ''
                earlier = self.topics.get(channel.topic)
                count = file.counts.get(number, 0) + (earlier.message_count if earlier else 0)
                self.topics[channel.topic] = RecordedTopic(channel.topic, interface, count)
        self.custom = self._custom()

    def _custom(self) -> dict[str, str]:
        """Return the notes of all files."""
        notes = notes_of(self._listing)
        for file in self.files:
            held = [record.metadata for record in file.metadata if record.name == 'rosbag2']
            # The first one is there even in a recording that was cut short.
            for metadata in (held[:1] + held[-1:])[-2:]:
                with suppress(yaml.YAMLError, KeyError):
                    notes |= notes_of(load_yaml(metadata['serialized_metadata']))
        return notes

    @property
    def missing(self) -> str:
        """The files of ``metadata.yaml`` that are missing, in words; empty if none is."""
        if self._listing is None:
            return ''
        there = {file.source.name for file in self.files} | set(self._empty)
        names = sorted(listed_files(self._listing) - there)
        others = f' and {len(names) - 1} more' if len(names) > 1 else ''
        return f'metadata.yaml lists {shown(names[0])}{others}, not there' if names else ''

    @property
    def own(self) -> bool:
        """Whether it is the node's own recording, as it was written or recovered."""
        return 'node' in self.custom and all(file.own for file in self.files)

    @property
    def dropped(self) -> int:
        """Number of messages that the node notes it has dropped, or 0."""
        number = self.custom.get('dropped', '')
        return int(number) if number.isdecimal() and len(number) < 20 else 0

    def faults(self) -> list[str]:
        """Return the contradictions within the bag; complete once all messages were read."""
        found = [f'{name} is empty: the recording was cut short there' for name in self._empty]
        for file in self.files:
            what = 'the bag' if len(self.files) == 1 else file.source.name
            found += [f'{what} is not whole: {text}' for text in file.faults()]
        if self.own:
            found += [
                f'messages are out of order in {file.source.name}, the first at stamp '
                f'{file.disordered_ns} ns'
                for file in self.files
                if file.disordered_ns is not None
            ]
            found += [
                f'the bag is not whole: its notes name the topic {topic}, which is not in it'
                for topic in (self.custom.get(name, '') for name in _NOTED)
                if topic and topic not in self.topics and self.complete
            ]
        if self._listing_error:
            found.append(self._listing_error)
        if self._listing is not None and self.complete:
            texts = listing_faults(self._listing, self._counts())
            found += [f'the bag is not whole: {text}' for text in texts]
        return found

    def _counts(self) -> dict[str, int]:
        return {topic.name: topic.message_count for topic in self.topics.values()}

    def remarks(self) -> list[str]:
        """Return what else a user should know of the recording."""
        found = []
        if self.dropped:
            found.append(f'the recorder notes that it has dropped {self.dropped:,} messages')
        if self._listing is not None and self.complete and not self.own:
            found += listing_remarks(self._listing, self._counts())
        return found

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return sum(topic.message_count for topic in self.topics.values())

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    def records(self, topics: Collection[str] | None = None) -> Iterator[RecordedMessage]:
        """
        Yield the messages in the order of their stamps; equal stamps keep the order of the bag.

        Only chunks that overlap in time are in memory together.

        Parameters
        ----------
        topics : collection of str, optional
            Full names of those wanted; all if not given.

        Raises
        ------
        RecordingError
            If a part of the bag is damaged, or too much of it overlaps in time.
        """
        queue = sorted(
            (block.start_ns, number, place, block)
            for number, file in enumerate(self.files)
            for place, block in enumerate(file.blocks)
        )
        # The messages of each block that later blocks may still precede, in the order of the bag.
        pending: list[tuple[int, int, list[RecordedMessage]]] = []
        with ExitStack() as stack:
            opened, stream, held = -1, None, 0
            for start, number, place, block in queue:
                if ready := _taken(pending, start):
                    yield from merge(*ready, key=_STAMP)
                    held = sum(len(m.content) + _HELD_EACH for *_, found in pending for m in found)
                file = self.files[number]
                if stream is None or opened != number:
                    # One at a time: of a long run there are more than may be open.
                    stack.close()
                    opened, stream = number, stack.enter_context(open_file(file.path))
                wanted = {
                    channel: (described.topic, self.topics[described.topic].type)
                    for channel, described in file.channels.items()
                    if topics is None or described.topic in topics
                }
                messages: list[RecordedMessage] = []
                for channel, stamp_ns, content in file.read(stream, block, wanted):
                    topic, kind = wanted[channel]
                    plain = content
                    if content.startswith(ZSTD):
                        plain = self._plain(topic, stamp_ns, content)
                    messages.append(RecordedMessage(topic, kind, stamp_ns, plain))
                    held += len(plain) + _HELD_EACH
                    if held > _MOST_HELD:
                        self._refuse_overlap()
                messages.sort(key=_STAMP)
                if messages:
                    insort(pending, (number, place, messages))
            yield from merge(*_taken(pending, math.inf), key=_STAMP)

    def _plain(self, topic: str, stamp_ns: int, content: bytes) -> bytes:
        try:
            return plain_content(content)
        except ValueError as error:
            cause = f'the message of {topic} at {stamp_ns} ns cannot be expanded: {error}'
            raise RecordingError('read', self.path, cause) from error

    def _refuse_overlap(self) -> None:
        cause = (
            f'its chunks overlap so much in time that more than {_MOST_HELD // 2**20} MiB would '
            'be needed to put their messages in order'
        )
        raise RecordingError('read', self.path, cause, 'rewrite it with: ros2 bag convert')


def _taken(
    pending: list[tuple[int, int, list[RecordedMessage]]], before_ns: float
) -> list[list[RecordedMessage]]:
    """Take out the messages from before a stamp, block by block."""
    ready = []
    for *_, messages in pending:
        if messages[0].stamp_ns < before_ns:
            cut = bisect_left(messages, before_ns, key=_STAMP)
            ready.append(messages[:cut])
            del messages[:cut]
    if ready:
        pending[:] = [entry for entry in pending if entry[-1]]
    return ready
