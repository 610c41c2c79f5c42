# SPDX-License-Identifier: Apache-2.0
"""
A rig fitted to measured data: the twin of a rig that exists.

For given K, C and instants of impacts the motion of M is linear in its state after each of them,
whatever m does, and the laws of m are linear in restitution, friction and gap. So the parameters
are found in steps: impacts, K and C from M alone (`partition`); the parameters of m by a linear
regression (`first_guess`); all at once with the laws, at first softly (`relaxation`); and then in
turns with a replay of each flight by the exact engine (`revision`), until nothing changes.
Intervals are those of the linearised model with the noise that the residuals show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .acceptance import WRONG_RIG, judged
from .alternatives import Alternative, alternatives
from .course import Course
from .estimate import Estimate
from .excitation import ExcitationError, excited
from .first_course import UnfitRecordError, first_course
from .gauss_newton import System, solve
from .measured_motion import MeasuredMotion
from .parameter_estimates import Correlations, estimates_of
from .partition import Record, noise_between, noise_of
from .record_check import faults_of
from .relaxation import relaxed
from .revision import Revised, chi_of, revised
from .shooting import Shooting
from .unknowns import EXTRAS, Unknowns, later
from .vibration import ORDERS, Array

#: What may be fitted beside K, C, one restitution, friction and gap.
FURTHER = ('restitution_2', *EXTRAS)
#: Samples closer to an impact than this (s), or this many samples, are not used of a velocity or
#: an acceleration, which jumps there.
_CONTACT, _AROUND = 1e-3, 0.75

#: A clock that begins so far from 0, s, leaves too few digits for derivatives by the time.
_FAR = 1e4
#: Impacts are looked for as if the noise were at least this part of the motion (rms): a record of
#: a simulation has none, and what the first, rough model leaves would pass for impacts.
_LEAST_NOISE = 0.01
#: ... and standard deviations are at least those of this noise, which rounding makes.
_ROUNDING = 1e-6

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
        Instants of its impacts, s.
    reversals : int
        How often m reverses in it.
    used : bool
        Whether it counts.
    why_not : str
        Why it does not; empty if it does.
    residual : float
        Root mean square of its residuals over the standard deviation; NaN without samples.
    gain : float
        By how much chi squared would fall if its laws did not hold.
    """

    start: float
    end: float
    reversals: int
    used: bool
    why_not: str
    residual: float
    gain: float


class RigFit(NamedTuple):
    """
    A rig as fitted, and how far it is known.

    Attributes
    ----------
    accepted : bool
        Whether the model describes the record, by the rule in `acceptance`.
    reasons : list of str
        Why it is not accepted.
    remarks : list of str
        What to know of it: parameters that cannot be distinguished.
    parameters : dict of Estimate
        By the names of the ROS parameters, then what was fitted of sensor and clocks; empty if
        nothing could be fitted.
    correlations : dict
        Of each two of them, by their names.
    chi_squared : float
        Mean square of the residuals over that of the noise, as fourth differences show it.
    fit_percent : float
        100 (1 - |residual|/|motion - mean|).
    whiteness : float
        Correlation of neighbouring residuals over its standard deviation, 0 for white ones; NaN
        if nothing could be fitted, or the residuals are those of rounding.
    deviation : float
        Standard deviation of the noise, from the residuals.
    impacts : ndarray of IMPACT_TYPE
        The fitted impacts; `speed` is that of the approach, relative to the stop, `measured_time`
        is NaN where none was.
    flights : list of FittedFlight
        Those between them.
    checks : list of Alternative
        Further parameters that the model does not have, and whether the data ask for them.
    motion, residuals : ndarray, shape (n,)
        The fitted signal at the instants of the record, and the record less that; NaN where no
        flight counts.
    rig : RigParameters or None
        The fitted rig; None if nothing could be fitted.
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
    checks: list[Alternative]
    motion: Array
    residuals: Array
    rig: RigParameters | None


class FitOptionError(ValueError):
    """An option of a fit that there is not."""


def fit_rig(
    measured: MeasuredMotion,
    start: RigParameters,
    *,
    also: Sequence[str] = (),
) -> RigFit:
    """
    Fit a rig to its measured motion.

    Parameters
    ----------
    measured : MeasuredMotion
        The motion of M, with impact times if there are any.
    start : RigParameters
        The rig: masses, force or motion of the base (unless they were recorded), and angle are
        taken from it, stiffness and damping are guesses (within 5 % and 60 %). The rest of it
        does not count.
    also : sequence of str, optional
        What to fit besides: 'restitution_2' for a restitution of its own of stop 2, 'bias' of
        the sensor, 'force_delay' of the force.

    Returns
    -------
    RigFit
        The estimates with their intervals, and whether the model describes the record.

    Raises
    ------
    FitOptionError
        If a name in `also` is none of `FURTHER`.
    """
    for name in also:
        if name not in FURTHER:
            raise FitOptionError(f'{name!r} cannot be fitted: give names of {", ".join(FURTHER)}')
    try:
        start, remarks = excited(measured, start)
    except ExcitationError as error:
        return _refused(measured, [str(error)])
    began = float(measured.time[0])
    if abs(began) < _FAR or start.multisine_level:
        began = 0.0
    found = _fitted(_earlier(measured, began), later(start, -began), also)
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


def _fitted(measured: MeasuredMotion, start: RigParameters, also: Sequence[str]) -> RigFit:
    """Fit a rig whose excitation is known."""
    faults = faults_of(measured, start, also)
    if faults:
        return _refused(measured, faults)
    extras = tuple(name for name in EXTRAS if name in also)
    unknowns = Unknowns(start, 'restitution_2' in also, extras)
    record = Record(
        np.asarray(measured.time, float),
        np.where(measured.used, measured.motion, 0.0),
        np.asarray(measured.used, float),
        ORDERS[measured.quantity],
    )
    times = np.zeros(0) if measured.impact_times is None else np.asarray(measured.impact_times)
    inside = (times > record.time[0]) & (times < record.time[-1])
    times = times[inside]
    least = _LEAST_NOISE * float(np.std(record.motion[measured.used]))
    noise = max(noise_of(record.motion[measured.used]), least)
    rough = noise
    step = float(np.median(np.diff(record.time)))
    masked = max(_CONTACT, _AROUND * step) if record.order else 0.0

    def problem(course: Course) -> Shooting:
        return Shooting(record, noise, unknowns, course, times, measured.impact_deviation, masked)

    try:
        course = first_course(record, unknowns, noise, times, measured.impact_deviation)
        course = relaxed(course, problem, timed=len(times) > 0)
        noise = max(_noise(problem(course), rough), least)
        found = revised(course, problem)
    except UnfitRecordError as error:
        return _refused(measured, [str(error)])
    except ParameterError as error:
        return _refused(measured, [f'no such rig moves like that (its {error}): {WRONG_RIG}'])
    except (RuntimeError, np.linalg.LinAlgError) as error:
        # A matrix without an inverse, or a flight that the engine cannot compute
        return _refused(measured, [f'the equations of the fit have no unique solution ({error})'])
    if not found.course.flies.any():
        return _refused(measured, [f'no flight obeys the laws of the damper: {WRONG_RIG}'])
    chi = found.chi
    chi *= noise / max(_noise(found.shooting, noise), _ROUNDING * least / _LEAST_NOISE)
    found = found.without_doubtful()
    # Weights of data and of impact times by the noise that the residuals show
    noise = max(noise * found.chi, _ROUNDING * least / _LEAST_NOISE)
    shooting = problem(found.course)
    solution = solve(shooting, shooting.start())
    found = found._replace(
        course=shooting.course_of(solution.unknowns), shooting=shooting, solution=solution
    )
    return _result(measured, found, chi)


def _noise(shooting: Shooting, otherwise: float) -> float:
    """Return the noise that fourth differences of the residuals show between impacts."""
    motion, counts = shooting.motion(shooting.start())
    residuals = np.where(counts, shooting.record.motion - motion, np.nan)
    found = noise_between(residuals, shooting.record.time, shooting.course.time)
    return found if found > 0.0 else otherwise


def _refused(measured: MeasuredMotion, reasons: list[str]) -> RigFit:
    """Return a fit of nothing, with the reasons."""
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


def _result(measured: MeasuredMotion, found: Revised, chi: float) -> RigFit:
    shooting, solution = found.shooting, found.solution
    unknowns, u = shooting.unknowns, solution.unknowns
    shared, _ = shooting.parts(u)
    swing = float(np.std(measured.motion[measured.used]))
    rounding = _ROUNDING * swing / shooting.deviation
    chi_now = chi_of(shooting, solution)
    scale = max(chi_now, rounding)
    columns = np.arange(shooting.count)
    covariance = System(solution.equations, 1e-11).covariance(columns) * scale**2
    parameters, correlations = estimates_of(unknowns, shared, covariance)
    checks = alternatives(shooting, solution, scale)
    judgement = judged(found, chi, checks, parameters, correlations)
    motion, counts = shooting.motion(u)
    residuals = np.where(counts, measured.motion - motion, np.nan)
    used = residuals[counts]
    signal = np.asarray(measured.motion)[counts]
    size = float(np.linalg.norm(signal - signal.mean()))
    return RigFit(
        accepted=judgement.accepted,
        reasons=judgement.reasons,
        remarks=judgement.remarks,
        parameters=parameters,
        correlations=correlations,
        chi_squared=chi * chi,
        fit_percent=100.0 * (1.0 - float(np.linalg.norm(used)) / size) if size else 0.0,
        whiteness=_whiteness(used) if chi_now > rounding else math.nan,
        deviation=shooting.deviation * scale,
        impacts=_impacts(shooting, u),
        flights=_flights(found, residuals, shooting.deviation * scale),
        checks=checks,
        motion=motion,
        residuals=residuals,
        rig=unknowns.rig_of(shared),
    )


def _whiteness(residuals: Array) -> float:
    """Return the correlation of neighbouring residuals over its standard deviation."""
    power = float(residuals @ residuals)
    if len(residuals) < 3 or power == 0.0:
        return 0.0
    return float(residuals[1:] @ residuals[:-1]) / power * math.sqrt(len(residuals))


def _impacts(shooting: Shooting, u: Array) -> NDArray[np.void]:
    """Return the table of fitted impacts."""
    course = shooting.course_of(u)
    shared, _ = shooting.parts(u)
    jump = shooting.jumps(u)
    alpha = shared[shooting.alpha_column[shooting.impacts]]
    table = np.zeros(len(course), IMPACT_TYPE)
    table['time'], table['stop'] = course.time, np.where(course.stop > 0, 1, 2)
    table['x'] = course.x
    table['speed'] = np.where(course.begins, np.nan, np.abs(alpha * jump))
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
    for k in range(len(course) - 1):
        part = residuals[edges[k] : edges[k + 1]]
        part = part[np.isfinite(part)]
        flights.append(
            FittedFlight(
                float(course.time[k]),
                float(course.time[k + 1]),
                len(course.reversals[k]),
                bool(course.flies[k]),
                '' if course.flies[k] else found.why_cut.get(k + 1, 'it was left out'),
                float(np.sqrt(np.mean(part**2)) / deviation) if len(part) else math.nan,
                float(found.gains[k]),
            )
        )
    return flights
