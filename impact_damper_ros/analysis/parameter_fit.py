"""
Which single wrong parameter would explain a log that does not obey the equations of motion.

Each is fitted in turn by Gauss and Newton's method to the residuals between recorded knots, all
others kept as logged.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from impact_damper_ros.rig import ParameterError, RigParameters

from .flight_check import check_intervals, knots_of
from .force_clock import ForceClock
from .recorded_stretch import RecordedImpacts, RecordedStates
from .run_curves import Array

__all__ = ['ParameterFit', 'fit_one_parameter']

_MOST_KNOTS = 1000
_STEPS = 8
_DIFFERENCE = 1e-6
#: Share of the residual that may be left by an explanation.
_EXPLAINS = 0.02
_ALIKE = 3.0


@dataclass(frozen=True)
class ParameterFit:
    """
    A parameter with which a log obeys the equations of motion.

    Attributes
    ----------
    name, unit : str
        The parameter.
    logged, fitted : float
        Its values.
    left : float
        Share of the root-mean-square residual that is left.
    alike : tuple of str
        Other parameters that would explain the residuals as well.
    """

    name: str
    unit: str
    logged: float
    fitted: float
    left: float
    alike: tuple[str, ...] = ()


_Change = Callable[[ForceClock, float], ForceClock]


def _number(name: str) -> _Change:
    def change(clock: ForceClock, value: float) -> ForceClock:
        return replace(clock, parameters=clock.parameters.replace(**{name: value}))

    return change


def _first_entry(name: str) -> _Change:
    def change(clock: ForceClock, value: float) -> ForceClock:
        others = getattr(clock.parameters, name)[1:]
        return replace(clock, parameters=clock.parameters.replace(**{name: (value, *others)}))

    return change


def _candidates(rig: RigParameters) -> list[tuple[str, str, float, float, _Change]]:
    """Return name, unit, logged value, scale and how to change it, for each parameter."""
    numbers = [
        ('primary_mass', 'kg', rig.primary_mass),
        ('stiffness', 'N/m', rig.stiffness),
        ('damping', 'N s/m', math.sqrt(rig.stiffness * rig.primary_mass)),
        ('damper_mass', 'kg', rig.damper_mass),
        ('angle', 'rad', 1.0),
        ('friction', '', 1.0),
        ('gravity', 'm/s^2', 10.0),
        ('air_force', 'N', rig.damper_mass),
    ]
    found = [(n, u, float(getattr(rig, n)), s, _number(n)) for n, u, s in numbers]
    arrays = [
        ('force_amplitudes', 'N', abs(rig.force_amplitudes[0]) or 1.0),
        ('force_frequencies', 'rad/s', rig.force_frequencies[0] or 1.0),
        ('force_phases', 'rad', 1.0),
    ]
    found += [(n, u, float(getattr(rig, n)[0]), s, _first_entry(n)) for n, u, s in arrays]
    return found


def fit_one_parameter(
    clock: ForceClock, states: RecordedStates, impacts: RecordedImpacts, last_stop: int
) -> ParameterFit | None:
    """
    Look for the one parameter whose logged value is wrong.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    states, impacts : RecordedStates, RecordedImpacts
        What was recorded, in a row.
    last_stop : int
        Stop hit last before all of them, or 0.

    Returns
    -------
    ParameterFit or None
        The one that explains all but a fiftieth of the residuals; None if none does.
    """
    states = states[:_MOST_KNOTS]
    if len(states) < 2:
        return None
    impacts = impacts[(impacts.time >= states.time[0]) & (impacts.time <= states.time[-1])]

    def residuals(trial: ForceClock) -> Array:
        knots = knots_of(trial.parameters, states, impacts, last_stop)
        found = check_intervals(trial, knots)
        scaled = np.where(found.plain[:, None], found.residuals / tolerances, 0.0)
        return np.nan_to_num(scaled, posinf=0.0, neginf=0.0).ravel()

    tolerances = check_intervals(
        clock, knots_of(clock.parameters, states, impacts, last_stop)
    ).tolerances
    start = residuals(clock)
    size = float(np.linalg.norm(start))
    fits: list[ParameterFit] = []
    for name, unit, logged, scale, change in _candidates(clock.parameters):
        try:
            fitted, left = _fitted(clock, residuals, start, logged, scale, change)
        except ParameterError:
            continue
        if left < _EXPLAINS * size:
            fits.append(ParameterFit(name, unit, logged, fitted, left / size))
    if not fits:
        return None
    least = min(fit.left for fit in fits)
    best, *alike = (fit for fit in fits if fit.left <= _ALIKE * least)
    return replace(best, alike=tuple(fit.name for fit in alike))


def _fitted(
    clock: ForceClock,
    residuals: Callable[[ForceClock], Array],
    start: Array,
    logged: float,
    scale: float,
    change: _Change,
) -> tuple[float, float]:
    """Return the best value of a parameter, and the norm of the residuals that it leaves."""
    value, at, size = logged, start, float(np.linalg.norm(start))
    step = _DIFFERENCE * scale
    for _ in range(_STEPS):
        slope = (residuals(change(clock, value + step)) - at) / step
        steepness = float(slope @ slope)
        if steepness == 0.0:
            break
        trial = value - float(slope @ at) / steepness
        there = residuals(change(clock, trial))
        if not float(np.linalg.norm(there)) < 0.999 * size:
            break
        value, at, size = trial, there, float(np.linalg.norm(there))
    return value, size
