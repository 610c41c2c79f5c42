"""
The series behind each figure of Bapat (1995), planned and computed.

The axes of the scan have no numbers: the ranges here cover all that the paper says of a figure.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from impact_damper_ros.orbits.optimum import OptimalGap, optimal_gap

from .curves import (
    Curve,
    SeriesPlan,
    SettledMotion,
    Start,
    Status,
    carried_starts,
    disturbed,
    enumerated_curves,
    followed_curves,
    frictionless_motions,
    point_of,
    settle,
    settled_motions,
)
from .rigs import BASIC, OPERATIONS

#: Figures, in order.
FIGURES = ('2', '3', '4', '5', '6')

#: Every n-th value that a quick look takes.
_QUICK = 4
#: Every n-th value at which curves of three and four impacts start, and at which motions of the
#: other rigs are carried over; of the same rig without friction, those at all values are.
_START_EVERY, _OTHERS_EVERY = 2, 8
#: Gap from which on no rig of Figure 2 has motions with three or four impacts, m.
_MANY_UP_TO = 26.0
#: The basic rig above resonance.
_ABOVE = BASIC.replace(force_frequencies=(1.02,))


@dataclass(frozen=True)
class Series:
    """A series of a figure: its curves and the simulated motions."""

    plan: SeriesPlan
    curves: tuple[Curve, ...]
    marks: tuple[SettledMotion, ...]
    starts: tuple[Start, ...] = ()  # the motions that curves were followed from

    def motions(self) -> list[Start]:
        """Return the motions with three impacts and more on the curves, between the starts."""
        started = {value for value, _ in self.starts}
        return [
            (point.value, point.orbit)
            for curve in self.curves
            for point in curve.points
            if curve.impacts > 2
            and point.value in self.plan.values
            and point.value not in started
            and point.orbit is not None
        ]

    def of(self, impacts: int) -> list[Curve]:
        """Return the curves with a number of impacts per cycle."""
        return [curve for curve in self.curves if curve.impacts == impacts]


def _values(*pieces: tuple[float, float, float]) -> tuple[float, ...]:
    """Return the sorted values of several ranges (low, high, step), without repeats."""
    values: set[float] = set()
    for low, high, step in pieces:
        count = round((high - low) / step)
        values |= {round(low + step * i, 9) for i in range(count + 1)}
    return tuple(sorted(values))


def _figure_2() -> list[SeriesPlan]:
    values = _values((4.0, 26.0, 0.25), (26.0, 64.0, 0.5))
    marks = _values((6.0, 24.0, 0.5), (24.0, 64.0, 2.0))
    horizontal, inclined, friction = OPERATIONS
    rigs = {'2 horizontal': horizontal.rig(_ABOVE, 1.0)} | {
        f'2 {operation.key} g={gravity:g}': operation.rig(_ABOVE, gravity)
        for gravity in (1.0, 2.0)
        for operation in (inclined, friction)
    }
    return [
        SeriesPlan(name, rig, 'gap', values, marks, (2, 3, 4), _MANY_UP_TO)
        for name, rig in rigs.items()
    ]


def _figure_3() -> list[SeriesPlan]:
    gaps, gap_marks = _values((20.0, 70.0, 0.5)), _values((20.0, 70.0, 2.5))
    plans = [
        SeriesPlan(
            f'3a {operation.key} {kind}',
            operation.rig(BASIC, 2.0).replace(restitution_1=first, restitution_2=second),
            'gap',
            gaps,
            gap_marks if kind == 'unequal' else (),
        )
        for operation in OPERATIONS
        for kind, first, second in (('equal', 0.75, 0.75), ('unequal', 0.78, 0.72))
    ]
    angles, angle_marks = _values((0.0, 90.0, 1.0)), _values((0.0, 50.0, 2.0))
    plans += [
        SeriesPlan(f'3b r={rig.force_frequencies[0]:g}', rig, 'angle', angles, angle_marks)
        for rig in (BASIC, _ABOVE)
    ]
    rates, rate_marks = (
        _values((0.999, 1.006, 0.0005), (1.006, 1.12, 0.002)),
        _values((1.0, 1.12, 0.01)),
    )
    plans += [
        SeriesPlan(
            f'3c θ={angle:g}°',
            BASIC.replace(angle=float(np.radians(angle))),
            'frequency',
            rates,
            rate_marks,
        )
        for angle in (0.0, 5.0, 10.0, 15.0)
    ]
    friction_marks = _values((0.0, 1.0, 0.05))
    frictions = _values((0.0, 1.0, 0.02), (0.0, 1.0, 0.05))
    plans.append(SeriesPlan('3d', BASIC.replace(gap=50.0), 'friction', frictions, friction_marks))
    return plans


def _figure_4() -> list[SeriesPlan]:
    values = tuple(float(f'{v:.4g}') for v in np.geomspace(0.5, 20.0, 97))
    tilted = BASIC.replace(gap=50.0, angle=float(np.radians(15.0)), friction=0.5)
    plans = [SeriesPlan('4 ζ=0.005', tilted, 'omega', values, values[::8])]
    level = tilted.replace(angle=0.0, friction=0.0)
    plans.append(SeriesPlan('4 ζ=0.005 level', level, 'omega', values, values[::16]))
    # zeta = 0.05 as printed, and A as large as in the basic rig, 100 m, by ten times the force
    damped = tilted.replace(damping=0.1)
    plans.append(SeriesPlan('4 ζ=0.05', damped, 'omega', values))
    strong = damped.replace(force_amplitudes=(STRONG_FORCE,))
    plans.append(SeriesPlan('4 ζ=0.05 strong', strong, 'omega', values))
    return plans


#: Force that gives the rig with zeta = 0.05 the amplitude A = 100 m of the basic rig.
STRONG_FORCE = 10.0


def _figure_6() -> list[SeriesPlan]:
    values, marks = _values((0.0, 6.0, 0.1), (0.0, 6.0, 0.25)), _values((0.0, 6.0, 0.25))
    return [
        SeriesPlan(
            f'6 r={rig.force_frequencies[0]:g}',
            rig.replace(friction=0.5),
            'air',
            values,
            marks,
            judged_at=(0.0, 0.5, 1.0, 2.0),
        )
        for rig in (BASIC, _ABOVE)
    ]


def plans_of(figure: str, *, quick: bool = False) -> list[SeriesPlan]:
    """Return the series of a figure, a quarter of their values if quick; Figure 5 has none."""
    figures = {'2': _figure_2, '3': _figure_3, '4': _figure_4, '6': _figure_6}
    plans = figures[figure]() if figure in figures else []
    if not quick:
        return plans
    return [
        replace(
            plan,
            values=tuple(sorted({*plan.values[::_QUICK], *plan.marks[::_QUICK], *plan.judged_at})),
            marks=plan.marks[::_QUICK],
        )
        for plan in plans
    ]


def figure_of(name: str) -> str:
    """Return the figure that a name such as 3a belongs to, or raise a `ValueError`."""
    panels = {'2': 'abcdef', '3': 'abcd', '4': '', '5': 'ab', '6': ''}
    figure, panel = name[:1], name[1:].lower()
    if figure not in panels or len(panel) > 1 or panel not in panels[figure]:
        raise ValueError(
            f'{name!r} is not a figure: give some of 2, 3, 4, 5, 6, or their panels such as 2a '
            'or 3d, with commas between them'
        )
    return figure


#: What a value of a series with two impacts per cycle costs, s of an idle core, all in all; what
#: one with three or four impacts, or an optimum, costs in such values.
SECONDS_PER_VALUE = 0.05
_COST_OF_MANY, COST_OF_OPTIMUM = 8, 8


def cost_of(plan: SeriesPlan) -> int:
    """Return how much work a series is, in values of one with two impacts per cycle."""
    return len(plan.values) * (_COST_OF_MANY if max(plan.impacts) > 2 else 1)


#: Gaps searched, m: all with stable motions of two impacts per cycle at r = 1.
_GAPS, _GAP_COUNT = (35.0, 62.0), 16


@dataclass(frozen=True)
class AngleOptimum:
    """The optimal gap at an angle, degrees, and the motion simulated from near the theory's."""

    angle: float
    best: OptimalGap
    settled: SettledMotion


def figure_5_angles(*, quick: bool = False) -> tuple[float, ...]:
    """Return the angles of Figure 5, degrees."""
    if quick:
        return (0.0, 10.0, 45.0, 90.0)
    fine = np.arange(0.0, 20.0, 2.5)
    return tuple(float(angle) for angle in np.concatenate([fine, np.arange(20.0, 90.1, 5.0)]))


def optimum_at(angle: float) -> AngleOptimum:
    """Find the optimal gap at an angle, degrees; g = 9.81 and r = 1, no friction."""
    rig = BASIC.replace(angle=float(np.radians(angle)))
    best = optimal_gap(rig, gaps=_GAPS, points=_GAP_COUNT, tolerance=1e-6)
    return AngleOptimum(angle, best, settle(disturbed(best.orbit, 1e-3), angle))


def needs_others(plan: SeriesPlan) -> bool:
    """Return whether the curves of a series start from the motions of other series."""
    return plan.rig.friction > 0.0 and max(plan.impacts) > 2


def start_motions(plan: SeriesPlan, others: Iterable[Series]) -> list[Start]:
    """Return motions to follow curves from: of the impact equations, carried over to friction."""
    if needs_others(plan):
        own, some = plan.rig.replace(friction=0.0), set(plan.values[::_OTHERS_EVERY])
        pool = [
            start
            for series in others
            for start in (*series.starts, *series.motions())
            if series.plan.rig == own or start[0] in some
        ]
        return carried_starts(plan, pool)
    if max(plan.impacts) > 2:
        return frictionless_motions(plan, plan.values[::_START_EVERY])
    rubs = plan.rig.friction > 0.0 or plan.variable == 'friction'
    return carried_starts(plan, frictionless_motions(plan, plan.marks)) if rubs else []


def compute_series(plan: SeriesPlan, others: Sequence[Series] = ()) -> Series:
    """
    Compute a series: theory and simulation.

    The simulator starts from rest, as in the paper, and near each stable motion of the theory.
    Where the force stays the same, motions are also carried from mark to mark, up and down. This
    finds attractors that are not reached from rest. With friction and three impacts or more,
    curves start from the motions of `others`, the frictionless series of the figure, carried over.
    """
    starts = start_motions(plan, others)
    curves = enumerated_curves(plan)
    for impacts in plan.impacts:
        curves += followed_curves(plan, starts, impacts)
    points = [p for curve in curves for p in curve.points if p.status == Status.STABLE]
    marks = settled_motions(
        [(v, plan.at(v)) for v in plan.marks],
        carried=plan.variable in ('gap', 'angle', 'friction', 'air'),
        predicted={
            v: [p.orbit for p in points if p.value == v and p.orbit is not None]
            for v in plan.marks
        },
    )
    if max(plan.impacts) < 3:
        curves += _curves_of_marks(plan, curves, marks)
    return Series(plan, tuple(curves), tuple(marks), tuple(starts))


def _curves_of_marks(
    plan: SeriesPlan, curves: Sequence[Curve], marks: Sequence[SettledMotion]
) -> list[Curve]:
    """Follow settled motions that are on no curve, such as two impacts on one stop."""
    new = [
        (mark.value, mark.orbit)
        for mark in marks
        if mark.orbit is not None and mark.cycles == 1 and point_of(curves, mark) is None
    ]
    found = [curve for impacts in plan.impacts for curve in followed_curves(plan, new, impacts)]
    return [replace(curve, simulated=True) for curve in found]
