"""
What is wrong with a log, by itself and against the rig that it names, in words.

Each is fitted in turn by Gauss and Newton's method to the residuals between recorded knots, all
others kept as logged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np

from impact_damper_ros.rig import ParameterError, RigParameters

from .fault_search import Fault, FaultSearch
from .flight_check import check_intervals, knots_of
from .impact_check import (
    contact_findings,
    gap_findings,
    impulse_findings,
    restitution_findings,
    stop_findings,
)
from .recorded_stretch import ForceClock, RecordedImpacts, RecordedStates, RecordedStretch
from .run_comparison import Finding
from .run_curves import Array

__all__ = ['ParameterFit', 'fit_one_parameter', 'log_findings', 'repaired_impacts']


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
    """Look for the one parameter whose logged value is wrong."""
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


#: Share of the intervals that disobey the equations of motion if a parameter is wrong.
_MOST_DISOBEY = 0.1
#: Topics that name the parameters.
_OF_PARAMETERS = ('/parameter_events', '/snapshot')
#: Faults told one by one, and share of the impacts that may be repaired.
_TOLD = 3
_FEW = 0.01
_REPAIRED = 0.05


def _fit_finding(fit: ParameterFit, time: float) -> Finding:
    unit = f' {fit.unit}' if fit.unit else ''
    alike = f' (or another {" or ".join(fit.alike)} instead)' if fit.alike else ''
    return Finding(
        quantity=fit.name,
        unit=fit.unit,
        time=time,
        measured=fit.fitted,
        expected=fit.logged,
        tolerance=abs(fit.fitted - fit.logged) * fit.left,
        text=(
            f'the recorded motion obeys the equations of motion with {fit.name} = '
            f'{fit.fitted:.9g}{unit}{alike}; logged is {fit.logged:.9g}{unit}'
        ),
    )


def _late(seconds: float) -> str:
    """Return a delay in words."""
    size, unit = abs(seconds), 's'
    for factor, name in ((1e9, 'ns'), (1e6, 'us'), (1e3, 'ms')):
        if size * factor < 999.5:
            size, unit = size * factor, name
            break
    return f'{size:.6g} {unit} {"late" if seconds > 0.0 else "early"}'


def _fault_text(fault: Fault) -> str:
    hit = f'the impact on stop {fault.stop} at {fault.time:.9f} s'
    if fault.kind == 'missing':
        return f'{hit} is missing in the log'
    if fault.kind == 'surplus':
        return f'{hit} is in the log, but did not happen'
    difference = fault.recorded - fault.expected
    if fault.kind == 'motion' and math.isnan(difference):
        return (
            f'what is recorded up to {fault.time:.9g} s does not follow from what is before: '
            'impacts, reversals or rest should have come otherwise'
        )
    if fault.kind == 'motion':
        return (
            f'the motion recorded up to {fault.time:.9g} s does not follow from the one before: '
            f'{fault.quantity} is {fault.recorded:.9g} {fault.unit}, off by {difference:+.6g} '
            f'{fault.unit}'
        )
    if fault.quantity == 'instant':
        return f'{hit} is stamped {_late(difference)}'
    return (
        f'{fault.quantity} of {hit} is {fault.recorded:.9g} {fault.unit}, off by '
        f'{difference:+.6g} {fault.unit}'
    )


def _fault_findings(faults: Sequence[Fault]) -> Iterator[Finding]:
    """Yield the faults: few ones one by one, of many the first and how many there are."""

    def sort(fault: Fault) -> tuple[str, str]:
        return fault.kind, fault.quantity

    for (kind, quantity), group in groupby(sorted(faults, key=sort), key=sort):
        alike = sorted(group, key=lambda fault: fault.time)
        for fault in alike if len(alike) <= _TOLD else alike[:1]:
            text = _fault_text(fault)
            if len(alike) > _TOLD:
                text += f'; {len(alike)} of this kind'
                sizes = [abs(f.recorded - f.expected) for f in alike]
                if not math.isnan(max(sizes)):
                    text += f', off by up to {max(sizes):.6g} {fault.unit}'
            name = {'missing': 'missing impact', 'surplus': 'surplus impact'}.get(kind)
            yield Finding(
                quantity=name or (f'{quantity} at impact' if kind == 'impact' else quantity),
                unit=fault.unit,
                time=fault.time,
                measured=fault.recorded,
                expected=fault.expected,
                tolerance=fault.tolerance,
                text=text,
            )


def log_findings(
    stretch: RecordedStretch,
    search: FaultSearch | None,
    *,
    controlled: bool,
    replayed: Sequence[Finding] | None = None,
) -> list[Finding]:
    """Return what is wrong with the log of a stretch, the earliest first."""
    if replayed is not None and not replayed:
        return []
    found = _motion_findings(stretch, search, controlled=controlled)
    if found and replayed:
        # A log that contradicts itself says what is wrong with it.
        own = [finding for finding in replayed if finding.quantity.endswith(_OF_PARAMETERS)]
        return [*own, *sorted(found, key=lambda finding: finding.time)]
    return sorted(found or list(replayed or ()), key=lambda finding: finding.time)


def _motion_findings(
    stretch: RecordedStretch, search: FaultSearch | None, *, controlled: bool
) -> list[Finding]:
    rig = stretch.parameters
    found = list(impulse_findings(stretch.impacts))
    fit = None
    driven = rig.multisine_level == 0.0
    if search is not None and driven and search.unsound > _MOST_DISOBEY * search.intervals:
        assert stretch.clock is not None
        start = float(stretch.states.time[0]) if len(stretch.states) else stretch.start
        fit = fit_one_parameter(
            stretch.clock, stretch.states, stretch.impacts, stretch.stop_before(start)
        )
    if fit is not None:
        found.append(_fit_finding(fit, stretch.start))
    else:
        found += restitution_findings(rig, stretch.impacts)
    if not controlled:
        found += gap_findings(rig, stretch.states, stretch.impacts)
    if search is not None and not found:
        faults = [f for f in search.faults if f.kind != 'missing' or not stretch.excuses(f.time)]
        found += _fault_findings(faults)
        if search.in_closed_form and search.unsound > max(_TOLD, _FEW * search.intervals):
            found.append(_disobeyed(stretch, search))
    if not found:
        found += restitution_findings(rig, stretch.impacts, single=True)
        found += stop_findings(rig, stretch.control, stretch.states)
        found += contact_findings(rig, stretch.states, stretch.impacts, moving=controlled)
    return found


def _disobeyed(stretch: RecordedStretch, search: FaultSearch) -> Finding:
    text = (
        f'{search.unsound} of {search.intervals} recorded values do not follow from the ones '
        'before by the equations of motion'
    )
    share = search.unsound / search.intervals
    return Finding('equations of motion', '', stretch.start, share, 0.0, _FEW, text)


def repaired_impacts(stretch: RecordedStretch, search: FaultSearch | None) -> RecordedImpacts:
    """Return the impacts, with the few wrong ones as they should be."""
    impacts = stretch.impacts
    if search is None or not search.repairs or len(search.repairs) > _REPAIRED * len(impacts):
        return impacts
    parts, begin = [], 0
    for repair in search.repairs:
        first, last = impacts.time.searchsorted([repair.start, repair.end], side='right')
        parts += [impacts[begin:first], repair.impacts]
        begin = int(last)
    return RecordedImpacts.joined([*parts, impacts[begin:]])
