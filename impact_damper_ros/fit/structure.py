# SPDX-License-Identifier: Apache-2.0
"""
Frequency and damping of a structure without its damper, from a ring-down or a sweep.

A ring-down is y = e^(-zeta w t) (a cos w_d t + b sin w_d t) + c, whichever of displacement,
velocity and acceleration was measured. With a measured force (or base), y also has the response to
this force, which is band-limited: the response is computed for straight lines between samples,
whose tones are amplified by the loss of the lines. For given w and zeta both are linear in all
other unknowns, so that the likelihood of white noise has its maximum over two unknowns only
(variable projection [1]_); intervals are those of its curvature there. Noise of the force passes
through the structure: the residuals are whitened by A/C, with A C/A* C* the spectrum of the noise
of both, A being the denominator of the response.

Parts of some cycles show whether the structure is linear with viscous damping: each part gives a
damping ratio and a frequency, with their deviations, at its amplitude. A slope of either over the
logarithm of the amplitude shows that it is not.

References
----------
1. G. H. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method and
   its applications", Inverse Problems 19 (2003), R1-R26.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar
from scipy.special import chdtri

from impact_damper_ros.parameters.parameter_spec import check_kind

from .estimate import Estimate
from .measured_motion import MeasuredMotion
from .record import noise_of

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Fewest cycles of a ring-down, and of a part of it; most parts.
_LEAST_CYCLES, _CYCLES_IN_PART, _MOST_PARTS = 4.0, 3.0, 10
#: Most consecutive samples of a force or base that a line may replace.
_MOST_MISSING = 2
#: A part is used whose amplitude is above so many standard deviations of the noise.
_ABOVE_NOISE = 4.0
#: Threshold of a change over the amplitude: significance 1e-4, and part of the value.
_RARE = float(chdtri(1, 1e-4))
_LEAST_CHANGE = {'damping_ratio': 0.05, 'frequency': 0.002}
#: Standard deviations by which two parts differ if the change is significant; part of the damping
#: ratio beyond which a change is not that of a usual structure.
_APART, _DAMPER = 6.0, 0.5
_DEVIATIONS = {'damping_ratio': 'damping_deviation', 'frequency': 'frequency_deviation'}
_UNITS = {'displacement': 'm', 'velocity': 'm/s', 'acceleration': 'm/s^2'}
#: Largest mean square of the residual over that of the noise, for long records; and its random
#: part in n samples, times sqrt(n).
_MOST_CHI_SQUARED, _CHANCE = 1.2, 7.0
#: Largest deviation of the gain of the base from 1: the uncertainty of vibration sensors is about
#: 10 %.
_GAIN = 0.2
#: Terms of a series; bounds of the logarithm of the noise of the drive at resonance, over that of
#: the motion, by how much it must raise twice the logarithm of the likelihood, and rounds of it;
#: and by how much noise that the drive shows may lower that, by chance in one of 2000 records.
_TERMS, _SHARES, _CLEAR_NOISE, _NOISE_ROUNDS = 6, (-4.0, 7.0), 2.0, 2
_CONTRADICTED = float(chdtri(1, 5e-4))


class Part(NamedTuple):
    """Some cycles of a ring-down: their time, amplitude, frequency (Hz) and damping ratio."""

    time: float
    amplitude: float
    frequency: float
    frequency_deviation: float
    damping_ratio: float
    damping_deviation: float


class StructureFit(NamedTuple):
    """
    A structure by a measurement.

    Attributes
    ----------
    accepted : bool
        Whether the structure is linear with viscous damping, as far as the data show.
    reasons : list of str
        Why the fit is not accepted.
    kind : {'ring-down', 'force', 'base'}
        Kind of the measurement.
    frequency, damping_ratio : Estimate
        Natural frequency (without damping), Hz, and damping ratio.
    mass : Estimate or None
        Modal mass, kg, where the force was measured.
    correlation : float
        Correlation of frequency and damping ratio.
    chi_squared : float
        Mean square of the residual over that of the noise.
    fit_percent : float
        100 (1 - rms residual/rms motion).
    whiteness : float
        Largest correlation of the residual with itself, at up to 20 samples.
    noise : float
        Standard deviation of the noise, in the unit of the motion.
    parts : tuple of Part
        Parts of a ring-down.
    data : MeasuredMotion
        The part of the data that was used.
    fitted : ndarray
        The motion at the times of `data`.
    input_noise : float
        Standard deviation of the noise of the force or base, in its unit; 0 where none is
        detected.

    Examples
    --------
    >>> time = np.arange(0.0, 60.0, 0.02)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal(len(time))
    >>> x = np.exp(-0.05 * time) * np.cos(5.0 * time) + noise
    >>> data = MeasuredMotion(time, x, 'displacement', np.ones(len(time), bool))
    >>> estimate = fit_structure(data).damping_ratio
    >>> estimate.interval[0] < 0.01 < estimate.interval[1]
    True
    """

    accepted: bool
    reasons: list[str]
    kind: str
    frequency: Estimate
    damping_ratio: Estimate
    mass: Estimate | None
    correlation: float
    chi_squared: float
    fit_percent: float
    whiteness: float
    noise: float
    parts: tuple[Part, ...]
    data: MeasuredMotion
    fitted: Array
    input_noise: float = 0.0

    def as_dict(self) -> dict[str, Any]:
        """Return the fit for JSON."""
        parameters = {
            'natural_frequency': self.frequency.as_dict(),
            'damping_ratio': self.damping_ratio.as_dict(),
        }
        if self.mass is not None:
            parameters['primary_mass'] = self.mass.as_dict()

        return {
            'accepted': self.accepted,
            'reasons': self.reasons,
            'kind': self.kind,
            'parameters': parameters,
            'correlations': {'natural_frequency damping_ratio': self.correlation},
            'chi_squared': self.chi_squared,
            'fit_percent': self.fit_percent,
            'whiteness': self.whiteness,
            'noise': self.noise,
            'input_noise': self.input_noise,
            'quantity': self.data.quantity,
            'interval_of_time': [float(self.data.time[0]), float(self.data.time[-1])],
            'parts': [part._asdict() for part in self.parts],
        }


class _Solution(NamedTuple):
    """The most likely w and zeta, the linear unknowns, and the covariance."""

    place: Array
    linear: Array
    covariance: Array
    deviation: float
    fitted: Array
    residual: Array


_Basis = Callable[[Array], Array]
#: Filter that makes residuals white, at a place.
_Filter = Callable[[Array, Array], Array]


def _solve(
    basis: _Basis, motion: Array, used: Mask, start: Array, whitened: _Filter | None = None
) -> _Solution:
    """
    Return the most likely solution from a start; `basis` has the linear terms as columns.

    With a filter `motion` has no missing samples.
    """
    white = whitened or (lambda _, columns: columns)
    size = float(np.std(motion[used])) or 1.0

    def linear(place: Array) -> tuple[Array, Array, Array]:
        columns, there = white(place, basis(place))[used], white(place, motion)[used]
        scale = np.sqrt((columns**2).sum(axis=0))
        scale[scale == 0.0] = 1.0
        scaled = columns / scale
        found = np.linalg.pinv(scaled.T @ scaled, hermitian=True) @ (scaled.T @ there)
        return found / scale, columns, there

    def residual(place: Array) -> Array:
        found, columns, there = linear(place)
        left: Array = columns @ found - there
        return left

    best = least_squares(
        lambda place: residual(place) / size,
        start,
        x_scale=(1e-3 * start[0], 1e-3),
        diff_step=(1e-7, 1e-5),
        xtol=1e-10,
        ftol=1e-12,
        max_nfev=60,
    )
    place: Array = best.x
    found, columns, there = linear(place)
    rates = []
    for k, step in enumerate((1e-6 * place[0], 1e-6)):
        ahead, behind = place.copy(), place.copy()
        ahead[k] += step
        behind[k] -= step
        change = (basis(ahead) @ found - basis(behind) @ found) / (2.0 * step)
        rates.append(white(place, change)[used])
    jacobian = np.column_stack([*rates, columns])
    scale = np.sqrt((jacobian**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    inverse = np.linalg.pinv((jacobian / scale).T @ (jacobian / scale), hermitian=True)
    free = max(1, len(there) - jacobian.shape[1])
    left = there - columns @ found
    deviation = math.sqrt(float(left @ left) / free)
    covariance = deviation**2 * inverse / np.outer(scale, scale)
    return _Solution(place, found, covariance, deviation, basis(place) @ found, left)


def _free(place: Array, time: Array) -> Array:
    """Return the two free vibrations, from the first instant on."""
    omega, zeta = place
    rate = omega * math.sqrt(max(1e-12, 1.0 - zeta * zeta))
    later = time - time[0]
    decay = np.exp(-np.clip(zeta * omega * later, -50.0, 700.0))
    return np.column_stack([decay * np.cos(rate * later), decay * np.sin(rate * later)])


def _ring_down_basis(time: Array) -> _Basis:
    ones = np.ones((len(time), 1))
    return lambda place: np.hstack([_free(place, time), ones])


#: Numerators of the response, highest power of s first, for a force (per mass): of displacement,
#: velocity and acceleration.
_RESPONSES = {'displacement': (0.0, 0.0, 1.0), 'velocity': (0.0, 1.0, 0.0)}
_RESPONSES['acceleration'] = (1.0, 0.0, 0.0)


def _as_lines(drive: Array) -> Array:
    """
    Return samples whose joining lines have the tones of a band-limited drive.

    Lines keep sin^2(a)/a^2 of a tone that turns by 2 a in a step; a^2/sin^2(a) is a series in
    sin^2(a), which is a second difference over -4.
    """
    padded = np.pad(drive, 2 * _TERMS, 'reflect', reflect_type='odd')
    total, factor = padded.copy(), 1.0
    for n in range(1, _TERMS + 1):
        padded = -0.25 * np.convolve(padded, [1.0, -2.0, 1.0], 'same')
        factor *= 2.0 * n * n / ((n + 1) * (2 * n + 1))
        total += factor * padded
    lines: Array = total[2 * _TERMS : -2 * _TERMS]
    return lines


class _Driven:
    """Columns of the response to a measured force or base: driven, free vibrations, offset."""

    def __init__(self, data: MeasuredMotion, drive: Array, kind: str) -> None:
        self._data, self._drive, self._lines = data, drive, _as_lines(drive)
        self._base = kind == 'base'

    def _system(self, place: Array) -> tuple[Array, Array, float]:
        """Return numerator and denominator by steps, and the direct term."""
        omega, zeta = float(place[0]), float(place[1])
        below = (1.0, 2.0 * zeta * omega, omega * omega)
        above = (0.0, *below[1:]) if self._base else _RESPONSES[self._data.quantity]
        # In balanced states, whose coefficients have one size
        feed = above[0]
        first, second = (above[k] - feed * below[k] for k in (1, 2))
        a = np.array([[-below[1], -omega], [omega, 0.0]])
        b, c = np.array([[1.0], [0.0]]), np.array([[first, second / omega]])
        # scipy.signal takes long to load, and a ring-down does not need it.
        system = scipy.signal.cont2discrete(
            (a, b, c, np.zeros((1, 1))), self._data.interval, 'foh'
        )
        numerator, denominator = scipy.signal.ss2tf(*system[:4])
        return numerator[0], denominator, feed

    def __call__(self, place: Array) -> Array:
        numerator, denominator, feed = self._system(place)
        response = scipy.signal.lfilter(numerator, denominator, self._lines) + feed * self._drive
        time = self._data.time
        return np.hstack([response[:, None], _free(place, time), np.ones((len(time), 1))])

    def peak(self, place: Array) -> float:
        """Return the largest response to a tone."""
        above, below, feed = self._system(place)
        turns = np.exp(-1j * self._data.interval * place[0] * np.arange(3))
        return float(abs(above @ turns / (below @ turns) + feed))

    def filter(self, share: float) -> _Filter:
        """
        Return the filter that whitens noise of the motion with that of the drive.

        At resonance the noise of the drive has `share` times the deviation of that of the motion.
        """

        def whiten(place: Array, columns: Array) -> Array:
            below, inner, _ = self._factors(place, share)
            white: Array = scipy.signal.lfilter(below, inner, columns, axis=0)
            return white

        return whiten

    def size(self, logarithm: float, place: Array, left: Array) -> float:
        """Return the logarithm of the square of filtered residuals."""
        white = self.filter(math.exp(logarithm))(place, left)
        return float(np.log(white @ white))

    def _factors(self, place: Array, share: float) -> tuple[Array, Array, float]:
        """Return the denominator, the spectrum of both noises as a factor, and its size."""
        above, below, feed = self._system(place)
        above = (above + feed * below) * (share / self.peak(place))
        spectrum = np.correlate(below, below, 'full') + np.correlate(above, above, 'full')
        roots = np.roots(spectrum)
        inner = np.real(np.poly(roots[np.argsort(np.abs(roots))[:2]]))
        return below, inner, float(spectrum[2] / (inner @ inner))

    @property
    def rough(self) -> float:
        """The noise of the drive, unless it is rough itself."""
        return noise_of(self._drive)

    def noise(self, place: Array, share: float) -> float:
        """Return the deviation of the noise of the motion over that of the white residuals."""
        return 1.0 / math.sqrt(self._factors(place, share)[2])


def _solved_with_noise(
    basis: _Driven, data: MeasuredMotion, plain: _Solution
) -> tuple[_Solution, float]:
    """
    Return a solution with noise of the drive, and the share of that noise at resonance.

    The noise is the roughness of the drive, unless the residuals contradict: then the drive itself
    is rough, and its noise is what the residuals show.
    """
    solution, share = plain, 0.0
    for _ in range(_NOISE_ROUNDS):
        motion = np.where(data.used, data.motion, solution.fitted)
        left, place = motion - solution.fitted, solution.place
        least, most = _SHARES
        rough = basis.rough * basis.peak(place) * abs(float(solution.linear[0]))
        shown = math.log(
            max(rough / (solution.deviation * basis.noise(place, share)), math.exp(least))
        )
        best = minimize_scalar(
            basis.size,
            bounds=_SHARES,
            args=(place, left),
            method='bounded',
            options={'xatol': 1e-2},
        )
        plausible = shown < most and (
            len(left) * (basis.size(shown, place, left) - best.fun) < _CONTRADICTED
        )
        if not plausible and len(left) * (math.log(left @ left) - best.fun) < _CLEAR_NOISE:
            break
        share = math.exp(shown if plausible else best.x)
        solution = _solve(basis, motion, data.used, place, basis.filter(share))
    return solution, share


def _peak(values: Array, step: float) -> float:
    """Return the frequency of the largest peak of a spectrum, Hz."""
    count = 4 * len(values)
    spectrum = np.abs(np.fft.rfft((values - values.mean()) * np.hanning(len(values)), count))
    spectrum[: max(2, 4 * 2)] = 0.0
    return float(np.argmax(spectrum)) / (count * step)


def _filled_motion(data: MeasuredMotion) -> Array:
    """Return the motion with lines in place of unused samples."""
    places = np.arange(len(data.time))
    filled: Array = np.interp(places, places[data.used], data.motion[data.used])
    return filled


def _filled_drive(data: MeasuredMotion, drive: Array, kind: str) -> Array:
    """Return a force or base with lines in place of few missing samples: earlier values matter."""
    there = np.flatnonzero(np.isfinite(drive))
    longest = int(np.argmax(np.diff(there)))
    last, following = there[longest : longest + 2]
    if following - last > _MOST_MISSING + 1:
        raise ValueError(
            f'{data.source}: the {kind} is not known from {data.time[last]:.6g} to '
            f'{data.time[following]:.6g} s, and its values matter later: cut the record there, '
            'with --from or --to'
        )
    filled: Array = np.interp(np.arange(len(drive)), there, drive[there])
    return filled


def _release(data: MeasuredMotion) -> float:
    """Return the instant of free vibration: half a cycle after the largest motion."""
    motion, step = _filled_motion(data), data.interval
    period = 1.0 / _peak(motion, step)
    window = max(4, round(period / step))
    if window * _LEAST_CYCLES > len(motion):
        raise ValueError(
            f'{data.source}: {len(motion) / window:.2g} cycles of {1.0 / period:.4g} Hz: record '
            f'at least {_LEAST_CYCLES:g}, better 30'
        )
    total = np.cumsum(np.concatenate([[0.0], motion]))
    squares = np.cumsum(np.concatenate([[0.0], motion**2]))
    mean = (total[window:] - total[:-window]) / window
    spread = np.sqrt(np.maximum(0.0, (squares[window:] - squares[:-window]) / window - mean**2))
    begin = int(np.argmax(spread >= 0.95 * spread.max()))
    # A record that begins within the vibration is used from its beginning on.
    return float(data.time[begin] + (0.5 * period if begin > window // 8 else 0.0))


def _noise_of(residual: Array) -> float:
    """Return the standard deviation of white noise under a slow signal, by fourth differences."""
    bend = np.diff(residual, 4)
    return float(np.sqrt(np.mean(bend**2) / 70.0))


def _whiteness(residual: Array) -> float:
    centred = residual - residual.mean()
    power = float(centred @ centred) or 1.0
    lags = range(1, min(21, len(residual) // 4))
    return max((abs(float(centred[k:] @ centred[:-k])) / power for k in lags), default=0.0)


def _parts(data: MeasuredMotion, whole: _Solution) -> list[Part]:
    """Return frequency and damping of parts of a ring-down."""
    omega, zeta = whole.place
    period = 2.0 * math.pi / omega
    span = data.time[-1] - data.time[0]
    first = float(np.hypot(*whole.linear[:2]))
    # Parts end where the vibration is below the noise.
    if zeta > 0.0 and first > _ABOVE_NOISE * whole.deviation:
        lost = math.log(first / (_ABOVE_NOISE * whole.deviation)) / (zeta * omega)
        span = min(span, lost)
    count = int(min(_MOST_PARTS, span / (_CYCLES_IN_PART * period)))
    found = []
    for k in range(count):
        low, high = data.time[0] + k * span / count, data.time[0] + (k + 1) * span / count
        inside = (data.time >= low) & (data.time < high)
        if (inside & data.used).sum() < 12:
            continue
        time = data.time[inside]
        try:
            one = _solve(
                _ring_down_basis(time), data.motion[inside], data.used[inside], whole.place
            )
        except (np.linalg.LinAlgError, ValueError):
            continue
        decay = math.exp(-one.place[1] * one.place[0] * 0.5 * (time[-1] - time[0]))
        amplitude = float(np.hypot(*one.linear[:2])) * decay
        deviations = np.sqrt(np.diag(one.covariance)[:2])
        if amplitude > 0.5 * _ABOVE_NOISE * one.deviation:
            found.append(
                Part(
                    float(time.mean()),
                    amplitude,
                    float(one.place[0]) / (2.0 * math.pi),
                    float(deviations[0]) / (2.0 * math.pi),
                    float(one.place[1]),
                    float(deviations[1]),
                )
            )
    return found


def _changing(parts: list[Part], name: str, unit: str) -> str:
    """Return the sentence on a quantity that is not constant; an empty text if it is."""
    if len(parts) < 3:
        return ''
    size, value, deviation = np.array(
        [(part.amplitude, getattr(part, name), getattr(part, _DEVIATIONS[name])) for part in parts]
    ).T

    def chi_squared(degree: int) -> float:
        """Return chi squared of a polynomial in the logarithm of the amplitude."""
        best = np.polyfit(np.log(size), value, degree, w=1.0 / deviation)
        return float(np.sum(((np.polyval(best, np.log(size)) - value) / deviation) ** 2))

    # With scatter beyond the deviations a slope may be random, and counts as none.
    scatter = max(1.0, chi_squared(1) / (len(parts) - 2))
    most, least = int(size.argmax()), int(size.argmin())
    how = 'changes with the amplitude'
    if chi_squared(0) - chi_squared(1) < _RARE * scatter:
        most, least = int(value.argmax()), int(value.argmin())
        how = 'is not constant'
        if value[most] - value[least] < _APART * math.hypot(deviation[most], deviation[least]):
            return ''
    change = abs(value[most] - value[least])
    if change < _LEAST_CHANGE[name] * np.median(value):
        return ''
    percent = name == 'damping_ratio'
    words = [
        (
            f'{100.0 * value[k]:.3g} ± {100.0 * deviation[k]:.1g} %'
            if percent
            else f'{value[k]:.5g} ± {deviation[k]:.1g} Hz'
        )
        + f' at {size[k]:.3g} {unit}'
        for k in (most, least)
    ]
    cause = 'the stiffness is not linear'
    if percent:
        large = change > _DAMPER * np.median(value)
        cause = 'the damping is not viscous' + (': is the damper still in it?' if large else '')
    return f'the {name.replace("_", " ")} {how}: {words[0]}, {words[1]}; {cause}'


def _start_of_sweep(basis: _Basis, data: MeasuredMotion, drive: Array) -> Array:
    """Return w and zeta near the most likely ones, by trial."""
    motion = _filled_motion(data)
    peak = 2.0 * math.pi * _peak(motion, data.interval)
    driven = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(len(drive))))
    rates = 2.0 * math.pi * np.fft.rfftfreq(len(drive), data.interval)
    band = rates[driven > 0.05 * driven.max()]
    low, high = 0.5 * min(band.min(), peak), 2.0 * max(band.max(), peak)
    best, place = math.inf, np.array([peak, 0.02])
    there = data.motion[data.used] - data.motion[data.used].mean()
    for omega in np.concatenate([np.geomspace(max(low, 1e-3), high, 60), [peak]]):
        for zeta in (0.003, 0.01, 0.03, 0.1):
            response = basis(np.array([omega, zeta]))[data.used, 0]
            response = response - response.mean()
            gain = np.sum(response * there) / (np.sum(response * response) or 1.0)
            cost = float(np.sum((there - gain * response) ** 2))
            if cost < best:
                best, place = cost, np.array([omega, zeta])
    return place


def fit_structure(data: MeasuredMotion) -> StructureFit:
    """
    Fit frequency and damping of a structure to its ring-down, or to a sweep.

    Parameters
    ----------
    data : MeasuredMotion
        Free vibration; or the response to a force or base that was measured, too.

    Returns
    -------
    StructureFit
        The most likely values with their intervals, and whether they are constant.

    Raises
    ------
    TypeError
        If the data are no `MeasuredMotion`.
    ValueError
        If the data are no vibration.

    Examples
    --------
    >>> time = np.arange(0.0, 60.0, 0.02)
    >>> noise = 1e-3 * np.random.default_rng(1).standard_normal(len(time))
    >>> x = np.exp(-0.05 * time) * np.cos(5.0 * time) + noise
    >>> data = MeasuredMotion(time, x, 'displacement', np.ones(len(time), bool))
    >>> found = fit_structure(data)
    >>> found.kind, round(found.frequency.value, 3), round(found.damping_ratio.value, 4)
    ('ring-down', 0.796, 0.01)
    """
    check_kind('data', data, MeasuredMotion, 'a MeasuredMotion, such as read_motion(path)')
    kind, drive, noises = 'ring-down', None, (1.0, 0.0)
    if data.base is not None:
        kind, drive = 'base', data.base
        if data.base_quantity != data.quantity:
            raise ValueError(
                f'{data.source}: the {data.quantity} of M beside the {data.base_quantity} of the '
                'base: measure the same of both'
            )
    elif data.force is not None and np.nanmax(data.force) > np.nanmin(data.force):
        kind, drive = 'force', data.force
    if drive is None:
        data = data.between(_release(data), math.inf)
        basis = _ring_down_basis(data.time)
        motion = _filled_motion(data)
        start = np.array([2.0 * math.pi * _peak(motion, data.interval), 0.01])
        tries = [np.array([start[0], zeta]) for zeta in (0.002, 0.01, 0.05)]
        found = [_solve(basis, data.motion, data.used, place) for place in tries]
        solution = min(found, key=lambda one: one.deviation)
    else:
        drive = _filled_drive(data, drive, kind)
        basis = _Driven(data, drive, kind)
        start = _start_of_sweep(basis, data, drive)
        solution = _solve(basis, data.motion, data.used, start)
        solution, share = _solved_with_noise(basis, data, solution)
        if share:
            size, peak = basis.noise(solution.place, share), basis.peak(solution.place)
            noises = size, share * size / (peak * abs(float(solution.linear[0])))
    return _judge(data, kind, solution, noises)


def _judge(
    data: MeasuredMotion, kind: str, solution: _Solution, noises: tuple[float, float]
) -> StructureFit:
    """
    Return the result with its faults.

    `noises` are those of the motion, over the white residual, and of the drive.
    """
    omega, zeta = map(float, solution.place)
    deviations = np.sqrt(np.diag(solution.covariance))
    frequency = Estimate.normal(
        omega / (2.0 * math.pi), float(deviations[0]) / (2.0 * math.pi), 'Hz'
    )
    damping = Estimate.normal(zeta, float(deviations[1]))
    mass = None
    if kind == 'force' and solution.linear[0] != 0.0:
        size = 1.0 / float(solution.linear[0])
        mass = Estimate.normal(size, size * size * float(deviations[2]), 'kg')
    residual = solution.residual
    noise = _noise_of(residual)
    chi_squared = (solution.deviation / noise) ** 2 if noise > 0.0 else 1.0
    size = float(np.std(data.motion[data.used]))
    parts = _parts(data, solution) if kind == 'ring-down' and zeta > 0.0 else []
    reasons = []
    if damping.interval[0] <= 0.0:
        reasons.append(
            'the vibration does not decay: the damping ratio is '
            f'{100.0 * zeta:.3g} % ± {100.0 * damping.standard_deviation:.2g} %'
            + ('; switch the shaker off, or record its force' if kind == 'ring-down' else '')
        )
    if mass is not None and mass.value < 0.0:
        reasons.append('M moves against the force: reverse the sign of one of the sensors')
    if kind == 'base' and abs(gain := float(solution.linear[0])) > 0.0 and abs(gain - 1.0) > _GAIN:
        reasons.append(
            f'M follows the base {gain:.4g} times as far as a structure on it does: '
            + (
                'reverse the sign of one of the sensors'
                if abs(gain + 1.0) < _GAIN
                else 'the sensors of M and of the base differ by this factor, or one is not where '
                'it should be'
            )
        )
    changes = [_changing(parts, name, _UNITS[data.quantity]) for name in _DEVIATIONS]
    reasons += filter(None, changes)
    most = _MOST_CHI_SQUARED + _CHANCE / math.sqrt(len(residual))
    if not reasons and chi_squared > most and solution.deviation > 2e-3 * size:
        worst = _where_worst(data, solution.fitted)
        reasons.append(
            f'the residual is {math.sqrt(chi_squared):.2g} times the noise, most of it around '
            f'{worst:.4g} s: look there for another mode, a disturbance, or a force'
        )
    correlation = float(solution.covariance[0, 1] / (deviations[0] * deviations[1] or 1.0))
    return StructureFit(
        accepted=not reasons,
        reasons=reasons,
        kind=kind,
        frequency=frequency,
        damping_ratio=damping,
        mass=mass,
        correlation=correlation,
        chi_squared=chi_squared,
        fit_percent=100.0 * (1.0 - solution.deviation / size),
        whiteness=_whiteness(residual),
        noise=noise * noises[0],
        parts=tuple(parts),
        data=data,
        fitted=solution.fitted,
        input_noise=noise * noises[1],
    )


def _where_worst(data: MeasuredMotion, fitted: Array) -> float:
    """Return the instant around which the residual is largest, s."""
    square = np.where(data.used, data.motion - fitted, 0.0) ** 2
    window = max(4, len(square) // 20)
    total = np.cumsum(np.concatenate([[0.0], square]))
    place = int(np.argmax(total[window:] - total[:-window]))
    return float(data.time[min(place + window // 2, len(data.time) - 1)])
