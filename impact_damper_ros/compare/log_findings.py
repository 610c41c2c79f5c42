"""
Faults of a log: contradictions within it, and with the parameters of the rig, as sentences.

The position of m at an impact determines the gap, the velocities of approach and separation the
restitution, and both masses receive equal impulses. None of this needs the motion between the
impacts. If that violates the equations of motion, each parameter in turn is fitted to the
residuals, with all others as logged.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import ParameterError, RigParameters

from .flight_check import Fault, FaultSearch, check_intervals
from .recorded_stretch import (
    ForceClock,
    RecordedImpacts,
    RecordedStates,
    RecordedStretch,
    knots_of,
    largest_size,
)
from .result import Array, Finding

# Stops, restitution and impulses


_TOLERANCE = 1e-9
# The relative speed of slower impacts has lost its digits.
_SLOW = 1e-6
_LEAST_IMPACTS = 3
_ROUND_OFF = 1e-12


def _last_run(wrong: NDArray[np.bool_]) -> int:
    """Return the index from which on all values are wrong; the length if there is none."""
    right = np.flatnonzero(~wrong)
    return int(right[-1]) + 1 if len(right) else 0


@dataclass(frozen=True)
class _StopPlace:
    """Y of a stop, the time since when it is there, and the evidence in words."""

    y: float
    time: float
    seen: str


def _misplaced(
    stop: int,
    expected: float,
    tolerance: float,
    states: RecordedStates,
    impacts: RecordedImpacts,
) -> _StopPlace | None:
    """Return where a stop is at the end of a stretch, if not at the Y expected."""
    at = (states.stop_1 if stop == 1 else states.stop_2) - states.x
    off = np.abs(at - expected) > tolerance
    # A stop that had to give way to m follows it to its place, in contact with it.
    astray = off & (np.abs(at - (states.z - states.x)) > tolerance)
    hit = impacts.stop == stop
    where, when = (impacts.z - impacts.x)[hit], impacts.time[hit]
    begin = _last_run(np.abs(where - expected) > tolerance)
    count = len(where) - begin
    if count >= _LEAST_IMPACTS:
        later = states.time >= when[begin]
        if not later.any() or astray[later].any() or not off[later].all():
            seen = f'{count} impacts from {when[begin]:.9g} s on'
            return _StopPlace(float(np.median(where[begin:])), float(when[begin]), seen)
    first = _last_run(astray)
    if len(at) - first >= _LEAST_IMPACTS:
        time = float(states.time[first])
        seen = f'joint states from {time:.9g} s on'
        return _StopPlace(float(np.median(at[first:])), time, seen)
    return None


def _gap_findings(
    rig: RigParameters, states: RecordedStates, impacts: RecordedImpacts
) -> Iterator[Finding]:
    """Check that m hits the stops, and that these are, where the logged gap has them."""
    half = 0.5 * rig.gap
    length = max(half, largest_size(states.x, impacts.x))
    tolerance = _TOLERANCE * (half + length)
    sides = ((1, half),) if rig.one_sided else ((1, half), (2, -half))
    found = {
        stop: place
        for stop, expected in sides
        if (place := _misplaced(stop, expected, tolerance, states, impacts)) is not None
    }
    if not found:
        return
    if len(found) == 2:
        gap = found[1].y - found[2].y
    else:
        gap = half + abs(next(iter(found.values())).y)
    where = ' and '.join(
        f'stop {stop} is at Y = {place.y:.9g} m ({place.seen})' for stop, place in found.items()
    )
    time = min(place.time for place in found.values())
    text = f'{where}: a gap of {gap:.9g} m; logged is {rig.gap:.9g} m'
    yield Finding('gap', 'm', time, gap, rig.gap, 2.0 * tolerance, text)


def _contact_findings(
    rig: RigParameters, states: RecordedStates, impacts: RecordedImpacts, *, moving: bool
) -> Iterator[Finding]:
    """
    Find single impacts on the wrong stop: by the direction of the impulse, and by where m is.

    With `moving`, stops may be anywhere, and only the direction counts.
    """
    if not len(impacts):
        return
    half = 0.5 * rig.gap
    side = np.where(impacts.stop == 1, 1.0, -1.0)
    with np.errstate(over='ignore', invalid='ignore'):
        outward = side * (impacts.z - impacts.x)
        tolerance = _TOLERANCE * (half + largest_size(states.x, impacts.x))
        # A stop that follows m comes inwards from where the joint states show it first.
        y = states.z - states.x
        at_stop = [np.abs(stop - states.z) <= tolerance for stop in (states.stop_1, states.stop_2)]
        farthest = np.abs(y[at_stop[0] | at_stop[1]]).max(initial=half)
        there = (outward >= half - tolerance) & (outward <= farthest + tolerance)
        wrong = np.flatnonzero(~((side * impacts.primary_impulse >= 0.0) & (there | moving)))
    if len(wrong):
        first = int(wrong[0])
        time, found = float(impacts.time[first]), float(side[first] * outward[first])
        text = (
            f'{len(wrong)} impacts are not at their stop or push M in the wrong direction, first '
            f'on stop {impacts.stop[first]:.0f} at {time:.9f} s: Y is {found:.9g} m, the impulse '
            f'on M {impacts.primary_impulse[first]:.9g} N s'
        )
        expected = float(side[first]) * half
        yield Finding('Y at impact', 'm', time, found, expected, tolerance, text)


def _stop_findings(stretch: RecordedStretch) -> Iterator[Finding]:
    """Find joint states with an impossible position or velocity of a stop."""
    rig, control, states = stretch.parameters, stretch.control, stretch.states
    half, active = 0.5 * rig.gap, stretch.controlled
    speed = float(control.get('actuator_speed') or 0.0) if active else 0.0
    reach = max(half, 0.5 * float(control.get('gap_max', 0.0))) if active else half
    place = _TOLERANCE * (reach + largest_size(states.x, states.z))
    rate = _TOLERANCE * (speed + largest_size(states.velocity, states.damper_velocity))
    with np.errstate(over='ignore', invalid='ignore'):
        y, y_rate = states.z - states.x, states.damper_velocity - states.velocity
        for stop, side, position, velocity in (
            (1, 1.0, states.stop_1, states.stop_1_velocity),
            (2, -1.0, states.stop_2, states.stop_2_velocity),
        ):
            at, moving = position - states.x, velocity - states.velocity
            touching = np.abs(at - y) <= place
            standing = np.abs(moving) <= rate
            right = touching | (np.abs(at - side * half) <= place)
            if active:
                right = (side * (at - y) >= -place) & (side * at <= reach + place)
            right &= (
                standing
                | (touching & (np.abs(moving - y_rate) <= rate))
                | ((speed > 0.0) & (np.abs(moving) <= speed + rate))
            )
            wrong = np.flatnonzero(~right)
            if len(wrong) and not (stop == 2 and rig.one_sided):
                first = int(wrong[0])
                time, found = float(states.time[first]), float(at[first])
                text = (
                    f'in {len(wrong)} joint states stop {stop} has an impossible position or '
                    f'velocity, first at {time:.9g} s: Y is {found:.9g} m, its rate in M '
                    f'{moving[first]:.9g} m/s'
                )
                yield Finding(f'stop_{stop}', 'm', time, found, side * half, place, text)


def _restitution_findings(
    rig: RigParameters, impacts: RecordedImpacts, *, single: bool = False
) -> Iterator[Finding]:
    """
    Check the velocities after impacts against the logged coefficients of restitution.

    With `single`, single impacts at which they do not are reported, too.
    """
    before = impacts.damper_velocity_before(rig) - impacts.velocity_before(rig)
    after = impacts.damper_velocity_after - impacts.velocity_after
    fast = np.abs(before) > _SLOW * largest_size(before)
    for stop, expected in ((1, rig.restitution_1), (2, rig.restitution_2)):
        hit = fast & (impacts.stop == stop)
        if hit.sum() < _LEAST_IMPACTS:
            continue
        found = -after[hit] / before[hit]
        time = impacts.time[hit]
        measured, first, tolerance = float(np.median(found)), 0, _TOLERANCE
        name = f'restitution_{stop}'
        text = (
            f'at stop {stop} the ratio of separation to approach speed is {measured:.9g} '
            f'(median of {len(found)} impacts, from impulses and logged masses); logged is '
            f'{name} = {expected:.9g}'
        )
        if abs(measured - expected) <= _TOLERANCE:
            # Slow ones are known less well.
            slack = _TOLERANCE + _ROUND_OFF * largest_size(before, after) / np.abs(before[hit])
            wrong = np.flatnonzero(~(np.abs(found - expected) <= slack))
            if not len(wrong) or not single:
                continue
            first = int(wrong[0])
            measured, tolerance = float(found[first]), float(slack[first])
            text = (
                f'{len(wrong)} of {len(found)} impacts on stop {stop} contradict '
                f'{name} = {expected:.9g}, first at {time[first]:.9f} s: the ratio of '
                f'separation to approach speed is {measured:.9g}'
            )
        yield Finding(name, '', float(time[first]), measured, expected, tolerance, text)


def _impulse_findings(impacts: RecordedImpacts) -> Iterator[Finding]:
    """Check that both masses receive the same impulse."""
    if not len(impacts):
        return
    scale = largest_size(impacts.primary_impulse) or 1.0
    off: Array = impacts.primary_impulse + impacts.damper_impulse
    wrong = np.flatnonzero(~(np.abs(off) <= _TOLERANCE * scale))
    if not len(wrong):
        return
    first = worst = int(wrong[0])
    if np.isfinite(off[wrong]).any():
        worst = int(wrong[np.nanargmax(np.abs(off[wrong]))])
    on_m, on_primary = float(impacts.damper_impulse[worst]), float(impacts.primary_impulse[worst])
    time = float(impacts.time[first])
    text = (
        f'{len(wrong)} impacts do not give M and m equal impulses: up to {on_m:.9g} N s on m '
        f'and {on_primary:.9g} N s on M, first at {time:.9f} s'
    )
    yield Finding('impulse', 'N s', time, on_m, -on_primary, _TOLERANCE * scale, text)


# Fits to the residuals of the equations of motion


_MOST_KNOTS = 1000
_STEPS = 8
_DIFFERENCE = 1e-6
#: Largest share of the residual that an explanation may leave.
_EXPLAINS = 0.02
_ALIKE = 3.0


@dataclass(frozen=True)
class _ParameterFit:
    """A parameter with which a log obeys the equations of motion."""

    name: str
    unit: str
    logged: float
    fitted: float
    left: float  # share of the root-mean-square residual that is left
    alike: tuple[str, ...] = ()  # other parameters that would explain the residuals as well


def _fitted_parameters(rig: RigParameters) -> Iterator[tuple[str, str, float]]:
    """Yield name, unit and scale of the parameters that may be wrong."""
    yield 'primary_mass', 'kg', rig.primary_mass
    yield 'stiffness', 'N/m', rig.stiffness
    yield 'damping', 'N s/m', math.sqrt(rig.stiffness * rig.primary_mass)
    yield 'damper_mass', 'kg', rig.damper_mass
    yield 'angle', 'rad', 1.0
    yield 'friction', '', 1.0
    yield 'gravity', 'm/s^2', 10.0
    yield 'air_force', 'N', rig.damper_mass
    yield 'force_amplitudes', 'N', abs(rig.force_amplitudes[0]) or 1.0
    yield 'force_frequencies', 'rad/s', rig.force_frequencies[0] or 1.0
    yield 'force_phases', 'rad', 1.0


def _fit_one_parameter(
    clock: ForceClock, states: RecordedStates, impacts: RecordedImpacts, last_stop: int
) -> _ParameterFit | None:
    """Look for the one parameter whose logged value is wrong."""
    states, rig = states[:_MOST_KNOTS], clock.parameters
    if len(states) < 2:
        return None
    impacts = impacts[(impacts.time >= states.time[0]) & (impacts.time <= states.time[-1])]
    tolerances = check_intervals(clock, knots_of(rig, states, impacts, last_stop)).tolerances

    def residuals(trial: RigParameters) -> Array:
        knots = knots_of(trial, states, impacts, last_stop)
        found = check_intervals(replace(clock, parameters=trial), knots)
        scaled = np.where(found.plain[:, None], found.residuals / tolerances, 0.0)
        return np.nan_to_num(scaled, posinf=0.0, neginf=0.0).ravel()

    start = residuals(rig)
    size = float(np.linalg.norm(start))
    fits: list[_ParameterFit] = []
    for name, unit, scale in _fitted_parameters(rig):
        held = getattr(rig, name)
        logged = float(held[0] if isinstance(held, tuple) else held)

        def at(value: float, name: str = name, held: object = held) -> Array:
            entry = (value, *held[1:]) if isinstance(held, tuple) else value
            return residuals(rig.replace(**{name: entry}))

        try:
            fitted, left = _least_squares(at, logged, start, _DIFFERENCE * scale)
        except ParameterError:
            continue
        if left < _EXPLAINS * size:
            fits.append(_ParameterFit(name, unit, logged, fitted, left / size))
    if not fits:
        return None
    least = min(fit.left for fit in fits)
    best, *alike = (fit for fit in fits if fit.left <= _ALIKE * least)
    return replace(best, alike=tuple(fit.name for fit in alike))


def _least_squares(
    residuals: Callable[[float], Array], value: float, at: Array, step: float
) -> tuple[float, float]:
    """
    Return the best value of a parameter by Gauss and Newton's method, and the norm left.

    `scipy.optimize.least_squares` takes 5 to 10 times as long, since it polishes the ten
    parameters that explain nothing.
    """
    size = float(np.linalg.norm(at))
    for _ in range(_STEPS):
        slope = (residuals(value + step) - at) / step
        steepness = float(slope @ slope)
        if steepness == 0.0:
            break
        trial = value - float(slope @ at) / steepness
        there = residuals(trial)
        if not float(np.linalg.norm(there)) < 0.999 * size:
            break
        value, at, size = trial, there, float(np.linalg.norm(there))
    return value, size


_MOST_CLOCK_KNOTS = 4000
#: Share of the residual without a force that the fitted one may leave.
_LEFT = 1e-3


def with_fitted_clock(
    stretch: RecordedStretch,
) -> tuple[RecordedStretch, FaultSearch | None]:
    """
    Return a stretch with the phase of its force found from the joint states, and its check.

    Between two joint states the force adds to X and X' what is linear in the sine and the cosine
    of its phase; both are found by least squares. The clock stays unknown if the force is not one
    harmonic, or does not explain the motion.
    """
    rig, states = stretch.parameters, stretch.states[:_MOST_CLOCK_KNOTS]
    amplitude = rig.force_amplitudes[0]
    if len(states) < 4 or not rig.periodic_force:
        return stretch, None
    start = float(states.time[0])
    knots = stretch.knots(start, float(states.time[-1]))

    def residuals(force: float, angle: float) -> Array:
        trial = ForceClock(
            rig.replace(force_amplitudes=(force, *rig.force_amplitudes[1:])),
            start,
            (angle,) * len(rig.force_phases),
        )
        found = check_intervals(trial, knots)
        scaled = found.residuals[:, :2] / np.array([1.0, rig.omega])
        return np.asarray(scaled[found.plain].ravel())

    offset = -rig.force_phases[0]
    free = residuals(0.0, 0.0)
    parts = [free - residuals(amplitude, offset + turn) for turn in (0.0, math.pi / 2.0)]
    (sine, cosine), *_ = np.linalg.lstsq(np.column_stack(parts), free, rcond=None)
    if not math.isclose(math.hypot(sine, cosine), 1.0, rel_tol=0.5):
        return stretch, None
    angle = math.atan2(cosine, sine)
    left = residuals(amplitude, offset + angle)
    if not float(np.linalg.norm(left)) < _LEFT * float(np.linalg.norm(free)):
        return stretch, None
    clock = ForceClock(rig, start, (offset + angle,) * len(rig.force_phases))
    search = FaultSearch(clock, in_closed_form=stretch.controlled)
    search.take(stretch.knots(stretch.start, stretch.end), final=True)
    return replace(stretch, clock=clock), search


# In words


#: Share of the intervals that disobey the equations of motion if a parameter is wrong.
_MOST_DISOBEY = 0.1
#: Topics that name the parameters.
_OF_PARAMETERS = ('/parameter_events', '/snapshot')
#: Faults reported one by one, and share of the impacts that may be repaired.
_ONE_BY_ONE = 3
_FEW = 0.01
_REPAIRED = 0.05


def _fit_finding(fit: _ParameterFit, time: float) -> Finding:
    unit = f' {fit.unit}' if fit.unit else ''
    alike = f' (or another {" or ".join(fit.alike)} instead)' if fit.alike else ''
    text = (
        f'the recorded motion obeys the equations of motion with {fit.name} = '
        f'{fit.fitted:.9g}{unit}{alike}; logged is {fit.logged:.9g}{unit}'
    )
    doubt = abs(fit.fitted - fit.logged) * fit.left
    return Finding(fit.name, fit.unit, time, fit.fitted, fit.logged, doubt, text)


def _delay(seconds: float) -> str:
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
            f'the motion recorded up to {fault.time:.9g} s does not follow from that before: '
            'other impacts, reversals or rest are expected'
        )
    if fault.kind == 'motion':
        return (
            f'the motion recorded up to {fault.time:.9g} s does not follow from that before: '
            f'{fault.quantity} is {fault.recorded:.9g} {fault.unit}, off by {difference:+.6g} '
            f'{fault.unit}'
        )
    if fault.quantity == 'instant':
        return f'{hit} is stamped {_delay(difference)}'
    return (
        f'{fault.quantity} of {hit} is {fault.recorded:.9g} {fault.unit}, off by '
        f'{difference:+.6g} {fault.unit}'
    )


def _fault_findings(faults: Sequence[Fault]) -> Iterator[Finding]:
    """Yield the faults one by one if they are few, else the first and their number."""

    def sort(fault: Fault) -> tuple[str, str]:
        return fault.kind, fault.quantity

    for (kind, quantity), group in groupby(sorted(faults, key=sort), key=sort):
        alike = sorted(group, key=lambda fault: fault.time)
        for fault in alike if len(alike) <= _ONE_BY_ONE else alike[:1]:
            text = _fault_text(fault)
            if len(alike) > _ONE_BY_ONE:
                text += f'; {len(alike)} of this kind'
                sizes = [abs(f.recorded - f.expected) for f in alike]
                if not math.isnan(max(sizes)):
                    text += f', off by up to {max(sizes):.6g} {fault.unit}'
            name = {'missing': 'missing impact', 'surplus': 'surplus impact'}.get(kind)
            name = name or (f'{quantity} at impact' if kind == 'impact' else quantity)
            numbers = (fault.time, fault.recorded, fault.expected, fault.tolerance)
            yield Finding(name, fault.unit, *numbers, text)


def log_findings(
    stretch: RecordedStretch, search: FaultSearch | None, replayed: Sequence[Finding] | None = None
) -> list[Finding]:
    """
    Return the faults in the log of a stretch, the earliest first.

    `search` is the check of its flights, `replayed` what a bit-for-bit replay of the log found in
    it; each is None if there was none.
    """
    if replayed is not None and not replayed:
        return []
    found = _motion_findings(stretch, search, replayed=bool(replayed))
    if found and replayed:
        # A log that contradicts itself names the fault.
        own = [finding for finding in replayed if finding.quantity.endswith(_OF_PARAMETERS)]
        return [*own, *sorted(found, key=lambda finding: finding.time)]
    return sorted(found or list(replayed or ()), key=lambda finding: finding.time)


def _motion_findings(
    stretch: RecordedStretch, search: FaultSearch | None, *, replayed: bool
) -> list[Finding]:
    """Find faults by the motion; a replay that differs shows better which single number is."""
    rig, states, impacts = stretch.parameters, stretch.states, stretch.impacts
    found = list(_impulse_findings(impacts))
    fit = None
    driven = rig.multisine_level == 0.0
    if search is not None and driven and search.unsound > _MOST_DISOBEY * search.intervals:
        assert stretch.clock is not None
        start = float(states.time[0]) if len(states) else stretch.start
        fit = _fit_one_parameter(stretch.clock, states, impacts, stretch.stop_before(start))
    if fit is not None:
        found.append(_fit_finding(fit, stretch.start))
    else:
        found += _restitution_findings(rig, impacts)
    if not stretch.controlled:
        found += _gap_findings(rig, states, impacts)
    if search is not None and not found:
        found += _fault_findings(
            [
                f
                for f in search.faults
                if not (f.kind == 'missing' and stretch.may_lack_impact(f.time))
                and not (f.kind == 'motion' and replayed)
            ]
        )
        if search.in_closed_form and search.unsound > max(_ONE_BY_ONE, _FEW * search.intervals):
            found.append(_disobeyed(stretch, search))
    if not (found or replayed):
        found += _restitution_findings(rig, impacts, single=True)
        found += _stop_findings(stretch)
        found += _contact_findings(rig, states, impacts, moving=stretch.controlled)
    return found


def _disobeyed(stretch: RecordedStretch, search: FaultSearch) -> Finding:
    text = (
        f'{search.unsound} of {search.intervals} recorded values do not follow from the ones '
        'before by the equations of motion'
    )
    share = search.unsound / search.intervals
    return Finding('equations of motion', '', stretch.start, share, 0.0, _FEW, text)


def repaired_impacts(stretch: RecordedStretch, search: FaultSearch | None) -> RecordedImpacts:
    """Return the impacts, with a few wrong ones replaced by the simulated ones."""
    impacts = stretch.impacts
    if search is None or not search.repairs or len(search.repairs) > _REPAIRED * len(impacts):
        return impacts
    parts, begin = [], 0
    for repair in search.repairs:
        first, last = impacts.time.searchsorted([repair.start, repair.end], side='right')
        parts += [impacts[begin:first], repair.impacts]
        begin = int(last)
    return RecordedImpacts.joined([*parts, impacts[begin:]])
