"""
The recorded messages as typed Python objects, and their encoding in CDR: one codec per type.

Plain CDR (XCDR version 1), as of DDS-XTypes 1.3, section 7.4.3: four bytes that name the
encoding, then the fields, each aligned to its own size counted from there. Everything here works
without ROS, and the bytes are those of the middleware with zeros for padding.

Stamps are integers of nanoseconds; a header is flattened into `stamp_ns` and `frame_id`.

The messages of a topic of joint states differ in stamp and numbers only, so that the rest is
written, compared and read at once: see `JointStateLayout`. Only the columns need numpy.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self, TypeVar

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


JOINT_STATE = 'sensor_msgs/msg/JointState'
STRING = 'std_msgs/msg/String'
PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'
DIAGNOSTIC_ARRAY = 'diagnostic_msgs/msg/DiagnosticArray'

T = TypeVar('T')

_LITTLE_ENDIAN = {b'\x00\x01': '<', b'\x00\x00': '>'}


class CdrError(ValueError):
    """The bytes are not a message of the expected type."""


class CdrReader:
    """
    Reads the fields of a message with its encapsulation header one after the other.

    Raises `CdrError` if the encapsulation is not plain CDR.
    """

    def __init__(self, content: bytes) -> None:
        try:
            self._order = _LITTLE_ENDIAN[bytes(content[:2])]
        except KeyError:
            raise CdrError(f'encapsulation {content[:2].hex()!r} is not plain CDR') from None
        self._content = content
        self.position = 4

    def _take(self, count: int, letter: str) -> tuple[Any, ...]:
        if not count:
            return ()
        size = struct.calcsize(f'<{letter}')
        start = self.position + (4 - self.position) % size
        if start + count * size > len(self._content):
            raise CdrError(f'the message ends at byte {len(self._content)}, in a field')
        self.position = start + count * size
        return struct.unpack_from(f'{self._order}{count}{letter}', self._content, start)

    def number(self, letter: str) -> Any:
        """Read a number of a type, named as `struct` does."""
        return self._take(1, letter)[0]

    def numbers(self, letter: str) -> tuple[Any, ...]:
        """Read a sequence of numbers of one type."""
        return self._take(self.number('I'), letter)

    def octets(self) -> bytes:
        """Read a sequence of bytes."""
        length = self.number('I')
        end = self.position + length
        if end > len(self._content):
            raise CdrError(f'the message ends at byte {len(self._content)}, in a field')
        start, self.position = self.position, end
        return bytes(self._content[start:end])

    def string(self) -> str:
        """Read a string; its length counts the zero at its end."""
        return self.octets().removesuffix(b'\x00').decode()

    def sequence(self, element: Callable[[], T]) -> tuple[T, ...]:
        """Read a sequence of what `element` reads."""
        count = self.number('I')
        if count > len(self._content):
            raise CdrError(f'a sequence of {count} cannot be in {len(self._content)} bytes')
        return tuple(element() for _ in range(count))

    def time_ns(self) -> int:
        """Read a builtin_interfaces/Time, in nanoseconds."""
        seconds, nanoseconds = self.number('i'), self.number('I')
        return int(seconds) * 10**9 + int(nanoseconds)


class CdrWriter:
    """Appends the fields of a message, little-endian, with zeros as padding."""

    def __init__(self) -> None:
        #: The message so far, with its encapsulation header
        self.content = bytearray(b'\x00\x01\x00\x00')

    def put(self, letter: str, *values: float) -> CdrWriter:
        """Append numbers of one type, named as `struct` does."""
        if values:
            size = struct.calcsize(f'<{letter}')
            self.content += bytes((4 - len(self.content)) % size)
            self.content += struct.pack(f'<{len(values)}{letter}', *values)
        return self

    def sequence(self, letter: str, values: Sequence[float]) -> CdrWriter:
        """Append a sequence of numbers of one type."""
        return self.put('I', len(values)).put(letter, *values)

    def octets(self, content: bytes) -> CdrWriter:
        """Append a sequence of bytes."""
        self.put('I', len(content))
        self.content += content
        return self

    def string(self, text: str) -> CdrWriter:
        """Append a string; its length counts the zero at its end."""
        return self.octets(text.encode() + b'\x00')

    def strings(self, texts: Sequence[str]) -> CdrWriter:
        """Append a sequence of strings."""
        self.put('I', len(texts))
        for text in texts:
            self.string(text)
        return self

    def time_ns(self, stamp_ns: int) -> CdrWriter:
        """Append a builtin_interfaces/Time."""
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
    """std_msgs/msg/String: a snapshot of the rig in JSON, or its robot description."""

    data: str


Message = JointState | ParameterEvent | DiagnosticArray | String


def _parameter(reader: CdrReader) -> Parameter:
    name = reader.string()
    kind = reader.number('B')
    # In the order of the type's numbers; all are in the message, the number selects one.
    values: tuple[ParameterContent, ...] = (
        None,
        *(reader.number('?'), reader.number('q'), reader.number('d')),
        *(reader.string(), reader.octets()),
        *(reader.numbers('?'), reader.numbers('q'), reader.numbers('d')),
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
        level=reader.number('B'),
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


_DECODERS: dict[str, Callable[[bytes], Message]] = {
    JOINT_STATE: lambda content: JointStateDecoder().decode(content),
    PARAMETER_EVENT: lambda content: _parameter_event(CdrReader(content)),
    DIAGNOSTIC_ARRAY: lambda content: _diagnostic_array(CdrReader(content)),
    STRING: lambda content: String(CdrReader(content).string()),
}

#: Types that `decode` knows.
DECODABLE = tuple(_DECODERS)


def decode(interface: str, content: bytes) -> Message:
    """Decode a message of a type, such as ``'std_msgs/msg/String'``."""
    try:
        decoder = _DECODERS[interface]
    except KeyError:
        known = ', '.join(DECODABLE)
        raise CdrError(f'messages of type {interface!r} are not decoded; only {known}') from None
    try:
        return decoder(content)
    except (struct.error, UnicodeDecodeError, OverflowError) as error:
        raise CdrError(f'it is no {interface}: {error}') from error


def encode(message: Message) -> bytes:
    """Encode a message; equal messages become equal bytes."""
    writer = CdrWriter()
    if isinstance(message, String):
        writer.string(message.data)
    elif isinstance(message, JointState):
        writer.time_ns(message.stamp_ns).string(message.frame_id).strings(message.name)
        for numbers in (message.position, message.velocity, message.effort):
            writer.sequence('d', numbers)
    elif isinstance(message, ParameterEvent):
        writer.time_ns(message.stamp_ns).string(message.node)
        for parameters in (
            message.new_parameters,
            message.changed_parameters,
            message.deleted_parameters,
        ):
            writer.put('I', len(parameters))
            for parameter in parameters:
                _put_parameter(writer, parameter)
    else:
        writer.time_ns(message.stamp_ns).string(message.frame_id).put('I', len(message.status))
        for status in message.status:
            writer.put('B', status.level).string(status.name).string(status.message)
            writer.string(status.hardware_id).put('I', len(status.values))
            for pair in status.values:
                writer.string(pair[0]).string(pair[1])
    return bytes(writer.content)


def _parameter_type(value: ParameterContent) -> int:
    """Return the number of a value's type, as of rcl_interfaces/ParameterType."""
    for number, kind in enumerate((type(None), bool, int, float, str, bytes)):
        if isinstance(value, kind):
            return number
    assert isinstance(value, tuple)
    for number, kind in ((6, bool), (7, int), (9, str)):
        if value and all(isinstance(entry, kind) for entry in value):
            return number
    return 8


def _put_parameter(writer: CdrWriter, parameter: Parameter) -> None:
    value: Any = parameter.value
    given = _parameter_type(value)
    # A value of every type is in the message.
    blank: list[Any] = [None, False, 0, 0.0, '', b'', (), (), (), ()]
    blank[given] = value
    writer.string(parameter.name).put('B', given)
    writer.put('?', blank[1]).put('q', blank[2]).put('d', blank[3]).string(blank[4])
    writer.octets(blank[5]).sequence('?', blank[6]).sequence('q', blank[7])
    writer.sequence('d', blank[8]).strings(blank[9])


# Messages that begin with their stamp

#: A message begins after the four bytes that name the encoding; alignment counts from there.
_STAMP_AT = 4
_STAMP_END = 12
_LITTLE = struct.Struct('<iI')
_BIG = struct.Struct('>iI')
_NS_PER_S = 10**9


def header_ns(content: bytes) -> int:
    """Return the stamp of a message that begins with it, ns; `CdrError` if it is too short."""
    if len(content) < _STAMP_END:
        raise CdrError(f'the message ends at byte {len(content)}, in its header')
    layout = _LITTLE if content[1] == 1 else _BIG
    seconds, nanoseconds = layout.unpack_from(content, _STAMP_AT)
    return int(seconds) * _NS_PER_S + int(nanoseconds)


def restamped(content: bytes, stamp_ns: int) -> bytes:
    """Return an encoded message that begins with its stamp with another stamp."""
    return content[:_STAMP_AT] + _LITTLE.pack(*divmod(stamp_ns, _NS_PER_S)) + content[_STAMP_END:]


def clock_message(stamp_ns: int) -> bytes:
    """Return a rosgraph_msgs/Clock."""
    return b'\x00\x01\x00\x00' + _LITTLE.pack(*divmod(stamp_ns, _NS_PER_S))


class JointStateLayout:
    """
    The layout of a sensor_msgs/JointState: all of it but the stamp and the numbers.

    It is read from a message in CDR; `CdrError` if that is no JointState.
    """

    def __init__(self, content: bytes) -> None:
        reader = CdrReader(content)
        order = '<' if content[1] == 1 else '>'
        # Where positions, velocities and efforts are, and how they are stored
        self._places: list[tuple[int, struct.Struct]] = []
        # Begin and end of everything that stays the same
        fixed = [(0, _STAMP_AT)]
        end = _STAMP_END
        try:
            reader.time_ns()
            self.frame_id = reader.string()
            self.names = reader.sequence(reader.string)
            for _ in range(3):
                count = len(reader.numbers('d'))
                at = reader.position - 8 * count
                self._places.append((at, struct.Struct(f'{order}{count}d')))
                fixed.append((end, at))
                end = reader.position
        except UnicodeDecodeError as error:
            raise CdrError(f'it is no {JOINT_STATE}: {error}') from error
        fixed.append((end, len(content)))
        #: How many positions, velocities and efforts there are
        self.counts = tuple(place.size // 8 for _, place in self._places)
        self.size = len(content)
        self._fixed = [(start, stop, content[start:stop]) for start, stop in fixed]
        self._stamp = _LITTLE if order == '<' else _BIG
        self._parts = tuple(same for _, _, same in self._fixed)
        sizes = [len(part) for part in self._parts]
        numbers = [f'{count}d{size}s' for count, size in zip(self.counts, sizes[2:], strict=True)]
        whole = struct.Struct(f'{order}{sizes[0]}siI{sizes[1]}s{"".join(numbers)}')
        self._pack = whole.pack
        self._no_efforts = (0.0,) * self.counts[2]

    @classmethod
    def of(cls, frame_id: str, names: Sequence[str], *counts: int) -> Self:
        """Return a layout with given numbers of positions, velocities and efforts."""
        zeros = [(0.0,) * count for count in counts]
        return cls(encode(JointState(0, frame_id, tuple(names), *zeros)))

    def filled(
        self,
        stamp_ns: int,
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float] | None = None,
    ) -> bytes:
        """Return a message of this layout; efforts that are not given are 0."""
        head, names, after_positions, after_velocities, after_efforts = self._parts
        # In one go: this is what a rig sends at every tick.
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

    def fits(self, content: bytes) -> bool:
        """Return whether a message has this layout."""
        return len(content) == self.size and all(
            content[start:stop] == same for start, stop, same in self._fixed
        )

    def numbers(self, content: bytes) -> tuple[tuple[float, ...], ...]:
        """Return positions, velocities and efforts of a message that fits."""
        return tuple(place.unpack_from(content, at) for at, place in self._places)

    def fitting(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of many messages of this size, one per row, fit."""
        import numpy as np

        fits = np.ones(len(rows), dtype=np.bool_)
        for start, stop, same in self._fixed:
            if stop > start:
                fits &= (rows[:, start:stop] == np.frombuffer(same, np.uint8)).all(axis=1)
        return fits

    def columns(self, rows: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the stamps, in ns, and all numbers of messages (one per row) that fit."""
        import numpy as np

        order = self._stamp.format[0]
        stamp = np.ascontiguousarray(rows[:, _STAMP_AT:_STAMP_END])
        seconds = stamp[:, :4].copy().view(f'{order}i4')[:, 0].astype(np.int64)
        rest = stamp[:, 4:].copy().view(f'{order}u4')[:, 0].astype(np.int64)
        parts = [
            np.ascontiguousarray(rows[:, at : at + place.size]).view(f'{order}f8')
            for at, place in self._places
            if place.size
        ]
        numbers = np.concatenate(parts, axis=1).astype(np.float64)
        return seconds * _NS_PER_S + rest, numbers


class JointStateDecoder:
    """Decodes the joint states of one topic."""

    def __init__(self) -> None:
        self._layout: JointStateLayout | None = None

    def decode(self, content: bytes) -> JointState:
        """Decode a message."""
        layout = self._layout
        if layout is None or not layout.fits(content):
            layout = self._layout = JointStateLayout(content)
        numbers = layout.numbers(content)
        return JointState(header_ns(content), layout.frame_id, layout.names, *numbers)


#: Layouts that are remembered for a topic.
_MOST_LAYOUTS = 8


@dataclass(frozen=True)
class JointStateTable:
    """Joint states, impacts or acts of the gap control as columns, one message per row."""

    stamps_ns: NDArray[np.int64]  # stamps of the headers, shape (n,)
    numbers: NDArray[np.float64]  # positions, velocities and efforts, shape (n, k)
    frames: NDArray[np.int64]  # index of each frame among `JointStateColumns.frames`, shape (n,)
    #: Index of each message that could not be read, which has no row, and why.
    unreadable: tuple[tuple[int, str], ...]


class JointStateColumns:
    """
    Reads the joint states of one topic.

    The messages must have one of the lists of joints; several, if there are messages of several
    formats. Of the positions, velocities and efforts the first `counts` are read.
    """

    def __init__(self, joints: Sequence[tuple[str, ...]], counts: tuple[int, int, int]) -> None:
        #: Those met so far
        self.frames: list[str] = []
        self._joints, self._counts = joints, counts
        self._layouts: list[JointStateLayout] = []

    def _layout(self, content: bytes) -> JointStateLayout:
        layout = JointStateLayout(content)
        whole = layout.counts[:2] == (len(layout.names),) * 2
        if layout.names not in self._joints or not whole or layout.counts[2] < self._counts[2]:
            held = ', '.join(layout.names) or 'none'
            raise CdrError(f'its joints are {held}, not {", ".join(self._joints[0])}')
        if layout.frame_id not in self.frames:
            self.frames.append(layout.frame_id)
        # The oldest are the commonest
        self._layouts = [*self._layouts[: _MOST_LAYOUTS - 1], layout]
        return layout

    def _places(self, layout: JointStateLayout) -> list[int]:
        """Return where the numbers that are read are among those of a layout."""
        begins = (0, layout.counts[0], sum(layout.counts[:2]))
        pairs = zip(begins, self._counts, strict=True)
        return [begin + i for begin, count in pairs for i in range(count)]

    def read(self, contents: Sequence[bytes]) -> JointStateTable:
        """Return messages as a table, which names those that cannot be read."""
        import numpy as np

        stamps = np.zeros(len(contents), dtype=np.int64)
        numbers = np.zeros((len(contents), sum(self._counts)))
        frames = np.zeros(len(contents), dtype=np.int64)
        sizes = np.fromiter(map(len, contents), dtype=np.int64, count=len(contents))
        unreadable: list[tuple[int, str]] = []
        for size in np.unique(sizes):
            left = np.flatnonzero(sizes == size)
            block = np.frombuffer(b''.join(contents[int(i)] for i in left), dtype=np.uint8)
            rows = block.reshape(len(left), int(size))
            layouts = [layout for layout in self._layouts if layout.size == size]
            while len(left):
                if not layouts:
                    first = int(left[0])
                    try:
                        layouts.append(self._layout(contents[first]))
                    except CdrError as error:
                        unreadable.append((first, str(error)))
                        left, rows = left[1:], rows[1:]
                        continue
                layout = layouts.pop(0)
                fits = layout.fitting(rows)
                at = left[fits]
                stamps[at], values = layout.columns(rows[fits])
                numbers[at] = values[:, self._places(layout)]
                frames[at] = self.frames.index(layout.frame_id)
                left, rows = left[~fits], rows[~fits]
        bad = np.zeros(len(contents), dtype=np.bool_)
        bad[[index for index, _ in unreadable]] = True
        return JointStateTable(
            stamps[~bad], numbers[~bad], frames[~bad], tuple(sorted(unreadable))
        )
