"""
Serialised messages of exact length, with nothing but the message in them.

The middleware serialises into a buffer of an estimated size and leaves what lay there before in
the padding and behind the end. Subscribers do not mind, but some readers of bags do (a message
longer than its fields is refused), and equal messages should be equal bytes. So the fields are
walked once, the padding is zeroed and the rest cut off.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, TypeAlias

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

__all__ = [
    'NS_PER_S',
    'ORIGIN',
    'STAMP',
    'SerialisationError',
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
