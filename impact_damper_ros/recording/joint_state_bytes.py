"""
Joint states as bytes: a message is checked against what it should be without decoding it.

The messages of a topic differ in stamp and numbers only. So one of them serves as a template: with
stamp and numbers overwritten it must equal the recorded message, to the last bit (a zero that has
changed its sign is a difference, too).
"""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig.published import PAUSED_FRAME

from .cdr import CdrError, CdrReader

__all__ = ['JointStateBytes', 'header_ns', 'is_paused']

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
