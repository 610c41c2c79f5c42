# SPDX-License-Identifier: Apache-2.0
"""
The recorded messages as typed Python objects, and their encoding in CDR.

Plain CDR (XCDR version 1), as of DDS-XTypes 1.3, section 7.4.3, little-endian as on all machines
of ROS 2: four bytes that name the encoding, then the fields, each aligned to its own size counted
from there. The module works without ROS, and writes the bytes of the middleware, with zeros for
padding. `_FIELDS` lists the fields of each type; reading and writing follow it.

Stamps are integers of nanoseconds; a header is flattened into `stamp_ns` and `frame_id`.

The messages of a topic of joint states differ in stamp and numbers only, so that all other bytes
are written, compared and read at once: see `JointStateLayout`. Only the columns need numpy.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, cast

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

JOINT_STATE = 'sensor_msgs/msg/JointState'
STRING = 'std_msgs/msg/String'
PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'


#: First bytes of a message in plain CDR.
_PLAIN = b'\x00\x01\x00\x00'


class CdrError(ValueError):
    """The bytes are not a message of the expected type."""


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
    """diagnostic_msgs/msg/DiagnosticArray: the states of the components."""

    stamp_ns: int
    frame_id: str
    status: tuple[DiagnosticStatus, ...]


@dataclass(frozen=True, slots=True)
class String:
    """std_msgs/msg/String: a snapshot of the rig in JSON, or its robot description."""

    data: str


Message = JointState | ParameterEvent | DiagnosticArray | String

_TYPES: dict[str, type[Message]] = {
    JOINT_STATE: JointState,
    PARAMETER_EVENT: ParameterEvent,
    DIAGNOSTIC_ARRAY: DiagnosticArray,
    STRING: String,
}

#: Kind of a field: a number, by its letter of `struct`; 'time', 'string' or 'octets'; a type; a
#: tuple of these; or a list with one of these, for a sequence.
_Kind = Any
_FIELDS: dict[type, tuple[_Kind, ...]] = {
    JointState: ('time', 'string', ['string'], ['d'], ['d'], ['d']),
    ParameterEvent: ('time', 'string', [Parameter], [Parameter], [Parameter]),
    DiagnosticStatus: ('B', 'string', 'string', 'string', [('string', 'string')]),
    DiagnosticArray: ('time', 'string', [DiagnosticStatus]),
    String: ('string',),
}
#: Values of a parameter of each type but 'not set', in the order of rcl_interfaces/ParameterType:
#: the message has all of them, and the number of the type selects one.
_VALUES: tuple[_Kind, ...] = ('?', 'q', 'd', 'string', 'octets', ['?'], ['q'], ['d'], ['string'])
_NO_VALUES = (False, 0, 0.0, '', b'', (), (), (), ())


class CdrReader:
    """
    Reads the fields of a message with its encapsulation header one after the other.

    Raises `CdrError` if the encapsulation is not plain CDR.
    """

    def __init__(self, content: bytes) -> None:
        if content[:2] != _PLAIN[:2]:
            raise CdrError(f'encapsulation {content[:2].hex()!r} is not plain CDR')
        self._content = content
        self.position = 4

    def _pass(self, length: int, alignment: int) -> int:
        """Move past a field and return the position where it begins."""
        start = self.position + (4 - self.position) % alignment
        if start + length > len(self._content):
            raise CdrError(f'the message ends at byte {len(self._content)}, in a field')
        self.position = start + length
        return start

    def _numbers(self, count: int, letter: str) -> tuple[Any, ...]:
        size = struct.calcsize(f'<{letter}')
        start = self._pass(count * size, size if count else 1)
        return struct.unpack_from(f'<{count}{letter}', self._content, start)

    def read(self, kind: _Kind) -> Any:
        """Read a field."""
        if kind is Parameter:
            return self._parameter()
        if isinstance(kind, type):
            return kind(*self.read(_FIELDS[kind]))
        if isinstance(kind, tuple):
            return tuple(map(self.read, kind))
        if isinstance(kind, list):
            return self._sequence(kind[0])
        if kind == 'time':
            seconds, nanoseconds = self.read(('i', 'I'))
            return seconds * _NS_PER_S + nanoseconds
        if kind in ('octets', 'string'):
            length = self.read('I')
            start = self._pass(length, 1)
            octets = bytes(self._content[start : self.position])
            return octets if kind == 'octets' else octets.removesuffix(b'\x00').decode()
        return self._numbers(1, kind)[0]

    def _sequence(self, element: _Kind) -> tuple[Any, ...]:
        count = self.read('I')
        if count > len(self._content):
            raise CdrError(f'a sequence of {count} cannot be in {len(self._content)} bytes')
        if isinstance(element, str) and len(element) == 1:
            return self._numbers(count, element)
        return tuple(self.read(element) for _ in range(count))

    def _parameter(self) -> Parameter:
        name, kind, values = self.read(('string', 'B', _VALUES))
        if kind > len(values):
            raise CdrError(f'parameter {name!r} has the unknown type {kind}')
        return Parameter(name, values[kind - 1] if kind else None)


class CdrWriter:
    """Appends the fields of a message, little-endian, with zeros as padding."""

    def __init__(self) -> None:
        #: The message so far, with its encapsulation header
        self.content = bytearray(_PLAIN)

    def _numbers(self, letter: str, values: Sequence[float]) -> None:
        if values:
            size = struct.calcsize(f'<{letter}')
            self.content += bytes((4 - len(self.content)) % size)
            self.content += struct.pack(f'<{len(values)}{letter}', *values)

    def write(self, kind: _Kind, value: Any) -> CdrWriter:
        """Append a field."""
        if kind is Parameter:
            self._parameter(value)
        elif isinstance(kind, type):
            names = [field.name for field in fields(kind)]
            self.write(_FIELDS[kind], [getattr(value, name) for name in names])
        elif isinstance(kind, tuple):
            for part, entry in zip(kind, value, strict=True):
                self.write(part, entry)
        elif isinstance(kind, list):
            self.write('I', len(value))
            if isinstance(kind[0], str) and len(kind[0]) == 1:
                self._numbers(kind[0], value)
            else:
                for entry in value:
                    self.write(kind[0], entry)
        elif kind == 'time':
            self.write(('i', 'I'), divmod(value, _NS_PER_S))
        elif kind in ('octets', 'string'):
            octets = value if kind == 'octets' else value.encode() + b'\x00'
            self.write('I', len(octets))
            self.content += octets
        else:
            self._numbers(kind, (value,))
        return self

    def _parameter(self, parameter: Parameter) -> None:
        number, values = _parameter_type(parameter.value), list(_NO_VALUES)
        if number:
            values[number - 1] = cast('Any', parameter.value)
        self.write(('string', 'B', _VALUES), (parameter.name, number, values))


def _parameter_type(value: ParameterContent) -> int:
    """Return the number of a value's type, as of rcl_interfaces/ParameterType."""
    for number, kind in enumerate((type(None), bool, int, float, str, bytes)):
        if isinstance(value, kind):
            return number
    entries = cast('tuple[object, ...]', value)
    for number, kind in ((6, bool), (7, int), (9, str)):
        if entries and all(isinstance(entry, kind) for entry in entries):
            return number
    return 8


def decode(interface: str, content: bytes) -> Message:
    """Decode a message of a type, such as ``'std_msgs/msg/String'``."""
    if interface not in _TYPES:
        known = ', '.join(_TYPES)
        raise CdrError(f'messages of type {interface!r} are not decoded; only {known}')
    try:
        return cast('Message', CdrReader(content).read(_TYPES[interface]))
    except (struct.error, UnicodeDecodeError, OverflowError) as error:
        raise CdrError(f'it is no {interface}: {error}') from error


def encode(message: Message) -> bytes:
    """Encode a message; equal messages become equal bytes."""
    return bytes(CdrWriter().write(type(message), message).content)


# Messages that begin with their stamp

#: A message begins after the four bytes that name the encoding; alignment counts from there.
_STAMP_AT = 4
_STAMP_END = 12
_STAMP = struct.Struct('<iI')
_NS_PER_S = 10**9


def header_ns(content: bytes) -> int:
    """Return the stamp of a message that begins with it, ns; `CdrError` if it is too short."""
    if len(content) < _STAMP_END:
        raise CdrError(f'the message ends at byte {len(content)}, in its header')
    seconds, nanoseconds = _STAMP.unpack_from(content, _STAMP_AT)
    return int(seconds) * _NS_PER_S + int(nanoseconds)


def with_stamp(content: bytes, stamp_ns: int) -> bytes:
    """Return an encoded message, which begins with its stamp, with another stamp."""
    return content[:_STAMP_AT] + _STAMP.pack(*divmod(stamp_ns, _NS_PER_S)) + content[_STAMP_END:]


def clock_message(stamp_ns: int) -> bytes:
    """Return a rosgraph_msgs/Clock."""
    return _PLAIN + _STAMP.pack(*divmod(stamp_ns, _NS_PER_S))


def message_row(numbers: int) -> np.dtype[np.void]:
    """Return the dtype of joint states with `numbers` positions, velocities and efforts in all."""
    import numpy as np

    return np.dtype(
        [
            ('place', np.int64),  # place in the recording, if the reader gives one
            ('stamp_ns', np.int64),  # stamp in the message
            ('frame', 'U16'),  # the stop of an impact, an act, or a state that is no sample
            ('numbers', np.float64, (numbers,)),
        ]
    )


class JointStateLayout:
    """
    The layout of a sensor_msgs/JointState: all its bytes but the stamp and the numbers.

    It is read from a message in CDR; a message that is no JointState raises `CdrError`.
    """

    def __init__(self, content: bytes) -> None:
        reader = CdrReader(content)
        counts, ends = [], []
        try:
            _, self.frame_id, self.names = reader.read(('time', 'string', ['string']))
            for _ in range(3):
                counts.append(len(reader.read(['d'])))
                ends.append(reader.position)
        except UnicodeDecodeError as error:
            raise CdrError(f'it is no {JOINT_STATE}: {error}') from error
        #: Numbers of positions, velocities and efforts
        self.counts = tuple(counts)
        self.size = len(content)
        begins = [end - 8 * count for end, count in zip(ends, counts, strict=True)]
        # The bytes that are the same in each message, between the stamp and the numbers
        same = zip([_STAMP_END, *ends], [*begins, len(content)], strict=True)
        self._same = [content[:_STAMP_AT], *(content[begin:end] for begin, end in same)]
        sizes = [f'{len(part)}s' for part in self._same]
        numbers = ''.join(f'{n}d{size}' for n, size in zip(counts, sizes[2:], strict=True))
        self._pack = struct.Struct(f'<{sizes[0]}iI{sizes[1]}{numbers}').pack
        self._no_efforts = (0.0,) * counts[2]
        self._content, self._begins, self._ends = content, begins, ends

    @classmethod
    def of(cls, frame_id: str, names: Sequence[str], *counts: int) -> Self:
        """Return a layout with given numbers of positions, velocities and efforts."""
        zeros = [(0.0,) * count for count in counts]
        return cls(encode(JointState(0, frame_id, tuple(names), *zeros)))

    def fill(
        self,
        stamp_ns: int,
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float] | None = None,
    ) -> bytes:
        """Return a message of this layout; efforts that are not given are 0."""
        head, names, after_positions, after_velocities, after_efforts = self._same
        # All at once: a rig sends this message at every tick.
        seconds, nanoseconds = divmod(stamp_ns, _NS_PER_S)
        return self._pack(
            head,
            seconds,
            nanoseconds,
            names,
            *positions,
            after_positions,
            *velocities,
            after_velocities,
            *(self._no_efforts if efforts is None else efforts),
            after_efforts,
        )

    @cached_property
    def _dtype(self) -> np.dtype[np.void]:
        """The dtype of a message."""
        import numpy as np

        names = ('seconds', 'rest', 'position', 'velocity', 'effort')
        formats = ['<i4', '<u4', *(f'{n}<f8' for n in self.counts)]
        offsets = [_STAMP_AT, _STAMP_AT + 4, *self._begins]
        return np.dtype(
            {'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': self.size}
        )

    def fitting(self, contents: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of many messages of this size, one per row, have this layout."""
        import numpy as np

        fits = np.ones(len(contents), dtype=np.bool_)
        for begin, same in zip([0, _STAMP_END, *self._ends], self._same, strict=True):
            there = contents[:, begin : begin + len(same)]
            fits &= (there == np.frombuffer(same, np.uint8)).all(axis=1)
        return fits

    def stamps(self, contents: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the stamps of such messages, ns."""
        held = contents.view(self._dtype)[:, 0]
        stamps: NDArray[np.int64] = held['seconds'].astype('i8') * _NS_PER_S + held['rest']
        return stamps

    def numbers(self, contents: NDArray[np.uint8], counts: Sequence[int]) -> NDArray[np.float64]:
        """Return the first positions, velocities and efforts of such messages."""
        import numpy as np

        held = contents.view(self._dtype)[:, 0]
        names = ('position', 'velocity', 'effort')
        parts = [held[name][:, :n] for name, n in zip(names, counts, strict=True)]
        return np.concatenate(parts, axis=1)


#: Layouts that are remembered for a topic.
_MOST_LAYOUTS = 8


class JointStateRows:
    """Reads the joint states of one topic: the first `counts` numbers of each kind, by joints."""

    def __init__(self, joints: tuple[str, ...], counts: tuple[int, int, int]) -> None:
        self._joints, self._counts = joints, counts
        self._layouts: list[JointStateLayout] = []

    def _layout(self, content: bytes) -> JointStateLayout:
        layout = JointStateLayout(content)
        whole = layout.counts[:2] == (len(layout.names),) * 2
        few = any(n < needed for n, needed in zip(layout.counts, self._counts, strict=True))
        if layout.names != self._joints or not whole or few:
            held = ', '.join(layout.names) or 'none'
            raise CdrError(f'its joints are {held}, not {", ".join(self._joints)}')
        # The oldest layouts are the most common.
        self._layouts = [*self._layouts[: _MOST_LAYOUTS - 1], layout]
        return layout

    def read(
        self, contents: Sequence[bytes], places: Sequence[int] | int = 0
    ) -> tuple[NDArray[np.void], NDArray[np.bool_]]:
        """Return messages as `message_row`, and a mask of those that can be read."""
        import numpy as np

        found = np.zeros(len(contents), message_row(sum(self._counts)))
        found['place'] = places
        readable = np.ones(len(contents), dtype=np.bool_)
        sizes = np.fromiter(map(len, contents), dtype=np.int64, count=len(contents))
        for size in np.unique(sizes).tolist():
            left = np.flatnonzero(sizes == size)
            block = np.frombuffer(b''.join(contents[i] for i in left.tolist()), dtype=np.uint8)
            rows = block.reshape(len(left), size)
            known = [layout for layout in self._layouts if layout.size == size]
            while len(left):
                first = int(left[0])
                try:
                    layout = known.pop(0) if known else self._layout(contents[first])
                except CdrError:
                    readable[first] = False
                    left, rows = left[1:], rows[1:]
                    continue
                fits = layout.fitting(rows)
                at, there = left[fits], rows[fits]
                found['stamp_ns'][at] = layout.stamps(there)
                found['frame'][at] = layout.frame_id
                found['numbers'][at] = layout.numbers(there, self._counts)
                left, rows = left[~fits], rows[~fits]
        return found, readable
