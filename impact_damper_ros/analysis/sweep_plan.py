"""The plan of a sweep: which rigs, in which order, and everything their rows depend on."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from enum import Enum
from typing import Any, Self

import impact_damper_ros
from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.rig import InitialConditions, RigParameters

from .settling_rig import Settling
from .sweep_axes import Axis, AxisError, Target

__all__ = ['MOST_POINTS', 'TABLE_FORMAT', 'Follow', 'Point', 'SweepPlan']

#: Raised whenever the same inputs give other rows.
TABLE_FORMAT = 2
#: Most rigs of one sweep.
MOST_POINTS = 2_000_000


class Follow(Enum):
    """How the rigs of a sweep start."""

    #: Each from the initial conditions.
    NONE = 'none'
    #: Along rising values of the first axis, each from the last state of the one before.
    UP = 'up'
    #: The same along falling values.
    DOWN = 'down'
    #: Both, each from the initial conditions at its end.
    BOTH = 'both'

    @property
    def passes(self) -> tuple[str, ...]:
        """The directions followed; one empty name if the rigs are independent."""
        if self is Follow.NONE:
            return ('',)
        return ('up', 'down') if self is Follow.BOTH else (self.value,)


@dataclass(frozen=True)
class Point:
    """
    One rig of a sweep.

    Attributes
    ----------
    index : int
        Its row in the table.
    direction : str
        'up', 'down', or empty if it does not start from another rig's state.
    values : tuple of float
        Its value on each axis.
    """

    index: int
    direction: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class SweepPlan:
    """
    A sweep.

    Attributes
    ----------
    parameters, initial : RigParameters, InitialConditions
        The rig, but for what is varied.
    axes : tuple of Axis
        What is varied; the first is the one that is followed.
    follow : Follow
        How the rigs start.
    settling : Settling
        How long and how closely each rig is watched.
    control : GapControlParameters
        The gap control, but for what is varied; off, if not given.

    Raises
    ------
    AxisError
        If the axes cannot be used together.
    """

    parameters: RigParameters
    initial: InitialConditions
    axes: tuple[Axis, ...]
    follow: Follow = Follow.NONE
    settling: Settling = field(default_factory=Settling)
    control: GapControlParameters = field(default_factory=GapControlParameters)

    def __post_init__(self) -> None:
        """Check what holds between the axes."""
        if self.parameters.sweep_mode != 'off':
            raise AxisError(
                f'sweep_mode is {self.parameters.sweep_mode}: a force that changes its frequency '
                'has no steady state; give --set sweep_mode=off, and vary force_frequencies'
            )
        if not self.axes:
            raise AxisError('nothing is varied: give --vary NAME=RANGE, such as gap=10:60:200')
        targets = [target for axis in self.axes for target in axis.targets]
        for target in targets:
            if targets.count(target) > 1:
                raise AxisError(f'{target} is varied twice: give each name once')
            if target.control and not self.control.active:
                raise AxisError(
                    f'{target} is varied, but gap_control is off, and nothing depends on it: '
                    'give --set gap_control=amplitude or --set gap_control=timed'
                )
        if self.follow is not Follow.NONE and self.axes[0].initial:
            raise AxisError(
                f'{self.axes[0].name} cannot be followed, a rig has its initial conditions only '
                'once: vary a parameter first, or leave out --follow'
            )
        if self.size > MOST_POINTS:
            raise AxisError(
                f'the sweep has {self.size} rigs: give ranges that make at most {MOST_POINTS}'
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values on each axis."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def size(self) -> int:
        """Number of rigs, one row each."""
        return len(self.follow.passes) * math.prod(self.shape)

    def point(self, index: int) -> Point:
        """Return a rig by its row: directions outermost, then the axes, the last one fastest."""
        turn, rest = divmod(index, math.prod(self.shape))
        places = []
        for count in reversed(self.shape):
            rest, place = divmod(rest, count)
            places.append(place)
        values = tuple(a.values[i] for a, i in zip(self.axes, reversed(places), strict=True))
        return Point(index, self.follow.passes[turn], values)

    def settings(self, point: Point) -> list[tuple[Target, float]]:
        """Return what takes which value at a point."""
        return [
            (target, value)
            for axis, value in zip(self.axes, point.values, strict=True)
            for target in axis.targets
        ]

    def chains(self) -> Iterator[range | list[int]]:
        """
        Yield the rows that have to be worked out in a row.

        Yields
        ------
        sequence of int
            Rows, each rig starting from the last state of the one before; without following all
            rows at once, which then need no order.
        """
        if self.follow is Follow.NONE:
            yield range(self.size)
            return
        grid = math.prod(self.shape)
        stride = grid // self.shape[0]
        for turn, direction in enumerate(self.follow.passes):
            for offset in range(stride):
                first = turn * grid + offset
                rows = range(first, first + grid, stride)
                yield rows if direction == 'up' else rows[::-1]

    def inputs(self) -> dict[str, Any]:
        """Return everything the table depends on, in a form that goes through JSON."""
        inputs: dict[str, Any] = {
            'format': TABLE_FORMAT,
            'version': impact_damper_ros.__version__,
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
            'initial': self.initial.as_dict(),
            'axes': [
                {
                    'names': [str(target) for target in axis.targets],
                    'values': list(axis.values),
                    'logarithmic': axis.logarithmic,
                }
                for axis in self.axes
            ],
            'follow': self.follow.value,
            'settling': asdict(self.settling),
        }
        if self.control != GapControlParameters():
            inputs['gap_control'] = self.control.as_dict()
        return inputs

    @classmethod
    def from_inputs(cls, inputs: dict[str, Any]) -> Self:
        """
        Return the plan that `inputs` was made from.

        Raises
        ------
        ValueError
            If this version does not know such inputs.
        """
        if inputs.get('format') != TABLE_FORMAT:
            raise ValueError(
                f'a sweep of format {inputs.get("format")!r}: this version reads {TABLE_FORMAT}'
            )
        return cls(
            parameters=RigParameters(**inputs['parameters']),
            initial=InitialConditions(**inputs['initial']),
            axes=tuple(
                Axis(
                    tuple(Target.named(name) for name in axis['names']),
                    tuple(axis['values']),
                    axis['logarithmic'],
                )
                for axis in inputs['axes']
            ),
            follow=Follow(inputs['follow']),
            settling=Settling(**inputs['settling']),
            control=GapControlParameters(**inputs.get('gap_control', {})),
        )
