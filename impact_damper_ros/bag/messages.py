"""
The recorded messages as typed Python objects, and the CDR encoding of them.

Plain CDR (XCDR version 1), as of DDS-XTypes 1.3, section 7.4.3: four bytes that name the
encoding, then the fields, each aligned to its own size counted from there.

Stamps are integers of nanoseconds; a header is flattened into `stamp_ns` and `frame_id`.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

__all__ = [
    'DECODABLE',
    'CdrError',
    'CdrReader',
    'CdrWriter',
    'DiagnosticArray',
    'DiagnosticStatus',
    'JointState',
    'JointStateDecoder',
    'Message',
    'Parameter',
    'ParameterEvent',
    'String',
    'decode',
]


T = TypeVar('T')

_LITTLE_ENDIAN = {b'\x00\x01': '<', b'\x00\x00': '>'}


class CdrError(ValueError):
    """The bytes are not a message of the type they are said to be."""


class CdrReader:
    """
    Takes the fields of a message one after the other.

    Parameters
    ----------
    content : bytes
        The serialised message with its encapsulation header.

    Raises
    ------
    CdrError
        If the encapsulation is not plain CDR.
    """

    def __init__(self, content: bytes) -> None:
        try:
            self._order = _LITTLE_ENDIAN[bytes(content[:2])]
        except KeyError:
            raise CdrError(f'encapsulation {content[:2].hex()!r} is not plain CDR') from None
        self._content = content
        self.position = 4

    def _take(self, count: int, size: int, letter: str) -> tuple[int | float | bool, ...]:
        if not count:
            return ()
        start = self.position + (4 - self.position) % size
        if start + count * size > len(self._content):
            raise CdrError(f'the message ends at byte {len(self._content)}, in a field')
        self.position = start + count * size
        return struct.unpack_from(f'{self._order}{count}{letter}', self._content, start)

    def boolean(self) -> bool:
        """Take a bool."""
        return bool(self._take(1, 1, '?')[0])

    def uint8(self) -> int:
        """Take a uint8 or byte."""
        return int(self._take(1, 1, 'B')[0])

    def int32(self) -> int:
        """Take an int32."""
        return int(self._take(1, 4, 'i')[0])

    def uint32(self) -> int:
        """Take a uint32, such as the length of what follows."""
        return int(self._take(1, 4, 'I')[0])

    def int64(self) -> int:
        """Take an int64."""
        return int(self._take(1, 8, 'q')[0])

    def float64(self) -> float:
        """Take a float64."""
        return float(self._take(1, 8, 'd')[0])

    def octets(self) -> bytes:
        """Take a sequence of bytes."""
        length = self.uint32()
        end = self.position + length
        if end > len(self._content):
            raise CdrError(f'the message ends at byte {len(self._content)}, in a field')
        start, self.position = self.position, end
        return bytes(self._content[start:end])

    def string(self) -> str:
        """Take a string; its length counts the zero at its end."""
        return self.octets().removesuffix(b'\x00').decode()

    def booleans(self) -> tuple[bool, ...]:
        """Take a sequence of bool."""
        return tuple(bool(value) for value in self._take(self.uint32(), 1, '?'))

    def int64s(self) -> tuple[int, ...]:
        """Take a sequence of int64."""
        return tuple(int(value) for value in self._take(self.uint32(), 8, 'q'))

    def float64s(self) -> tuple[float, ...]:
        """Take a sequence of float64."""
        return tuple(float(value) for value in self._take(self.uint32(), 8, 'd'))

    def sequence(self, element: Callable[[], T]) -> tuple[T, ...]:
        """Take a sequence of what `element` takes."""
        count = self.uint32()
        if count > len(self._content):
            raise CdrError(f'a sequence of {count} cannot be in {len(self._content)} bytes')
        return tuple(element() for _ in range(count))

    def time_ns(self) -> int:
        """Take a builtin_interfaces/Time, in nanoseconds."""
        seconds = self.int32()
        return seconds * 10**9 + self.uint32()


class CdrWriter:
    """
    Puts the fields of a message one after the other, little-endian, with zeros as padding.

    Attributes
    ----------
    content : bytearray
        The message so far, with its encapsulation header.
    """

    def __init__(self) -> None:
        self.content = bytearray(b'\x00\x01\x00\x00')

    def put(self, letter: str, *values: float) -> CdrWriter:
        """Put numbers of one type, named as `struct` does."""
        if values:
            size = struct.calcsize(f'<{letter}')
            self.content += bytes((4 - len(self.content)) % size)
            self.content += struct.pack(f'<{len(values)}{letter}', *values)
        return self

    def sequence(self, letter: str, values: Sequence[float]) -> CdrWriter:
        """Put a sequence of numbers of one type."""
        return self.put('I', len(values)).put(letter, *values)

    def string(self, text: str) -> CdrWriter:
        """Put a string; its length counts the zero at its end."""
        content = text.encode() + b'\x00'
        self.put('I', len(content))
        self.content += content
        return self

    def time_ns(self, stamp_ns: int) -> CdrWriter:
        """Put a builtin_interfaces/Time."""
        return self.put('i', stamp_ns // 10**9).put('I', stamp_ns % 10**9)


@dataclass(frozen=True, slots=True)
class JointState:
    """sensor_msgs/msg/JointState: states of the rig, and impacts."""

    stamp_ns: int
    frame_id: str
    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


ParameterContent = (
    None
    | bool
    | int
    | float
    | str
    | bytes
    | tuple[bool, ...]
    | tuple[int, ...]
    | tuple[float, ...]
    | tuple[str, ...]
)


@dataclass(frozen=True, slots=True)
class Parameter:
    """rcl_interfaces/msg/Parameter: a name and the value that its type selects."""

    name: str
    value: ParameterContent


@dataclass(frozen=True, slots=True)
class ParameterEvent:
    """rcl_interfaces/msg/ParameterEvent: parameters that changed at one instant."""

    stamp_ns: int
    node: str
    new_parameters: tuple[Parameter, ...]
    changed_parameters: tuple[Parameter, ...]
    deleted_parameters: tuple[Parameter, ...]


@dataclass(frozen=True, slots=True)
class DiagnosticStatus:
    """diagnostic_msgs/msg/DiagnosticStatus: one component (level 0 is fine, 1 warns, 2 fails)."""

    level: int
    name: str
    message: str
    hardware_id: str
    values: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class DiagnosticArray:
    """diagnostic_msgs/msg/DiagnosticArray: the components' state."""

    stamp_ns: int
    frame_id: str
    status: tuple[DiagnosticStatus, ...]


@dataclass(frozen=True, slots=True)
class String:
    """std_msgs/msg/String: here, a snapshot of the simulator in JSON."""

    data: str


Message = JointState | ParameterEvent | DiagnosticArray | String


def _joint_state(reader: CdrReader) -> JointState:
    return JointState(
        stamp_ns=reader.time_ns(),
        frame_id=reader.string(),
        name=reader.sequence(reader.string),
        position=reader.float64s(),
        velocity=reader.float64s(),
        effort=reader.float64s(),
    )


def _parameter(reader: CdrReader) -> Parameter:
    name = reader.string()
    kind = reader.uint8()
    # In the order of the type's numbers; all are in the message, the number selects one.
    values: tuple[ParameterContent, ...] = (
        None,
        reader.boolean(),
        reader.int64(),
        reader.float64(),
        reader.string(),
        reader.octets(),
        reader.booleans(),
        reader.int64s(),
        reader.float64s(),
        reader.sequence(reader.string),
    )
    if kind >= len(values):
        raise CdrError(f'parameter {name!r} has the unknown type {kind}')
    return Parameter(name, values[kind])


def _parameter_event(reader: CdrReader) -> ParameterEvent:
    def parameters() -> tuple[Parameter, ...]:
        return reader.sequence(lambda: _parameter(reader))

    return ParameterEvent(
        stamp_ns=reader.time_ns(),
        node=reader.string(),
        new_parameters=parameters(),
        changed_parameters=parameters(),
        deleted_parameters=parameters(),
    )


def _diagnostic_status(reader: CdrReader) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=reader.uint8(),
        name=reader.string(),
        message=reader.string(),
        hardware_id=reader.string(),
        values=reader.sequence(lambda: (reader.string(), reader.string())),
    )


def _diagnostic_array(reader: CdrReader) -> DiagnosticArray:
    return DiagnosticArray(
        stamp_ns=reader.time_ns(),
        frame_id=reader.string(),
        status=reader.sequence(lambda: _diagnostic_status(reader)),
    )


def _string(reader: CdrReader) -> String:
    return String(reader.string())


_DECODERS: dict[str, Callable[[CdrReader], Message]] = {
    'sensor_msgs/msg/JointState': _joint_state,
    'rcl_interfaces/msg/ParameterEvent': _parameter_event,
    'diagnostic_msgs/msg/DiagnosticArray': _diagnostic_array,
    'std_msgs/msg/String': _string,
}

#: Types that `decode` knows.
DECODABLE = tuple(_DECODERS)


def decode(interface: str, content: bytes) -> Message:
    """Decode a message."""
    try:
        decoder = _DECODERS[interface]
    except KeyError:
        known = ', '.join(DECODABLE)
        raise CdrError(f'messages of type {interface!r} are not decoded; only {known}') from None
    try:
        return decoder(CdrReader(content))
    except (struct.error, UnicodeDecodeError, OverflowError) as error:
        raise CdrError(f'it is no {interface}: {error}') from error


class JointStateDecoder:
    """
    Decodes the joint states of one topic, several times faster than `decode`.

    The messages of a topic differ in stamp and values, hardly ever in names: what lies between is
    compared as bytes, and the rest unpacked at one go.
    """

    def __init__(self) -> None:
        self._last: JointState | None = None
        self._size = -1
        self._tail = 12
        self._between = b''
        self._values = struct.Struct('')
        self._counts = (0, 0, 0)

    def decode(self, content: bytes) -> JointState:
        """Decode a message; as `decode` does for this type."""
        last = self._last
        if (
            last is not None
            and len(content) == self._size
            and content[:4] == b'\x00\x01\x00\x00'
            and content[12 : self._tail] == self._between
        ):
            seconds, nanoseconds, *values = self._values.unpack_from(content, 4)
            positions, velocities, _ = self._counts
            second = positions + 1
            third = second + velocities + 1
            if (values[0], values[second], values[third]) == self._counts:
                return JointState(
                    seconds * 10**9 + nanoseconds,
                    last.frame_id,
                    last.name,
                    tuple(values[1:second]),
                    tuple(values[second + 1 : third]),
                    tuple(values[third + 1 :]),
                )
        state = decode('sensor_msgs/msg/JointState', content)
        assert isinstance(state, JointState)
        self._learn(state, content)
        return state

    def _learn(self, state: JointState, content: bytes) -> None:
        reader = CdrReader(content)
        reader.time_ns()
        reader.string()
        reader.sequence(reader.string)
        self._tail = reader.position + (-reader.position) % 4
        self._last = state
        self._size = len(content)
        self._between = content[12 : self._tail]
        self._counts = (len(state.position), len(state.velocity), len(state.effort))
        layout = f'<iI{self._tail - 12}x'
        at = self._tail
        for count in self._counts:
            layout += 'I'
            at += 4
            if count:
                padding = (4 - at) % 8
                layout += f'{padding}x{count}d'
                at += padding + 8 * count
            padding = (-at) % 4
            layout += f'{padding}x'
        self._values = struct.Struct(layout)
