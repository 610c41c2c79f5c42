# SPDX-License-Identifier: Apache-2.0
"""
Possible faults of a model or a file, judged by the share of the record that each explains.

Near a fit one Gauss-Newton step gives the value and standard deviation of each further parameter,
zero in the model, without another fit: a score test. Far from one, `misreading` compares how well
the motion of M is made of free vibrations if its sensor or the force is in another unit.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impact_damper_ros.motion.impact import bounce
from impact_damper_ros.parameters.base_motion import ORDERS
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .first_course import GRID, SAMPLES, guess_of, thin_out
from .gauss_newton import FitSolution, System
from .impact_search import ImpactSearch
from .node_kernels import PAIR
from .record import Record
from .shooting import Further, Shooting
from .unknowns import CONSTANTS, Fall, later, scaled_constant
from .vibration import Array, Phasors, Vibration

_STEP = 1e-6
#: Factors of an acceleration, of other motions and of any in a wrong unit, with a sentence each.
_OF_ACCELERATION = {
    9.80665: 'the motion is 9.81 times too small: g were taken for m/s^2',
    1.0 / 9.80665: 'the motion is 9.81 times too large: m/s^2 were taken for g',
}
_OF_LENGTH = {
    25.4: 'the motion is 25.4 times too small: inches were taken for millimetres',
    1.0 / 25.4: 'the motion is 25.4 times too large: millimetres were taken for inches',
    10.0: 'the motion is 10 times too small: centimetres were taken for millimetres',
    0.1: 'the motion is 10 times too large: millimetres were taken for centimetres',
}
_OF_ANY = {
    1e3: 'the motion is 1000 times too small: check its unit',
    1e-3: 'the motion is 1000 times too large: check its unit',
}
_OF_BASE = {
    9.80665: 'the motion of the base is 9.81 times too large: m/s^2 were taken for g',
    1.0 / 9.80665: 'the motion of the base is 9.81 times too small: g were taken for m/s^2',
}
#: Factors of the motion by a wrong sign or level.
_RMS = 2.0**0.5
RELATIVE = 'the motion of M is relative to the base: add the motion of the base to it'
REVERSED = 'the sensor or the force is the other way round: reverse the sign of one of them'
_SIGNS = {
    -1.0: REVERSED,
    1.0
    / _RMS: 'the force is 1.41 times as large as the file says, as if its rms were given for the '
    'amplitude',
    _RMS: 'the force is 0.707 times as large as the file says, as if its amplitude were given '
    'for the rms',
}
#: Phases of the force that are tried, and the sentence on them.
_PHASES = 16
OVER_SPEED = 'restitution over impact speed'
OTHER_PHASE = 'the force comes at another time than described, which --also force_delay fits'
#: Readings of a file are compared at few or more stiffnesses; units only if the cost of a sample
#: is at least `_DEAR`.
_FEW, _MORE = np.linspace(0.96, 1.04, 3), np.linspace(0.96, 1.04, 5)
_ONE, _DEAR = np.ones(1), 4.0
#: Largest fall of R, as a part of the exponent, to which a slowness belongs.
_STEEP = 0.2
#: Residuals beyond this many standard deviations count less in the fit of one vibration, and the
#: largest change of the logarithms of K and C from their start.
_ROBUST, _WIDEST = 3.0, np.array([0.2, 3.0])
#: Largest residuals of a record that is one vibration, over the noise.
_ONE_VIBRATION = 1.5
#: Shares of costs: that another reading must save where a fit has failed, that another unit may
#: leave where no fit was tried, and that another phase may have of the cost of another sign.
_SAVED, _CLEARLY, _AS_GOOD = 0.15, 0.5, 0.95
#: Factor of costs within which units are not distinguished.
_ALMOST = 1.05
#: A force is as its rms would be within this number of standard deviations.
_ALIKE = 3.0
#: Frequencies of a second mode that are tried, in the natural one, and their damping ratio.
_SECOND_MODE = 'second mode'
_MODE_RATIOS, _MODE_DAMPING = np.geomspace(1.15, 6.0, 166), 0.01
#: Nodes and weights of Gauss's rule for the integral over a part of 1.
_PLACES = np.array([0.5 - math.sqrt(0.15), 0.5, 0.5 + math.sqrt(0.15)])
_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
#: Chance that a constant of a file is wrong, unless its uncertainty is given, and the part by
#: which it is wrong then: a mass may lack a forgotten part, a force its calibration.
_DOUBT, _WRONG_BY = 0.2, 0.1
_NO_INFORMATION = 1e-300
#: Standard deviations beyond which a further parameter is missing in the model, and at which it is
#: as likely as none.
MOST_Z, _EVEN = 4.0, 3.5
#: Probability below which cases are outside intervals of 95 %.
_OUTSIDE = 0.05


class Candidate(NamedTuple):
    """
    A further parameter that the model does not have.

    Attributes
    ----------
    name : str
        What the parameter is.
    value, standard_deviation : float
        Value and deviation by one step from the fit; the deviation includes the uncertainty of the
        file.
    unit : str
        Unit of value and deviation.
    meaning : str
        The fault if the parameter is not zero.
    """

    name: str
    value: float
    standard_deviation: float
    unit: str
    meaning: str

    @property
    def z(self) -> float:
        """The value in standard deviations."""
        return self.value / self.standard_deviation if self.standard_deviation else 0.0


class ParameterColumn(NamedTuple):
    """Derivatives of residuals and conditions by a parameter, and its prior deviation."""

    name: str
    unit: str
    meaning: str
    residual: Array
    condition: Array
    uncertainty: float = 0.0
    doubt: float = 0.0


class Evidence(NamedTuple):
    """
    The evidence of a record for further parameters, with all unknowns fitted again.

    Attributes
    ----------
    columns : list of ParameterColumn
        The constants of the file, then parameters that the model does not have.
    information, gradient : ndarray
        Second and first derivatives of minus the logarithm of the likelihood by all parameters.
    changes : ndarray
        Changes of the unknowns with each parameter.
    """

    columns: list[ParameterColumn]
    information: Array
    gradient: Array
    changes: Array

    @classmethod
    def of(
        cls, shooting: Shooting, solution: FitSolution, scale: float, *, laws: bool = True
    ) -> Evidence:
        """Return the evidence near a solution whose residuals have the deviation `scale`."""
        equations = solution.equations
        system = System(equations, 1e-11)
        columns = constant_columns(shooting, solution)
        if laws:
            columns += [*_of_laws(shooting, solution), *_second_modes(shooting, solution)]
        residual = np.stack([one.residual for one in columns], axis=1)
        condition = np.stack([one.condition for one in columns], axis=1)
        information, changes = system.profile(residual, condition)
        # At the end of the remaining step: a solution is less exact where two parameters can
        # hardly be distinguished
        step, multipliers = system.step(equations)
        left = equations.residual + equations.changes(step)[0]
        gradient = residual.T @ left + condition.T @ multipliers
        return cls(columns, information / scale**2, gradient / scale**2, changes)

    def if_wrong(self) -> Evidence:
        """Return the evidence if all constants are wrong that may be."""
        columns = [
            one._replace(uncertainty=_WRONG_BY, doubt=0.0)
            if one.doubt and one.uncertainty
            else one
            for one in self.columns
        ]
        return self._replace(columns=columns)

    def uncertain(self) -> list[int]:
        """Return which constants have an uncertainty."""
        return [k for k, one in enumerate(self.columns) if one.uncertainty > 0.0]

    def step(
        self, free: list[int], since: Array, but: int = -1, *, doubts: bool = True
    ) -> tuple[Array, Array]:
        """
        Return the step and covariance of some parameters, given their prior.

        `since` holds earlier changes of each; column `but` has no prior. Each constant has the
        value of the file with its uncertainty, or, with `doubts`, it is wrong: these cases count
        by how likely they make the record.
        """
        information, gradient = self.information[np.ix_(free, free)], self.gradient[free]
        cases = []
        for k in free:
            one = self.columns[k]
            known = k != but and 0.0 < one.uncertainty < math.inf
            cases.append(
                [(one.uncertainty if known else math.inf, 1.0 - one.doubt * known * doubts)]
            )
            if known and doubts and one.doubt:
                cases[-1].append((_WRONG_BY, one.doubt))
        likely, steps, covariances = [], [], []
        for case in product(*cases):
            deviations, chances = np.array(case).T
            before = deviations**-2.0
            together = information + np.diag(before)
            covariance = np.linalg.pinv(together, hermitian=True)
            pull = gradient + before * since[free]
            steps.append(-covariance @ pull)
            covariances.append(covariance)
            squares = before @ since[free] ** 2 - pull @ covariance @ pull
            volume = -np.log(np.maximum(np.linalg.eigvalsh(together), _NO_INFORMATION)).sum()
            spread = np.log(deviations[before > 0.0]).sum()
            likely.append(np.log(chances).sum() - spread + 0.5 * (volume - squares))
        part = np.exp(np.array(likely) - max(likely))
        part /= part.sum()
        step = np.asarray(part @ np.array(steps))
        apart = np.array(steps) - step
        between = (part[:, None] * apart).T @ apart
        return step, np.tensordot(part, np.array(covariances), 1) + between

    def candidates(self, moved: Mapping[str, float]) -> list[Candidate]:
        """
        Return each further parameter by one step, the most significant first.

        One fault is tried at a time: otherwise the file is right within its uncertainty.
        """
        since = np.array([moved.get(one.name, 0.0) for one in self.columns])
        found = []
        for k, column in enumerate(self.columns):
            if not self.information[k, k] > 0.0:
                continue
            step, covariance = self.step(self._with(k), since, but=k, doubts=False)
            value, own = float(since[k] + step[-1]), float(np.sqrt(max(covariance[-1, -1], 0.0)))
            deviation = math.hypot(own, column.uncertainty)
            meaning = column.meaning
            if column.name == 'force_amplitudes':
                for factor in (_RMS, 1.0 / _RMS):
                    near = abs(1.0 + value - 1.0 / factor) < _ALIKE * deviation
                    meaning = _SIGNS[factor] if near else meaning
            found.append(Candidate(column.name, value, deviation, column.unit, meaning))
        found.sort(key=lambda one: -abs(one.z))
        modes = [one for one in found if one.name.startswith(_SECOND_MODE)]
        # A part of the mobility is positive.
        less = [one for one in modes if one.value < 0.0]
        best = [one for one in modes if one not in less]
        return [one for one in found if one not in less and one not in best[1:]]

    def _with(self, k: int) -> list[int]:
        """Return the uncertain constants and last of all another column."""
        return [*(i for i in self.uncertain() if i != k), k]

    def joint(self, free: list[int], own: Array, covariance: Array) -> Array:
        """Return the covariance of the shared unknowns and of some columns."""
        shared = self.changes[: len(own), free]
        across = shared @ covariance
        return np.block([[own + across @ shared.T, across], [across.T, covariance]])

    def with_doubts(
        self, own: Array, moved: Mapping[str, float], checks: Sequence[Candidate]
    ) -> Array:
        """
        Return the covariance of the shared unknowns and of the uncertain constants.

        Each candidate may be right, with the probability by the record, and would change the
        estimates.
        """
        since = np.array([moved.get(one.name, 0.0) for one in self.columns])
        free, names = self.uncertain(), [one.name for one in self.columns]
        step, covariance = self.step(free, since)
        total = 1.0
        mean = self.joint(free, own, covariance)
        for check in checks:
            k = names.index(check.name)
            odds = math.exp(0.5 * (min(abs(check.z), MOST_Z) ** 2 - _EVEN**2))
            if k in free or odds < _OUTSIDE:
                continue
            other, wider = self.step(self._with(k), since, but=k)
            shift = np.append(other[:-1] - step, other[-1])
            change = np.concatenate([self.changes[: len(own), [*free, k]] @ shift, shift[:-1]])
            inside = self.joint([*free, k], own, wider)[:-1, :-1]
            mean = mean + odds * (inside + np.outer(change, change))
            total += odds
        return mean / total


def _second_modes(shooting: Shooting, solution: FitSolution) -> Iterator[ParameterColumn]:
    """
    Yield modes of other frequencies, by the part of the mobility of M that is theirs.

    They answer impacts and force as M does, sensor and stops move with them, and the mass of the
    first mode is larger.
    """
    u, record, order = solution.unknowns, shooting.record, shooting.record.order
    shared, states = shooting.parts(u)
    impacts, ends, nodes = states[shooting.impacts, 0], shooting.ends, states[:, 0]
    drive = shooting.vibration(shared)
    weight = np.where(shooting.motion(u)[1], shooting.weight, 0.0)
    heavier = scaled_constant(shooting.unknowns.rig, 'primary_mass', _STEP)
    assert heavier is not None
    by_mass = _derivatives(shooting, solution, heavier, _STEP)
    hit, sticks, n = shooting.kind[ends] != 0, shooting.sticks[ends - 1], len(record.time)
    roots = complex(-_MODE_DAMPING, 1.0) * shooting.rate * _MODE_RATIOS
    answers = shooting.likely_jumps(u)[:, None] / roots.imag + 0j
    for k, span in enumerate(np.diff(impacts).tolist()):
        answers[k + 1] += answers[k] * np.exp(roots * span)
    for root, after in zip(roots.tolist(), answers.T, strict=True):
        mode = drive._replace(decay=-root.real, damped=root.imag, stiffness=abs(root) ** 2)
        residual, condition = by_mass[0].copy(), by_mass[1].copy()
        residual[:n] += _answer(mode, impacts, after, record.time, order) * weight
        place = _answer(mode, impacts, after, nodes, 0)
        speed = _answer(mode, impacts, after, nodes, 1, 'left')
        rows = np.zeros((len(ends), 5))
        rows[hit, 1] = rows[hit, 2] = -speed[ends][hit]
        rows[:, 3] = np.where(sticks, 0.0, place[ends - 1] - place[ends])
        rows[sticks, 2] = (speed[ends] - speed[ends - 1])[sticks]
        rows[~hit, 4] = -speed[ends][~hit]
        released = shooting.released
        rows[released, 4] = -_answer(mode, impacts, after, nodes[ends[released]], 2)
        condition[: rows.size] += shooting.in_units(rows).ravel()
        yield ParameterColumn(
            f'{_SECOND_MODE} at {root.imag / math.tau:.3g} Hz',
            '',
            'M has a second mode: fix the sensor to M, or stiffen what swings on it',
            residual,
            condition,
        )


def _answer(
    mode: Vibration,
    impacts: Array,
    after: Phasors,
    times: Array,
    derivative: int,
    side: Literal['left', 'right'] = 'right',
) -> Array:
    """Return a derivative of the answer of a mode to force and impacts, after these or before."""
    last = np.searchsorted(impacts, times, side=side) - 1
    free = np.where(last >= 0, after[last], 0.0) * mode.root**derivative
    turned = np.exp(mode.root * (times - impacts[last]))
    return np.asarray((free * turned).imag) + mode.steady(times, derivative)


def _of_laws(shooting: Shooting, solution: FitSolution) -> Iterator[ParameterColumn]:
    """Yield slopes of parameters that the model takes for constant, and the delay."""
    unknowns, u, equations = shooting.unknowns, solution.unknowns, solution.equations
    shared, states = shooting.parts(u)
    ends = shooting.ends
    jump = np.zeros(shooting.count_of_nodes)
    jump[shooting.impacts] = shooting.jumps(u)
    alpha = shared[shooting.alpha_column]
    speed = np.zeros(shooting.count_of_nodes)
    speed[shooting.impacts] = shooting.speeds(u)
    speed = speed[ends]
    hit = shooting.kind[ends] != 0

    def spread(
        columns: list[int], at_end: Array, at_start: Array | None = None, size: float = 1.0
    ) -> tuple[Array, Array]:
        """Return derivatives by a parameter of m that is larger by factors, where flights end."""
        rows = equations.rows[equations.others :, [PAIR + k for k in columns]].sum(axis=1)
        rows[: 5 * len(ends)] *= np.repeat(at_end, 5)
        others = rows[5 * len(ends) :]
        others[len(shooting.firsts) :] = 0.0
        others[: len(shooting.firsts)] *= 0.0 if at_start is None else at_start[shooting.firsts]
        return np.zeros(len(equations.residual)), size * rows

    alphas = list(set(unknowns.alpha_columns()))
    by_restitution = -unknowns.share * alpha[ends] ** 2
    if hit.any() and 'slowness' not in unknowns.extras:
        middle = speed[hit].mean()
        yield ParameterColumn(
            OVER_SPEED,
            's/m',
            'restitution depends on the speed of impact, which --also restitution_speed fits',
            *spread(alphas, by_restitution * np.where(hit, speed - middle, 0.0)),
        )
    if not unknowns.separate and {1, -1} <= set(shooting.kind[ends].tolist()):
        yield ParameterColumn(
            'restitution_2 less restitution_1',
            '',
            'the stops have different restitution, which --also restitution_2 fits',
            *spread(alphas, by_restitution * (shooting.kind[ends] == -1)),
        )
    yield ParameterColumn(
        'cubic stiffness', '', 'the spring is not linear', *_cubic_spring(shooting, solution)
    )
    span = shooting.record.time[-1] - shooting.record.time[0]
    late = (states[:, 0] - states[:, 0].mean()) / span
    gap = unknowns.value(shared, 'gap')
    yield ParameterColumn(
        'change of the gap',
        '',
        'the gap changes over the record',
        *spread([unknowns.column('gap')], late[ends], late, gap),
    )
    if any(unknowns.rig.base_amplitudes):
        record, n = shooting.record, len(shooting.record.time)
        residual = np.zeros(len(equations.residual))
        weight = np.where(shooting.motion(u)[1], shooting.weight, 0.0)
        residual[:n] = -base_of(unknowns.rig, record.time, record.order) * weight
        yield ParameterColumn(
            'share of the base in the motion', '', RELATIVE, residual, 0.0 * equations.condition
        )
    if 'force_delay' not in unknowns.extras and any(unknowns.rig.force_amplitudes):
        delay = _STEP / shooting.rate
        yield ParameterColumn(
            'force delay',
            's',
            OTHER_PHASE,
            *_derivatives(shooting, solution, later(unknowns.rig, delay), delay),
        )


def _cubic_spring(shooting: Shooting, solution: FitSolution) -> tuple[Array, Array]:
    """
    Return derivatives by the part of K that a cubic spring adds where X has its rms.

    The answer of M to the force of the spring is an integral over each flight, by Gauss's rule.
    """
    u, order = solution.unknowns, shooting.record.order
    shared, states = shooting.parts(u)
    vibration, nodes = shooting.vibration(shared), states[:, 0]
    root = vibration.root
    samples = np.clip(shooting.record.time, nodes[0], nodes[-1])
    edges = np.unique(np.concatenate([nodes, samples]))
    spans = np.diff(edges)
    at = edges[:-1, None] + spans[:, None] * _PLACES
    node = np.searchsorted(nodes, at, side='right') - 1
    x = shooting.place(u, at.ravel()).reshape(at.shape)
    factor = -vibration.stiffness / float(np.mean(x**2))
    turned = factor * x**3 * np.exp(-root * (at - nodes[node]))
    sums = np.append(0.0, np.cumsum((turned @ _WEIGHTS) * spans)) / vibration.damped

    def answer(times: Array, start: NDArray[np.int64]) -> Phasors:
        total = sums[np.searchsorted(edges, times)] - sums[np.searchsorted(edges, nodes[start])]
        return np.asarray(total * np.exp(root * (times - nodes[start])))

    start = np.clip(np.searchsorted(nodes, samples, side='right') - 1, 0, len(nodes) - 2)
    ends = shooting.ends

    def motion_at(times: Array, start: NDArray[np.int64], derivative: int) -> Array:
        found = (root**derivative * answer(times, start)).imag
        if derivative == 2:
            found += factor * shooting.place(u, times) ** 3
        return np.asarray(found)

    varied = copy.copy(shooting)
    varied.further = Further(
        motion_at(samples, start, order), *(motion_at(nodes[ends], ends - 1, k) for k in range(3))
    )
    residual, condition = varied.residual(u)
    equations = solution.equations
    return residual - equations.residual, condition - equations.condition


def shared_with_fall(shooting: Shooting, u: Array, slope: float) -> Array:
    """Return a solution's shared unknowns, and the slowness that gives a slope dR/dv."""
    shared = shooting.parts(u)[0].copy()
    unknowns, columns = shooting.unknowns, list(set(shooting.unknowns.alpha_columns()))
    speeds = shooting.speeds(u)
    speed, bounces = float(speeds[speeds > 0.0].mean()), unknowns.restitution(shared[columns])
    # The slowness of R(0) (1 + s v)^-p; a fall by most of p over v/v_c is the limit.
    exponent = unknowns.rig.restitution_exponent
    fall = -slope * speed / float(bounces.mean())
    slowness = fall / max(exponent - fall, _STEEP * exponent) / speed
    part, _ = bounce(Fall(slowness, exponent), 1.0, speed)
    shared[columns] = unknowns.alpha(np.minimum(bounces / part, 1.0))
    return np.append(shared, slowness)


def constant_columns(shooting: Shooting, solution: FitSolution) -> list[ParameterColumn]:
    """Return derivatives by the relative changes of masses and level of the excitation."""
    unknowns, found = shooting.unknowns, []
    for name, constant in CONSTANTS.items():
        other = scaled_constant(unknowns.rig, name, _STEP)
        if other is not None:
            uncertainty = unknowns.uncertain.get(name, constant.uncertainty)
            varied = _derivatives(shooting, solution, other, _STEP)
            # A given uncertainty is taken as right.
            doubt = 0.0 if name in unknowns.uncertain else _DOUBT
            found.append(ParameterColumn(name, '', constant.meaning, *varied, uncertainty, doubt))
    return found


def _derivatives(
    shooting: Shooting, solution: FitSolution, rig: RigParameters, step: float
) -> tuple[Array, Array]:
    """Return derivatives by a difference of the rig."""
    varied = copy.copy(shooting)
    varied.unknowns = shooting.unknowns._replace(rig=rig)
    residual, condition = varied.residual(solution.unknowns)
    equations = solution.equations
    return (residual - equations.residual) / step, (condition - equations.condition) / step


def misreading(record: Record, rig: RigParameters, deviation: float) -> str:
    """Return the sentence on a unit that explains the motion far better, or ''."""
    fewer = thin_out(record, rig, SAMPLES)
    as_it_is = _cost(fewer, rig, deviation, _FEW)
    if as_it_is < _DEAR * len(fewer.time):
        return ''
    units = _OF_ANY | (_OF_ACCELERATION if record.order == 2 else _OF_LENGTH)
    if rig.base_quantity == 'acceleration' and any(rig.base_amplitudes) and record.order < 2:
        units |= _OF_BASE
    costs = {
        sentence: _cost(fewer, _driven_rig(rig, factor), deviation, _FEW)
        for factor, sentence in units.items()
    }
    best = min(costs, key=costs.__getitem__)
    if costs[best] >= _CLEARLY * as_it_is:
        return ''
    # Units that differ by little, such as 9.81 and 10
    return '; or '.join(one for one in costs if costs[one] < _ALMOST * costs[best])


def wrong_file(
    record: Record, rig: RigParameters, deviation: float
) -> tuple[str, RigParameters | None]:
    """
    Return the sentence on a fault of a file with which a fit has failed, or ''.

    The fault is a record without impacts, or another sign, level or phase of the force, where one
    leaves far fewer vibrations. With many weak impacts that is no proof: the second result is the
    rig, up to the phase of the force, with which a fit should succeed then.
    """
    # Units are not tried: with one that leaves hardly any force, vibrations are fewer than with a
    # wrong phase.
    if without_impacts := one_vibration(record, rig, deviation):
        return without_impacts, None
    fewer = thin_out(record, rig, SAMPLES)
    others = [(sentence, _driven_rig(rig, factor)) for factor, sentence in _SIGNS.items()]
    period = math.tau / max(rig.first_harmonic[1], 1e-3 * rig.omega)
    delays = period * np.arange(1, _PHASES) / _PHASES
    others += [(OTHER_PHASE, later(rig, delay)) for delay in delays.tolist()]
    costs = [_cost(fewer, other, deviation, _MORE) for _, other in others]
    # Half a period later the sign is reversed.
    weights = [_AS_GOOD if sentence == OTHER_PHASE else 1.0 for sentence, _ in others]
    sentence, other = others[int(np.argmin(np.divide(costs, weights)))]
    as_it_is, there = (_cost(fewer, one, deviation, *GRID) for one in (rig, other))
    found = there < (1.0 - _SAVED) * as_it_is
    return (sentence, rig if sentence == OTHER_PHASE else other) if found else ('', None)


def one_vibration(
    record: Record, rig: RigParameters, deviation: float, most: float = _ONE_VIBRATION
) -> str:
    """Return the fault if the record is one vibration, of M or of M and m, or ''."""
    joint = scaled_constant(rig, 'primary_mass', rig.mass_ratio) or rig
    left, slower = {}, {}
    for which, alone in (('M', rig), ('both', joint)):
        stiffness, free = _fit_one_vibration(record, alone, deviation)
        left[which] = float(np.std(free[record.weight > 0.0]))
        slower[which] = 50.0 * (1.0 - stiffness / alone.primary_mass / rig.omega**2)
        # Without a force on M both fit: that with the stiffness of the file is taken.
        left[which] *= 1.0 + abs(stiffness / rig.stiffness - 1.0)
    best = min(left, key=left.__getitem__)
    if left[best] > most:
        return ''
    lower = f'{abs(slower[best]):.2g} % {"lower" if slower[best] > 0.0 else "higher"}'
    return (
        f'the natural frequency is {lower} than that of the file, as that of M and m together '
        'is: m moves with M, or its impacts are lost in the noise; free it, shake harder than '
        'friction holds, or record with less noise'
        if best == 'both'
        else 'the record is one vibration without impacts, with a natural frequency '
        f'{lower} than that of the file: the damper is not in it, or does not move'
    )


def _fit_one_vibration(
    record: Record, rig: RigParameters, deviation: float
) -> tuple[float, Array]:
    """Return K fitted to a record as one vibration, and the residuals over the noise."""
    search = ImpactSearch(record, rig, deviation)

    def misfit(logarithms: Array) -> Array:
        search.smooth(Vibration.of(rig, *np.exp(logarithms).tolist()))
        return np.arcsinh(search.innovations / _ROBUST)

    start = np.log([rig.stiffness, max(rig.damping, 1e-3 * rig.stiffness / rig.omega)])
    bounds = start - _WIDEST, start + _WIDEST
    found = least_squares(misfit, start, diff_step=1e-5, max_nfev=30, bounds=bounds)
    search.smooth(Vibration.of(rig, *np.exp(found.x).tolist()))
    return float(np.exp(found.x[0])), search.innovations


def base_of(rig: RigParameters, times: Array, order: int) -> Array:
    """Return a time derivative of the motion of the base."""
    lines = rig.base_amplitudes, rig.base_frequencies, rig.base_phases
    amplitudes, frequencies, phases = (np.asarray(values, float) for values in lines)
    turned = amplitudes * np.exp(1j * (frequencies * times[:, None] + phases))
    rates = (1j * frequencies) ** (order - ORDERS[rig.base_quantity])
    return np.asarray((turned @ rates).imag)


def _driven_rig(rig: RigParameters, factor: float) -> RigParameters:
    """Return the rig for a motion that is too small by a factor."""
    driven = scaled_constant(rig, 'force_amplitudes', 1.0 / factor - 1.0) or rig
    return scaled_constant(driven, 'base_amplitudes', 1.0 / factor - 1.0) or driven


def _cost(
    record: Record,
    rig: RigParameters,
    deviation: float,
    stiffnesses: Array,
    dampings: Array = _ONE,
) -> float:
    """Return the least cost with some stiffnesses and dampings, in those of the rig."""
    stiffness, damping = guess_of(rig)
    tried = product((stiffness * stiffnesses).tolist(), (damping * dampings).tolist())
    search = ImpactSearch(record, rig, deviation)
    return min(search.find(Vibration.of(rig, *one)) for one in tried)
