"""The ``metadata.yaml`` of a rosbag2 bag, version 9 (ROS 2 Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from .errors import RecordingError
from .mcap_scan import open_file
from .topic import LONGEST_YAML, Channel, dump_yaml, load_yaml

__all__ = [
    'FILE_NAME',
    'PART',
    'BagMetadata',
    'FileInformation',
    'listed_files',
    'notes_of',
    'read_listing',
    'sync_directory',
]

FILE_NAME = 'metadata.yaml'
#: Note in a file of this package that is not the first of its bag: its number there.
PART = 'part'
VERSION = 9

#: Starting time of a bag without messages, as rosbag2 has it: the largest int64.
_NEVER = 2**63 - 1


class FileInformation(NamedTuple):
    """
    What rosbag2 notes about one file of a bag.

    Attributes
    ----------
    path : str
        Its name, in the directory of the bag.
    start_ns, end_ns : int or None
        Earliest and latest stamp; None without messages.
    message_count : int
        Its messages.
    """

    path: str
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
    """
    What rosbag2 notes about a bag.

    Attributes
    ----------
    files : tuple of FileInformation
        The MCAP files, in order.
    channels : tuple of Channel
        The topics.
    counts : tuple of int
        Messages per channel.
    custom : mapping of str to str
        Free notes of the recorder.
    """

    files: tuple[FileInformation, ...]
    channels: tuple[Channel, ...]
    counts: tuple[int, ...]
    custom: Mapping[str, str] = field(default_factory=dict)

    @property
    def whole(self) -> FileInformation:
        """What holds of all files together."""
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
        """Return the YAML that goes into the MCAP file itself."""
        return dump_yaml(self.as_mapping())

    def write(self, directory: Path) -> None:
        """
        Write ``metadata.yaml`` so that at any instant there is a whole one or none.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        text = dump_yaml({'rosbag2_bagfile_information': self.as_mapping()}) + '\n'
        draft = directory / f'{FILE_NAME}.tmp'
        try:
            with draft.open('w', encoding='utf-8') as stream:
                stream.write(text)
                stream.flush()
                os.fsync(stream.fileno())
            draft.replace(directory / FILE_NAME)
        except OSError:
            with suppress(OSError):
                draft.unlink()
            raise
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
    """
    Return what ``metadata.yaml`` says of a bag; None if there is none.

    Raises
    ------
    RecordingError
        If it cannot be read, or is no list of the files of a bag.
    """
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
    """Return the notes of the recorder that metadata hold: those that are texts and numbers."""
    custom = content.get('custom_data') if isinstance(content, dict) else None
    if not isinstance(custom, dict):
        return {}
    return {
        str(key): str(value)
        for key, value in custom.items()
        if isinstance(key, str | int | float) and isinstance(value, str | int | float)
    }
