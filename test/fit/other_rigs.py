"""
Rigs that the model does not describe, by an integrator that shares no code with the package.

Fourth-order Runge-Kutta steps of 0.1 ms, impacts at the crossing of a stop by secants.
"""

import math

import numba
import numpy as np

from impact_damper_ros import RigParameters
from impact_damper_ros.fit.measured_motion import MeasuredMotion

from .random_rigs import DEVIATION, LONGEST

_STEP = 1e-4
#: Slower impacts, in the usual speed, are those of m that rests at a stop, one in each step.
_REST = 0.02
_QUANTITIES = ('displacement', 'velocity', 'acceleration')


@numba.njit(cache=False)
def _rates(t, s, c, slides, out):
    """Write the time derivatives of X, X', Z, Z', Q, Q' with m sliding (+1, -1) or held (0)."""
    M, K, C, m, grip, F, w, phase, cubic, m2, k2, c2 = c[:12]
    pull = F * math.sin(w * t + phase) - C * s[1] - (K + cubic * s[0] * s[0]) * s[0]
    coupling = k2 * (s[4] - s[0]) + c2 * (s[5] - s[1])
    out[0], out[2], out[4] = s[1], s[3], s[5]
    if slides == 0.0:
        out[1] = (pull + coupling) / (M + m)
        out[3] = out[1]
    else:
        out[1] = (pull + coupling + slides * m * grip) / M
        out[3] = -slides * grip
    out[5] = -coupling / m2 if m2 > 0.0 else 0.0


@numba.njit(cache=False)
def _stepped(t, s, h, c, slides):
    k1, k2, k3, k4 = np.empty(6), np.empty(6), np.empty(6), np.empty(6)
    _rates(t, s, c, slides, k1)
    _rates(t + 0.5 * h, s + 0.5 * h * k1, c, slides, k2)
    _rates(t + 0.5 * h, s + 0.5 * h * k2, c, slides, k3)
    _rates(t + h, s + h * k3, c, slides, k4)
    return s + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


@numba.njit(cache=False)
def _run(c, gap, growth, restitution, fall, fast, s, every, samples, most):
    """Return rows of X, X', X'' and the instants of impacts, until so many of them."""
    M, m, grip = c[0], c[3], c[4]
    rows = np.empty((samples, 3))
    hits = np.empty(most + 50)
    rate = np.empty(6)
    count, n = 0, 0
    h = _STEP
    for step in range(samples * every):
        t = step * h
        relative = s[3] - s[1]
        slides = 1.0 if relative > 0.0 else -1.0
        _rates(t, s, c, 0.0, rate)
        if abs(relative) < 2.0 * grip * h and abs(rate[1]) <= grip:
            slides = 0.0
            s[3] = s[1]
        if step % every == 0:
            _rates(t, s, c, slides, rate)
            rows[n, 0], rows[n, 1], rows[n, 2] = s[0], s[1], rate[1]
            n += 1
            if count >= most and t > hits[most - 1] + 0.05:
                break
        after = _stepped(t, s, h, c, slides)
        half = 0.5 * (gap + growth * t)
        if abs(after[2] - after[0]) > half and (after[2] - after[0]) * (after[3] - after[1]) > 0.0:
            side = 1.0 if after[2] > after[0] else -1.0
            low = half - side * (s[2] - s[0])
            part = 0.0
            if low > 0.0:
                part = low / (low - half + side * (after[2] - after[0]))
                for _ in range(3):
                    middle = _stepped(t, s, part * h, c, slides)
                    off = side * (middle[2] - middle[0]) - half
                    speed = side * (middle[3] - middle[1])
                    part = min(max(part - off / (speed * h), 0.0), 1.0)
            at = _stepped(t, s, part * h, c, slides)
            approach = at[3] - at[1]
            R = max(0.0, min(1.0, restitution * (1.0 - fall * (abs(approach) / fast - 1.0))))
            impulse = M * m / (M + m) * (1.0 + R) * approach
            at[1] += impulse / M
            at[3] -= impulse / m
            if count < len(hits) and abs(approach) > _REST * fast:
                hits[count] = t + part * h
                count += 1
            back = 1.0 if at[3] > at[1] else -1.0
            after = _stepped(t + part * h, at, (1.0 - part) * h, c, back)
        s = after
    return rows[:n], hits[:count]


def measure_other(
    rig: RigParameters,
    rng: np.random.Generator,
    *,
    impacts: int = 100,
    rate: float = 200.0,
    noise: float = 0.01,
    quantity: str = 'displacement',
    timed: bool = True,
    cubic: float = 0.0,
    second_mode: float = 0.0,
    gap_growth: float = 0.0,
    fall: float = 0.0,
    longest: float = LONGEST,
) -> MeasuredMotion:
    """
    Return the record of a rig beside the model.

    `cubic` is the part of K by which the spring is stiffer at a quarter of the gap; `second_mode`
    the part of M that vibrates on it at 1.5 times its frequency; `gap_growth` the part by which
    the gap grows over the record; `fall` by which part R is lower at twice the usual speed.
    """
    M, w0 = rig.primary_mass, rig.omega
    small = second_mode * M
    fast = math.sqrt(rig.stiffness / M) * rig.gap / math.pi
    constants = np.array([
        M, rig.stiffness, rig.damping, rig.damper_mass, rig.friction * rig.gravity,
        rig.force_amplitudes[0], rig.force_frequencies[0], rig.force_phases[0],
        cubic * rig.stiffness / (0.25 * rig.gap) ** 2,
        small, small * (1.5 * w0) ** 2, 2.0 * 0.01 * small * 1.5 * w0,
    ])  # fmt: skip
    start = np.array([0.0, 0.0, 0.0, float(rng.uniform(-0.3, 0.3)), 0.0, 0.0])
    every = round(1.0 / rate / _STEP)

    def run(growth, start):
        return _run(constants, rig.gap, growth, rig.restitution_1, fall, fast, start.copy(),
                    every, int(longest * rate), impacts)  # fmt: skip

    rows, hits = run(0.0, start)
    if gap_growth:
        rows, hits = run(gap_growth * rig.gap * rate / len(rows), start)
    time = np.arange(len(rows)) / rate
    motion = rows[:, _QUANTITIES.index(quantity)]
    motion = motion + rng.normal(0.0, noise * math.sqrt(2.0) * float(np.std(motion)), len(time))
    times = np.sort(hits[hits < time[-1]] + rng.normal(0.0, DEVIATION, (hits < time[-1]).sum()))
    return MeasuredMotion(
        time,
        motion,
        quantity,
        np.ones(len(time), bool),
        impact_times=times if timed else None,
        impact_deviation=DEVIATION,
    )
