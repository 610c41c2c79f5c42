"""
What theory says of a rig, part by part: the predicted orbit, and the curve of Xmax/A over the gap.

A generator, worked through in a process of its own (`theory_process`): each message is the best
that is known by then, the first ones after some tens of milliseconds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from impact_damper_ros.compare import (
    ForceClock,
    LoggedRig,
    Prediction,
    predicted_curve,
    predictions,
)
from impact_damper_ros.control import ControlledRig
from impact_damper_ros.orbits import Branch, OrbitError, PeriodicOrbit, continue_orbit
from impact_damper_ros.rig import RigParameters

from .knobs import as_json

#: Gaps that are followed, as shares of the present one.
_SPAN = 4.0
_PREVIEW_POINTS, _MOST_POINTS = 16, 150
#: Other branches that are followed.
_MOST_BRANCHES = 4
#: A motion is on a branch that is nearer than this in Xmax/A.
_ON_BRANCH = 2e-3
_MOST_ROWS = 1500


def theory(state: Mapping[str, Any], *, orbit: bool, curve: bool) -> Iterator[dict[str, Any]]:
    """
    Work out theory for a rig.

    Parameters
    ----------
    state : mapping
        Of a snapshot.
    orbit, curve : bool
        What is wanted.

    Yields
    ------
    dict
        Messages for the page.
    """
    if not (orbit or curve):
        return
    rig = ControlledRig.restore(dict(state))
    clock = LoggedRig.of_snapshot(state).clock
    gap_curve = GapCurve(rig.parameters)
    begun: list[PeriodicOrbit] = []
    last = Prediction()
    for last in predictions(rig):
        if orbit:
            yield orbit_message(clock, last, rig.time)
        start = last.expected
        if curve and start is not None and not begun and not rig.parameters.one_sided:
            begun.append(start)
            yield from gap_curve.previewed(start)
    if not last.applies:
        yield {'type': 'theory_failed', 'text': last.reason}
        return
    if not curve:
        return
    if rig.parameters.one_sided:
        yield {'type': 'theory_failed', 'text': 'a one-sided rig has no gap to choose'}
        return
    starts = [*([last.expected] if last.expected else []), *last.orbits]
    for start in starts:
        if len(gap_curve.branches) < _MOST_BRANCHES and not gap_curve.holds(start):
            yield from gap_curve.followed(start)
    yield gap_curve.message(done=True)


def orbit_message(clock: ForceClock | None, prediction: Prediction, time: float) -> dict[str, Any]:
    """Return what is predicted, with one period of the motion."""
    expected = prediction.expected
    message: dict[str, Any] = {
        'type': 'orbit',
        'found': expected is not None,
        'text': prediction.reason,
        'complete': prediction.complete,
        'others': [_summary(other) for other in prediction.orbits if other is not expected],
    }
    if expected is None:
        return message
    message |= _summary(expected) | {
        'cycles': expected.cycles,
        'stops': list(expected.stops),
        'period': expected.period,
        'basis': prediction.basis,
        'impacts': [
            {
                'phase': phase % expected.cycles,
                'x': x,
                'stop': stop,
                'velocity_after': velocity,
                'damper_velocity_after': damper,
            }
            for phase, x, stop, velocity, damper in zip(
                expected.phases,
                expected.x,
                expected.stops,
                expected.primary_velocity_after,
                expected.damper_velocity_after,
                strict=True,
            )
        ],
    }
    drawn = None if clock is None else predicted_curve(clock, expected, None, time)
    if drawn is not None:
        step = max(1, -(-len(drawn.phase) // _MOST_ROWS))
        # From the zero of the force on, as the period is repeated
        phase = np.remainder(drawn.phase[:-1:step], drawn.cycles)
        order = np.argsort(phase, kind='stable')
        x, y = drawn.x[:-1:step][order], drawn.y[:-1:step][order]
        message |= {
            't_zero': drawn.force_zero,
            't': (phase[order] * drawn.cycle).tolist(),
            'phase': phase[order].tolist(),
            'x': x.tolist(),
            'z': (x + y).tolist(),
            'y': y.tolist(),
            'relative_velocity': drawn.relative_velocity[:-1:step][order].tolist(),
        }
    return dict(as_json(message))


def _summary(orbit: PeriodicOrbit) -> dict[str, Any]:
    return {
        'label': _label(orbit),
        'stable': orbit.stable,
        'viable': orbit.viable,
        'reason': orbit.reason,
        'x_max': orbit.x_max,
        'x_max_ratio': as_json(orbit.amplitude_ratio),
        'multipliers': [[value.real, value.imag] for value in orbit.multipliers],
    }


def _label(orbit: PeriodicOrbit) -> str:
    impacts, cycles = len(orbit.stops), orbit.cycles
    return (
        f'{impacts} impact{"s" if impacts > 1 else ""} in {cycles} '
        f'cycle{"s" if cycles > 1 else ""}'
    )


class GapCurve:
    """
    Xmax/A over the gap, as far as it is known.

    Parameters
    ----------
    rig : RigParameters
        The rig; its gap is varied.
    """

    def __init__(self, rig: RigParameters) -> None:
        self._rig = rig
        self._here: PeriodicOrbit | None = None
        self._preview: list[dict[str, Any]] = []
        # Branches of which one way is still to be followed
        self._half: list[dict[str, Any]] = []
        self._special: list[dict[str, Any]] = []
        self.branches: list[dict[str, Any]] = []

    def previewed(self, start: PeriodicOrbit) -> Iterator[dict[str, Any]]:
        """Follow a motion for a short way."""
        self._here = start
        down, up = self._both_ways(start, _PREVIEW_POINTS)
        self._preview = [_joined(start, down, up)] if down is not None and up is not None else []
        if self._preview:
            yield self.message()

    def followed(self, start: PeriodicOrbit) -> Iterator[dict[str, Any]]:
        """Follow a motion to both ends of the range."""
        self._here = self._here or start
        down, _ = self._both_ways(start, _MOST_POINTS, upwards=False)
        if down is not None:
            self._half = [_joined(start, down, None)]
            yield self.message()
        _, up = self._both_ways(start, _MOST_POINTS, downwards=False)
        self._half = []
        if down is None and up is None:
            return
        self.branches.append(_joined(start, down, up))
        self._preview = []
        for branch in (down, up):
            self._special += [
                {
                    'gap': special.value,
                    'x_max_ratio': special.orbit.amplitude_ratio,
                    'kind': special.kind.value,
                    'stable': special.orbit.stable,
                }
                for special in (branch.special if branch is not None else ())
                if special.orbit.viable
            ]
        yield self.message()

    def _both_ways(
        self, start: PeriodicOrbit, points: int, *, upwards: bool = True, downwards: bool = True
    ) -> tuple[Branch | None, Branch | None]:
        gap = start.parameters.gap
        found: list[Branch | None] = []
        for way, wanted in ((False, downwards), (True, upwards)):
            branch = None
            if wanted:
                try:
                    branch = continue_orbit(
                        *(start, 'gap', gap / _SPAN, gap * _SPAN),
                        upwards=way,
                        most_points=points,
                    )
                except (OrbitError, ValueError, ArithmeticError):
                    branch = None
            found.append(branch if branch is not None and branch.orbits else None)
        return found[0], found[1]

    def holds(self, orbit: PeriodicOrbit) -> bool:
        """Return whether a motion is on a branch that is known."""
        gap, ratio = orbit.parameters.gap, orbit.amplitude_ratio
        for branch in self.branches:
            if branch['label'] != _label(orbit):
                continue
            gaps, ratios = np.array(branch['gap']), np.array(branch['x_max_ratio'])
            crossed = (gaps[:-1] - gap) * (gaps[1:] - gap) <= 0.0
            for i in np.flatnonzero(crossed):
                width = gaps[i + 1] - gaps[i]
                share = (gap - gaps[i]) / width if width else 0.0
                there = ratios[i] + share * (ratios[i + 1] - ratios[i])
                if abs(there - ratio) < _ON_BRANCH + 0.02 * ratio:
                    return True
        return False

    def _parts(self) -> Iterator[tuple[dict[str, Any], tuple[int, ...]]]:
        """Yield all branches, and at which of its points each goes on: to be followed yet."""
        yield from ((branch, ()) for branch in self.branches)
        yield from ((branch, (-1,)) for branch in self._half)
        yield from ((branch, (0, -1)) for branch in self._preview)

    @property
    def optimum(self) -> tuple[float, float] | None:
        """
        The gap with the least Xmax/A of a stable motion, and that; None if there is none.

        The open end of a branch that is still being followed is none: it goes on from there.
        """
        lowest = (_lowest(branch, ends) for branch, ends in self._parts())
        best = min(filter(None, lowest), key=lambda found: found[1], default=None)
        for special in self._special:
            # A motion that loses its stability is best just before.
            at_edge = best is not None and special['stable']
            if at_edge and best is not None and special['x_max_ratio'] < best[1]:
                best = special['gap'], special['x_max_ratio']
        return best

    def message(self, *, done: bool = False) -> dict[str, Any]:
        """Return all that is known."""
        best = self.optimum
        here = self._here
        return {
            'type': 'gap_curve',
            'gap': self._rig.gap,
            'x_max_ratio': here.amplitude_ratio if here is not None else None,
            'branches': [branch for branch, _ in self._parts()],
            'special': self._special,
            'optimum': {'gap': best[0], 'x_max_ratio': best[1]} if best else None,
            'done': done,
        }


def _lowest(branch: Mapping[str, Any], open_ends: Sequence[int]) -> tuple[float, float] | None:
    """Return the lowest stable point of a branch; None if a lower one may be beyond an end."""
    best, place = None, 0
    gaps, ratios = branch['gap'], branch['x_max_ratio']
    fit = [s and v for s, v in zip(branch['stable'], branch['viable'], strict=True)]
    for i in (i for i, good in enumerate(fit) if good):
        found = gaps[i], ratios[i]
        if 0 < i < len(fit) - 1 and fit[i - 1] and fit[i + 1]:
            found = _vertex(gaps[i - 1 : i + 2], ratios[i - 1 : i + 2])
        if best is None or found[1] < best[1]:
            best, place = found, i
    return None if place in {end % len(fit) for end in open_ends if fit} else best


def _vertex(gaps: Sequence[float], ratios: Sequence[float]) -> tuple[float, float]:
    """Return the lowest point of the parabola through three, or the middle one."""
    if not ratios[0] > ratios[1] < ratios[2] or len(set(gaps)) < 3:
        return gaps[1], ratios[1]
    a, b, c = np.polyfit(np.array(gaps) - gaps[1], ratios, 2)
    if a <= 0.0:
        return gaps[1], ratios[1]
    return float(gaps[1] - 0.5 * b / a), float(c - 0.25 * b * b / a)


def _joined(start: PeriodicOrbit, down: Branch | None, up: Branch | None) -> dict[str, Any]:
    """Return both ways from a motion as one branch."""
    lower = list(down.orbits[::-1]) if down is not None else []
    upper = list(up.orbits[1 if lower else 0 :]) if up is not None else []
    orbits = [o for o in [*lower, *upper] if math.isfinite(o.amplitude_ratio)]
    return {
        'label': _label(start),
        'gap': [o.parameters.gap for o in orbits],
        'x_max_ratio': [o.amplitude_ratio for o in orbits],
        'stable': [o.stable for o in orbits],
        'viable': [o.viable for o in orbits],
    }
