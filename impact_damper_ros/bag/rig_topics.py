# SPDX-License-Identifier: Apache-2.0
"""
The topics of a rig: their names, types and quality of service, and the content of their messages.

The node, a recorder without ROS and a replay all take the messages from here, so that their bytes
are the same. A new topic is a line in `RIG_TOPICS`, and a layout and a method of `RigMessages`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from impact_damper_ros.control.act import CONTROL_JOINTS, Action, ControlAct

from .messages import DIAGNOSTIC_ARRAY, JOINT_STATE, PARAMETER_EVENT, STRING, JointStateLayout
from .topics import LATCHED, QosProfile, Topic

if TYPE_CHECKING:
    from impact_damper_ros.motion.event import Event, Sample

#: The `frame_id` of the joint states that a rig repeats while it is paused, so many a second; such
#: states are no samples.
PAUSED_FRAME, PAUSED_RATE = 'paused', 10.0
_SAMPLED = 'taken at each sample and measurement; its `frame_id` is not read'


@dataclass(frozen=True, kw_only=True)
class RigTopic(Topic):
    """
    A topic of the node.

    Attributes
    ----------
    rate : float or str
        Messages a second, or the name of the setting that holds them; 0 if `when` describes them.
    when : str
        What else causes a message.
    frames : tuple of str
        Each `frame_id` of its messages.
    """

    rate: float | str = 0.0
    when: str = ''
    frames: tuple[str, ...] = ()

    def rate_of(self, settings: object) -> float:
        """Return the messages a second of a node with some settings."""
        return float(getattr(settings, self.rate) if isinstance(self.rate, str) else self.rate)


#: Topics that a rig publishes, by the name under which the notes of a bag list them. A name
#: without a slash is in the namespace of the node; a user may remap it.
RIG_TOPICS: dict[str, RigTopic] = {
    # Reliable, as joint_state_publisher and joint_state_broadcaster offer it: best-effort
    # subscribers (robot_state_publisher) match too. Deep, for a subscriber that stalls.
    'joint_states': RigTopic(
        'joint_states',
        JOINT_STATE,
        QosProfile(depth=100),
        rate='state_rate',
        when=f'{PAUSED_RATE:g} a second while paused',
        frames=('', PAUSED_FRAME),
    ),
    'impacts': RigTopic(
        'impacts',
        JOINT_STATE,
        QosProfile(depth=1000),
        when='at each impact',
        frames=('stop_1', 'stop_2'),
    ),
    'gap_control': RigTopic(
        'gap_control',
        JOINT_STATE,
        QosProfile(depth=1000),
        when='at each act of the control',
        frames=tuple(action.name.lower() for action in Action),
    ),
    'measurements': RigTopic(
        'measurements',
        JOINT_STATE,
        QosProfile(depth=100),
        rate='measurement_rate',
        frames=('',),
    ),
    'snapshot': RigTopic(
        'snapshot', STRING, LATCHED, when='at the start, after each change, reset and pause'
    ),
    'parameter_events': RigTopic(
        '/parameter_events',
        PARAMETER_EVENT,
        QosProfile(depth=1000),
        when='at each change of a parameter',
    ),
    'diagnostics': RigTopic(
        '/diagnostics',
        DIAGNOSTIC_ARRAY,
        QosProfile(depth=10),
        rate=1.0,
        when='when more is predicted',
        frames=('',),
    ),
    'robot_description': RigTopic(
        'robot_description', STRING, LATCHED, when='at the start, and when a change is visible'
    ),
}

#: Topics that the node also publishes, and does not record.
LIVE_TOPICS: dict[str, RigTopic] = {
    'theory': RigTopic('theory', STRING, LATCHED, when='twice after a change'),
    # Reliable and best-effort subscribers match.
    'clock': RigTopic(
        '/clock',
        'rosgraph_msgs/msg/Clock',
        QosProfile(depth=10),
        rate='state_rate',
        when=f'{PAUSED_RATE:g} a second while paused; of a rig with simulated time',
    ),
}
#: Topics of commands of a controller: a few messages that wait are enough.
COMMAND_TOPICS: dict[str, RigTopic] = {
    'stop_commands': RigTopic('stop_commands', JOINT_STATE, QosProfile(depth=4), when=_SAMPLED),
    'force_command': RigTopic(
        'force_command', 'geometry_msgs/msg/WrenchStamped', QosProfile(depth=4), when=_SAMPLED
    ),
}


def recorded_topics(names: Mapping[str, str]) -> list[Topic]:
    """Return the topics of a recording, given the full names of those that it has."""
    return [replace(topic, name=names[key]) for key, topic in RIG_TOPICS.items() if key in names]


def recording_notes(node: str, names: Mapping[str, str]) -> dict[str, str]:
    """Return the notes that name the topics, which may be remapped, for a reader."""
    return {'node': node, **names}


#: Joints along the axis of the parts that ride on M, and all joints. `incline` is an angle, the
#: spring of M hangs on `base`, and `relative` is the primary mass relative to `base`.
AXIS_JOINTS = ('primary', 'damper', 'stop_1', 'stop_2')
JOINTS = (*AXIS_JOINTS, 'incline', 'base', 'relative')
IMPACT_JOINTS = AXIS_JOINTS[:2]

_Numbers = tuple[float, ...]


def state_numbers(sample: Sample, deflection: float, angle: float) -> tuple[_Numbers, _Numbers]:
    """
    Return the published numbers of a sample: positions and velocities of `JOINTS`.

    Positions count from the place of M with an unloaded spring, which no change of the rig moves;
    `deflection` is the static deflection of the rig at that time, m. The angle of the incline,
    rad, changes in jumps only, so that its velocity is 0. The position of `relative` is the
    elongation of the spring.
    """
    _, x, velocity, z, damper_velocity, stop_1, stop_2, velocity_1, velocity_2, *base = sample
    here, rate = base
    primary = x + deflection
    places = (primary, z + deflection, stop_1 + deflection, stop_2 + deflection)
    velocities = (velocity, damper_velocity, velocity_1, velocity_2)
    return (*places, angle, here, primary - here), (*velocities, 0.0, rate, velocity - rate)


def impact_numbers(
    x: float, y: float, after: tuple[float, float], impulse: float, deflection: float
) -> tuple[_Numbers, _Numbers, _Numbers]:
    """
    Return the published numbers of an impact: positions, velocities, efforts of `IMPACT_JOINTS`.

    The velocities are those of M and m after the impact, the efforts the impulses on them.
    `impulse` is that on M: stop 1, the lower one, throws m up. For the deflection see
    `state_numbers`. Columns of several impacts may stand for the numbers.
    """
    return (x + deflection, x + y + deflection), after, (impulse, -impulse)


class RigMessages:
    """Encodes joint states, impacts and acts of the gap control."""

    def __init__(self) -> None:

        def layouts(key: str, joints: Sequence[str], *numbers: int) -> list[JointStateLayout]:
            return [JointStateLayout.of(f, joints, *numbers) for f in RIG_TOPICS[key].frames]

        self._states, self._paused = layouts('joint_states', JOINTS, 7, 7, 0)
        (self._measurement,) = layouts('measurements', AXIS_JOINTS, 4, 4, 0)
        self._impacts = dict(enumerate(layouts('impacts', IMPACT_JOINTS, 2, 2, 2), 1))
        acts = layouts('gap_control', CONTROL_JOINTS, 3, 3, 3)
        self._control = dict(zip(Action, acts, strict=True))

    def states(self, stamp_ns: int, sample: Sample, deflection: float, angle: float) -> bytes:
        """Return the joint states of a sample; see `state_numbers`."""
        return self._states.fill(stamp_ns, *state_numbers(sample, deflection, angle))

    def paused_states(
        self, stamp_ns: int, sample: Sample, deflection: float, angle: float
    ) -> bytes:
        """Return the joint states that a paused rig repeats."""
        return self._paused.fill(stamp_ns, *state_numbers(sample, deflection, angle))

    def measurement(
        self, stamp_ns: int, positions: Sequence[float], velocities: Sequence[float]
    ) -> bytes:
        """Return the measurement of `AXIS_JOINTS`: X, and the positions of the others in M."""
        return self._measurement.fill(stamp_ns, positions, velocities)

    def impact(self, stamp_ns: int, event: Event, deflection: float) -> bytes:
        """Return the message of an impact; see `impact_numbers`."""
        after = event.primary_velocity_after, event.damper_velocity_after
        impulse = event.impulse if event.stop == 1 else -event.impulse
        parts = impact_numbers(event.x, event.y, after, impulse, deflection)
        return self._impacts[event.stop].fill(stamp_ns, *parts)

    def events(
        self,
        offset_ns: int,
        events: Iterable[Event],
        acts: Iterable[ControlAct],
        deflection: float,
    ) -> Iterator[tuple[str, bytes, int]]:
        """Yield key of the topic, content and stamp of the impacts among events, then of acts."""
        from impact_damper_ros.motion.event import EventKind

        for event in events:
            if event.kind is EventKind.IMPACT:
                stamp_ns = offset_ns + round(event.time * 1e9)
                yield 'impacts', self.impact(stamp_ns, event, deflection), stamp_ns
        for act in acts:
            stamp_ns = offset_ns + round(act.time * 1e9)
            yield 'gap_control', self.control(stamp_ns, act), stamp_ns

    def control(self, stamp_ns: int, act: ControlAct) -> bytes:
        """Return the message of an act of the gap control; see `ControlAct.numbers`."""
        return self._control[act.action].fill(stamp_ns, *act.numbers)


def rig_nodes(services: Mapping[str, Sequence[str]]) -> list[str]:
    """Return the full names of the nodes that are rigs, by all services and their types."""
    return sorted(
        node
        for name, kinds in services.items()
        if name.endswith('/pause')
        and 'std_srvs/srv/SetBool' in kinds
        and (node := name.removesuffix('/pause'))
        and f'{node}/reset' in services
        and f'{node}/set_parameters_atomically' in services
    )
