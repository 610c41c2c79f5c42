# SPDX-License-Identifier: Apache-2.0
"""A recorded run, finished or cut short, of one file or several, read without ROS."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, suppress
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, cast

import yaml

from impact_damper_ros.parameters.quoting import quote

from .errors import RecordingError
from .mcap_file import McapFile
from .metadata import listed_files, listing_faults, listing_remarks, notes_of, read_listing
from .topics import load_yaml


class RecordedMessage(NamedTuple):
    """A recorded message, still serialised."""

    topic: str
    type: str
    stamp_ns: int
    content: bytes


class RecordedTopic(NamedTuple):
    """A topic of a bag, with messages of one type."""

    name: str
    type: str
    message_count: int


_STAMP = itemgetter(2)
#: Most bytes in memory of messages that overlap in time.
_MOST_HELD = 512 * 1024 * 1024
_EACH = 250
_REMEDY = 'name a bag directory or a .mcap file'


def bag_files(path: Path | str) -> list[Path]:
    """
    Return the files of a bag, in order: its own path, or those in the directory.

    The files are those that `metadata.yaml` lists. Without a readable list, or where all its files
    are missing, they are all files of the kind that rosbag2 writes, but hidden ones.
    """
    path, listing = Path(path), None
    with suppress(RecordingError):
        listing = read_listing(path) if path.is_dir() else None
    return _files_of(path, listing)


def _files_of(path: Path, listing: Mapping[str, Any] | None) -> list[Path]:
    if not path.is_dir():
        if not path.exists():
            raise RecordingError('read', path, 'there is no such file or directory', _REMEDY)
        return [path]
    if listing is not None:
        listed = [path / name for name in listed_files(listing)]
        if found := [file for file in listed if file.exists()]:
            return found
    for kind in ('mcap', 'mcap.zstd', 'db3', 'db3.zstd'):
        if found := [file for file in path.glob(f'*.{kind}') if file.name[0] != '.']:
            return sorted(found, key=_file_number)
    raise RecordingError('read', path, 'there is no .mcap file in this directory', _REMEDY)


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
        A bag directory or a single MCAP file. It may have been cut short, by ``kill -9`` or a
        power cut; then its whole messages are read, and `complete` is False.

    Attributes
    ----------
    path : Path
        As given.
    topics : dict of (str, str) to RecordedTopic
        Topics by name and type: a topic that has messages of two types stands here twice.
    start_ns, end_ns : int or None
        Earliest and latest stamp; None without messages.
    complete : bool
        Whether the bag was finished and no file is missing.
    unusable : int
        Bytes that belong to no whole record, as at the end of a cut file.
    custom : dict of str to str
        The recorder's notes.
    distro : str
        The distribution of ROS that the bag states; empty if none.
    files : list of McapFile
        Its files, in order.

    Raises
    ------
    RecordingError
        If `path` is no bag written by ROS 2 or by `RunWriter`, or not plain MCAP.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self.files: list[McapFile] = []
        self._empty: list[str] = []
        self._listing: Mapping[str, Any] | None = None
        self._listing_error = ''
        if self.path.is_dir():
            try:
                self._listing = read_listing(self.path)
            except RecordingError as error:
                self._listing_error = str(error)
        paths = _files_of(self.path, self._listing)
        for name in paths:
            if len(self._empty) < len(paths) - 1 and _is_empty(name):
                # A recorder of several files was killed before it wrote to its last one.
                self._empty.append(name.name)
                continue
            file = McapFile(name)
            # Some recorders state no profile.
            if file.profile not in ('ros2', ''):
                cause = f'its MCAP profile is {file.profile!r}, not ros2: ROS 2 did not write it'
                raise RecordingError('read', name, cause)
            self.files.append(file)
        self.unusable = sum(file.unusable for file in self.files)
        self.complete = all(file.finished for file in self.files) and not self._empty
        if self.path.is_dir():
            self.complete &= self._listing is not None and not self.missing
        blocks = [block for file in self.files for block in file.blocks]
        self.start_ns: int | None = min((block.start_ns for block in blocks), default=None)
        self.end_ns: int | None = max((block.end_ns for block in blocks), default=None)
        counts: Counter[tuple[str, str]] = Counter()
        for file in self.files:
            for number, channel in file.channels.items():
                counts[channel.topic, channel.type] += file.counts.get(number, 0)
        self.topics = {key: RecordedTopic(*key, count) for key, count in counts.items()}
        self.custom: dict[str, str] = {}
        self.distro = ''
        for described in self._descriptions():
            self.custom |= notes_of(described)
            self.distro = str(described.get('ros_distro') or self.distro)

    def _descriptions(self) -> Iterator[Mapping[str, Any]]:
        """Yield the descriptions of the bag by metadata.yaml and by the files, in one form."""
        yield self._listing or {}
        for file in self.files:
            held = [record.metadata for record in file.metadata if record.name == 'rosbag2']
            # The first file is there even in a recording that was cut short.
            for metadata in held[:1] + held[1:][-1:]:
                with suppress(yaml.YAMLError, KeyError):
                    described = load_yaml(metadata['serialized_metadata'])
                    if isinstance(described, dict):
                        yield described

    @property
    def missing(self) -> str:
        """The files of ``metadata.yaml`` that are missing, in words; empty if none is."""
        if self._listing is None:
            return ''
        there = {file.path.name for file in self.files} | set(self._empty)
        names = [name for name in listed_files(self._listing) if name not in there]
        others = f' and {len(names) - 1} more' if len(names) > 1 else ''
        return f'metadata.yaml lists {quote(names[0])}{others}, not there' if names else ''

    @property
    def own(self) -> bool:
        """Whether the node wrote the recording; it may be recovered."""
        return 'node' in self.custom and all(file.own for file in self.files)

    @property
    def dropped(self) -> int:
        """Number of messages that the node dropped by its notes, or 0."""
        number = self.custom.get('dropped', '')
        return int(number) if number.isdecimal() and len(number) < 20 else 0

    def faults(self) -> list[str]:
        """Return the contradictions within the bag; complete once all messages were read."""
        found = [f'{name} is empty: the recording was cut short there' for name in self._empty]
        if source := self.custom.get('recovered_from'):
            found.append(
                f'the bag is recovered from {quote(source)}, which was cut short or damaged: '
                f'{self.custom.get("lost_bytes", "?")} bytes of that could not be used, and '
                f'{self.custom.get("doubtful", "?")} messages may be altered'
            )
        for file in self.files:
            what = 'the bag' if len(self.files) == 1 else file.path.name
            found += [f'{what} is not complete: {text}' for text in file.faults()]
        names = {name for name, _ in self.topics}
        if self.own and self.complete:
            noted = {text for key, text in self.custom.items() if key != 'node'}
            found += [
                f'the bag is not complete: its notes name the topic {topic}, which is not in it'
                for topic in sorted(noted - names)
                if topic.startswith('/')
            ]
        if self._listing_error:
            found.append(self._listing_error)
        if self._listing is not None and self.complete:
            texts = listing_faults(self._listing, self.message_count)
            found += [f'the bag is not complete: {text}' for text in texts]
        return found

    def remarks(self) -> list[str]:
        """Return remarks for the user on the recording."""
        found = []
        if self.dropped:
            found.append(f'the recorder notes that it has dropped {self.dropped:,} messages')
        if self._listing is not None and self.complete and not self.own:
            found += listing_remarks(self._listing, self.message_count)
        return found

    @property
    def span(self) -> float:
        """Time from the earliest to the latest stamp, s."""
        return ((self.end_ns or 0) - (self.start_ns or 0)) / 1e9

    @property
    def message_count(self) -> int:
        """Number of messages."""
        return sum(topic.message_count for topic in self.topics.values())

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.messages()

    def messages(
        self, topics: Collection[str | tuple[str, str]] | None = None
    ) -> Iterator[RecordedMessage]:
        """
        Yield the messages in the order of their stamps.

        Only chunks that overlap in time are in memory together.

        Parameters
        ----------
        topics : collection of str and (str, str), optional
            Topics to read, each by its full name or by name and type; all if not given.

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
        wanted = [self._wanted_channels(file, topics) for file in self.files]
        # Messages that later blocks may still precede
        held: list[RecordedMessage] = []
        with ExitStack() as stack:
            opened, stream = -1, cast('Any', None)
            for start_ns, number, _, block in queue:
                ready = bisect_left(held, start_ns, key=_STAMP)
                yield from held[:ready]
                del held[:ready]
                file, channels = self.files[number], wanted[number]
                if opened != number:
                    # One file at a time: a long run has more files than may be open.
                    stack.close()
                    opened, stream = number, stack.enter_context(file.open())
                stored, fault = file.read(stream, block, channels)
                if fault:
                    remedy = 'recover_run saves the rest of the bag'
                    raise RecordingError('read', file.path, fault, remedy)
                held += [
                    RecordedMessage(*channels[channel], stamp_ns, content)
                    for channel, _, stamp_ns, _, content in stored
                ]
                held.sort(key=_STAMP)
                if sum(len(message.content) + _EACH for message in held) > _MOST_HELD:
                    cause = (
                        f'its chunks overlap so much in time that more than {_MOST_HELD >> 20} '
                        'MiB would be needed to put their messages in order'
                    )
                    remedy = 'rewrite it with: ros2 bag convert'
                    raise RecordingError('read', self.path, cause, remedy)
            yield from held

    @staticmethod
    def _wanted_channels(
        file: McapFile, topics: Collection[str | tuple[str, str]] | None
    ) -> dict[int, tuple[str, str]]:
        """Return name and type of the wanted channels of a file, by number."""
        keys = {number: (c.topic, c.type) for number, c in file.channels.items()}
        return {n: k for n, k in keys.items() if topics is None or k in topics or k[0] in topics}
