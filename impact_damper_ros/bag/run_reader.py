"""
A recorded run, finished or cut short, compressed or in SQLite, read without ROS.

Compressed and SQLite files are converted into a temporary file, which is deleted with the reader.
"""

from __future__ import annotations

import json
import shlex
import shutil
import sqlite3
import tempfile
import weakref
from bisect import bisect_left
from collections import OrderedDict
from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from operator import itemgetter
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import yaml
import zstandard
from mcap.writer import CompressionType, Writer

from impact_damper_ros.rig.quoting import counted, shown

from .errors import RecordingError
from .mcap_scan import LARGEST_CHUNK, MAGIC, Scan, open_file, plain_content, read_block, scan_file
from .messages import DECODABLE, JOINT_STATE, CdrError, JointStateDecoder, Message, decode
from .metadata import (
    PART,
    check_summary,
    description_faults,
    listed_files,
    listing_faults,
    listing_remarks,
    notes_of,
    number_faults,
    read_listing,
)
from .rig_topics import RIG_TOPICS
from .topics import definition, load_yaml

#: Bytes to which the compressed files of a bag may expand in all.
MOST_EXPANDED = 8 * 1024**3
#: Bytes that are left free on the disk.
_SPARE = 256 * 1024**2
_PIECE = 1024 * 1024
_ZSTD = b'\x28\xb5\x2f\xfd'
_SQLITE = b'SQLite format 3\0'


#: Longest wait of SQLite, s.
_DB_TIMEOUT_S = 5.0
_LATEST_STAMP = 2**63 - 1


class Unpacked:
    """The files of one bag as plain MCAP files."""

    def __init__(self) -> None:
        self._directory: Path | None = None
        self._left = MOST_EXPANDED
        self._count = 0

    def file(self, path: Path) -> Path:
        """Return the plain MCAP file of a bag's file: itself, or an expanded copy."""
        plain = path
        try:
            with open_file(path) as stream:
                head = stream.read(len(_SQLITE))
                if head.startswith(_ZSTD):
                    stream.seek(0)
                    plain = self._expanded(path, stream)
            if plain is not path:
                with plain.open('rb') as stream:
                    head = stream.read(len(_SQLITE))
            return self._of_database(path, plain) if head == _SQLITE else plain
        except OSError as error:
            raise RecordingError.from_os_error('expand', path, error) from error

    def _new_file(self) -> tuple[Path, int]:
        """Return the path of a new temporary file, and how long it may become."""
        if self._directory is None:
            self._directory = Path(tempfile.mkdtemp(prefix='impact_damper_bag_'))
            weakref.finalize(self, shutil.rmtree, self._directory, ignore_errors=True)
        self._count += 1
        free = shutil.disk_usage(self._directory).free - _SPARE
        return self._directory / f'{self._count}.mcap', max(0, min(self._left, free))

    def _expanded(self, path: Path, stream: BinaryIO) -> Path:
        copy, limit = self._new_file()
        try:
            size = zstandard.get_frame_parameters(stream.read(_PIECE)).content_size
            if size == zstandard.CONTENTSIZE_UNKNOWN:
                size = limit
            if size > limit:
                raise _too_large(path, f'{size} bytes are declared', limit)
            stream.seek(0)
            reader = zstandard.ZstdDecompressor().stream_reader(stream)
            length = 0
            with copy.open('wb') as output:
                while piece := reader.read(_PIECE):
                    if not length and not piece.startswith((MAGIC[: len(piece)], _SQLITE)):
                        cause = 'its compressed content is not a file of a bag'
                        raise RecordingError('read', path, cause)
                    length += len(piece)
                    if length > size:
                        raise _too_large(path, f'it expands to more than {size} bytes', limit)
                    output.write(piece)
            self._left -= length
        except zstandard.ZstdError as error:
            cause = f'its compression is damaged: {error}'
            raise RecordingError('expand', path, cause) from error
        return copy

    def _of_database(self, path: Path, database: Path) -> Path:
        """Convert an SQLite file of rosbag2 into an MCAP file."""
        copy, limit = self._new_file()
        try:
            address = f'{database.absolute().as_uri()}?mode=ro'
            with (
                closing(sqlite3.connect(address, _DB_TIMEOUT_S, uri=True)) as connection,
                copy.open('wb') as output,
            ):
                # The database may neither change nor compute anything, nor hold larger values.
                connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_CHUNK)
                connection.execute('PRAGMA trusted_schema = OFF')
                connection.execute('PRAGMA query_only = ON')
                writer = Writer(output, compression=CompressionType.NONE)
                writer.start('ros2', 'rosbag2 sqlite3')
                channels = dict(_database_channels(connection, writer))
                query = 'SELECT topic_id, timestamp, data FROM messages ORDER BY timestamp, id'
                for topic, stamp, content in connection.execute(query):
                    if not isinstance(content, bytes) or not isinstance(stamp, int):
                        raise sqlite3.DatabaseError(f'a message is {shown(content)}, not bytes')
                    if not 0 <= stamp <= _LATEST_STAMP or topic not in channels:
                        text = f'a message of topic {shown(topic)} is stamped {stamp} ns'
                        raise sqlite3.DatabaseError(text)
                    writer.add_message(channels[topic], stamp, content, stamp)
                    if output.tell() > limit:
                        raise _too_large(path, f'its messages are more than {limit} bytes', limit)
                writer.finish()  # type: ignore[no-untyped-call]
                self._left -= output.tell()
        except (sqlite3.Error, LookupError, OverflowError, ValueError) as error:
            cause = f'it is stored in SQLite, and cannot be read: {error}'
            raise RecordingError('read', path, cause, _conversion(path)) from error
        return copy


def _database_channels(
    connection: sqlite3.Connection, writer: Writer
) -> Iterator[tuple[Any, int]]:
    """Register the topics; yield the number of each in the database and in the MCAP file."""
    master = "SELECT name, sql FROM sqlite_master WHERE type = 'table'"
    tables = {name: str(sql) for name, sql in connection.execute(master)}
    for name in ('topics', 'messages'):
        # Neither a view nor a virtual or computed table
        words = tables.get(name, '').upper()
        if not words.startswith('CREATE TABLE') or 'GENERATED' in words or ' AS ' in words:
            raise sqlite3.DatabaseError(f'it has no table {name} as rosbag2 writes it')
    schemas: dict[str, int] = {}
    rows = connection.execute('SELECT * FROM topics')
    names = [column[0] for column in rows.description]
    for row in rows:
        topic = dict(zip(names, row, strict=True))
        kind = str(topic['type'])
        if kind not in schemas:
            with suppress(ValueError):
                schemas[kind] = writer.register_schema(kind, 'ros2msg', definition(kind).encode())
        if kind not in schemas:
            schemas[kind] = writer.register_schema(kind, '', b'')
        yield (
            topic['id'],
            writer.register_channel(
                str(topic['name']),
                str(topic.get('serialization_format', 'cdr')),
                schemas[kind],
                {
                    'offered_qos_profiles': str(topic.get('offered_qos_profiles', '')),
                    'topic_type_hash': str(topic.get('type_description_hash', '')),
                },
            ),
        )


def _too_large(path: Path, what: str, limit: int) -> RecordingError:
    cause = (
        f'{what}; {limit} can be used here (at most {MOST_EXPANDED} for a bag, and what is free '
        f'in {tempfile.gettempdir()})'
    )
    remedy = 'set TMPDIR to a directory with more space, or expand or convert it beforehand'
    return RecordingError('expand', path, cause, remedy)


def _conversion(path: Path) -> str:
    """Return the command that converts the bag of a file."""
    bag = path.absolute().parent
    options = {'uri': f'{bag.name}_mcap', 'storage_id': 'mcap', 'all_topics': True}
    text = shlex.quote(json.dumps({'output_bags': [options]}))
    return (
        f'convert it with ROS 2: echo {text} > to_mcap.yaml && '
        f'ros2 bag convert -i {shlex.quote(str(path.parent))} -o to_mcap.yaml'
    )


class RecordedMessage(NamedTuple):
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


#: Bytes of messages, with what each takes in memory, that overlap in time and are held together.
_MOST_HELD = 512 * 1024 * 1024
_HELD_EACH = 250
#: Files that are open at once.
_MOST_OPEN = 50
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
    parts : list of int
        The number of each file in the bag of which this package has written it; 0 of others.

    Raises
    ------
    RecordingError
        If it is no bag written by ROS 2 or by `RunWriter`.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._unpacked = Unpacked()
        self.scans: list[Scan] = []
        self._empty: list[str] = []
        files = bag_files(self.path)
        for file in files:
            if len(self._empty) < len(files) - 1 and _is_empty(file):
                # A recorder of several files was killed before it wrote to its last one.
                self._empty.append(file.name)
                continue
            scan = scan_file(self._unpacked.file(file), file)
            if scan.profile not in ('ros2', '') or (scan.finished and not scan.profile):
                cause = f'its MCAP profile is {scan.profile!r}, not ros2: ROS 2 did not write it'
                raise RecordingError('read', scan.source, cause)
            check_summary(scan)
            self.scans.append(scan)
        self.unusable = sum(scan.unusable for scan in self.scans)
        self.complete = all(scan.finished for scan in self.scans) and not self._empty
        self._listing: Mapping[str, Any] | None = None
        self._listing_error = ''
        if self.path.is_dir():
            found = {scan.source.name for scan in self.scans}
            try:
                self._listing = read_listing(self.path)
            except RecordingError as error:
                self._listing_error = str(error)
            whole = self._listing is not None and listed_files(self._listing) == found
            self.complete = self.complete and whole
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
        self.parts: list[int] = []
        self.custom = self._custom()

    def _custom(self) -> dict[str, str]:
        """Return the notes of all files; of each, note which part of the bag it is."""
        notes = notes_of(self._listing)
        for scan in self.scans:
            held = [record.metadata for record in scan.metadata if record.name == 'rosbag2']
            # The first one is there even in a recording that was cut short.
            for metadata in (held[:1] + held[-1:])[-2:]:
                with suppress(yaml.YAMLError, KeyError):
                    notes |= notes_of(load_yaml(metadata['serialized_metadata']))
            part = notes.pop(PART, '') if scan.own else ''
            self.parts.append(int(part) if part.isdecimal() and len(part) < 20 else 0)
        return notes

    @property
    def begins_later(self) -> bool:
        """Whether this is a later file of a bag, read alone."""
        return not self.path.is_dir() and self.parts[0] > 0

    @property
    def missing(self) -> str:
        """The files of ``metadata.yaml`` that are missing, in words; empty if none is."""
        if self._listing is None:
            return ''
        there = {scan.source.name for scan in self.scans} | set(self._empty)
        names = sorted(listed_files(self._listing) - there)
        others = f' and {len(names) - 1} more' if len(names) > 1 else ''
        return f'metadata.yaml lists {shown(names[0])}{others}, not there' if names else ''

    def _missing_parts(self) -> Iterator[str]:
        """Yield where files are missing, by the numbers in files of this package."""
        expected = self.parts[0] if self.begins_later else 0
        for scan, part in zip(self.scans, self.parts, strict=True):
            if part > expected:
                lost = counted(part - expected, 'file')
                yield f'{lost} of it missing before {scan.source.name}'
            expected = part + 1

    @property
    def own(self) -> bool:
        """Whether it is the node's own recording, as it was written or recovered."""
        return 'node' in self.custom and all(scan.own for scan in self.scans)

    @property
    def dropped(self) -> int:
        """Number of messages that the node notes it has dropped, or 0."""
        number = self.custom.get('dropped', '')
        return int(number) if number.isdecimal() and len(number) < 20 else 0

    def faults(self) -> list[str]:
        """Return the contradictions within the bag; complete once all messages were read."""
        found = [f'{name} is empty: the recording was cut short there' for name in self._empty]
        for scan in self.scans:
            what = 'the bag' if len(self.scans) == 1 else scan.source.name
            for kind, (text, count) in scan.faults.items():
                if kind.startswith('number') and not self.own:
                    # Of another recorder's messages, as recover_run has kept them
                    continue
                others = f' (the first of {count})' if count > 1 else ''
                found.append(f'{what} is not whole: {text}{others}')
        found += [f'the bag is not whole: {text}' for text in self._missing_parts()]
        described = {text: None for scan in self.scans for text in self._described(scan)}
        found += [f'the bag contradicts itself: {text}' for text in described]
        if self.own:
            numbers = number_faults(self.scans, later=self.begins_later)
            found += [f'the bag is not whole: {text}' for text in numbers]
            found += [
                f'the bag is not whole: its notes name the topic {topic}, which is not in it'
                for topic in (self.custom.get(name, '') for name in _NOTED)
                if topic and topic not in self.topics and self.complete
            ]
        if self._listing_error:
            found.append(self._listing_error)
        if self._listing is not None and self.complete:
            counts = {topic.name: topic.message_count for topic in self.topics.values()}
            types = {topic.name: topic.type for topic in self.topics.values()}
            texts = listing_faults(self._listing, self.scans, counts, types, own=self.own)
            found += [f'the bag is not whole: {text}' for text in texts]
        return found

    def _described(self, scan: Scan) -> Iterator[str]:
        """Yield the faults of a file whose schemas or encodings contradict its messages."""
        yield from description_faults(scan, DECODABLE)
        if self.own:
            for name, topic in RIG_TOPICS.items():
                held = self.topics.get(self.custom.get(name, ''))
                if held is not None and held.type != topic.type:
                    yield f'{held.name} is of type {shown(held.type)}, not {topic.type}'
            listed = notes_of(self._listing)
            for name in sorted(listed.keys() & self.custom.keys()):
                if listed[name] != self.custom[name]:
                    yield (
                        f'metadata.yaml notes {name} as {shown(listed[name])}, the file as '
                        f'{shown(self.custom[name])}'
                    )

    def remarks(self) -> list[str]:
        """Return what else a user should know of the recording."""
        found = []
        if self.dropped:
            found.append(f'the recorder notes that it has dropped {self.dropped:,} messages')
        if self._listing is not None and self.complete and not self.own:
            counts = {topic.name: topic.message_count for topic in self.topics.values()}
            found += listing_remarks(self._listing, counts)
        return found

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

    def __iter__(self) -> Iterator[RecordedMessage]:
        return self.records()

    def records(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        by_index: bool = False,
    ) -> Iterator[RecordedMessage]:
        """
        Yield the messages in the order of their stamps, and as written where these are equal.

        Only blocks that overlap in time are in memory together.

        Parameters
        ----------
        topics : collection of str, optional
            Full names of those wanted; all if not given.
        start_ns, end_ns : int, optional
            Earliest stamp wanted, and latest (inclusive).
        by_index : bool, optional
            Whether chunks are left out that have none of the topics, by their index.

        Raises
        ------
        RecordingError
            If a part of the bag is damaged, or too much of it overlaps in time.
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
            if not by_index or self.scans[index].may_hold(block, names[index])
        )
        # Sorted by stamp and place in the bag; holds what later blocks may still precede.
        pending: list[tuple[int, int, int, RecordedMessage]] = []
        held = 0
        with ExitStack() as stack:
            # Of a long run there are more files than may be open at once.
            streams: OrderedDict[int, BinaryIO] = OrderedDict()
            stack.callback(lambda: [stream.close() for stream in streams.values()])
            for start, place, index, block in queue:
                if index not in streams:
                    if len(streams) >= _MOST_OPEN:
                        streams.popitem(last=False)[1].close()
                    streams[index] = open_file(self.scans[index].path)
                streams.move_to_end(index)
                ready = bisect_left(pending, start, key=itemgetter(0))
                yield from (entry[3] for entry in pending[:ready])
                held -= sum(len(entry[3].content) + _HELD_EACH for entry in pending[:ready])
                del pending[:ready]
                scan, channels = self.scans[index], names[index]
                for number, message in enumerate(
                    read_block(scan, streams[index], block, channels)
                ):
                    if first <= message.stamp_ns <= last:
                        named = channels[message.channel]
                        content = self._plain(named[0], message.stamp_ns, message.content)
                        record = RecordedMessage(*named, message.stamp_ns, content)
                        pending.append((message.stamp_ns, place, number, record))
                        held += len(content) + _HELD_EACH
                        if held > _MOST_HELD:
                            self._refuse_overlap()
                pending.sort()
            yield from (entry[3] for entry in pending)

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
                if interface == JOINT_STATE:
                    if topic not in decoders:
                        decoders[topic] = JointStateDecoder()
                    message: Message = decoders[topic].decode(content)
                else:
                    message = decode(interface, content)
            except CdrError as error:
                cause = f'the message of {topic} at {stamp_ns} ns cannot be decoded: {error}'
                raise RecordingError('read', self.path, cause) from error
            yield Decoded(topic, stamp_ns, message)
