"""
Reading and writing the Common Data Representation, in which ROS 2 serialises messages.

Plain CDR (XCDR version 1), as of DDS-XTypes 1.3, section 7.4.3: four bytes that name the
encoding, then the fields, each aligned to its own size counted from there.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from typing import TypeVar

__all__ = ['CdrError', 'CdrReader', 'CdrWriter']

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
