# SPDX-License-Identifier: Apache-2.0
"""The ``metadata.yaml`` of a rosbag2 bag, version 9 (ROS 2 Jazzy)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from impact_damper_ros.outputs import write_text
from impact_damper_ros.parameters.quoting import plural

from .errors import RecordingError
from .mcap_file import open_file
from .topics import LONGEST_YAML, Channel, dump_yaml, load_yaml

FILE_NAME = 'metadata.yaml'
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
    distro: str = ''  # distribution of ROS; the present one if not given

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
                        'offered_qos_profiles': channel.qos_profiles,
                        'type_description_hash': channel.type_hash,
                    },
                    'message_count': count,
                }
                for channel, count in zip(self.channels, self.counts, strict=True)
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': [name_in_utf8(file.path) for file in self.files],
            'files': [
                {
                    'path': name_in_utf8(file.path),
                    **file.times(),
                    'message_count': file.message_count,
                }
                for file in self.files
            ],
            'custom_data': dict(self.custom) or None,
            'ros_distro': self.distro or os.environ.get('ROS_DISTRO') or 'jazzy',
        }

    def yaml_text(self) -> str:
        """Return the YAML for the MCAP file itself."""
        return dump_yaml(self.as_mapping())

    def write(self, directory: Path) -> None:
        """Write ``metadata.yaml``, whole or not at all."""
        text = dump_yaml({'rosbag2_bagfile_information': self.as_mapping()}) + '\n'
        write_text(directory / FILE_NAME, text)


def name_in_utf8(name: str) -> str:
    """Return the name of a file with its bytes decoded as UTF-8, whatever the locale is."""
    return os.fsencode(name).decode()


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


def listed_files(listing: Mapping[str, Any]) -> list[str]:
    """Return the names of the files that ``metadata.yaml`` lists, in order."""
    names = (Path(path).name.encode() for path in listing['relative_file_paths'])
    return list(dict.fromkeys(map(os.fsdecode, names)))


def notes_of(content: Mapping[str, Any]) -> dict[str, str]:
    """Return the notes of the recorder in the metadata: texts and numbers."""
    custom = content.get('custom_data')
    if not isinstance(custom, dict):
        return {}
    return {
        str(key): str(value)
        for key, value in custom.items()
        if isinstance(key, str | int | float) and isinstance(value, str | int | float)
    }


def _count(content: Mapping[str, Any]) -> int | None:
    number = content.get('message_count')
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def listing_faults(listing: Mapping[str, Any], there: int) -> Iterator[str]:
    """Yield a fault if ``metadata.yaml`` does not state the number of messages in the files."""
    stated = _count(listing)
    if stated not in (None, there):
        yield f'metadata.yaml counts {plural(stated or 0, "message", ",")} in all, not {there:,}'


def listing_remarks(listing: Mapping[str, Any], there: int) -> Iterator[str]:
    """Yield the number of messages that another recorder received and did not write."""
    held = listing.get('files')
    files = held if isinstance(held, list) else []
    received = [_count(file) for file in files if isinstance(file, dict)]
    total = sum(number for number in received if number is not None)
    if received and None not in received and total > there:
        yield (
            f'the recorder received {plural(total, "message", ",")} and wrote {there:,}: it lost '
            f'{total - there:,} of them'
        )
