# SPDX-License-Identifier: Apache-2.0
"""Recovery of the whole messages of a recording that was cut short or damaged."""

from __future__ import annotations

import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path

from impact_damper_ros.parameters.quoting import as_line, plural

from .bag_file import BagFile
from .errors import RecordingError
from .mcap_file import McapFile, StoredMessage
from .metadata import FILE_NAME
from .run_reader import RecordedTopic, RunReader
from .topics import Channel

#: Most bytes of messages that wait in memory.
_MOST_WAITING = 4 * 1024 * 1024


@dataclass(frozen=True)
class Recovery:
    """
    The result of a recovery.

    Attributes
    ----------
    source, output : Path
        The recording and the new bag.
    topics : tuple of RecordedTopic
        The topics of the new bag.
    start_ns, end_ns : int
        Earliest and latest stamp.
    unusable : int
        Bytes of the source that could not be used, or only in part.
    doubtful : int
        Messages of damaged chunks among those saved: some may be altered.
    was_complete : bool
        Whether the source was complete; the new bag is then a copy.
    faults : tuple of str
        Contradictions within the source.
    left_out : tuple of str
        Content other than messages that is not in the new bag.
    """

    source: Path
    output: Path
    topics: tuple[RecordedTopic, ...]
    start_ns: int
    end_ns: int
    unusable: int
    doubtful: int
    was_complete: bool
    faults: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()

    @property
    def message_count(self) -> int:
        """Number of messages saved."""
        return sum(topic.message_count for topic in self.topics)


def recover_run(source: Path | str, output: Path | str | None = None) -> Recovery:
    """
    Make a complete bag of the whole messages of a recording, which is not changed.

    The new bag is built under a temporary name and renamed when it is complete.

    Parameters
    ----------
    source : Path or str
        A bag directory, with or without ``metadata.yaml``, or an ``.mcap`` file.
    output : Path or str, optional
        Directory of the new bag; beside the source with ``_recovered`` appended if not given.

    Raises
    ------
    RecordingError
        If there is nothing to save, the output exists already or it cannot be written.
    """
    source = Path(source).absolute()
    output = (
        Path(output).absolute()
        if output is not None
        else source.with_name(f'{source.stem if source.is_file() else source.name}_recovered')
    )
    if output.exists() or output.is_symlink():
        cause = 'it exists already'
        raise RecordingError('recover to', output, cause, 'give another directory with --output')
    reader = RunReader(source)
    if not reader.message_count:
        raise RecordingError('recover', source, 'no complete message was found in it')
    draft = output.with_name(f'.{output.name}.{secrets.token_hex(4)}.tmp')
    try:
        draft.mkdir()
    except OSError as error:
        raise RecordingError.from_os_error('recover to', output, error) from error
    try:
        recovery = _copy(reader, source, draft, output)
        if not recovery.message_count:
            raise RecordingError('recover', source, 'every message in it is damaged')
        draft.rename(output)
    except OSError as error:
        raise RecordingError.from_os_error('recover to', output, error) from error
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return recovery


def _copy(reader: RunReader, source: Path, draft: Path, output: Path) -> Recovery:
    # The same topic in several files is one channel.
    places: dict[object, int] = {}
    channels: list[Channel] = []
    for file in reader.files:
        for channel in file.channels.values():
            if places.setdefault(_key(channel), len(channels)) == len(channels):
                channels.append(channel)
    bag = BagFile(draft, channels, reader.custom, name=output.name, distro=reader.distro)
    copy = _Copy(bag, places)
    try:
        for file in reader.files:
            copy.add_file(file)
        faults = (*reader.faults(), *copy.faults, *filter(None, [reader.missing]))
        unusable = reader.unusable + copy.unusable
        whole = reader.complete and not faults and not unusable
        if not whole:
            notes = {'lost_bytes': str(unusable), 'doubtful': str(copy.doubtful)}
            bag.custom |= {'recovered_from': as_line(source.name), **notes}
        bag.finish()
    finally:
        bag.abandon()
    whole_bag = bag.metadata().whole
    return Recovery(
        source=source,
        output=output,
        topics=tuple(
            RecordedTopic(channel.topic, channel.type, count)
            for channel, count in zip(bag.channels, bag.counts, strict=True)
        ),
        start_ns=whole_bag.start_ns or 0,
        end_ns=whole_bag.end_ns or 0,
        unusable=unusable,
        doubtful=copy.doubtful,
        was_complete=whole,
        faults=faults,
        left_out=(*copy.left_out, *_files_beside(reader)),
    )


class _Copy:
    """Copies the files of a recording to a new bag, and counts what cannot be copied."""

    def __init__(self, bag: BagFile, places: dict[object, int]) -> None:
        self._bag, self._places = bag, places
        self._waiting = 0
        self.faults: list[str] = []
        self.unusable = self.doubtful = 0
        self.left_out: list[str] = []

    def add_file(self, file: McapFile) -> None:
        with file.open() as stream:
            for block in file.blocks:
                messages, fault = file.read(stream, block)
                saved = sum(self._add(file, message) for message in messages)
                if fault:
                    self.faults.append(f'{fault}; {saved} of its messages are saved')
                    self.doubtful += saved
                    if not 0 <= block.position - file.framed < file.unusable:
                        self.unusable += block.length
                if self._waiting > _MOST_WAITING:
                    self._bag.flush()
                    self._waiting = 0
        others = file.others + sum(record.name != 'rosbag2' for record in file.metadata)
        if others:
            what = f'{plural(others, "record")} of other programs, such as attachments'
            self.left_out.append(f'{what} (mcap recover copies them)')

    def _add(self, file: McapFile, message: StoredMessage) -> bool:
        """Add a message, unless its channel is not described."""
        number, sequence, stamp_ns, publish_ns, content = message
        if number not in file.channels:
            self.unusable += len(content)
            return False
        place = self._places[_key(file.channels[number])]
        self._bag.add(place, content, stamp_ns, publish_ns=publish_ns, sequence=sequence)
        self._waiting += len(content)
        return True


def _key(channel: Channel) -> object:
    """Return the key of a channel, without its publishers: those of a topic may change."""
    encodings = channel.schema_encoding, channel.message_encoding
    return channel.topic, channel.type, channel.schema, channel.type_hash, encodings


def _files_beside(reader: RunReader) -> list[str]:
    """Return the files in the directory of the bag that are no part of it."""
    if not reader.path.is_dir():
        return []
    parts = {FILE_NAME, *(file.path.name for file in reader.files)}
    others = sorted(p.name for p in reader.path.iterdir() if p.name[0] != '.')
    return [f'the file {as_line(name)} beside the bag' for name in others if name not in parts]
