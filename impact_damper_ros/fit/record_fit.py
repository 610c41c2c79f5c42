# SPDX-License-Identifier: Apache-2.0
"""The fit of one record from its first course: the course, the constants, the checks."""

from __future__ import annotations

import numpy as np

from impact_damper_ros.parameters.parameter_spec import ParameterError

from .candidates import OVER_SPEED, Candidate, Evidence, shared_with_fall
from .constant_estimates import ConstantEstimates, own_covariance
from .contradictions import without_contradictions
from .course import Course
from .first_course import WRONG_RIG, UnfitRecordError
from .record import Record, noise_between, noise_of
from .revision import Revised, revise
from .shooting import Shooting
from .unknowns import Unknowns
from .vibration import Array

#: Errors where parameters belong to no rig, the engine cannot compute a flight, or the equations
#: have no unique solution.
NO_SUCH_RIG = (ParameterError, RuntimeError, np.linalg.LinAlgError)
#: Most steps of the constants of a file, and part by which a change revises the course again.
_MOST_CONSTANTS, _MOVED = 6, 0.01
#: Share of flights that count above which it is not revised again.
_ENOUGH = 0.95
#: A fall of chi squared that shows that m sticks.
_SHOWN = 15.0
#: A fall of restitution beyond so many standard deviations is fitted.
_FALL = 3.0
#: Largest v/v_c that is fitted: above it R is nearly a power of the speed.
_STEEPEST = 100.0
#: Samples closer to an impact than this (s), or this many samples, are not used of a velocity or
#: an acceleration, which jumps there.
_CONTACT, _AROUND = 1e-3, 0.75
#: Least noise for the search of impacts, as a part of the motion (rms): a record of a simulation
#: has none, and residuals of the first, rough model would pass for impacts.
_LEAST_NOISE = 0.01
#: Least noise for standard deviations, which rounding makes.
_ROUNDING = 1e-6


class OtherLawError(Exception):
    """A record that a fit explains but for the law of restitution; the text has the remedy."""


class RecordFit:
    """
    The fit of one record.

    Parameters
    ----------
    record : Record
        The measured motion.
    unknowns : Unknowns
        The shared unknowns of the file.
    times : ndarray
        Measured instants of impacts.
    impact_deviation : float
        Standard deviation of these instants.

    Attributes
    ----------
    unknowns : Unknowns
        The shared unknowns; its rig has the constants by record and file.
    moved : dict
        Relative changes of the constants from the file.
    found : Revised
        The fitted course, after `run`.
    known : ConstantEstimates
        What is known of the constants.
    checks : list of Candidate
        Further parameters that the model does not have, the most significant first.
    remarks : list of str
        What was fitted without being asked for.
    chi : float
        Root of chi squared, with the noise that the residuals have between impacts.
    """

    found: Revised
    known: ConstantEstimates
    checks: list[Candidate]
    chi: float

    def __init__(
        self, record: Record, unknowns: Unknowns, times: Array, impact_deviation: float
    ) -> None:
        self.unknowns, self.moved, self.remarks = unknowns, dict[str, float](), list[str]()
        self._record, self._times, self._impact_deviation = record, times, impact_deviation
        step = float(np.median(np.diff(record.time)))
        self._masked = max(_CONTACT, _AROUND * step) if record.order else 0.0
        self._noise = rough_noise(record)
        self._swing = _swing(record)
        self._rounding = _ROUNDING * self._swing
        self._scale = 1.0

    def run(self, course: Course) -> None:
        """
        Fit the rig from a first course.

        Raises
        ------
        UnfitRecordError
            If no flight obeys the laws, or flights contradict each other.
        OtherLawError
            If restitution falls with the speed by another law.
        ParameterError, RuntimeError, LinAlgError
            If no rig moves as recorded (`NO_SUCH_RIG`).
        """
        self._noise = max(self._noise_left(self._problem(course)), _LEAST_NOISE * self._swing)
        self.found = self._revise(course)
        # Weights of data and of impact times by the noise of the residuals
        self._noise = max(self._noise * self.found.chi, self._rounding)
        self.found = self.found.solve(self._problem)
        self._scale = self.scale_of(self.found)
        self._fit_constants()
        self._try_sticks()
        evidence = self._examine()
        before = self.found
        self._mend()
        if self.found is not before:
            evidence = self._examine()
        own = own_covariance(self.found.shooting, self.found.solution, self._scale)
        covariance = evidence.with_doubts(own, self.moved, self.checks)
        self.known = self.known._replace(covariance=covariance)
        noise = max(self._noise_left(self.found.shooting), self._rounding)
        self.chi = self.found.chi * self._noise / noise

    def scale_of(self, found: Revised) -> float:
        """Return the deviation of the residuals over that of the noise, at least of rounding."""
        return max(found.chi, self._rounding / found.shooting.deviation)

    def _problem(self, course: Course) -> Shooting:
        """Return the equations of a course."""
        return Shooting(
            self._record,
            self._noise,
            self.unknowns,
            course,
            self._times,
            self._impact_deviation,
            self._masked,
        )

    def _noise_left(self, shooting: Shooting) -> float:
        """Return the noise between impacts, from fourth differences of the residuals."""
        motion, counts = shooting.motion(shooting.start())
        residuals = np.where(counts, shooting.record.motion - motion, np.nan)
        found = noise_between(residuals, shooting.record.time, shooting.course.time)
        return found if found > 0.0 else self._noise

    def _revise(self, course: Course) -> Revised:
        """Return a course as the engine computes it, without rejected flights."""
        found = revise(course, self._problem).without_rejected(self._problem)
        _check_flights(found)
        return found

    def _try_sticks(self) -> None:
        """
        Take the fit in which m sticks between two reversals, if the record shows that.

        Less friction and less restitution make nearly the same motion.
        """
        course = self.found.course.with_sticks()
        if course.structure == self.found.course.structure:
            return
        before = self.found, self.known, self.unknowns, dict(self.moved)
        try:
            shooting, solution, _ = without_contradictions(
                self._problem, self._problem(course), {}, softly=True
            )
            self.found = self._revise(shooting.course_of(solution.unknowns))
            self._fit_constants()
            if self._gain_over(before[0]) > _SHOWN:
                return
        except (UnfitRecordError, *NO_SUCH_RIG):
            pass
        self.found, self.known, self.unknowns, self.moved = before

    def _gain_over(self, before: Revised) -> float:
        """Return the fall of chi squared from another fit, for the samples that both explain."""
        n, saved = len(self._record.time), np.zeros(len(self._record.time))
        for fit, sign in ((before, 1.0), (self.found, -1.0)):
            saved += sign * fit.solution.equations.residual[:n] ** 2
            saved[~fit.shooting.motion(fit.solution.unknowns)[1]] = np.nan
        return float(np.nansum(saved))

    def _estimate_constants(self, *, doubted: bool = False) -> ConstantEstimates:
        return ConstantEstimates.of(self.found, self._scale, self.moved, doubted=doubted)

    def _move_constants(self, known: ConstantEstimates) -> None:
        """Move the constants by a step, and solve the course with them."""
        for name, step in known.steps.items():
            self.moved[name] = self.moved.get(name, 0.0) + step
        self.unknowns = self.unknowns._replace(rig=known.rig)
        course = self.found.shooting.course_of(known.unknowns)
        self.found = self.found.solve(self._problem, course)

    def _fit_constants(self) -> None:
        """Fit the constants by record and file, and leave out flights rejected with them."""
        self.known = self._estimate_constants()
        for _ in range(_MOST_CONSTANTS):
            if not self.known.moves or 2 * self.found.obey < len(self.found.course.flies):
                break
            self._move_constants(self.known)
            self.known = self._estimate_constants()
        flights = int(self.found.course.flies.sum())
        self.found = self.found.without_rejected(self._problem)
        _check_flights(self.found)
        if self.found.course.flies.sum() < flights:
            self.known = self._estimate_constants()

    def _judge_again(self) -> None:
        """
        Judge the flights once more with the constants that the record alone has.

        Flights that show that a constant is wrong are left out while it is believed.
        """
        known = self._estimate_constants(doubted=True)
        if max(map(abs, known.steps.values()), default=0.0) <= _MOVED:
            return
        before = self.found, self.known, self.unknowns, dict(self.moved)
        try:
            self._move_constants(known)
            self.found = self._revise(self.found.course)
            self._fit_constants()
        except (UnfitRecordError, *NO_SUCH_RIG):
            # No rig with such constants: the flights remain as they were judged.
            self.found, self.known, self.unknowns, self.moved = before

    def _examine(self) -> Evidence:
        """Return the evidence for further parameters, and check these."""
        evidence = Evidence.of(self.found.shooting, self.found.solution, self._scale)
        self.checks = evidence.candidates(self.moved)
        return evidence

    def _mend(self) -> None:
        """Fit a fall of R that the checks show, or judge flights again if many are left out."""
        few = self.found.obey < _ENOUGH * len(self.found.course.flies)
        if (fall := self._fall()) is not None:
            self._add_fall(fall)
        elif few:
            self._judge_again()
        if self.unknowns.value(self.found.course.shared, 'slowness') < 0.0:
            # No rig has a restitution that grows with the speed.
            self.unknowns = self.unknowns._replace(extras=self.unknowns.extras[:-1])
            course = self.found.course.copy()
            course.shared = course.shared[:-1]
            solved = self.found.solve(self._problem, course)
            self.found = solved.without_rejected(self._problem)
            self.known = self._estimate_constants()
            self.remarks = ['restitution does not fall with the speed of impact in this record']

    def _fall(self) -> Candidate | None:
        """Return the check that R falls with the speed, if it explains the record best."""
        first = self.checks[0] if self.checks else None
        falls = first is not None and first.name == OVER_SPEED and first.z < -_FALL
        return first if falls and self.unknowns.rig.restitution_exponent > 0.0 else None

    def _add_fall(self, fall: Candidate) -> None:
        """Fit a restitution that falls with the speed, too."""
        self.unknowns = self.unknowns._replace(extras=(*self.unknowns.extras, 'slowness'))
        course, shooting = self.found.course.copy(), self.found.shooting
        course.shared = shared_with_fall(shooting, self.found.solution.unknowns, fall.value)
        try:
            self.found = revise(course, self._problem).without_rejected(self._problem)
            self._check_fall()
            self._fit_constants()
        except (UnfitRecordError, *NO_SUCH_RIG) as error:
            raise OtherLawError(
                'restitution depends on the speed of impact, but not as a restitution_exponent of '
                f'{self.unknowns.rig.restitution_exponent:g} has it: give another one'
            ) from error
        self.remarks = [
            'restitution_speed is fitted: that R falls with the speed of impact is '
            f'{abs(fall.z):.0f} standard deviations from 0'
        ]

    def _check_fall(self) -> None:
        """Raise `UnfitRecordError` if restitution falls by more than its exponent lets it."""
        shooting, u = self.found.shooting, self.found.solution.unknowns
        slowness = self.unknowns.value(self.found.course.shared, 'slowness')
        if slowness * float(shooting.speeds(u).max()) > _STEEPEST:
            raise UnfitRecordError('restitution at rest is without bound')


def rough_noise(record: Record) -> float:
    """Return the noise of a record for the search of impacts, from its fourth differences."""
    return max(noise_of(record.motion[record.weight > 0.0]), _LEAST_NOISE * _swing(record))


def _swing(record: Record) -> float:
    return float(np.std(record.motion[record.weight > 0.0]))


def _check_flights(found: Revised) -> None:
    """Raise `UnfitRecordError` if no flight is left."""
    if not found.course.flies.any():
        raise UnfitRecordError(f'no flight obeys the laws of the damper: {WRONG_RIG}')
