"""
Recording a rig that runs without ROS: the bag that the node would have written.

The same topics, in the same order, with the same bytes. Stamps count from 0, as those of a node
that publishes /clock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from impact_damper_ros.control import ControlRecord, GapControlParameters
from impact_damper_ros.rig import Event, EventKind, RigParameters, Sample
from impact_damper_ros.rig.description import robot_description

from .messages import CdrWriter
from .rig_messages import RigMessages, parameter_event, snapshot_message
from .run_writer import RunWriter
from .topics import LATCHED, QosProfile, Topic

__all__ = ['RigRecorder', 'RunningRig', 'rig_topics', 'write_description']


_EVENTS = '/parameter_events'
_JOINT_STATE = 'sensor_msgs/msg/JointState'
#: Messages that may wait for the disk before the rig waits for them.
_BACKLOG = 50_000
_NAP = 0.01


class RunningRig(Protocol):
    """What is asked of a rig."""

    @property
    def records(self) -> Sequence[ControlRecord]:
        """What the gap control did during the last call of `advance`."""

    @property
    def parameters(self) -> RigParameters:
        """The present parameters."""

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the gap control."""

    def sample(self) -> Sample:
        """Return the motion at the present time."""

    def snapshot(self) -> dict[str, Any]:
        """Return what the rig's future depends on."""


def rig_topics(
    joint_states: str,
    impacts: str,
    gap_control: str,
    snapshot: str,
    parameter_events: str,
    diagnostics: str = '',
    description: str = '',
) -> list[Topic]:
    """Return the topics of a rig by their full names, with the node's quality of service."""
    topics = [
        Topic(joint_states, _JOINT_STATE, QosProfile(depth=100)),
        Topic(impacts, _JOINT_STATE, QosProfile(depth=1000)),
        Topic(gap_control, _JOINT_STATE, QosProfile(depth=1000)),
        Topic(snapshot, 'std_msgs/msg/String', LATCHED),
        Topic(parameter_events, 'rcl_interfaces/msg/ParameterEvent', QosProfile(depth=1000)),
    ]
    if diagnostics:
        topics.append(
            Topic(diagnostics, 'diagnostic_msgs/msg/DiagnosticArray', QosProfile(depth=10))
        )
    if description:
        topics.append(Topic(description, 'std_msgs/msg/String', LATCHED))
    return topics


def write_description(directory: Path, text: str) -> None:
    """
    Write the robot description as a file beside the bag.

    A recording does not depend on it, and is no worse without: the same text is in the bag.
    """
    with suppress(OSError):
        (directory / 'rig.urdf').write_text(text, encoding='utf-8')


class RigRecorder:
    """
    Records a rig tick by tick, on whole nanoseconds as the node does.

    Parameters
    ----------
    directory : Path or str
        Of the bag; made if absent, must not hold a bag already.
    rig : RunningRig
        The rig, at time 0.
    parameters : mapping
        Parameters by name, for the list of all parameters with which the bag begins.
    rate, duration : float
        Ticks per second, and length of the run, s.
    node : str, optional
        Full name of the node that the bag is to be of; its topics are in its namespace.
    max_size, max_duration : int and float, optional
        Limits to a file of the bag; see `RunWriter`.

    Raises
    ------
    RecordingError
        If the bag cannot be made.
    """

    def __init__(
        self,
        directory: Path | str,
        rig: RunningRig,
        parameters: Mapping[str, Any],
        rate: float,
        duration: float,
        node: str = '/sim_node',
        *,
        max_size: int = 0,
        max_duration: float = 0.0,
    ) -> None:
        self._rig = rig
        self._rate = rate
        self._node = node
        self._due = 0
        self._last = math.floor(duration * rate * (1.0 + 1e-15))
        self._messages = RigMessages()
        space = node.rpartition('/')[0]
        self._states = f'{space}/joint_states'
        self._impacts = f'{space}/impacts'
        self._control = f'{space}/gap_control'
        self._snapshots = f'{space}/snapshot'
        self._descriptions = f'{space}/robot_description'
        topics = rig_topics(
            self._states,
            self._impacts,
            self._control,
            self._snapshots,
            _EVENTS,
            description=self._descriptions,
        )
        notes = {
            'node': node,
            'joint_states': self._states,
            'impacts': self._impacts,
            'gap_control': self._control,
            'snapshot': self._snapshots,
            'robot_description': self._descriptions,
        }
        self._writer = RunWriter(
            directory, topics, custom=notes, max_size=max_size, max_duration=max_duration
        )
        self._values = {**parameters, 'state_rate': rate, 'record': True}
        self._begin_file(0)
        write_description(self._writer.directory, self._description)
        self._snapshot('start', 0)
        self._tick()

    def _begin_file(self, time_ns: int) -> None:
        """Record what a reader of this file alone needs to know."""
        self._snapshot('record', time_ns)
        dump = parameter_event(time_ns, self._node, self._values, new=True)
        self._writer.write(_EVENTS, dump, time_ns)
        self._description = ''
        self._describe(time_ns)

    def _snapshot(self, reason: str, time_ns: int) -> None:
        content = snapshot_message(0, time_ns, reason, self._rig.snapshot())
        self._writer.write(self._snapshots, content, time_ns)

    def _describe(self, time_ns: int) -> None:
        """Record how the rig looks, if that has changed."""
        text = robot_description(self._rig.parameters, self._rig.control.widest_gap)
        if text != self._description:
            self._description = text
            content = bytes(CdrWriter().string(text).content)
            self._writer.write(self._descriptions, content, time_ns)

    def _instant_ns(self, tick: int) -> int:
        return round(tick * 1e9 / self._rate)

    def _tick(self) -> None:
        """Record the joint states; the rig stands at the tick that is due."""
        time_ns = self._instant_ns(self._due)
        deflection = self._rig.parameters.static_deflection
        content = self._messages.states(time_ns, self._rig.sample(), deflection)
        self._writer.write(self._states, content, time_ns)
        self._due += 1
        while self._writer.backlog > _BACKLOG and self._writer.error is None:
            time.sleep(_NAP)
        # A file begins after a tick, and with one more to come.
        if self._due <= self._last and self._writer.split_due(time_ns):
            if self._writer.split(time_ns):
                self._begin_file(time_ns)
            while self._writer.splitting:
                time.sleep(_NAP / 10)

    def ticks(self) -> Iterator[float]:
        """Yield the instants of the ticks after the start, s: the rig must stop at each."""
        return (self._instant_ns(tick) / 1e9 for tick in range(1, self._last + 1))

    def reached(self, instant: float) -> None:
        """Record the joint states if a tick is due at an instant, s, at which the rig stands."""
        if self._due <= self._last and instant == self._instant_ns(self._due) / 1e9:
            self._tick()

    def changed(self, time_ns: int, values: Mapping[str, Any], events: Iterable[Event]) -> None:
        """
        Record a change of parameters, after the rig was changed and before `reached`.

        Parameters
        ----------
        time_ns : int
            The instant, at which the rig stands.
        values : mapping
            The new values by name.
        events : iterable of Event
            What the change caused at once.
        """
        if self._due > self._last:
            return
        self._values |= values
        self._writer.write(_EVENTS, parameter_event(time_ns, self._node, values), time_ns)
        self.happened(events)
        self._describe(time_ns)
        self._snapshot('change', time_ns)

    def happened(self, events: Iterable[Event]) -> None:
        """
        Record impacts, and what the gap control did, of the rig's last call.

        Raises
        ------
        RecordingError
            If the recording has failed.
        """
        if self._writer.error is not None:
            raise self._writer.error
        if self._due > self._last:
            # A bag ends with a whole tick.
            return
        deflection = self._rig.parameters.static_deflection
        for event in events:
            if event.kind is EventKind.IMPACT:
                stamp_ns = round(event.time * 1e9)
                content = self._messages.impact(stamp_ns, event, deflection)
                self._writer.write(self._impacts, content, stamp_ns)
        for record in self._rig.records:
            stamp_ns = round(record.time * 1e9)
            self._writer.write(self._control, self._messages.control(stamp_ns, record), stamp_ns)

    def close(self) -> None:
        """
        Finish the bag.

        Raises
        ------
        RecordingError
            If it could not be written in whole.
        """
        summary = self._writer.close()
        if summary.error is not None:
            raise summary.error
