# SPDX-License-Identifier: Apache-2.0
"""
The acceptance of a fit, and the reasons against it in words.

The rule was fixed before the fits of `benchmarks/fit_rig.py` were made.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .candidates import MOST_Z, Candidate
from .estimate import Estimate
from .first_course import LEAST_IMPACTS, WRONG_RIG
from .parameter_estimates import Correlations
from .revision import Revised

#: Largest root of chi squared, with the noise from fourth differences.
MOST_CHI = 1.1
#: Least number of flights that count, and their least part of those that show whether the model is
#: right; least part of all flights that no verdict rejects.
LEAST_FLIGHTS, LEAST_USED, LEAST_OF_ALL = 10, 0.75, 0.5
#: Correlations beyond this are reported.
CORRELATED = 0.9
#: A standard deviation beyond this part of the value is poor.
POOR = 0.1


class Judgement(NamedTuple):
    """Whether a fit is accepted, the reasons against it, and further remarks."""

    accepted: bool
    reasons: list[str]
    remarks: list[str]


def judge_fit(
    revised: Revised,
    chi: float,
    checks: list[Candidate],
    parameters: dict[str, Estimate],
    correlations: Correlations,
) -> Judgement:
    """Apply the rule of acceptance."""
    # They are meaningless for a course that is mostly wrong.
    reasons = [
        f'{check.meaning}: {check.name} {check.value:.3g} ± {check.standard_deviation:.2g}'
        f'{" " + check.unit if check.unit else ""}, {abs(check.z):.0f} standard deviations from 0'
        for check in checks
        if abs(check.z) > MOST_Z and 2 * revised.obey > len(revised.course) - 1
    ]
    course = revised.course
    flights, used = len(course) - 1, int(course.flies.sum())
    # Many laws fit a flight that no other one confirms: it tests the model no more than an
    # unclear one.
    tested = flights - revised.unclear - revised.unconfirmed
    if used < LEAST_FLIGHTS:
        reasons.append(
            f'{used} of {flights} flights between impacts obey the laws of the damper, and a fit '
            f'needs {LEAST_FLIGHTS}: '
            + (
                WRONG_RIG
                if flights > 2 * LEAST_FLIGHTS
                else f'record more impacts ({LEAST_IMPACTS} are the least that is tried)'
            )
        )
    elif used < LEAST_USED * tested or revised.obey < LEAST_OF_ALL * flights:
        few, of = (used, tested) if used < LEAST_USED * tested else (revised.obey, flights)
        reasons.append(
            f'only {few} of {of} flights obey one set of parameters{_where(revised)}: impacts '
            'missed, since they are weak or closer than the samples, or two rigs in one record; '
            'record impact times or less noise, or at a higher rate, or shake harder; else '
            f'{WRONG_RIG}'
        )
    if chi > MOST_CHI:
        reasons.append(
            f'the residuals are {chi:.3g} times as large as the noise of the record '
            f'(at most {MOST_CHI:g} is accepted)'
        )
    deviations = [estimate.standard_deviation for estimate in parameters.values()]
    if not all(math.isfinite(deviation) and deviation > 0.0 for deviation in deviations):
        reasons.append('the record does not determine every parameter')
    return Judgement(not reasons, reasons, _remarks(parameters, correlations))


def _where(revised: Revised) -> str:
    """Return the time in which most of the unused flights are, in words."""
    course = revised.course
    starts = course.time[:-1][~course.flies]
    if len(starts) < 4:
        return ''
    low, high = np.quantile(starts, [0.1, 0.9])
    return f', and most of the others are from {low:.4g} s to {high:.4g} s'


def _remarks(parameters: dict[str, Estimate], correlations: Correlations) -> list[str]:
    """Return the parameters that the motion does not distinguish, in words."""
    remarks = []
    if 'restitution_speed' in parameters:
        low, high = parameters['restitution_speed'].interval
        if high == math.inf:
            remarks.append(
                f'restitution_speed is {low:.3g} m/s or more: the speeds of this record do not '
                'exclude a constant restitution; record several levels'
            )
    both = 'restitution_1', 'restitution_2'
    common = set(both) <= set(parameters) and correlations[both[0]][both[1]] > 0.999999
    names = [name for name in parameters if not (common and name == both[1])]
    for i, one in enumerate(names):
        for other in names[:i]:
            correlation = correlations[other][one]
            if not abs(correlation) > CORRELATED:
                continue
            poor = [
                name
                for name in (other, one)
                if parameters[name].standard_deviation > POOR * abs(parameters[name].value)
            ]
            remark = f'{other} and {one} are hardly distinguished (correlation {correlation:.3f})'
            if poor:
                remark += (
                    f', and {" and ".join(poor)} is known to {100 * POOR:g} % at best: record a '
                    'start from rest, or two levels of the force'
                )
            remarks.append(remark)
    return remarks
