# SPDX-License-Identifier: Apache-2.0
"""
The search for impacts in the motion of M alone, by the shocks that explain it.

Whatever m does, M vibrates freely between impacts, and each of them changes X' at once, not X. A
Kalman filter and the smoother of its disturbances [1]_ test a shock between any two samples in one
pass, with the size of all others estimated anew. Shocks are added as long as one reduces the sum
of squares by more than a penalty, and those are removed that do not.

References
----------
.. [1] P. de Jong, J. Penzer, "Diagnosing shocks in time series", J. Amer. Statist. Assoc. 93
   (1998), 796-806.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from math import cos, exp, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from impact_damper_ros.motion.kernels import call_kernel, kernel
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .record import Record
from .vibration import Array, Vibration

#: Fall of the sum of squares by a further impact, in variances; that where one was measured.
PENALTY, PENALTY_MEASURED = 11.0, 1.0
#: Most passes that add shocks, and passes after which some are removed.
_PASSES, _PRUNES = 40, 4
#: Shocks are added that are as significant as this part of the most significant one, and as far
#: from each other in natural periods.
_PART, _APART = 0.35, 0.35
#: Shocks closer than so many samples may be one, and how often these are found anew.
_CLOSE, _AGAIN = 5, 2
#: Variances at the start, and of a shock, over those of the motion: they are as good as infinite.
_START, _SHOCK = 1e6, 100.0
#: Columns of the smoother: innovation, gain of a shock (or its square over the variance where
#: there is one), its size, time from it to the next sample, X and X' less the steady ones, and
#: what the filter needs.
INNOVATION, GAIN, SHOCK, LAG, SMOOTH_X, SMOOTH_V, SPACE_FROM = range(7)
_COLUMNS = SPACE_FROM + 14


class Jumps(NamedTuple):
    """Impacts: instants, X and X' just before each, the jump of X', and its deviation."""

    time: Array
    x: Array
    velocity: Array
    jump: Array
    deviation: Array


@kernel
def smooth_shocks(
    times: Any,
    motion: Any,
    weights: Any,
    sensor: Any,
    shocks: Sequence[bool],
    variance: float,
    size: float,
    table: Any,
) -> float:
    """
    Filter and smooth the motion of M less its steady response, with shocks after some samples.

    `sensor` holds a, b, w^2 and how X and X' are measured; `size` is the variance of X. The result
    is the sum of the squares of the innovations.
    """
    a = sensor[0]
    b = sensor[1]
    square = sensor[2]
    h_x = sensor[3]
    h_v = sensor[4]
    shock = _SHOCK * size * square
    x = 0.0
    v = 0.0
    p_xx = _START * size
    p_xv = 0.0
    p_vv = _START * size * square
    cost = 0.0
    n = len(times)
    for i in range(n):
        row = table[i]
        at = SPACE_FROM
        row[at] = x
        row[at + 1] = v
        row[at + 2] = p_xx
        row[at + 3] = p_xv
        row[at + 4] = p_vv
        g_x = 0.0
        g_v = 0.0
        left = 0.0
        spread = 1.0
        if weights[i] > 0.0:
            o_x = p_xx * h_x + p_xv * h_v
            o_v = p_xv * h_x + p_vv * h_v
            spread = o_x * h_x + o_v * h_v + variance
            left = motion[i] - h_x * x - h_v * v
            g_x = o_x / spread
            g_v = o_v / spread
            cost += left * left / spread
            k_xx = 1.0 - g_x * h_x
            k_xv = -g_x * h_v
            k_vx = -g_v * h_x
            k_vv = 1.0 - g_v * h_v
            u_x = p_xx * k_xx + p_xv * k_xv
            u_v = p_xv * k_xx + p_vv * k_xv
            w_x = p_xx * k_vx + p_xv * k_vv
            w_v = p_xv * k_vx + p_vv * k_vv
            p_xx = k_xx * u_x + k_xv * u_v + g_x * g_x * variance
            p_xv = k_vx * u_x + k_vv * u_v + g_x * g_v * variance
            p_vv = k_vx * w_x + k_vv * w_v + g_v * g_v * variance
            x += g_x * left
            v += g_v * left
        row[INNOVATION] = left / sqrt(spread)
        step = times[i + 1] - times[i] if i + 1 < n else times[i] - times[i - 1]
        envelope = exp(-a * step)
        impulse = envelope * sin(b * step) / b
        slope = envelope * cos(b * step)
        f_xx = slope + a * impulse
        f_vx = -square * impulse
        f_vv = slope - a * impulse
        x, v = f_xx * x + impulse * v, f_vx * x + f_vv * v
        u_x = p_xx * f_xx + p_xv * impulse
        u_v = p_xv * f_xx + p_vv * impulse
        w_x = p_xx * f_vx + p_xv * f_vv
        w_v = p_xv * f_vx + p_vv * f_vv
        p_xx = f_xx * u_x + impulse * u_v
        p_xv = f_vx * u_x + f_vv * u_v
        p_vv = f_vx * w_x + f_vv * w_v
        if shocks[i]:
            # At any instant between the samples
            p_xx += shock * step * step / 3.0
            p_xv += shock * step / 2.0
            p_vv += shock
        row[at + 5] = left / spread
        row[at + 6] = spread
        row[at + 7] = g_x
        row[at + 8] = g_v
        row[at + 9] = f_xx
        row[at + 10] = impulse
        row[at + 11] = f_vx
        row[at + 12] = f_vv
        row[at + 13] = step
    r_x = 0.0
    r_v = 0.0
    n_xx = 0.0
    n_xv = 0.0
    n_vv = 0.0
    for done in range(n):
        i = n - 1 - done
        row = table[i]
        at = SPACE_FROM
        step = row[at + 13]
        row[GAIN] = 0.0
        row[SHOCK] = 0.0
        row[LAG] = 0.5 * step
        if shocks[i]:
            q_xv = shock * step / 2.0
            row[SHOCK] = q_xv * r_x + shock * r_v
            m_x = q_xv * n_xx + shock * n_xv
            m_v = q_xv * n_xv + shock * n_vv
            known = shock - (m_x * q_xv + m_v * shock)
            if known > 0.0 and row[SHOCK] != 0.0:
                row[GAIN] = row[SHOCK] * row[SHOCK] / known
                moved = shock * step * step / 3.0 * r_x + q_xv * r_v
                row[LAG] = min(max(moved / row[SHOCK], 0.0), step)
        else:
            pull = 0.5 * step * r_x + r_v
            known = 0.25 * step * step * n_xx + step * n_xv + n_vv
            if known > 0.0:
                row[GAIN] = pull * pull / known
        f_xx = row[at + 9]
        f_xv = row[at + 10]
        f_vx = row[at + 11]
        f_vv = row[at + 12]
        # Back through the transition, then through the measurement
        t_x = f_xx * r_x + f_vx * r_v
        t_v = f_xv * r_x + f_vv * r_v
        u_x = n_xx * f_xx + n_xv * f_vx
        u_v = n_xv * f_xx + n_vv * f_vx
        w_x = n_xx * f_xv + n_xv * f_vv
        w_v = n_xv * f_xv + n_vv * f_vv
        n_xx = f_xx * u_x + f_vx * u_v
        n_xv = f_xv * u_x + f_vv * u_v
        n_vv = f_xv * w_x + f_vv * w_v
        r_x = t_x
        r_v = t_v
        if weights[i] > 0.0:
            g_x = row[at + 7]
            g_v = row[at + 8]
            k_xx = 1.0 - g_x * h_x
            k_xv = -g_x * h_v
            k_vx = -g_v * h_x
            k_vv = 1.0 - g_v * h_v
            r_x = k_xx * t_x + k_vx * t_v + h_x * row[at + 5]
            r_v = k_xv * t_x + k_vv * t_v + h_v * row[at + 5]
            u_x = n_xx * k_xx + n_xv * k_vx
            u_v = n_xv * k_xx + n_vv * k_vx
            w_x = n_xx * k_xv + n_xv * k_vv
            w_v = n_xv * k_xv + n_vv * k_vv
            n_xx = k_xx * u_x + k_vx * u_v + h_x * h_x / row[at + 6]
            n_xv = k_xv * u_x + k_vv * u_v + h_x * h_v / row[at + 6]
            n_vv = k_xv * w_x + k_vv * w_v + h_v * h_v / row[at + 6]
        row[SMOOTH_X] = row[at] + row[at + 2] * r_x + row[at + 3] * r_v
        row[SMOOTH_V] = row[at + 1] + row[at + 3] * r_x + row[at + 4] * r_v
    return cost


class ImpactSearch:
    """
    The impacts of a record, for given K and C.

    Parameters
    ----------
    record : Record
        The measured motion.
    rig : RigParameters
        The rig: shocks closer than a part of its natural period are added one after the other.
    deviation : float
        Standard deviation of the noise.
    measured : ndarray, optional
        Measured instants of impacts.
    impact_deviation : float, optional
        Their standard deviation.

    Attributes
    ----------
    shocks : ndarray of bool
        After which samples there is an impact.
    cost : float
        Sum of squares that is left, in variances, and the penalties.
    """

    def __init__(
        self,
        record: Record,
        rig: RigParameters,
        deviation: float,
        measured: Array | None = None,
        impact_deviation: float = 0.0,
    ) -> None:
        # A kernel takes arrays without gaps; a record may be every second sample of another.
        time, motion, weight = map(np.ascontiguousarray, record[:3])
        record = Record(time, motion, weight, record.order)
        self._record, self._deviation = record, deviation
        self._measured = np.zeros(0) if measured is None else measured
        n = len(record.time)
        self.shocks, self.cost = np.zeros(n, bool), np.inf
        self._table = np.zeros((n, _COLUMNS))
        self._variance = float(np.var(record.motion[record.weight > 0.0]))
        # The motion less the steady response, which is the same for many shocks
        self._vibration: Vibration | None = None
        self._free = record.motion
        self._penalties = np.full(n, PENALTY)
        for shift in (-2.0, -1.0, 0.0, 1.0, 2.0):
            at = np.searchsorted(record.time, self._measured + shift * impact_deviation) - 1
            self._penalties[np.clip(at, 0, n - 1)] = PENALTY_MEASURED
        period = 2.0 * np.pi / rig.omega
        self._apart = max(1, int(_APART * period / float(np.median(np.diff(record.time)))))

    def smooth(self, vibration: Vibration) -> float:
        """Estimate the shocks; return the sum of squares that they leave."""
        record, order = self._record, self._record.order
        a, square = vibration.decay, vibration.stiffness
        sensor = a, vibration.damped, square, *((1.0, 0.0), (0.0, 1.0), (-square, -2.0 * a))[order]
        size = self._variance / square**order
        if self._vibration is not vibration:
            self._vibration = vibration
            self._free = record.motion - vibration.steady(record.time, order)
        cost: float = call_kernel(
            *(smooth_shocks, record.time, self._free),
            *(record.weight, np.array(sensor), self.shocks, self._deviation**2, size, self._table),
            what='fit',
        )
        return cost

    @property
    def innovations(self) -> Array:
        """What each sample adds to those before it, in standard deviations."""
        return self._table[:, INNOVATION]

    def find(self, vibration: Vibration, *, merge: bool = False) -> float:
        """Find the impacts and return the cost; `merge` neighbouring shocks where that pays."""
        self.shocks[:], again = False, _AGAIN
        for number in range(_PASSES):
            self.smooth(vibration)
            if number % _PRUNES == _PRUNES - 1:
                self._prune(0.5 * self._penalties, vibration)
            saved = np.where(self.shocks, 0.0, self._table[:, GAIN] - self._penalties)
            least = max(0.0, _PART * float(saved.max()))
            while saved.max() > least:
                best = int(saved.argmax())
                self.shocks[best] = True
                saved[max(0, best - self._apart) : best + self._apart + 1] = 0.0
            if least == 0.0:
                # One impact may have two shocks beside it, which were found before it was.
                here = np.flatnonzero(self.shocks)
                close = np.diff(here) < _CLOSE
                if not again or not close.any():
                    break
                again -= 1
                self.shocks[here[:-1][close]] = self.shocks[here[1:][close]] = False
        if merge:
            self._merge(vibration)
        left = self._prune(self._penalties, vibration)
        self.cost = left + float(self._penalties[self.shocks].sum())
        return self.cost

    def _prune(self, penalties: Array, vibration: Vibration) -> float:
        """Remove shocks that save less than penalties, the weakest of neighbours at a time."""
        while True:
            left = self.smooth(vibration)
            weak = np.where(self.shocks, penalties - self._table[:, GAIN], 0.0)
            if not (weak > 0.0).any():
                return left
            while weak.max() > 0.0:
                worst = int(weak.argmax())
                self.shocks[worst] = False
                weak[max(0, worst - self._apart) : worst + self._apart + 1] = 0.0

    def _merge(self, vibration: Vibration) -> None:
        """Replace two shocks beside an impact, found before it was, by one where it is."""
        here = np.flatnonzero(self.shocks).tolist()
        for one, other in pairwise(here):
            if other - one >= _CLOSE or not self.shocks[one]:
                continue
            with_both, alone = self.smooth(vibration), []
            for place in range(one, other + 1):
                self.shocks[one : other + 1] = False
                self.shocks[place] = True
                alone.append(self.smooth(vibration))
            best = int(np.argmin(alone))
            self.shocks[one : other + 1] = False
            if alone[best] - with_both < self._penalties[one + best]:
                self.shocks[one + best] = True
            else:
                self.shocks[[one, other]] = True

    def jumps(self, vibration: Vibration) -> Jumps:
        """Return the impacts; a measured time replaces the instant of one that is near."""
        self.smooth(vibration)
        time = self._record.time
        before = np.flatnonzero(self.shocks[:-1])
        here, after = self._table[before], self._table[before + 1]
        at, step = time[before + 1] - here[:, LAG], time[before + 1] - time[before]
        if len(self._measured):
            near = self._measured[np.abs(self._measured[None, :] - at[:, None]).argmin(1)]
            known = (near > time[before] - 0.5 * step) & (near < time[before + 1] + 0.5 * step)
            at = np.where(known & (np.append(True, np.diff(near) > 0.0)), near, at)
        back = np.exp(vibration.root * (at - time[before + 1]))
        free = after[:, SMOOTH_X] - 1j * (
            (after[:, SMOOTH_V] + vibration.decay * after[:, SMOOTH_X]) / vibration.damped
        )
        x, jump = (free * back).real + vibration.steady(at, 0), here[:, SHOCK]
        speed = (free * back * vibration.root).real + vibration.steady(at, 1)
        deviation = np.abs(jump) / np.sqrt(np.maximum(here[:, GAIN], 1e-12))
        rises = np.append(True, np.diff(at) > 0.0)[: len(at)]
        found = at, x, speed - jump, jump, deviation
        return Jumps(*(column[rises] for column in found))
