# SPDX-License-Identifier: Apache-2.0
"""
Commands of a controller outside the node: the topics `stop_commands` and `force_command`.

The engine's thread takes the commands from the middleware itself, a few at most at each stop of
the rig, and no other thread wakes up for them. They are in effect at once, and a flood of them
does not change the pace. A command that cannot be carried out is refused, counted, and reported
with the reason.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import NamedTuple

from impact_damper_ros.bag.messages import JOINT_STATE, CdrReader, JointState, decode
from impact_damper_ros.bag.rig_topics import COMMAND_TOPICS
from impact_damper_ros.parameters.quoting import plural, quote
from impact_damper_ros.rig.order import Order

#: Most messages of a topic that are taken at a stop of the rig, and that wait.
DEPTH = COMMAND_TOPICS['stop_commands'].qos.depth


class TopicCommandError(ValueError):
    """A command that cannot be carried out."""


class TopicCommand(NamedTuple):
    """A command: key and name of its topic, stamp or 0 for none, and the order."""

    key: str
    topic: str
    stamp_ns: int
    order: Order


class CommandTopic(NamedTuple):
    """A topic of commands: its key, ``'stop_commands'`` or ``'force_command'``, and its name."""

    key: str
    topic: str
    take: Callable[[], Sequence[bytes]]  # returns the messages that have come, at most `DEPTH`
    publishers: Callable[[], int]  # returns the number of publishers
    #: Returns stamp and order of a message; raises a ValueError with the reason if it has none
    read: Callable[[bytes], tuple[int, Order]]


def read_stop_command(content: bytes) -> tuple[int, Order]:
    """Read a sensor_msgs/JointState as an order to the stops."""
    message = decode(JOINT_STATE, content)
    assert isinstance(message, JointState)
    strange = [name for name in message.name if name not in ('stop_1', 'stop_2')]
    if strange:
        raise TopicCommandError(
            f'there is no joint {quote(strange[0])}: give stop_1, stop_2, both or none'
        )
    count = len(message.name)
    if len(set(message.name)) < count:
        raise TopicCommandError(f'it names {quote(message.name[0])} twice')
    if len(message.position) != count or len(message.velocity) not in (0, count):
        raise TopicCommandError(
            f'it has {plural(count, "joint")}, {plural(len(message.position), "position")} '
            f'and {len(message.velocity)} velocities: give one position each, and one '
            'velocity each or none'
        )
    places = {}
    for name, place in zip(message.name, message.position, strict=True):
        if place != place:
            raise TopicCommandError(f'{name} is nan: leave a joint out that is to stay')
        places[name] = place
    for name, velocity in zip(message.name, message.velocity, strict=False):
        if velocity != velocity:
            raise TopicCommandError(f'the velocity of {name} is nan: give none, or 0 for any')
        if velocity:
            places[name.replace('stop', 'speed')] = abs(velocity)
    return message.stamp_ns, Order(**places)


def read_force_command(content: bytes) -> tuple[int, Order]:
    """Read a geometry_msgs/WrenchStamped as the active force on M, along the axis."""
    stamp_ns, _, force, *others = CdrReader(content).read(('time', 'string', *'dddddd'))
    if force != force:
        raise TopicCommandError('force.x is nan')
    if any(others):
        raise TopicCommandError('only force.x acts, along the axis: give 0 for the others')
    return stamp_ns, Order(force=force)


class CommandInbox:
    """Takes the commands that have come, in the engine's thread."""

    def __init__(
        self, topics: Sequence[CommandTopic] = (), wait: Callable[[float], object] = time.sleep
    ) -> None:
        #: Waits until a command comes, or for some seconds
        self.wait = wait
        self._topics = topics
        self.refused = 0
        self.reason = ''

    def take(self) -> list[TopicCommand]:
        """Return the commands that have come and can be read."""
        found = []
        for topic in self._topics:
            for content in topic.take():
                try:
                    found.append(self._read(topic, content))
                except ValueError as error:
                    self.refuse(topic.topic, error)
        return found

    @staticmethod
    def _read(topic: CommandTopic, content: bytes) -> TopicCommand:
        if (count := topic.publishers()) > 1:
            raise TopicCommandError(
                f'there are {count} publishers: stop all but one (one that was killed counts for '
                'up to 20 s more)'
            )
        return TopicCommand(topic.key, topic.topic, *topic.read(content))

    def refuse(self, topic: str, reason: object) -> None:
        """Note that a command was not carried out."""
        self.refused += 1
        self.reason = f'{topic}: {reason}'
