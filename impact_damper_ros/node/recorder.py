"""The node's recording: opened before a request is accepted, closed when the bag is whole."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .diagnostics import RecordingStatus
from .engine import Engine
from .publishing import Outlets

if TYPE_CHECKING:
    from impact_damper_ros.bag import RecordingError, RunWriter

__all__ = ['Recorder']


# Longest wait for the engine to let go of a log.
RELEASE_TIMEOUT_S = 5.0


class Recorder:
    """
    Begin and finish recordings; used from the executor's thread.

    Parameters
    ----------
    engine : Engine
        Writes into the recording.
    outlets : Outlets
        The topics.
    node_name : str
        Fully qualified. The bag's notes tell it, and which topic is which after remapping.
    on_failure : callable
        Called from another thread when a recording fails.
    """

    def __init__(
        self,
        engine: Engine,
        outlets: Outlets,
        node_name: str,
        on_failure: Callable[[], object],
    ) -> None:
        """Record nothing so far."""
        self._on_failure = on_failure
        self._engine = engine
        self._outlets = outlets
        self._notes = {
            'node': node_name,
            'joint_states': outlets.joint_states.topic,
            'impacts': outlets.impacts.topic,
            'gap_control': outlets.gap_control.topic,
            'snapshot': outlets.snapshot.topic,
            'robot_description': outlets.robot_description,
        }
        self._writer: RunWriter | None = None
        self._error = ''

    @property
    def path(self) -> str:
        """The directory of the recording, or an empty text."""
        return str(self._writer.directory) if self._writer is not None else ''

    @property
    def splits(self) -> bool:
        """Whether the recording may go on to further files."""
        return self._writer is not None and self._writer.splits

    def open(
        self, parent: str, description: str, max_size: int = 0, max_duration: float = 0.0
    ) -> None:
        """
        Create the bag, in a new directory under `parent`, with limits to each of its files.

        The robot description is written beside it.
        """
        # Not needed, and not loaded, unless something is recorded.
        from impact_damper_ros.bag import RunWriter
        from impact_damper_ros.bag.rig_recorder import write_description

        if self._writer is not None:
            # Left from a request that another part of the node rejected.
            self._writer.close()
            self._writer = None
        self._writer = RunWriter.new_run(
            parent,
            self._topics(),
            custom=self._notes,
            on_error=self._on_failure,
            max_size=max_size,
            max_duration=max_duration,
        )
        self._error = ''
        write_description(self._writer.directory, description)

    def begin(self, dump: bytes, description: bytes) -> None:
        """Let the engine record, beginning with all parameters and the robot description."""
        if self._writer is not None:
            self._engine.record_to(self._writer, dump)
            self._engine.record(self._outlets.robot_description, description)

    def finish(self) -> str:
        """Let the engine record no more, finish the bag and say what it holds."""
        writer, self._writer = self._writer, None
        if writer is None:
            return ''
        self._engine.stop_recording().wait(RELEASE_TIMEOUT_S)
        summary = writer.close()
        if summary.error is not None:
            self._error = str(summary.error)
            return f'the recording ended early: {summary.error}'
        return f'recorded {summary.message_count} messages to {summary.directory}'

    def failure(self) -> RecordingError | None:
        """Return why the recording goes on no more, or None."""
        return self._writer.error if self._writer is not None else None

    def status(self, messages: int) -> RecordingStatus:
        """Return how the recording is doing, with so many messages handed to it."""
        writer = self._writer
        if writer is None:
            return RecordingStatus(error=self._error)
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

    def _topics(self) -> list[Any]:
        from impact_damper_ros.bag.rig_recorder import rig_topics

        outlets = self._outlets
        return list(
            rig_topics(
                outlets.joint_states.topic,
                outlets.impacts.topic,
                outlets.gap_control.topic,
                outlets.snapshot.topic,
                outlets.parameter_events,
                outlets.diagnostics,
                outlets.robot_description,
            )
        )
