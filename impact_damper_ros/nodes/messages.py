"""
The messages of the rig as bytes: templates in which only stamp and numbers are filled in.

Serialising a JointState costs several times what publishing its bytes does, and the log wants the
same bytes. So every shape is serialised once at start-up; afterwards a message is packed of the
stamp, the doubles, and the bytes that stand between them in the template.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from impact_damper_ros.control import CONTROL_JOINTS, Action, ControlRecord
from impact_damper_ros.nodes.serialisation import (
    NS_PER_S,
    ORIGIN,
    STAMP,
    SerialisationError,
    Walk,
    restamped,
    serialised,
    time_from_ns,
)
from impact_damper_ros.rig import Event, Sample
from impact_damper_ros.rig.published import (
    IMPACT_JOINTS,
    JOINTS,
    impact_numbers,
    state_numbers,
)

__all__ = [
    'ClockTemplate',
    'ControlTemplate',
    'ImpactTemplate',
    'JointStateTemplate',
    'StateTemplate',
]


class JointStateTemplate:
    """
    A sensor_msgs/JointState of fixed joints, to be filled in.

    Parameters
    ----------
    frame_id : str
        Frame of the header.
    names : sequence of str
        The joints.
    fields : sequence of str
        Which of `position`, `velocity`, `effort` carry values; the others stay empty.

    Raises
    ------
    SerialisationError
        If filled-in bytes do not read back, through the middleware, as the values filled in.
    """

    def __init__(self, frame_id: str, names: Sequence[str], fields: Sequence[str]) -> None:
        """Let the middleware serialise the shape, and find the places to fill."""
        blank = {field: [0.0] * len(names) for field in fields}
        header = Header(frame_id=frame_id)
        walk = Walk(JointState(header=header, name=list(names), **blank))
        content = bytes(walk.buffer)
        # What stays as it is stands between the stamp and the numbers of each field.
        ends = [ORIGIN + STAMP.size, *(at + 8 * len(names) for at in walk.numbers_at)]
        starts = [*walk.numbers_at, len(content)]
        self._head = content[:ORIGIN]
        self._fixed = [content[end:start] for end, start in zip(ends, starts, strict=True)]
        numbers = f'{len(names)}d'
        layout = numbers.join(f'{len(part)}s' for part in self._fixed)
        self._layout = struct.Struct(f'<{ORIGIN}s{STAMP.format[1:]}{layout}')
        self._verify(header, names, fields)

    def filled(self, stamp_ns: int, *values: Sequence[float]) -> bytes:
        """
        Return the message as bytes.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the header.
        *values : sequence of float
            One sequence for each field that the template carries, in the message's order.
        """
        parts = [*divmod(stamp_ns, NS_PER_S), self._fixed[0]]
        for numbers, fixed in zip(values, self._fixed[1:], strict=True):
            parts += numbers
            parts.append(fixed)
        return self._layout.pack(self._head, *parts)

    def _verify(self, header: Any, names: Sequence[str], fields: Sequence[str]) -> None:
        count = len(names)
        values = {
            field: [row * count + column + 0.5 for column in range(count)]
            for row, field in enumerate(fields)
        }
        stamp_ns = 1_234_567_890_123_456_789
        header.stamp = time_from_ns(stamp_ns)
        expected = JointState(header=header, name=list(names), **values)
        if deserialize_message(self.filled(stamp_ns, *values.values()), JointState) != expected:
            raise SerialisationError('a filled-in JointState does not read back as it was filled')


class StateTemplate(JointStateTemplate):
    """
    Joint states of the rig; the numbers are those of `state_numbers`.

    Samples of the motion have no frame; what a rig that is held repeats has `PAUSED_FRAME`.
    """

    def __init__(self, frame_id: str = '') -> None:
        """Build the template."""
        super().__init__(frame_id, JOINTS, ('position', 'velocity'))

    def of(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a sample, given the static deflection of the rig then, m."""
        positions, velocities = state_numbers(sample, deflection)
        seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
        names, between, end = self._fixed
        # As `filled` does it, in one go: this is what the rig sends at every tick.
        return self._layout.pack(
            self._head,
            seconds,
            nanoseconds,
            names,
            *positions,
            between,
            *velocities,
            end,
        )


class ImpactTemplate(JointStateTemplate):
    """An impact at one stop, of primary and damper; the numbers are those of `impact_numbers`."""

    def __init__(self, stop: int) -> None:
        """Build the template for stop 1 or 2."""
        super().__init__(f'stop_{stop}', IMPACT_JOINTS, ('position', 'velocity', 'effort'))

    def of(self, stamp_ns: int, event: Event, deflection: float) -> bytes:
        """Return the message of an impact, given the static deflection of the rig then, m."""
        return self.filled(stamp_ns, *impact_numbers(event, deflection))


class ControlTemplate(JointStateTemplate):
    """
    An act of the gap control, or what became of it.

    Positions: where each stop is to be (Y), and the estimate of the amplitude of X. Velocities:
    of each stop in M, and X' as it was sampled last. Efforts: the energy that each actuator has
    spent so far, and nothing.
    """

    def __init__(self, action: Action) -> None:
        """Build the template for one kind of act."""
        super().__init__(action.name.lower(), CONTROL_JOINTS, ('position', 'velocity', 'effort'))

    def of(self, stamp_ns: int, record: ControlRecord) -> bytes:
        """Return the message of an act."""
        return self.filled(stamp_ns, *record.numbers)


class ClockTemplate:
    """A rosgraph_msgs/Clock."""

    def __init__(self) -> None:
        """Let the middleware serialise the shape."""
        self._data = serialised(Clock())
        stamp_ns = 1_234_567_890_123_456_789
        if deserialize_message(self.of(stamp_ns), Clock) != Clock(clock=time_from_ns(stamp_ns)):
            raise SerialisationError('a filled-in Clock does not read back as it was filled')

    def of(self, stamp_ns: int) -> bytes:
        """Return the message of an instant."""
        return restamped(self._data, stamp_ns)
