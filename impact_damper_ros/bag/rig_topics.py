# SPDX-License-Identifier: Apache-2.0
"""
The topics of a rig: their names, types and quality of service, and the content of their messages.

The node, a recorder without ROS and a replay all take the messages from here, so that their bytes
are the same. A new topic is a line in `RIG_TOPICS`, and a layout and a method of `RigMessages`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from impact_damper_ros.control.record import CONTROL_JOINTS, Action, ControlRecord

from .messages import DIAGNOSTIC_ARRAY, JOINT_STATE, PARAMETER_EVENT, STRING, JointStateLayout
from .topics import LATCHED, QosProfile, Topic

if TYPE_CHECKING:
    from impact_damper_ros.motion.event import Event, Sample

#: What a rig publishes, by the name under which the notes of a bag list it. A name without a slash
#: is in the namespace of the node, which has the topics remapped if its user wants that.
RIG_TOPICS: dict[str, Topic] = {
    # Reliable, as joint_state_publisher and joint_state_broadcaster offer it: best-effort
    # subscribers (robot_state_publisher) match too. Deep, for a subscriber that stalls.
    'joint_states': Topic('joint_states', JOINT_STATE, QosProfile(depth=100)),
    'impacts': Topic('impacts', JOINT_STATE, QosProfile(depth=1000)),
    'gap_control': Topic('gap_control', JOINT_STATE, QosProfile(depth=1000)),
    'measurements': Topic('measurements', JOINT_STATE, QosProfile(depth=100)),
    'snapshot': Topic('snapshot', STRING, LATCHED),
    'parameter_events': Topic('/parameter_events', PARAMETER_EVENT, QosProfile(depth=1000)),
    'diagnostics': Topic('/diagnostics', DIAGNOSTIC_ARRAY, QosProfile(depth=10)),
    'robot_description': Topic('robot_description', STRING, LATCHED),
}

#: What the node publishes beside them, and does not record.
LIVE_TOPICS: dict[str, Topic] = {
    'theory': Topic('theory', STRING, LATCHED),
    # Reliable and best-effort subscribers match.
    'clock': Topic('/clock', 'rosgraph_msgs/msg/Clock', QosProfile(depth=10)),
}
#: What it takes from a controller: those that have come are few, or old.
COMMAND_TOPICS: dict[str, Topic] = {
    'stop_commands': Topic('stop_commands', JOINT_STATE, QosProfile(depth=4)),
    'force_command': Topic(
        'force_command', 'geometry_msgs/msg/WrenchStamped', QosProfile(depth=4)
    ),
}


def recorded_topics(names: Mapping[str, str]) -> list[Topic]:
    """Return the topics of a recording, given the full names of those that it has."""
    return [replace(topic, name=names[key]) for key, topic in RIG_TOPICS.items() if key in names]


def recording_notes(node: str, names: Mapping[str, str]) -> dict[str, str]:
    """Return the notes that name the topics, which may be remapped, for a reader."""
    return {'node': node, **names}


#: Joints along the axis of what rides on M, and all joints. The incline is an angle, `base` is
#: what the spring of M hangs on, and `relative` is the primary mass as seen from there.
AXIS_JOINTS = ('primary', 'damper', 'stop_1', 'stop_2')
JOINTS = (*AXIS_JOINTS, 'incline', 'base', 'relative')
IMPACT_JOINTS = AXIS_JOINTS[:2]
#: The `frame_id` of the joint states that a rig repeats while it is paused; they are no samples.
PAUSED_FRAME = 'paused'

_Numbers = tuple[float, ...]


def state_numbers(sample: Sample, deflection: float, angle: float) -> tuple[_Numbers, _Numbers]:
    """
    Return the published numbers of a sample: positions and velocities of `JOINTS`.

    Positions count from the place of M with an unloaded spring, which no change of the rig moves;
    `deflection` is the static deflection of the rig then, m. The angle of the incline, rad, only
    changes at once, so that its velocity is 0. The place of `relative` is how far the spring is
    stretched.
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

    The velocities are those of M and m after the impact, the efforts the impulses on them, of
    which the first is given: stop 1, the lower one, throws m up. For the deflection see
    `state_numbers`. Columns of several impacts may stand for the numbers.
    """
    return (x + deflection, x + y + deflection), after, (impulse, -impulse)


class RigMessages:
    """Encodes joint states, impacts and acts of the gap control."""

    def __init__(self) -> None:
        self._states = JointStateLayout.of('', JOINTS, 7, 7, 0)
        self._paused = JointStateLayout.of(PAUSED_FRAME, JOINTS, 7, 7, 0)
        self._measurement = JointStateLayout.of('', AXIS_JOINTS, 4, 4, 0)
        self._impacts = {
            stop: JointStateLayout.of(f'stop_{stop}', IMPACT_JOINTS, 2, 2, 2) for stop in (1, 2)
        }
        self._control = {
            action: JointStateLayout.of(action.name.lower(), CONTROL_JOINTS, 3, 3, 3)
            for action in Action
        }

    def states(self, stamp_ns: int, sample: Sample, deflection: float, angle: float) -> bytes:
        """Return the joint states of a sample; see `state_numbers`."""
        return self._states.filled(stamp_ns, *state_numbers(sample, deflection, angle))

    def paused_states(
        self, stamp_ns: int, sample: Sample, deflection: float, angle: float
    ) -> bytes:
        """Return the joint states that a paused rig repeats."""
        return self._paused.filled(stamp_ns, *state_numbers(sample, deflection, angle))

    def measurement(
        self, stamp_ns: int, positions: Sequence[float], velocities: Sequence[float]
    ) -> bytes:
        """Return what the sensors see of `AXIS_JOINTS`: X, and the others in M."""
        return self._measurement.filled(stamp_ns, positions, velocities)

    def impact(self, stamp_ns: int, event: Event, deflection: float) -> bytes:
        """Return the message of an impact; see `impact_numbers`."""
        after = event.primary_velocity_after, event.damper_velocity_after
        impulse = event.impulse if event.stop == 1 else -event.impulse
        parts = impact_numbers(event.x, event.y, after, impulse, deflection)
        return self._impacts[event.stop].filled(stamp_ns, *parts)

    def control(self, stamp_ns: int, record: ControlRecord) -> bytes:
        """Return the message of an act of the gap control; see `ControlRecord.numbers`."""
        return self._control[record.action].filled(stamp_ns, *record.numbers)


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
