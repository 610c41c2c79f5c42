# SPDX-License-Identifier: Apache-2.0
"""
The partition of the measured motion into the fewest stretches of one free vibration each.

Less the steady response, each stretch between two impacts is exp(-a t) (A cos bt + B sin bt),
whether displacement, velocity or acceleration was measured. The stretches are found by optimal
partitioning [1]_: each further one must reduce the sum of squares by a penalty.

References
----------
.. [1] B. Jackson et al., "An algorithm for optimal partitioning of data on an interval", IEEE
   Signal Processing Letters 12 (2005), 105-108.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.optimize import least_squares

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .vibration import Array, Vibration

Edges = NDArray[np.int64]

#: Least samples of a stretch that determine its vibration.
LEAST = 3
#: Longest stretch that is searched as one, in natural periods; longer ones are joined.
_LONGEST = 1.6
#: Rows of the table of sums that are computed at once.
_ROWS = 256
#: Least number of fourth differences that show the noise.
_LEAST_DIFFERENCES = 30
#: Residuals beyond this many standard deviations count less in the fit of K and C.
_ROBUST = 3.0
#: Largest change of the logarithms of K and C from their start.
_WIDEST = np.array([0.2, 3.0])


class Record(NamedTuple):
    """Samples of the motion of M for the partition; weights are 0 or 1."""

    time: Array
    motion: Array
    weight: Array
    order: int


class Jumps(NamedTuple):
    """Impacts in the motion of M: instants, X and X' just before each, and the jump of X'."""

    time: Array
    x: Array
    velocity: Array
    jump: Array


def noise_of(motion: Array) -> float:
    """
    Return the standard deviation of white noise, from fourth differences.

    A smooth motion has almost no fourth differences; jumps are too few to alter the median.
    """
    differences = np.diff(motion, 4)
    if not len(differences):
        return 0.0
    middle = np.median(differences)
    return float(1.4826 * np.median(np.abs(differences - middle)) / np.sqrt(70.0))


def noise_between(residuals: Array, time: Array, impacts: Array) -> float:
    """
    Return the noise of residuals from fourth differences that do not span an impact.

    The result is NaN with too few differences; the residuals may have gaps of NaN.
    """
    differences = np.diff(residuals, 4)
    first = np.searchsorted(impacts, time)
    differences = differences[(first[4:] == first[:-4]) & np.isfinite(differences)]
    if len(differences) < _LEAST_DIFFERENCES:
        return float('nan')
    rough = 1.4826 * float(np.median(np.abs(differences)))
    return float(np.sqrt(np.mean(differences[np.abs(differences) <= 4.0 * rough] ** 2) / 70.0))


def _sums(record: Record, vibration: Vibration, first: int, end: int) -> Array:
    """Return running sums of y^2, yc, ys, cc, cs and ss from a sample on, with 0 before it."""
    part = slice(first, end)
    time, weight = record.time[part], record.weight[part]
    y = record.motion[part] - vibration.steady(time, record.order)
    wave = np.exp(vibration.root * (time - time[0]))
    c, s = wave.real, wave.imag
    terms = weight * np.array([y * y, y * c, y * s, c * c, c * s, s * s])
    return np.concatenate([np.zeros((6, 1)), np.cumsum(terms, axis=1)], axis=1)


def _squares_left(sums: Array) -> Array:
    """Return the residual sum of squares of the best vibration, given sums over stretches."""
    yy, yc, ys, cc, cs, ss = sums
    det = cc * ss - cs * cs
    poor = det <= 1e-9 * cc * ss
    taken = (ss * yc * yc - 2.0 * cs * yc * ys + cc * ys * ys) / np.where(poor, 1.0, det)
    left: Array = np.where(poor, 0.0, np.maximum(yy - taken, 0.0))
    return left


def partition(
    record: Record, vibration: Vibration, deviation: float, penalty: float | Array
) -> Edges:
    """
    Return where the stretches begin, as indices of samples, and the number of samples.

    `penalty` has that of a cut before each sample, in squares of the standard deviation.
    """
    n = len(record.time)
    cuts = np.broadcast_to(np.asarray(penalty, float), (n,))
    _, came = _cheapest(record, vibration, deviation, cuts)
    edges = [n]
    while edges[-1] > 0:
        edges.append(int(came[edges[-1]]))
    return _join(record, vibration, deviation, cuts, np.array(edges[::-1]))


def least_cost(record: Record, vibration: Vibration, deviation: float, penalty: float) -> float:
    """Return the sum of squares that the best stretches leave, in variances, and the penalties."""
    cuts = np.broadcast_to(penalty, (len(record.time),))
    return float(_cheapest(record, vibration, deviation, cuts)[0])


def _cheapest(
    record: Record, vibration: Vibration, deviation: float, cuts: Array
) -> tuple[float, Edges]:
    """Return the least cost and the last stretch's begin for each initial part of the record."""
    n = len(record.time)
    period = 2.0 * np.pi / vibration.damped
    longest = min(n, max(2 * LEAST, int(_LONGEST * period / np.median(np.diff(record.time)))))
    cost = np.full(n + 1, np.inf)
    came = np.zeros(n + 1, np.int64)
    cost[0] = -cuts[0]
    for first in range(0, n, _ROWS):
        last = min(first + _ROWS, n)
        sums = _sums(record, vibration, first, min(n, last + longest))
        padded = np.concatenate([sums, np.repeat(sums[:, -1:], longest, axis=1)], axis=1)
        rows = last - first
        windows = sliding_window_view(padded, longest + 1, axis=1)[:, :rows]
        table = _squares_left(windows[:, :, 1:] - windows[:, :, :1]) / deviation**2
        for k in range(first, last):
            size = min(longest, n - k)
            through = table[k - first, :size] + (cost[k] + cuts[k])
            ahead = cost[k + 1 : k + 1 + size]
            better = through < ahead
            ahead[better] = through[better]
            came[k + 1 : k + 1 + size][better] = k
    return float(cost[n]), came


def _join(
    record: Record, vibration: Vibration, deviation: float, cuts: Array, edges: Edges
) -> Edges:
    """Join neighbouring stretches that are one vibration, however long."""
    kept = [int(edges[0])]
    for k in range(1, len(edges) - 1):
        low, middle, high = kept[-1], int(edges[k]), int(edges[k + 1])
        sums = _sums(record, vibration, low, high)
        at = middle - low
        parts = [sums[:, -1], sums[:, at], sums[:, -1] - sums[:, at]]
        whole, left, right = (float(_squares_left(part)) for part in parts)
        if whole - left - right >= cuts[middle] * deviation**2:
            kept.append(middle)
    return np.array([*kept, edges[-1]])


class FreeVibrations(NamedTuple):
    """Free vibrations of the stretches, Re(c exp(root (t - t_first))), and all residuals."""

    amplitude: NDArray[np.complex128]
    residual: Array


def free_vibrations(record: Record, vibration: Vibration, edges: Edges) -> FreeVibrations:
    """Fit the free vibration of each stretch; too short stretches have none, and no residual."""
    starts, sizes = edges[:-1], np.diff(edges)
    y = record.motion - vibration.steady(record.time, record.order)
    since = record.time - np.repeat(record.time[starts], sizes)
    wave = np.exp(vibration.root * since)
    c, s, w = wave.real, wave.imag, record.weight
    add = np.add.reduceat
    cc, ss, cs = add(w * c * c, starts), add(w * s * s, starts), add(w * c * s, starts)
    yc, ys = add(w * y * c, starts), add(w * y * s, starts)
    det = cc * ss - cs * cs
    short = (add(w, starts) < LEAST) | (det <= 1e-9 * cc * ss)
    det = np.where(short, 1.0, det)
    real = np.where(short, 0.0, (ss * yc - cs * ys) / det)
    imaginary = np.where(short, 0.0, (cc * ys - cs * yc) / det)
    residual = w * (y - np.repeat(real, sizes) * c - np.repeat(imaginary, sizes) * s)
    residual[np.repeat(short, sizes)] = 0.0
    return FreeVibrations(np.where(short, 0.0, real - 1j * imaginary), residual)


def fit_vibration(
    record: Record, rig: RigParameters, edges: Edges, start: tuple[float, float], deviation: float
) -> tuple[float, float]:
    """Return K and C for which the stretches fit best, robustly."""

    def residuals(logarithms: Array) -> Array:
        stiffness, damping = np.exp(logarithms)
        vibration = Vibration.of(rig, float(stiffness), float(damping))
        left = free_vibrations(record, vibration, edges).residual
        scaled: Array = np.arcsinh(left / (_ROBUST * deviation))
        return scaled

    middle = np.log(start)
    bounds = middle - _WIDEST, middle + _WIDEST
    found = least_squares(residuals, middle, diff_step=1e-5, max_nfev=30, bounds=bounds)
    stiffness, damping = np.exp(found.x)
    return float(stiffness), float(damping)


def jumps_between(record: Record, vibration: Vibration, edges: Edges, measured: Array) -> Jumps:
    """
    Return impacts: where the displacements of neighbouring stretches are equal, or as measured.

    A measured impact time replaces the nearest of these instants.
    """
    amplitude, _ = free_vibrations(record, vibration, edges)
    amplitude = amplitude / vibration.root**record.order
    used = np.flatnonzero(amplitude)
    time, step = record.time, float(np.median(np.diff(record.time)))
    rows = []
    for left, right in pairwise(used.tolist()):

        def states(at: Array, *stretches: int) -> tuple[Array, ...]:
            """Return X and X' of stretches, less the steady response."""
            turning = [
                amplitude[k] * np.exp(vibration.root * (at - time[edges[k]])) for k in stretches
            ]
            return tuple(
                part for wave in turning for part in (wave.real, (vibration.root * wave).real)
            )

        low, high = time[edges[left + 1] - 1] - step, time[edges[right]] + step
        tried = np.linspace(low, high, 121)
        x_left, v_left, x_right, v_right = states(tried, left, right)
        middle = time[edges[right]] - 0.5 * step
        apart = np.abs(x_left - x_right) + 1e-3 * np.abs(v_left - v_right) * np.abs(tried - middle)
        at = tried[[int(np.argmin(apart))]]
        near = measured[(measured > low) & (measured < high)]
        if len(near):
            at = near[[int(np.argmin(np.abs(near - at)))]]
        x_left, v_left, x_right, v_right = (value[0] for value in states(at, left, right))
        x, v = (vibration.steady(at, order)[0] for order in (0, 1))
        rows.append((at[0], 0.5 * (x_left + x_right) + x, v_left + v, v_right - v_left))
    found = np.array(rows).reshape(-1, 4)
    found = found[np.argsort(found[:, 0], kind='stable')]
    apart = np.append(True, np.diff(found[:, 0]) > 0.2 * step)[: len(found)]
    return Jumps(*found[apart].T)
