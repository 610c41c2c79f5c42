"""What a motion can be."""

from __future__ import annotations

from enum import Enum

__all__ = ['MotionKind']


class MotionKind(Enum):
    """What a motion is, as measured."""

    AT_REST = 'at rest'
    #: M moves, m hits no stop.
    NO_IMPACTS = 'without impacts'
    #: It comes to repeat, or to have no impacts.
    TRANSIENT = 'transient'
    PERIODIC = 'periodic'
    #: These two by the thresholds of `irregularity`.
    QUASI_PERIODIC = 'quasi-periodic'
    CHAOTIC = 'chaotic'
    #: What is known does not decide.
    UNDECIDED = 'undecided'
    #: Under a force, or a control, that never repeats.
    NOT_PERIODICALLY_DRIVEN = 'not periodically driven'
