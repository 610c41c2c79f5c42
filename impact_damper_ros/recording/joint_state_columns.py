"""
Many joint states at once: their numbers as arrays.

The messages of a topic have the same shape but for stamp and numbers. So they are laid out as the
rows of one array of bytes, compared with the shape, and read column by column.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .cdr import CdrError
from .joint_state_bytes import JointStateBytes

__all__ = ['JointStateColumns', 'JointStateTable']

_STAMP_AT = 4
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
