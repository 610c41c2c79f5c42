"""What a motion can be."""

from __future__ import annotations

from enum import Enum

__all__ = ['MotionKind']


class MotionKind(Enum):
    """What a motion is, as measured."""

    AT_REST = 'at rest'
    #: M moves, m hits no stop.
    NO_IMPACTS = 'without impacts'
    TRANSIENT = 'transient'
    PERIODIC = 'periodic'
    QUASI_PERIODIC = 'quasi-periodic'
    CHAOTIC = 'chaotic'
    #: Neither periodic nor long enough to tell more.
    UNDECIDED = 'undecided'
    #: Under a force, or a control, that never repeats.
    NOT_PERIODICALLY_DRIVEN = 'not periodically driven'
