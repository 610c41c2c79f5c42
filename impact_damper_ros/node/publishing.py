"""
The messages of the rig, and where they go: topics and a recording.

The middleware serialises into a buffer of an estimated size and leaves what lay there before in
the padding and behind the end. Subscribers do not mind, but some readers of bags do (a message
longer than its fields is refused), and equal messages should be equal bytes. So the fields are
walked once, the padding is zeroed and the rest cut off.

Serialising a JointState costs several times what publishing its bytes does, and the log wants the
same bytes. So every shape is serialised once at start-up; afterwards a message is packed of the
stamp, the doubles, and the bytes that stand between them in the template.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String

from impact_damper_ros.control import CONTROL_JOINTS, Action, ControlRecord
from impact_damper_ros.rig import Event, EventKind, Sample
from impact_damper_ros.rig.published import (
    IMPACT_JOINTS,
    JOINTS,
    PAUSED_FRAME,
    impact_numbers,
    state_numbers,
)

__all__ = [
    'NS_PER_S',
    'ORIGIN',
    'STAMP',
    'ClockTemplate',
    'ControlTemplate',
    'Emitter',
    'Happening',
    'ImpactTemplate',
    'JointStateTemplate',
    'Log',
    'Outlet',
    'Outlets',
    'SerialisationError',
    'StateTemplate',
    'TickMessages',
    'Walk',
    'restamped',
    'serialised',
    'time_from_ns',
]


NS_PER_S = 1_000_000_000
#: CDR: a message begins after the four bytes that name the encoding; alignment counts from there.
ORIGIN = 4
_LITTLE_ENDIAN = b'\x00\x01'
#: Of a builtin_interfaces/Time
STAMP = struct.Struct('<iI')
_COUNT = struct.Struct('<I')

# A field is the name of a method of `Walk`; a list is a sequence of its entries.
Field: TypeAlias = str | list['Field']
# Name and type, and then every kind of value that there is.
_SINGLE_VALUES: list[Field] = ['byte', 'number', 'number', 'text']
_VALUE_ARRAYS: list[Field] = ['text', 'text', 'numbers', 'numbers', ['text']]
_PARAMETERS: list[Field] = ['text', 'byte', *_SINGLE_VALUES, *_VALUE_ARRAYS]
_FIELDS: dict[type, Sequence[Field]] = {
    Clock: ['stamp'],
    DiagnosticArray: ['stamp', 'text', ['byte', 'text', 'text', 'text', ['text', 'text']]],
    JointState: ['stamp', 'text', ['text'], 'numbers', 'numbers', 'numbers'],
    ParameterEvent: ['stamp', 'text', _PARAMETERS, _PARAMETERS, _PARAMETERS],
    String: ['text'],
}


class SerialisationError(RuntimeError):
    """The middleware serialises a message otherwise than expected."""


def time_from_ns(stamp_ns: int) -> Any:
    """Return the builtin_interfaces/Time of a stamp in nanoseconds."""
    seconds, nanoseconds = divmod(stamp_ns, NS_PER_S)
    return Time(sec=seconds, nanosec=nanoseconds)


def serialised(message: Any) -> bytes:
    """Serialise a message of one of the types that the node publishes."""
    return bytes(Walk(message).buffer)


def restamped(data: bytes, stamp_ns: int) -> bytes:
    """Return a serialised message, of a type that begins with its stamp, stamped anew."""
    buffer = bytearray(data)
    STAMP.pack_into(buffer, ORIGIN, *divmod(stamp_ns, NS_PER_S))
    return bytes(buffer)


class Walk:
    """
    A walk through the fields of a message as the middleware serialises it.

    Parameters
    ----------
    message : object
        The message.

    Attributes
    ----------
    buffer : bytearray
        The message, of exact length and with zeros for padding.
    numbers_at : list of int
        Where the doubles of each sequence that is not empty begin.

    Raises
    ------
    SerialisationError
        If the encoding is not the one that can be walked.
    """

    def __init__(self, message: Any) -> None:
        """Walk to the end."""
        self.buffer = bytearray(serialize_message(message))
        self.numbers_at: list[int] = []
        if self.buffer[:2] != _LITTLE_ENDIAN:
            raise SerialisationError(
                f'messages are encoded as {bytes(self.buffer[:4]).hex()}, not little-endian CDR'
            )
        self._at = ORIGIN
        self._walk(_FIELDS[type(message)])
        if len(self.buffer) < self._at:
            raise SerialisationError(f'{type(message).__name__} ends within a field')
        del self.buffer[self._at :]

    def _walk(self, fields: Sequence[Field]) -> None:
        for field in fields:
            if isinstance(field, list):
                for _ in range(self._count()):
                    self._walk(field)
            else:
                getattr(self, f'_{field}')()

    def _align(self, size: int) -> None:
        gap = (ORIGIN - self._at) % size
        self.buffer[self._at : self._at + gap] = bytes(gap)
        self._at += gap

    def _count(self) -> int:
        self._align(_COUNT.size)
        (count,) = _COUNT.unpack_from(self.buffer, self._at)
        self._at += _COUNT.size
        return int(count)

    def _stamp(self) -> None:
        self._at += STAMP.size

    def _byte(self) -> None:
        self._at += 1

    def _text(self) -> None:
        count = self._count()
        self._at += count

    def _number(self) -> None:
        self._align(8)
        self._at += 8

    def _numbers(self) -> None:
        # An empty sequence is not followed by padding.
        if count := self._count():
            self._align(8)
            self.numbers_at.append(self._at)
            self._at += 8 * count


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
        """Return the message as bytes."""
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


class Outlet(NamedTuple):
    """A topic: its resolved name, and what publishes a serialised message on it."""

    topic: str
    publish: Callable[[bytes], None]


class Log(Protocol):
    """A recording."""

    @property
    def backlog(self) -> int:
        """Number of messages that wait to be written."""

    def write(self, topic: str, data: bytes, stamp_ns: int, /) -> object:
        """Take a serialised message, without blocking."""

    def split_due(self, stamp_ns: int, /) -> bool:
        """Return whether a new file should begin with this stamp."""

    def split(self, stamp_ns: int, /) -> bool:
        """Let what comes go to a new file; false if that cannot be now."""


class Outlets(NamedTuple):
    """Where the engine publishes, and the topics it only records."""

    joint_states: Outlet
    impacts: Outlet
    gap_control: Outlet
    snapshot: Outlet
    clock: Outlet | None
    parameter_events: str
    diagnostics: str
    robot_description: str = ''


class Emitter:
    """
    Publish what the engine hands out, and record it while there is a log.

    Parameters
    ----------
    alive : callable
        Whether ROS still runs; publishing fails once it does not.
    on_end : callable
        Called if it does not.

    Attributes
    ----------
    log : Log or None
        The recording.
    recorded : int
        Messages given to it.
    """

    def __init__(self, alive: Callable[[], bool], on_end: Callable[[], object]) -> None:
        """Record nothing so far."""
        self.log: Log | None = None
        self.recorded = 0
        self._alive = alive
        self._on_end = on_end

    def emit(self, outlet: Outlet, data: bytes, stamp_ns: int) -> None:
        """Record and publish a serialised message."""
        # Record first: once ROS shuts down nothing can be published, but the log is to be whole.
        self.record(outlet.topic, data, stamp_ns)
        self.publish(outlet, data)

    def record(self, topic: str, data: bytes, stamp_ns: int) -> None:
        """Record a serialised message, if there is a log."""
        if self.log is not None:
            self.log.write(topic, data, stamp_ns)
            self.recorded += 1

    def publish(self, outlet: Outlet, data: bytes) -> None:
        """Publish a serialised message; what fails because ROS has ended is not an error."""
        try:
            outlet.publish(data)
        except Exception:
            if self._alive():
                raise
            self._on_end()


class Happening(NamedTuple):
    """A message that is ready to go out."""

    outlet: Outlet
    data: bytes
    stamp_ns: int


class TickMessages:
    """
    Make messages of what happens between two ticks, and count.

    Parameters
    ----------
    outlets : Outlets
        Where they go.

    Attributes
    ----------
    impacts, commands : int
        How many so far.
    last_act : ControlRecord or None
        The last thing that the gap control did.
    """

    def __init__(self, outlets: Outlets) -> None:
        """Build the templates."""
        self.impacts = 0
        self.commands = 0
        self.last_act: ControlRecord | None = None
        self._outlets = outlets
        self._states = StateTemplate()
        self._paused = StateTemplate(PAUSED_FRAME)
        self._impacts_at = {1: ImpactTemplate(1), 2: ImpactTemplate(2)}
        self._acts = {action: ControlTemplate(action) for action in Action}

    def states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a sample, given the static deflection of the rig then, m."""
        return self._states.of(stamp_ns, sample, deflection)

    def paused_states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a rig that is held; they are no sample of its motion."""
        return self._paused.of(stamp_ns, sample, deflection)

    def happenings(
        self,
        events: Sequence[Event],
        records: Sequence[ControlRecord],
        offset_ns: int,
        deflection: float,
    ) -> list[Happening]:
        """Return the messages of impacts, then of what the gap control did."""
        out = []
        for event in events:
            if event.kind is EventKind.IMPACT:
                stamp_ns = offset_ns + round(event.time * 1e9)
                data = self._impacts_at[event.stop].of(stamp_ns, event, deflection)
                out.append(Happening(self._outlets.impacts, data, stamp_ns))
                self.impacts += 1
        for record in records:
            stamp_ns = offset_ns + round(record.time * 1e9)
            data = self._acts[record.action].of(stamp_ns, record)
            out.append(Happening(self._outlets.gap_control, data, stamp_ns))
            self.commands += record.action is Action.COMMAND
            self.last_act = record
        return out
