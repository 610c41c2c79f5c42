# SPDX-License-Identifier: Apache-2.0
"""
Recording a rig that runs without ROS: the bag that the node would have written.

The same topics, in the same order, with the same bytes. Stamps count from 0, as those of a node
that publishes /clock.
"""

from __future__ import annotations

import math
import time
from bisect import bisect_right
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from itertools import count, takewhile
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.motion.event import Event, Sample
from impact_damper_ros.outputs import write_text
from impact_damper_ros.parameters.parameter_spec import number_between
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS
from impact_damper_ros.rig.observed_run import Observer
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.snapshot import LATEST
from impact_damper_ros.rig.tick_grid import TickGrid

from .messages import Parameter, ParameterEvent, String, encode
from .rig_topics import RIG_TOPICS, RigMessages, recorded_topics, recording_notes
from .run_writer import RunWriter
from .snapshots import RATES, Snapshots

#: Messages that may wait for the disk before the rig waits for them.
_BACKLOG = 50_000
_NAP = 0.01


def parameter_event(
    stamp_ns: int, node: str, values: Mapping[str, Any], *, new: bool = False
) -> bytes:
    """Encode the event that parameters are new or, by default, changed."""
    parameters = tuple(
        Parameter(name, tuple(value) if isinstance(value, list) else value)
        for name, value in values.items()
    )
    lists = (parameters, (), ()) if new else ((), parameters, ())
    return encode(ParameterEvent(stamp_ns, node, *lists))


def write_description(directory: Path, text: str) -> None:
    """
    Write the robot description as a file beside the bag.

    A failure is ignored: the same text is in the bag.
    """
    with suppress(OSError):
        write_text(directory / 'rig.urdf', text)


_time_of = attrgetter('time')


class RigRecorder(Observer):
    """
    Records a rig at ticks, on whole nanoseconds as the node does.

    Parameters
    ----------
    directory : Path or str
        Directory of the bag; made if absent, must not hold a bag already.
    rig : Rig
        The rig, where the run begins.
    parameters : mapping
        Parameters by name, for the list of parameters at the beginning of the bag.
    rate, duration : float
        Ticks per second, and rig time after which the bag ends, s; infinity if unknown.
    node : str, optional
        Full name of the node that the bag names; the topics are in its namespace.
    start_ns : int, optional
        Rig time at which the rig is, ns.
    max_size, max_duration : int and float, optional
        Limits to a file of the bag; see `RunWriter`.

    Attributes
    ----------
    hold : float
        Instant from which on ticks are not recorded yet, s: what is done to the rig there is
        recorded first.

    Raises
    ------
    RecordingError
        If the bag cannot be made.
    ValueError
        If the rate or the duration is out of range; nothing is made then.
    """

    def __init__(
        self,
        directory: Path | str,
        rig: Rig,
        parameters: Mapping[str, Any],
        rate: float,
        duration: float,
        node: str = '/sim_node',
        *,
        start_ns: int = 0,
        max_size: int = 0,
        max_duration: float = 0.0,
    ) -> None:
        rate = number_between('rate', rate, *RATES)
        if duration != math.inf:
            duration = number_between('duration', duration, 0.0, LATEST)
        self.hold = math.inf
        self._rig = rig
        self._grid = TickGrid(rate)
        self._node = node
        self._due = max(0, math.floor(start_ns * rate / 1e9) - 1)
        while self._grid.instant(self._due) < start_ns:
            self._due += 1
        self._last: float = duration
        if duration != math.inf:
            self._last = math.floor(duration * rate * (1.0 + 1e-15))
        self._messages = RigMessages()
        space = node.rpartition('/')[0]
        self._names = names = {
            key: topic.name if topic.name.startswith('/') else f'{space}/{topic.name}'
            for key, topic in RIG_TOPICS.items()
            if key not in ('diagnostics', 'measurements')
        }
        self._writer = RunWriter(
            directory,
            recorded_topics(names),
            custom=recording_notes(node, names),
            max_size=max_size,
            max_duration=max_duration,
        )
        initial = {n: value for n, value in parameters.items() if n in INITIAL_SPECS}
        self._snapshots = Snapshots(node, names, initial, rate)
        self._values = {**parameters, 'state_rate': rate, 'record': True}
        self._begin_file(start_ns)
        write_description(self._writer.directory, self._description)
        self._snapshot('start', start_ns)
        if self._grid.instant(self._due) == start_ns:
            self._tick(rig.sample())
            self.look_at(rig.time)

    def _begin_file(self, time_ns: int) -> None:
        """Record everything that a reader needs who has this file alone."""
        self._snapshot('record', time_ns)
        listing = parameter_event(time_ns, self._node, self._values, new=True)
        self._write('parameter_events', listing, time_ns)
        self._description = ''
        self._describe(time_ns)

    def _snapshot(self, reason: str, time_ns: int) -> None:
        text = self._snapshots.text(time_ns, reason, self._rig.snapshot())
        self._write('snapshot', encode(String(text)), time_ns)

    def _describe(self, time_ns: int) -> None:
        """Record the robot description, if it has changed."""
        text = robot_description(self._rig.parameters, self._rig.control.widest_gap)
        if text != self._description:
            self._description = text
            self._write('robot_description', encode(String(text)), time_ns)

    def _write(self, key: str, content: bytes, stamp_ns: int) -> None:
        self._writer.write(self._names[key], content, stamp_ns)

    def _tick(self, sample: Sample) -> None:
        """Record the joint states of the tick that is due."""
        time_ns = self._grid.instant(self._due)
        rig = self._rig.parameters
        content = self._messages.states(time_ns, sample, rig.static_deflection, rig.angle)
        self._write('joint_states', content, time_ns)
        self._due += 1
        self._wait()

    def _wait(self) -> None:
        """Wait for the disk if many messages are waiting for it."""
        while self._writer.backlog > _BACKLOG and self._writer.error is None:
            time.sleep(_NAP)

    def instants(self) -> Iterator[float]:
        """Yield the instants of the ticks to come, s."""
        ticks = takewhile(lambda tick: tick <= self._last, count(self._due))
        instants = (self._grid.instant(tick) / 1e9 for tick in ticks)
        return takewhile(lambda instant: instant < self.hold, instants)

    def ticks(self) -> Iterator[float]:
        """Yield the ticks if a file of the bag may end at each: it ends with a snapshot."""
        return self.instants() if self._writer.splits else iter(())

    def look_at(self, instant: float) -> None:
        """Begin a new file after a tick, which is not the last one, if it is time for one."""
        time_ns = self._grid.instant(self._due - 1)
        if instant != time_ns / 1e9 or self._due > self._last:
            return
        if self._writer.split_due(time_ns):
            if self._writer.split(time_ns):
                self._begin_file(time_ns)
            while self._writer.splitting:
                time.sleep(_NAP / 10)

    def take_change(
        self, time_ns: int, values: Mapping[str, Any], events: Sequence[Event]
    ) -> None:
        """
        Record a change of parameters, after the rig was changed.

        Parameters
        ----------
        time_ns : int
            The instant that the rig has reached.
        values : mapping
            The new values by name.
        events : sequence of Event
            Immediate effects of the change.
        """
        if self._due > self._last:
            return
        self._snapshots.change(self._values, values)
        self._values |= values
        self._write('parameter_events', parameter_event(time_ns, self._node, values), time_ns)
        self.take_events(events)
        self._describe(time_ns)
        self._snapshot('change', time_ns)

    def reset(self, time_ns: int, initial: Mapping[str, Any], events: Sequence[Event]) -> None:
        """Record a reset to initial conditions as `take_change` records a change."""
        if self._due > self._last:
            return
        self._snapshots.reset(initial)
        self.take_events(events)
        self._snapshot('reset', time_ns)

    def take_events(self, events: Sequence[Event]) -> None:
        """
        Record the impacts and the acts of the gap control of the rig's last call.

        Raises
        ------
        RecordingError
            If the recording has failed.
        """
        if self._writer.error is not None:
            raise self._writer.error
        self._write_events(events, self._rig.acts)

    def _write_events(self, events: Sequence[Event], acts: Sequence[ControlAct]) -> None:
        # A bag ends with a whole tick.
        if self._due <= self._last and (events or acts):
            deflection = self._rig.parameters.static_deflection
            for message in self._messages.events(0, events, acts, deflection):
                self._write(*message)
            self._wait()

    def take_samples(self, samples: NDArray[np.void]) -> None:
        """Record joint states."""
        for row in samples.tolist():
            self._tick(Sample(*row))

    def take_motion(self, events: Sequence[Event], samples: NDArray[np.void]) -> None:
        """Record events, acts and joint states as if the rig had stopped at each tick."""
        if self._writer.error is not None:
            raise self._writer.error
        acts, event, act = self._rig.acts, 0, 0
        for row in samples.tolist():
            sample = Sample(*row)
            since = event, act
            event = bisect_right(events, sample.time, since[0], key=_time_of)
            act = bisect_right(acts, sample.time, since[1], key=_time_of)
            self._write_events(events[since[0] : event], acts[since[1] : act])
            self._tick(sample)
        self._write_events(events[event:], acts[act:])

    def close(self) -> None:
        """
        Finish the bag, with the tick that is due now if there is one.

        Raises
        ------
        RecordingError
            If it could not be written completely.
        """
        if self._due <= self._last and self._grid.instant(self._due) / 1e9 == self._rig.time:
            self._tick(self._rig.sample())
        self._writer.close()
        if self._writer.error is not None:
            raise self._writer.error
