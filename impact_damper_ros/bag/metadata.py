"""
The ``metadata.yaml`` of a rosbag2 bag, version 9 (ROS 2 Jazzy), and checks of a bag against it.

Lost parts are detected: the summary of an MCAP file counts its messages and chunks and names their
places, and ``metadata.yaml`` counts those of the whole bag. A writer may leave out summary and
checksums; then nothing is checked.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from mcap.opcode import Opcode

from impact_damper_ros.outputs import write_text
from impact_damper_ros.rig.quoting import counted, shown

from .errors import RecordingError
from .mcap_scan import Scan, jump_text, open_file
from .topics import LONGEST_YAML, Channel, dump_yaml, load_yaml, says_the_same, type_hash

FILE_NAME = 'metadata.yaml'
#: Note in a file of this package that is not the first of its bag: its number there.
PART = 'part'
VERSION = 9

#: Starting time of a bag without messages, as rosbag2 has it: the largest int64.
_NEVER = 2**63 - 1


class FileInformation(NamedTuple):
    """The entry of one file of a bag."""

    path: str  # name within the directory of the bag
    #: Earliest and latest stamp; None without messages.
    start_ns: int | None = None
    end_ns: int | None = None
    message_count: int = 0

    def times(self) -> dict[str, Any]:
        """Return beginning and duration with the names of rosbag2."""
        if self.start_ns is None or self.end_ns is None:
            start, duration = _NEVER, 0
        else:
            start, duration = self.start_ns, self.end_ns - self.start_ns
        return {
            'starting_time': {'nanoseconds_since_epoch': start},
            'duration': {'nanoseconds': duration},
        }


@dataclass(frozen=True)
class BagMetadata:
    """The metadata of a bag."""

    files: tuple[FileInformation, ...]  # the MCAP files, in order
    channels: tuple[Channel, ...]
    counts: tuple[int, ...]  # messages in each channel
    custom: Mapping[str, str] = field(default_factory=dict)  # free notes of the recorder

    @property
    def whole(self) -> FileInformation:
        """The entry of all files together."""
        starts = [file.start_ns for file in self.files if file.start_ns is not None]
        ends = [file.end_ns for file in self.files if file.end_ns is not None]
        return FileInformation(
            '', min(starts, default=None), max(ends, default=None), sum(self.counts)
        )

    def as_mapping(self) -> dict[str, Any]:
        """Return the fields with the names and in the order of rosbag2."""
        times = self.whole.times()
        return {
            'version': VERSION,
            'storage_identifier': 'mcap',
            'duration': times['duration'],
            'starting_time': times['starting_time'],
            'message_count': sum(self.counts),
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': channel.topic,
                        'type': channel.type,
                        'serialization_format': channel.message_encoding,
                        'offered_qos_profiles': [dict(qos) for qos in channel.qos_profiles],
                        'type_description_hash': channel.type_hash,
                    },
                    'message_count': count,
                }
                for channel, count in zip(self.channels, self.counts, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [file.path for file in self.files],
            'files': [
                {'path': file.path, **file.times(), 'message_count': file.message_count}
                for file in self.files
            ],
            'custom_data': dict(self.custom) or None,
            'ros_distro': os.environ.get('ROS_DISTRO') or 'jazzy',
        }

    def serialized(self) -> str:
        """Return the YAML for the MCAP file itself."""
        return dump_yaml(self.as_mapping())

    def write(self, directory: Path) -> None:
        """Write ``metadata.yaml``, whole or not at all."""
        text = dump_yaml({'rosbag2_bagfile_information': self.as_mapping()}) + '\n'
        write_text(directory / FILE_NAME, text)
        sync_directory(directory)


def sync_directory(directory: Path) -> None:
    """Make the names in a directory survive a power cut; nothing where that is not supported."""
    with suppress(OSError):
        descriptor = os.open(directory, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def read_listing(directory: Path) -> dict[str, Any] | None:
    """Return the content of a bag's ``metadata.yaml``; None if there is none."""
    path = directory / FILE_NAME
    if not path.exists():
        return None
    with open_file(path) as stream:
        content = stream.read(LONGEST_YAML + 1)
    try:
        listing = load_yaml(content.decode())['rosbag2_bagfile_information']
        if not all(isinstance(file, str) for file in listing['relative_file_paths']):
            raise TypeError('relative_file_paths are not all texts')
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, KeyError) as error:
        cause = f'it is not the metadata of a bag: {" ".join(str(error).split())}'
        remedy = 'recover_run makes a new one; so does: ros2 bag reindex'
        raise RecordingError('use', path, cause, remedy) from error
    return dict(listing)


def listed_files(listing: Mapping[str, Any]) -> set[str]:
    """Return the names of the files that ``metadata.yaml`` lists."""
    return {Path(path).name for path in listing['relative_file_paths']}


def notes_of(content: object) -> dict[str, str]:
    """Return the notes of the recorder in the metadata: texts and numbers."""
    custom = content.get('custom_data') if isinstance(content, dict) else None
    if not isinstance(custom, dict):
        return {}
    return {
        str(key): str(value)
        for key, value in custom.items()
        if isinstance(key, str | int | float) and isinstance(value, str | int | float)
    }


_PIECE = 1024 * 1024
_MAGIC_LENGTH = 8
_FOOTER_LENGTH = 9 + 8 + 8 + 4
#: Times in the metadata of other recorders are right to about this, ns: theirs is the first
#: message to arrive, not the earliest.
_ABOUT_NS = 10**9


def _messages(count: int) -> str:
    return counted(count, 'message', ',')


def check_summary(scan: Scan) -> None:
    """Compare the summary of a finished file with its content."""
    if not scan.finished:
        return
    for kind, text in (*_count_faults(scan), *_chunk_faults(scan), *_checksum_faults(scan)):
        scan.fault(kind, text)


def _count_faults(scan: Scan) -> Iterator[tuple[str, str]]:
    said = scan.statistics
    if said is None:
        return
    wrong = False
    for channel in sorted({*said.channel_message_counts, *scan.counts}):
        listed = said.channel_message_counts.get(channel, 0)
        there = scan.counts.get(channel, 0)
        if listed != there:
            wrong = True
            text = f'its statistics count {_messages(listed)} on {scan.topic_of(channel)}'
            yield f'statistics {channel}', f'{text}, not {there:,}'
    total = sum(scan.counts.values())
    if said.message_count != total and not wrong:
        text = f'its statistics count {_messages(said.message_count)} in all, not {total:,}'
        yield 'statistics', text
    chunks = len(scan.heads)
    if said.chunk_count != chunks:
        text = f'its statistics count {counted(said.chunk_count, "chunk", ",")}, not {chunks:,}'
        yield 'chunk count', text
    for what, listed, there in (
        ('metadata record', said.metadata_count, len(scan.metadata)),
        ('attachment', said.attachment_count, scan.attachments),
    ):
        if listed != there:
            text = f'its statistics count {counted(listed, what, ",")}, not {there:,}'
            yield what, text
    if total and scan.blocks:
        span = min(b.start_ns for b in scan.blocks), max(b.end_ns for b in scan.blocks)
        if (said.message_start_time, said.message_end_time) != span:
            yield (
                'statistics times',
                f'its statistics give stamps from {said.message_start_time} to '
                f'{said.message_end_time} ns, they go from {span[0]} to {span[1]} ns',
            )


def _chunk_faults(scan: Scan) -> Iterator[tuple[str, str]]:
    heads = {head.position: head for head in scan.heads}
    offsets = {
        position: {part.channel: part.position for part in scan.indexes.get(position + 9, ())}
        for position in heads
    }
    listed: set[int] = set()
    for index in scan.chunk_indexes:
        where = index.chunk_start_offset
        head = heads.get(where)
        if head is None:
            yield 'chunk place', f'its summary lists a chunk at byte {where}, where there is none'
            continue
        if where in listed:
            yield 'chunk twice', f'its summary lists the chunk at byte {where} twice'
        listed.add(where)
        said = (
            index.chunk_length,
            index.message_start_time,
            index.message_end_time,
            index.compression,
            index.compressed_size,
            index.uncompressed_size,
        )
        if said != head[1:]:
            yield (
                'chunk head',
                'its summary describes the chunk at byte '
                f'{where} (length, stamps, compression, sizes): {shown(said)}; the chunk says '
                f'{shown(tuple(head[1:]))}',
            )
        if index.message_index_offsets and index.message_index_offsets != offsets[where]:
            text = f'the message indexes of the chunk at byte {where} are not where it names them'
            yield 'index place', f'its summary is wrong: {text}'
    if scan.chunk_indexes:
        for where in heads.keys() - listed:
            yield 'chunk unlisted', f'its summary does not list the chunk at byte {where}'


def _checksum_faults(scan: Scan) -> Iterator[tuple[str, str]]:
    footer, end = scan.footer, scan.data_end
    if footer is None or end is None:
        yield 'data end', 'it has no record that ends its data'
        return
    position, checksum = end
    # Opcode, length and checksum
    begin = position + 9 + 4
    if footer.summary_start not in (0, begin):
        yield (
            'summary place',
            f'its footer places the summary at byte {footer.summary_start}, not {begin}',
        )
    elif footer.summary_start and footer.summary_crc:
        with open_file(scan.path) as stream:
            stream.seek(begin)
            summary = stream.read(scan.size - begin - _MAGIC_LENGTH - _FOOTER_LENGTH)
        head = struct.pack(
            '<BQQQ', Opcode.FOOTER, 20, footer.summary_start, footer.summary_offset_start
        )
        if zlib.crc32(head, zlib.crc32(summary)) != footer.summary_crc:
            yield 'summary checksum', 'the checksum of its summary does not match'
    # Writers differ in whether the magic bytes at the beginning count.
    if checksum and checksum not in (_crc(scan, 0, position), _crc(scan, _MAGIC_LENGTH, position)):
        yield 'data checksum', 'the checksum of its data does not match'


def _crc(scan: Scan, begin: int, end: int) -> int:
    crc = 0
    with open_file(scan.path) as stream:
        stream.seek(begin)
        while begin < end and (piece := stream.read(min(_PIECE, end - begin))):
            crc = zlib.crc32(piece, crc)
            begin += len(piece)
    return crc


def number_faults(scans: Sequence[Scan], *, later: bool = False) -> Iterator[str]:
    """
    Yield gaps in the sequence numbers of the node's own bag, the first one of each topic.

    A file may begin at 0 or continue the one before. After a chunk that could not be read,
    nothing is checked.
    """
    last: dict[str, int] = {}
    wrong: set[str] = set()
    for scan in scans:
        here: dict[str, int] = {}
        for block in scan.blocks:
            held = scan.numbers.get(block.offset)
            if held is None:
                return
            for channel, (begin, end) in held.items():
                topic = scan.topic_of(channel)
                before = here.get(topic, -1)
                on = topic not in here and (
                    begin == last.get(topic, -1) + 1 or (later and scan is scans[0])
                )
                if begin != before + 1 and not on and topic not in wrong:
                    wrong.add(topic)
                    yield jump_text(topic, here.get(topic, last.get(topic, -1)), begin)
                here[topic] = end
        last |= here


def description_faults(scan: Scan, known: Collection[str]) -> Iterator[str]:
    """
    Yield where a file describes messages otherwise than they are read.

    Other readers go by the description, if there is one. Messages of the `known` types are read by
    the definitions that are shipped.
    """
    for channel in scan.channels.values():
        topic, schema = channel.topic, scan.schemas.get(channel.schema_id)
        encoding = channel.message_encoding
        if encoding != 'cdr':
            yield f'messages of {topic} are declared as {shown(encoding)}, not cdr'
        if schema is None or schema.name not in known or not schema.data:
            continue
        if schema.encoding == 'ros2msg':
            if not says_the_same(schema.name, schema.data):
                yield f'the schema of {topic} has other fields than {schema.name}'
        elif scan.own or schema.encoding != 'ros2idl':
            yield f'the schema of {topic} is declared as {shown(schema.encoding)}'
        hash_held = channel.metadata.get('topic_type_hash', '')
        if hash_held and hash_held != type_hash(schema.name):
            yield f'the hash of the type of {topic} is not that of {schema.name}'


# metadata.yaml


def _nanoseconds(content: Mapping[str, Any], name: str, unit: str) -> int | None:
    held = content.get(name)
    number = held.get(unit) if isinstance(held, dict) else None
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def _count(content: Mapping[str, Any], name: str = 'message_count') -> int | None:
    number = content.get(name)
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def _items(content: Mapping[str, Any], name: str) -> list[dict[str, Any]]:
    held = content.get(name)
    return [item for item in held if isinstance(item, dict)] if isinstance(held, list) else []


def listing_faults(
    listing: Mapping[str, Any],
    scans: Sequence[Scan],
    counts: Mapping[str, int],
    types: Mapping[str, str],
    *,
    own: bool,
) -> Iterator[str]:
    """Yield the contradictions between ``metadata.yaml`` and the files."""
    yield from _storage_faults(listing, scans, own=own)
    yield from _qos_faults(listing, scans)
    topics: dict[str, int] = {}
    for item in _items(listing, 'topics_with_message_count'):
        held = item.get('topic_metadata')
        about = held if isinstance(held, dict) else {}
        name, kind = about.get('name'), about.get('type')
        number = _count(item)
        if isinstance(name, str) and kind is not None and types.get(name, kind) != kind:
            yield f'metadata.yaml says that {name} is of type {shown(kind)}, not {types[name]}'
        if isinstance(name, str) and number is not None:
            topics[name] = topics.get(name, 0) + number
    wrong = False
    for name in sorted({*topics, *counts}):
        listed, there = topics.get(name, 0), counts.get(name, 0)
        if topics and listed != there:
            wrong = True
            yield f'metadata.yaml counts {_messages(listed)} on {name}, not {there:,}'
    total, there = _count(listing), sum(counts.values())
    if total is not None and total != there and not wrong:
        yield f'metadata.yaml counts {_messages(total)} in all, not {there:,}'
    if own:
        by_name = {scan.source.name: sum(scan.counts.values()) for scan in scans}
        for item in _items(listing, 'files'):
            number, name = _count(item), str(item.get('path')).rpartition('/')[2]
            if number is not None and name in by_name and number != by_name[name]:
                there = by_name[name]
                yield f'metadata.yaml counts {_messages(number)} in {name}, not {there:,}'
    yield from _time_faults(listing, scans, own=own)


def _storage_faults(
    listing: Mapping[str, Any], scans: Sequence[Scan], *, own: bool
) -> Iterator[str]:
    version = listing.get('version')
    whole = isinstance(version, int) and not isinstance(version, bool) and version > 0
    if (own and version != VERSION) or not whole:
        yield f'metadata.yaml is said to be of version {shown(version)}' + (
            f', and has the fields of {VERSION}' if own else ''
        )
    # By it rosbag2 chooses what opens the files
    named = listing.get('storage_identifier')
    for kind, suffix in (('mcap', '.mcap'), ('sqlite3', '.db3')):
        if any(suffix in scan.source.suffixes for scan in scans) and named != kind:
            yield f'metadata.yaml says that {shown(named)} stores the bag, its files are {suffix}'


#: What of a quality of service decides which subscriber gets which messages.
_QOS = ('history', 'depth', 'reliability', 'durability')


def qos_profiles(held: object) -> tuple[Mapping[str, Any], ...]:
    """Return profiles, given as they are or as a YAML text; none if it is not a list of them."""
    try:
        profiles = load_yaml(held) if isinstance(held, str) and held else held
    except yaml.YAMLError:
        return ()
    if not isinstance(profiles, list) or not all(isinstance(p, dict) for p in profiles):
        return ()
    return tuple(profiles)


def _qos_faults(listing: Mapping[str, Any], scans: Sequence[Scan]) -> Iterator[str]:
    """Yield the topics that would be played otherwise than they were offered."""

    def deciding(profiles: Sequence[Mapping[str, Any]]) -> list[list[str]]:
        return [[str(profile.get(name)) for name in _QOS] for profile in profiles]

    in_files: dict[str, list[list[list[str]]]] = {}
    for scan in scans:
        for channel in scan.channels.values():
            if held := qos_profiles(channel.metadata.get('offered_qos_profiles', '')):
                in_files.setdefault(channel.topic, []).append(deciding(held))
    for item in _items(listing, 'topics_with_message_count'):
        about = item.get('topic_metadata')
        name = about.get('name') if isinstance(about, dict) else None
        if not isinstance(about, dict) or not isinstance(name, str) or name not in in_files:
            continue
        listed = deciding(qos_profiles(about.get('offered_qos_profiles')))
        if listed and listed not in in_files[name]:
            yield f'metadata.yaml gives {name} another quality of service than the file'


def _time_faults(listing: Mapping[str, Any], scans: Sequence[Scan], *, own: bool) -> Iterator[str]:
    blocks = [block for scan in scans for block in scan.blocks if block.start_ns <= block.end_ns]
    start = _nanoseconds(listing, 'starting_time', 'nanoseconds_since_epoch')
    duration = _nanoseconds(listing, 'duration', 'nanoseconds')
    if start is None or duration is None or not blocks:
        return
    first, last = min(block.start_ns for block in blocks), max(block.end_ns for block in blocks)
    if own:
        wrong = (start, duration) != (first, last - first)
    else:
        # It may have counted messages from before and after, which it has lost.
        wrong = start > first + _ABOUT_NS or start + duration < last - _ABOUT_NS
    if wrong:
        yield (
            f'metadata.yaml says that it begins at {start} ns and lasts {duration} ns; it begins '
            f'at {first} ns and lasts {last - first} ns'
        )


def listing_remarks(listing: Mapping[str, Any], counts: Mapping[str, int]) -> Iterator[str]:
    """Yield the number of messages that another recorder received and did not write."""
    received = [_count(item) for item in _items(listing, 'files')]
    there = sum(counts.values())
    total = sum(number for number in received if number is not None)
    if received and None not in received and total > there:
        yield (
            f'the recorder received {_messages(total)} and wrote {there:,}: it lost '
            f'{total - there:,} of them'
        )
