# SPDX-License-Identifier: Apache-2.0
"""Recordings of the node: they are begun and finished here, and written by the engine."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from concurrent.futures import wait
from typing import TYPE_CHECKING, NamedTuple

from impact_damper_ros.bag.rig_topics import RIG_TOPICS, recorded_topics, recording_notes
from impact_damper_ros.parameters.quoting import plural

from .engine import Engine
from .publishing import RigPublishers

if TYPE_CHECKING:
    from impact_damper_ros.bag import RecordingError, RunWriter

# Longest wait for the engine to release a log.
RELEASE_TIMEOUT_S = 20.0


class RecordingStatus(NamedTuple):
    """State of the recording; `error` stays until the next one begins."""

    path: str = ''
    messages: int = 0
    size: int = 0
    backlog: int = 0
    dropped: int = 0
    error: str = ''


class Recorder:
    """Begins and finishes recordings; used from the executor's thread."""

    def __init__(
        self,
        engine: Engine,
        publishers: RigPublishers,
        node_name: str,
        on_failure: Callable[[], object],
    ) -> None:
        self._on_failure = on_failure
        self._engine = engine
        self._names = {key: publishers[key].topic for key in RIG_TOPICS}
        self._notes = recording_notes(node_name, self._names)
        self._writer: RunWriter | None = None
        #: Why the last recording that has been finished ended early; empty if it did not
        self.error = ''

    @property
    def path(self) -> str:
        """The directory of the recording, or an empty text."""
        return str(self._writer.directory) if self._writer is not None else ''

    @property
    def splits(self) -> bool:
        """Whether the recording may be split into several files."""
        return self._writer is not None and self._writer.splits

    def open(
        self, parent: str, description: str, max_size: int = 0, max_duration: float = 0.0
    ) -> None:
        """
        Create the bag, in a new directory under `parent`, with limits to each of its files.

        The robot description is written beside it.
        """
        # Loaded only if something is recorded
        from impact_damper_ros.bag import RunWriter
        from impact_damper_ros.bag.rig_recorder import write_description

        if self._writer is not None:
            # Left from a request that another part of the node rejected
            self._writer.close()
            self._writer = None
        self._writer = RunWriter.new_run(
            parent,
            recorded_topics(self._names),
            custom=self._notes,
            on_error=self._on_failure,
            max_size=max_size,
            max_duration=max_duration,
        )
        self.error = ''
        write_description(self._writer.directory, description)

    def begin(self, listing: bytes, description: bytes) -> None:
        """Let the engine record; the bag begins with all parameters and the robot description."""
        if self._writer is not None:
            self._engine.ask(self._engine.record_to, self._writer, listing)
            self._engine.ask(self._engine.record, self._names['robot_description'], description)

    def finish(self) -> str:
        """End the recording, finish the bag, and return a summary for the user."""
        writer, self._writer = self._writer, None
        if writer is None:
            return ''
        wait([self._engine.ask(self._engine.stop_recording)], RELEASE_TIMEOUT_S)
        writer.close()
        if writer.error is not None:
            self.error = str(writer.error)
            return f'the recording ended early: {writer.error}'
        text = f'recorded {plural(writer.message_count, "message")} to {writer.directory}'
        if writer.dropped:
            text += f'; {writer.dropped} were dropped: {writer.drop_reason}'
        return text

    def failure(self) -> RecordingError | None:
        """Return why the recording has failed, or None."""
        return self._writer.error if self._writer is not None else None

    def status(self, messages: int) -> RecordingStatus:
        """Return the state of the recording, given the number of messages handed to it."""
        writer = self._writer
        if writer is None:
            return RecordingStatus(error=self.error)
        size = 0
        with contextlib.suppress(OSError):
            size = writer.path.stat().st_size
        return RecordingStatus(
            path=str(writer.path),
            messages=messages,
            size=size,
            backlog=writer.backlog,
            dropped=writer.dropped,
            error=str(writer.error or ''),
        )
