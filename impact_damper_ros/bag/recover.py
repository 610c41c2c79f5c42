# SPDX-License-Identifier: Apache-2.0
"""Recovery of the whole messages of a recording that was cut short or damaged."""

from __future__ import annotations

import secrets
import shutil
from dataclasses import dataclass
from pathlib import Path

from impact_damper_ros.parameters.quoting import as_line

from .bag_file import BagFile
from .errors import RecordingError
from .mcap_file import open_file, plain_content
from .metadata import qos_profiles
from .run_reader import RecordedTopic, RunReader
from .topics import Channel

#: Bytes of messages that wait in memory.
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
        Bytes of the source that could not be used.
    was_complete : bool
        Whether the source was complete; the new bag is then a copy.
    faults : tuple of str
        Contradictions within the source.
    """

    source: Path
    output: Path
    topics: tuple[RecordedTopic, ...]
    start_ns: int
    end_ns: int
    unusable: int
    was_complete: bool
    faults: tuple[str, ...] = ()

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
        cause = 'it holds no whole message; it was cut before its first flush'
        raise RecordingError('recover', source, cause)
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
    channels = _channels(reader)
    places = {channel.topic: place for place, channel in enumerate(channels)}
    bag = BagFile(draft, channels, reader.custom, name=output.name)
    unusable, waiting = reader.unusable, 0
    try:
        for file in reader.files:
            with open_file(file.path) as stream:
                for block in file.blocks:
                    try:
                        messages = file.read(stream, block)
                    except RecordingError:
                        unusable += block.length
                        continue
                    for channel, stamp_ns, content in messages:
                        plain = _plain(content)
                        if channel not in file.channels or plain is None or stamp_ns >= 2**63:
                            unusable += len(content)
                            continue
                        bag.add(places[file.channels[channel].topic], plain, stamp_ns)
                        waiting += len(plain)
                    if waiting > _MOST_WAITING:
                        bag.flush()
                        waiting = 0
        faults = (*reader.faults(), *filter(None, [reader.missing]))
        whole = reader.complete and not faults and not unusable
        if not whole:
            bag.custom['recovered_from'] = as_line(source.name)
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
        was_complete=whole,
        faults=faults,
    )


def _plain(content: bytes) -> bytes | None:
    """Return a message as it was sent; None if it cannot be decompressed."""
    try:
        return plain_content(content)
    except ValueError:
        return None


def _channels(reader: RunReader) -> list[Channel]:
    """Return the channels of all files, one per topic."""
    found: dict[str, Channel] = {}
    for file in reader.files:
        for channel in file.channels.values():
            schema = file.schemas.get(channel.schema_id)
            described = Channel(
                topic=channel.topic,
                type=schema.name if schema else '',
                schema=schema.data if schema else b'',
                type_hash=channel.metadata.get('topic_type_hash', ''),
                qos_profiles=qos_profiles(channel.metadata.get('offered_qos_profiles', '')),
                schema_encoding=schema.encoding if schema else '',
                message_encoding=channel.message_encoding,
            )
            found.setdefault(channel.topic, described)
    return list(found.values())
