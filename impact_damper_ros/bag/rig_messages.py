"""
The messages of a rig as bytes and as arrays, without ROS: bit for bit those of the node.

The messages of a topic differ in stamp and numbers only. So one of them serves as a template: with
stamp and numbers overwritten it must equal the recorded message, to the last bit (a zero that has
changed its sign is a difference, too).

The messages of a topic have the same shape but for stamp and numbers. So they are laid out as the
rows of one array of bytes, compared with the shape, and read column by column.

The shapes of joint states and impacts never change, so that each is written out once and then only
filled in.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.control import CONTROL_JOINTS, Action, ControlRecord
from impact_damper_ros.rig import Event, Sample
from impact_damper_ros.rig.published import (
    IMPACT_JOINTS,
    JOINTS,
    PAUSED_FRAME,
    impact_numbers,
    snapshot_text,
    state_numbers,
)

from .messages import CdrError, CdrReader, CdrWriter

__all__ = [
    'IMPACT_JOINTS',
    'JOINTS',
    'JointStateBytes',
    'JointStateColumns',
    'JointStateTable',
    'RigMessages',
    'header_ns',
    'is_paused',
    'parameter_event',
    'snapshot_message',
]


_LITTLE = struct.Struct('<iI')
_BIG = struct.Struct('>iI')
_STAMP_AT = 4
_STAMP_END = 12


def header_ns(content: bytes) -> int:
    """
    Return the stamp of a message that begins with a header, in nanoseconds.

    Raises
    ------
    CdrError
        If it is too short to have one.
    """
    if len(content) < _STAMP_END:
        raise CdrError(f'the message ends at byte {len(content)}, in its header')
    layout = _LITTLE if content[1] == 1 else _BIG
    seconds, nanoseconds = layout.unpack_from(content, _STAMP_AT)
    return int(seconds) * 10**9 + int(nanoseconds)


_PAUSED = PAUSED_FRAME.encode() + b'\0'
_PAUSED_AT = slice(_STAMP_END, _STAMP_END + 4 + len(_PAUSED))
_PAUSED_FRAMES = tuple(len(_PAUSED).to_bytes(4, order) + _PAUSED for order in ('little', 'big'))


def is_paused(content: bytes) -> bool:
    """Return whether these joint states only repeat, of a rig that is held, where it stands."""
    return content[_PAUSED_AT] in _PAUSED_FRAMES


class JointStateBytes:
    """
    The shape of a sensor_msgs/JointState: all of it but the stamp and the numbers.

    Parameters
    ----------
    content : bytes
        A message of that shape, in CDR.

    Attributes
    ----------
    frame_id : str
        Frame of the header.
    names : tuple of str
        The joints.

    Raises
    ------
    CdrError
        If it is no JointState.
    """

    def __init__(self, content: bytes) -> None:
        reader = CdrReader(content)
        order = '<' if content[1] == 1 else '>'
        #: Where positions, velocities and efforts stand, and how.
        self._places: list[tuple[int, struct.Struct]] = []
        #: Everything between stamp and numbers.
        fixed = [(0, _STAMP_AT)]
        end = _STAMP_END
        try:
            reader.time_ns()
            self.frame_id = reader.string()
            self.names = reader.sequence(reader.string)
            for _ in range(3):
                count = len(reader.float64s())
                at = reader.position - 8 * count
                self._places.append((at, struct.Struct(f'{order}{count}d')))
                fixed.append((end, at))
                end = reader.position
        except UnicodeDecodeError as error:
            raise CdrError(f'it is no sensor_msgs/msg/JointState: {error}') from error
        fixed.append((end, len(content)))
        self._fixed = [(start, stop, content[start:stop]) for start, stop in fixed]
        self._stamp = _LITTLE if order == '<' else _BIG
        self._buffer = bytearray(content)

    @property
    def counts(self) -> tuple[int, ...]:
        """How many positions, velocities and efforts there are."""
        return tuple(layout.size // 8 for _, layout in self._places)

    @property
    def size(self) -> int:
        """Length of a message of this shape, in bytes."""
        return len(self._buffer)

    def fitting(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of many messages of this size, one per row, have this shape."""
        fits = np.ones(len(rows), dtype=np.bool_)
        for start, stop, same in self._fixed:
            if stop > start:
                fits &= (rows[:, start:stop] == np.frombuffer(same, np.uint8)).all(axis=1)
        return fits

    def columns(self, rows: NDArray[np.uint8]) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """
        Return the stamps, in ns, and all numbers of messages that fit, one per row.

        Parameters
        ----------
        rows : ndarray of uint8, shape (n, size)
            The messages.
        """
        order = self._stamp.format[0]
        stamp = np.ascontiguousarray(rows[:, _STAMP_AT:_STAMP_END])
        seconds = stamp[:, :4].copy().view(f'{order}i4')[:, 0].astype(np.int64)
        rest = stamp[:, 4:].copy().view(f'{order}u4')[:, 0].astype(np.int64)
        parts = [
            np.ascontiguousarray(rows[:, at : at + layout.size]).view(f'{order}f8')
            for at, layout in self._places
            if layout.size
        ]
        numbers = np.concatenate(parts, axis=1).astype(np.float64)
        return seconds * 10**9 + rest, numbers

    def fits(self, content: bytes) -> bool:
        """Return whether a message has this shape."""
        return len(content) == len(self._buffer) and all(
            content[start:stop] == same for start, stop, same in self._fixed
        )

    def filled(self, stamp_ns: int, *numbers: Sequence[float]) -> bytes:
        """
        Return a message of this shape.

        Parameters
        ----------
        stamp_ns : int
            Its stamp.
        *numbers : sequence of float
            Positions, velocities and efforts, as many of each as the shape has; may stop short
            of those of which there are none.
        """
        buffer = self._buffer
        self._stamp.pack_into(buffer, _STAMP_AT, stamp_ns // 10**9, stamp_ns % 10**9)
        for (at, layout), values in zip(self._places, numbers, strict=False):
            layout.pack_into(buffer, at, *values)
        return bytes(buffer)

    def numbers(self, content: bytes) -> tuple[tuple[float, ...], ...]:
        """Return positions, velocities and efforts of a message that `fits`."""
        return tuple(layout.unpack_from(content, at) for at, layout in self._places)


_MOST_SHAPES = 8


@dataclass(frozen=True)
class JointStateTable:
    """
    Joint states as columns.

    Attributes
    ----------
    stamps_ns : ndarray of int, shape (n,)
        Stamps of the headers.
    numbers : ndarray, shape (n, k)
        Positions, velocities and efforts.
    frames : ndarray of int, shape (n,)
        Index of each frame among `JointStateColumns.frames`.
    unreadable : tuple of (int, str)
        Index of each message that is not among the rows, and why.
    """

    stamps_ns: NDArray[np.int64]
    numbers: NDArray[np.float64]
    frames: NDArray[np.int64]
    unreadable: tuple[tuple[int, str], ...]


class JointStateColumns:
    """
    Reads the joint states of one topic.

    Parameters
    ----------
    joints : tuple of str
        The joints that they must have.
    counts : tuple of int
        How many positions, velocities and efforts are read; there may be more efforts.

    Attributes
    ----------
    frames : list of str
        The frames met.
    """

    def __init__(self, joints: tuple[str, ...], counts: tuple[int, int, int]) -> None:
        self.frames: list[str] = []
        self._joints, self._counts = joints, counts
        self._shapes: list[JointStateBytes] = []

    def _shape(self, content: bytes) -> JointStateBytes:
        shape = JointStateBytes(content)
        enough = all(a >= b for a, b in zip(shape.counts, self._counts, strict=True))
        if shape.names != self._joints or shape.counts[:2] != self._counts[:2] or not enough:
            held = ', '.join(shape.names) or 'none'
            raise CdrError(f'its joints are {held}, not {", ".join(self._joints)}')
        if shape.frame_id not in self.frames:
            self.frames.append(shape.frame_id)
        # The commonest shape first
        self._shapes = [*self._shapes[: _MOST_SHAPES - 1], shape]
        return shape

    def read(self, contents: Sequence[bytes]) -> JointStateTable:
        """Return messages as a table; those that cannot be read are told apart."""
        width = sum(self._counts)
        stamps = np.zeros(len(contents), dtype=np.int64)
        numbers = np.zeros((len(contents), width))
        frames = np.zeros(len(contents), dtype=np.int64)
        sizes = np.fromiter(map(len, contents), dtype=np.int64, count=len(contents))
        unreadable: list[tuple[int, str]] = []
        for size in np.unique(sizes):
            left = np.flatnonzero(sizes == size)
            block = np.frombuffer(b''.join(contents[int(i)] for i in left), dtype=np.uint8)
            rows = block.reshape(len(left), int(size))
            shapes = [shape for shape in self._shapes if shape.size == size]
            while len(left):
                if not shapes:
                    first = int(left[0])
                    try:
                        shapes.append(self._shape(contents[first]))
                    except CdrError as error:
                        unreadable.append((first, str(error)))
                        left, rows = left[1:], rows[1:]
                        continue
                shape = shapes.pop(0)
                fits = shape.fitting(rows)
                at = left[fits]
                stamps[at], values = shape.columns(rows[fits])
                numbers[at] = values[:, :width]
                frames[at] = self.frames.index(shape.frame_id)
                left, rows = left[~fits], rows[~fits]
        bad = np.zeros(len(contents), dtype=np.bool_)
        bad[[index for index, _ in unreadable]] = True
        return JointStateTable(
            stamps[~bad], numbers[~bad], frames[~bad], tuple(sorted(unreadable))
        )


# Numbers of the types of a parameter (rcl_interfaces/ParameterType), without the arrays.
_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLE_ARRAY = 1, 2, 3, 4, 8


def _shape(frame_id: str, names: Sequence[str], *counts: int) -> JointStateBytes:
    """Return a JointState with so many positions, velocities and efforts."""
    writer = CdrWriter().time_ns(0).string(frame_id).put('I', len(names))
    for name in names:
        writer.string(name)
    for count in counts:
        writer.sequence('d', (0.0,) * count)
    return JointStateBytes(bytes(writer.content))


class RigMessages:
    """Joint states and impacts of a rig, to be filled in."""

    def __init__(self) -> None:
        self._states = _shape('', JOINTS, 4, 4, 0)
        self._impacts = {stop: _shape(f'stop_{stop}', IMPACT_JOINTS, 2, 2, 2) for stop in (1, 2)}
        self._control = {
            action: _shape(action.name.lower(), CONTROL_JOINTS, 3, 3, 3) for action in Action
        }

    def states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a sample; see `state_numbers`."""
        return self._states.filled(stamp_ns, *state_numbers(sample, deflection))

    def impact(self, stamp_ns: int, event: Event, deflection: float) -> bytes:
        """Return the message of an impact; see `impact_numbers`."""
        return self._impacts[event.stop].filled(stamp_ns, *impact_numbers(event, deflection))

    def control(self, stamp_ns: int, record: ControlRecord) -> bytes:
        """Return the message of what the gap control did."""
        return self._control[record.action].filled(stamp_ns, *record.numbers)


def snapshot_message(offset_ns: int, time_ns: int, reason: str, state: Mapping[str, Any]) -> bytes:
    """Return the message of a snapshot; see `snapshot_text`."""
    text = snapshot_text(offset_ns, time_ns, reason, state)
    return bytes(CdrWriter().string(text).content)


def parameter_event(
    stamp_ns: int, node: str, values: Mapping[str, Any], *, new: bool = False
) -> bytes:
    """Return a rcl_interfaces/ParameterEvent."""
    writer = CdrWriter().time_ns(stamp_ns).string(node)
    for listed in (new, not new, False):
        writer.put('I', len(values) if listed else 0)
        for name, value in values.items() if listed else ():
            _put_parameter(writer, name, value)
    return bytes(writer.content)


def _put_parameter(writer: CdrWriter, name: str, value: Any) -> None:
    kind = (
        _BOOL
        if isinstance(value, bool)
        else _INTEGER
        if isinstance(value, int)
        else _DOUBLE
        if isinstance(value, float)
        else _STRING
        if isinstance(value, str)
        else _DOUBLE_ARRAY
    )
    writer.string(name).put('B', kind)
    writer.put('?', value if kind == _BOOL else False)
    writer.put('q', value if kind == _INTEGER else 0)
    writer.put('d', value if kind == _DOUBLE else 0.0)
    writer.string(value if kind == _STRING else '')
    # Bytes, bools, integers, doubles, texts
    for place in range(5):
        writer.sequence('d', value if kind == _DOUBLE_ARRAY and place == 3 else ())
