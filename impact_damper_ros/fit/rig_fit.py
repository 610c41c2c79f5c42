# SPDX-License-Identifier: Apache-2.0
"""
A rig fitted to measured data.

For given K, C and instants of impacts the motion of M is linear in its state after each of them,
whatever m does, and the laws of m are linear in restitution, friction and gap. The parameters are
therefore found in steps: impacts, K and C from M alone (`impact_search`); the parameters of m by a
linear regression (`first_guess`); and all at once with the laws, in turns with a replay of each
flight by the exact engine (`revision`), until nothing changes.
Intervals are those of the linearised model with the noise of the residuals.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.parameter_spec import check_kind
from impact_damper_ros.parameters.rig_parameters import RigParameters, check_rig

from .acceptance import LEAST_USED, MOST_CHI, judge_fit
from .candidates import (
    OTHER_PHASE,
    RELATIVE,
    REVERSED,
    Candidate,
    base_of,
    misreading,
    one_vibration,
    wrong_file,
)
from .estimate import Estimate
from .excitation import ExcitationError, with_excitation
from .first_course import WRONG_RIG, UnfitRecordError, clock_offset_of, first_course
from .measured_motion import MeasuredMotion
from .parameter_estimates import Correlations, estimates_of
from .record import Record
from .record_check import faults_of
from .record_fit import NO_SUCH_RIG, OtherLawError, RecordFit, rough_noise
from .revision import UNCONFIRMED, Revised
from .shooting import Shooting
from .unknowns import CONSTANTS, EXTRAS, Unknowns, later
from .vibration import Array

#: Further parameters that may be fitted, besides K, C, one restitution, friction and gap.
FURTHER = (
    *('restitution_2', 'restitution_speed', 'bias', 'force_delay'),
    *('damper_mass', 'primary_mass'),
)
#: A clock that begins farther from 0, s, leaves too few digits for derivatives by the time.
_FAR = 1e4
#: A constant is far off beyond so many of its assumed deviations.
_FAR_MOVED = 3.0
#: A time is that of an impact within so many of its deviations, if more than this part of all are.
_NEAR, _MOST = 6.0, 0.8
#: Residuals of a record without impacts, over the noise; rigs whose impacts show leave more.
_ONE = 1.2
#: A delay within so much of half a period, in periods, is another sign.
_HALF = 0.01

IMPACT_TYPE = np.dtype(
    [
        ('time', 'f8'),
        ('stop', 'i8'),
        ('speed', 'f8'),
        ('x', 'f8'),
        ('primary_velocity_before', 'f8'),
        ('primary_velocity_after', 'f8'),
        ('measured_time', 'f8'),
        ('time_residual', 'f8'),
    ]
)


class FittedFlight(NamedTuple):
    """
    A flight between two impacts.

    Attributes
    ----------
    start, end : float
        Instants of the impacts at its ends, s.
    reversals, sticks : int
        How often m reverses, and how often it sticks.
    used : bool
        Whether the flight counts.
    why_not : str
        Why the flight does not count; empty if it does.
    residual : float
        Root mean square of the residuals over the standard deviation; NaN without samples.
    gain : float
        Fall of chi squared if the laws of the flight did not hold.
    """

    start: float
    end: float
    reversals: int
    sticks: int
    used: bool
    why_not: str
    residual: float
    gain: float


class RigFit(NamedTuple):
    """
    A fitted rig, and its uncertainty.

    Attributes
    ----------
    accepted : bool
        Whether the model describes the record, by the rule in `acceptance`.
    reasons : list of str
        Why the fit is not accepted.
    remarks : list of str
        Remarks on the fit: parameters that cannot be distinguished.
    parameters : dict of Estimate
        Estimates by the names of the ROS parameters, then those of sensor and clocks; empty
        without a fit.
    correlations : dict
        Correlation of each two parameters, by their names.
    chi_squared : float
        Mean square of the residuals over that of the noise, from fourth differences.
    fit_percent : float
        100 (1 - |residual|/|motion - mean|).
    whiteness : float
        Correlation of neighbouring residuals over its standard deviation, 0 for white ones; NaN
        without a fit, or if the residuals are those of rounding.
    deviation : float
        Standard deviation of the noise, from the residuals.
    impacts : ndarray of IMPACT_TYPE
        The fitted impacts; `speed` is that of the approach, relative to the stop, `measured_time`
        is NaN where no time was measured.
    flights : list of FittedFlight
        The flights between the impacts.
    checks : list of Candidate
        Further parameters that the model does not have, and their significance.
    motion, residuals : ndarray, shape (n,)
        The fitted signal at the instants of the record, and the record less that; NaN where no
        flight counts.
    rig : RigParameters or None
        The fitted rig; None without a fit.

    Examples
    --------
    >>> time = np.arange(0.0, 1.0, 0.005)
    >>> motion = MeasuredMotion(time, np.cos(time), 'displacement', np.ones(len(time), bool))
    >>> found = fit_rig(motion, RigParameters(gravity=0.0))
    >>> found.accepted, len(found.reasons) > 0
    (False, True)
    """

    accepted: bool
    reasons: list[str]
    remarks: list[str]
    parameters: dict[str, Estimate]
    correlations: Correlations
    chi_squared: float
    fit_percent: float
    whiteness: float
    deviation: float
    impacts: NDArray[np.void]
    flights: list[FittedFlight]
    checks: list[Candidate]
    motion: Array
    residuals: Array
    rig: RigParameters | None


class FitOptionError(ValueError):
    """An unknown option of a fit."""


def fit_rig(
    measured: MeasuredMotion,
    start: RigParameters,
    *,
    also: Sequence[str] = (),
    uncertain: Mapping[str, float] | None = None,
) -> RigFit:
    """
    Fit a rig to its measured motion.

    Parameters
    ----------
    measured : MeasuredMotion
        The motion of M, with impact times if there are any.
    start : RigParameters
        The start: masses, force or motion of the base (unless they were recorded), and angle are
        constants; stiffness and damping are guesses (within 5 % and 60 %). Other parameters do not
        count.
    also : sequence of str, optional
        Further parameters to fit: 'restitution_2' for another restitution of stop 2,
        'restitution_speed' for a restitution that falls with the speed of impact, with the
        exponent of the rig, 'bias' of the sensor, 'force_delay' of the force, 'damper_mass' or
        'primary_mass'. The bias of an acceleration is always fitted, and so is restitution_speed
        where the rig has one, or where it explains the record best.
    uncertain : mapping of str to float, optional
        Relative standard deviations of constants of the rig: `damper_mass` (0.005 if not given),
        `primary_mass` (0: it is the measure of all masses and forces), `force_amplitudes` and
        `base_amplitudes` (0.01). One that is not given may be wrong by 0.1, with a chance of 0.2.
        The record counts, too: the fitted rig has the combined values, and their remaining
        uncertainty enters all intervals.

    Returns
    -------
    RigFit
        The estimates with their intervals, and whether the model describes the record.

    Raises
    ------
    TypeError
        If the motion is no `MeasuredMotion`, or the start no `RigParameters`.
    FitOptionError
        If a name in `also` is none of `FURTHER`, or one in `uncertain` none of `CONSTANTS`.

    Examples
    --------
    >>> from impact_damper_ros import Rig
    >>> rig = RigParameters(gravity=0.0)
    >>> time, noise = np.arange(0.0, 200.0, 0.2), np.random.default_rng(1).standard_normal(1000)
    >>> run = Rig(rig).run(200.0, time)
    >>> x = run.samples['x'] + 0.01 * noise
    >>> found = fit_rig(MeasuredMotion(time, x, 'displacement', np.ones(1000, bool)), rig)
    >>> found.accepted, round(found.rig.gap, 1)
    (True, 37.0)
    """
    check_kind('measured', measured, MeasuredMotion, 'a MeasuredMotion, such as read_motion(path)')
    check_rig('start', start)
    for what, names, allowed in (
        ('fitted', also, FURTHER),
        ('uncertain', uncertain or {}, tuple(CONSTANTS)),
    ):
        for name in names:
            if name not in allowed:
                raise FitOptionError(
                    f'{name!r} cannot be {what}: give names of {", ".join(allowed)}'
                )
    asked = dict(uncertain or {}) | {name: math.inf for name in also if name in CONSTANTS}
    if measured.quantity == 'acceleration':
        also = [*also, 'bias']
    try:
        start, remarks = with_excitation(measured, start)
    except ExcitationError as error:
        return _refusal(measured, [str(error)])
    began = float(measured.time[0])
    if abs(began) < _FAR or start.multisine_level:
        began = 0.0
    try:
        # A wrong file may lead far away before it is refused.
        with np.errstate(all='ignore'):
            found = _fit(_earlier(measured, began), later(start, -began), also, asked)
    except OtherLawError as error:
        return _refusal(measured, [str(error)])
    found = found._replace(remarks=[*remarks, *found.remarks])
    return _on_clock(found, began) if began else found


def _earlier(measured: MeasuredMotion, began: float) -> MeasuredMotion:
    """Return a record whose clock begins anew at an instant."""
    times = measured.impact_times
    return measured._replace(
        time=np.asarray(measured.time, float) - began,
        impact_times=None if times is None else np.asarray(times, float) - began,
    )


def _on_clock(found: RigFit, began: float) -> RigFit:
    """Return a fit on the clock of a record that began anew."""
    impacts = found.impacts.copy()
    for name in ('time', 'measured_time'):
        impacts[name] += began
    flights = [
        flight._replace(start=flight.start + began, end=flight.end + began)
        for flight in found.flights
    ]
    rig = None if found.rig is None else later(found.rig, began)
    return found._replace(impacts=impacts, flights=flights, rig=rig)


def _fit(
    measured: MeasuredMotion,
    start: RigParameters,
    also: Sequence[str],
    uncertain: Mapping[str, float],
) -> RigFit:
    """Fit a rig whose excitation is known, or return the possible faults."""
    faults = faults_of(measured, start, also)
    if faults:
        return _refusal(measured, faults)
    extras = tuple(name for name in EXTRAS if name in also)
    if start.restitution_speed or 'restitution_speed' in also:
        extras += ('slowness',)
    unknowns = Unknowns(start, 'restitution_2' in also, extras, uncertain)
    record = Record(
        np.asarray(measured.time, float),
        np.where(measured.used, measured.motion, 0.0),
        np.asarray(measured.used, float),
        ORDERS[measured.quantity],
    )
    times = np.zeros(0) if measured.impact_times is None else np.asarray(measured.impact_times)
    inside = (times > record.time[0]) & (times < record.time[-1])
    times, deviation = times[inside], measured.impact_deviation
    noise = rough_noise(record)

    offset = clock_offset_of(record, start) if 'bias' in extras else 0.0
    level = record._replace(motion=record.motion - offset * record.weight)
    # Where no impacts show, a search finds some in the noise.
    if cause := misreading(level, start, noise) or one_vibration(level, start, noise, _ONE):
        return _refusal(measured, [cause])
    try:
        fit = RecordFit(record, unknowns, times, deviation)
        fit.run(first_course(record, unknowns, noise, times, deviation))
        found = _result(measured, fit)
    except UnfitRecordError as error:
        found = _refusal(measured, [str(error)])
    except NO_SUCH_RIG:
        found = _refusal(measured, [f'no rig like this one moves as recorded: {WRONG_RIG}'])
    if found.accepted or 'force_delay' in extras or _explains_record(found):
        return found
    cause, other = wrong_file(level, start, noise)
    if any(start.base_amplitudes) and not cause:
        base = base_of(start, record.time, record.order)
        absolute = measured._replace(motion=measured.motion + base)
        if _fit(absolute, start, [*also, 'force_delay'], uncertain).accepted:
            cause = RELATIVE
    elif not cause and len(times):
        without = _fit(
            measured._replace(impact_times=None), start, [*also, 'force_delay'], uncertain
        )
        if without.accepted:
            if _are_right(times, without.impacts['time'], deviation):
                remark = 'the impact times agree with the fit, and are not used in it'
                return without._replace(remarks=[*without.remarks, remark])
            clock = _clock(times, without.impacts['time'])
            cause = f'without the impact times the record is accepted: {clock}'
    elif other:
        with_it = _fit(measured, other, [*also, 'force_delay'], uncertain)
        # A wrong mass passes for another level, too, but not within a fit.
        if not (with_it.accepted or (cause == OTHER_PHASE and _explains_record(with_it))):
            cause = ''
        elif cause == OTHER_PHASE:
            turns = with_it.parameters['force_delay'].value * start.first_harmonic[1] / math.tau
            cause = REVERSED if abs(turns % 1.0 - 0.5) < _HALF else cause
    return found._replace(reasons=[cause, *found.reasons]) if cause else found


def _are_right(times: Array, impacts: Array, deviation: float) -> bool:
    """Return whether most measured times are those of impacts, and not late or early."""
    nearest = np.abs(times[:, None] - impacts).argmin(1)
    late = times - impacts[nearest]
    near = np.abs(late) < _NEAR * deviation
    return bool(near.mean() > _MOST and abs(np.median(late[near])) < deviation)


def _explains_record(found: RigFit) -> bool:
    """Return whether a fit describes enough of the record to find faults of the model."""
    used = sum(flight.used or flight.why_not == UNCONFIRMED for flight in found.flights)
    return used >= LEAST_USED * max(len(found.flights), 1) and found.chi_squared < MOST_CHI**2


def _refusal(measured: MeasuredMotion, reasons: list[str]) -> RigFit:
    """Return the result without a fit, with the reasons."""
    nothing = np.full(len(measured.time), np.nan)
    return RigFit(
        accepted=False,
        reasons=reasons,
        remarks=[],
        parameters={},
        correlations={},
        chi_squared=math.nan,
        fit_percent=math.nan,
        whiteness=math.nan,
        deviation=math.nan,
        impacts=np.zeros(0, IMPACT_TYPE),
        flights=[],
        checks=[],
        motion=nothing,
        residuals=nothing,
        rig=None,
    )


def _result(measured: MeasuredMotion, fit: RecordFit) -> RigFit:
    """Return the result of a fit, judged by the rule of acceptance."""
    found, known, checks = fit.found, fit.known, fit.checks
    shooting, u = found.shooting, found.solution.unknowns
    unknowns, shared = shooting.unknowns, shooting.parts(u)[0]
    parameters, correlations = estimates_of(unknowns, shared, known.covariance, known.names)
    for name, moved in fit.moved.items():
        if (one := parameters.get(name)) is not None:
            parameters[name] = one._replace(start=one.value / (1.0 + moved))
    judgement = judge_fit(found, fit.chi, checks, parameters, correlations)
    motion, counts = shooting.motion(u)
    residuals = np.where(counts, measured.motion - motion, np.nan)
    used = residuals[counts]
    signal = np.asarray(measured.motion)[counts]
    size = float(np.linalg.norm(signal - signal.mean()))
    scale = fit.scale_of(found)
    return RigFit(
        accepted=judgement.accepted,
        reasons=judgement.reasons,
        remarks=[
            *fit.remarks,
            *_far_constants(fit, parameters),
            *_lost_times(shooting, u),
            *judgement.remarks,
        ],
        parameters=parameters,
        correlations=correlations,
        chi_squared=fit.chi**2,
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(used)) / size) if size else 0.0,
        whiteness=_whiteness(used) if scale == found.chi else math.nan,
        deviation=shooting.deviation * scale,
        impacts=_impacts(shooting, u),
        flights=_flights(found, residuals, shooting.deviation * scale),
        checks=checks,
        motion=motion,
        residuals=residuals,
        rig=unknowns.rig_of(shared),
    )


def _far_constants(fit: RecordFit, parameters: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield constants of the file that the record moves beyond what is assumed of them."""
    for name, moved in fit.moved.items():
        uncertainty = fit.unknowns.uncertain.get(name, CONSTANTS[name].uncertainty)
        if name in parameters and abs(moved) > _FAR_MOVED * uncertainty > 0.0:
            yield (
                f'by the record {name} is {100.0 * moved:+.2g} % off the file, which is believed '
                f'to {100.0 * uncertainty:g} %: check it, and the clock of the record'
            )


def _lost_times(shooting: Shooting, u: Array) -> Iterator[str]:
    """Yield a remark if most of the measured impact times belong to no impact."""
    times, course = shooting.impact_times, shooting.course
    lost = len(times) - int((course.measured >= 0).sum())
    if 2 * lost <= len(times):
        return
    impacts = shooting.parts(u)[1][shooting.impacts, 0]
    yield (
        f'{lost} of {len(times)} impact times are those of no impact, and were not used: '
        f'{_clock(times, impacts)}'
    )


def _clock(times: Array, impacts: Array) -> str:
    """Return by how much measured times differ from those of the impacts, in words."""
    late = times - impacts[np.abs(times[:, None] - impacts).argmin(1)]
    middle, spread = np.median(late), 1.5 * np.median(np.abs(late - np.median(late)))
    if abs(middle) < 2.0 * spread:
        return 'check their clock'
    way = 'late' if middle > 0.0 else 'early'
    return f'they seem {abs(1e3 * middle):.2g} ms {way}, check their clock'


def _whiteness(residuals: Array) -> float:
    """Return the correlation of neighbouring residuals over its standard deviation."""
    power = float(residuals @ residuals)
    if len(residuals) < 3 or power == 0.0:
        return 0.0
    return float(residuals[1:] @ residuals[:-1]) / power * math.sqrt(len(residuals))


def _impacts(shooting: Shooting, u: Array) -> NDArray[np.void]:
    """Return the table of fitted impacts."""
    course = shooting.course_of(u)
    jump = shooting.jumps(u)
    table = np.zeros(len(course), IMPACT_TYPE)
    table['time'], table['stop'] = course.time, np.where(course.stop > 0, 1, 2)
    table['x'] = course.x
    table['speed'] = np.where(course.begins, np.nan, shooting.speeds(u))
    table['primary_velocity_after'] = course.velocity
    table['primary_velocity_before'] = np.where(course.begins, np.nan, course.velocity - jump)
    timed = course.measured >= 0
    table['measured_time'] = np.nan
    table['measured_time'][timed] = shooting.impact_times[course.measured[timed]]
    table['time_residual'] = table['measured_time'] - course.time
    return table


def _flights(found: Revised, residuals: Array, deviation: float) -> list[FittedFlight]:
    """Return the flights between the impacts."""
    course, time = found.course, found.shooting.record.time
    edges = np.searchsorted(time, course.time)
    flights = []
    # Each stick ends in a release
    sticks = [int((ways == 0).sum()) for ways in course.after]
    for k in range(len(course) - 1):
        part = residuals[edges[k] : edges[k + 1]]
        part = part[np.isfinite(part)]
        flights.append(
            FittedFlight(
                float(course.time[k]),
                float(course.time[k + 1]),
                len(course.after[k]) - 2 * sticks[k],
                sticks[k],
                bool(course.flies[k]),
                '' if course.flies[k] else found.why_cut.get(k + 1, 'it was left out'),
                float(np.sqrt(np.mean(part**2)) / deviation) if len(part) else math.nan,
                float(found.gains[k]),
            )
        )
    return flights
