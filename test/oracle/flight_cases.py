"""Single flights of the rig, many at a time, and their motion in closed form (80-bit floats)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oracle.precise_motion import Harmonic, Motion, Oscillator, mp

Array = NDArray[Any]
REAL = np.longdouble
EPS = float(np.finfo(np.float64).eps)
TERMS = 27


@dataclass
class FlightCases:
    """
    Flights of  X'' = -omega0^2 X - 2 zeta omega0 X' + const_acc + sum f_j sin(phase_j + freq_j t)
    and  Y'' = gz - X'',  one per row.

    `slide` is the sign of Y' just after the start, which matters where w0 = 0; left out, it is
    worked out.  `horizon` is how far a generator suggests to look; left out, it is infinite.
    """  # noqa: D205

    omega0: Array
    zeta: Array
    x0: Array
    v0: Array
    y0: Array
    w0: Array
    half_gap: Array
    gz: Array
    force_acc: Array
    force_freq: Array
    force_phase0: Array
    const_acc: Array
    one_sided: Array
    watch_reversal: Array
    slide: Array = field(default_factory=lambda: np.zeros(0, dtype=np.int8))
    horizon: Array = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if self.horizon.shape != self.omega0.shape:
            self.horizon = np.full(self.omega0.shape, np.inf)
        if self.slide.shape != self.omega0.shape:
            self.slide = self.leading_sign()

    def __len__(self) -> int:
        return len(self.omega0)

    def take(self, index: Array | slice) -> FlightCases:
        """Return the flights chosen by an index or mask."""
        return FlightCases(**{name: getattr(self, name)[index] for name in NAMES})

    def active(self, count: int) -> FlightCases:
        """Return the flights with their first `count` harmonics only."""
        return FlightCases(
            **{
                f.name: getattr(self, f.name)[:, :count]
                if f.name.startswith('force_')
                else getattr(self, f.name)
                for f in fields(self)
            }
        )

    @cached_property
    def fastest(self) -> Array:
        """Return the highest circular frequency at work in each flight."""
        at_work = np.where(self.force_acc != 0, self.force_freq, 0.0)
        return np.asarray(np.maximum(self.omega0, at_work.max(axis=1, initial=0.0)))

    @property
    def strength(self) -> Array:
        """Return the sum of the magnitudes that make up Y'' at the start."""
        spring = self.omega0**2 * np.abs(self.x0) + 2 * self.zeta * self.omega0 * np.abs(self.v0)
        force = np.abs(self.force_acc).sum(axis=1)
        return np.asarray(spring + np.abs(self.const_acc) + force + np.abs(self.gz))

    def leading_sign(self) -> Array:
        """Return the sign of Y' just after the start: of Y', else Y'', else Y'''."""
        y2, y3 = (y.astype(float) for y in taylor_derivatives(self, 4)[2:4])
        flat = np.abs(y2) <= 1e3 * EPS * self.strength
        sign = np.where(self.w0 != 0, np.sign(self.w0), np.where(flat, np.sign(y3), np.sign(y2)))
        return sign.astype(np.int8)

    @staticmethod
    def join(parts: Sequence[FlightCases]) -> FlightCases:
        """Return one set of all the flights (same number of harmonics)."""
        return FlightCases(
            **{
                f.name: np.concatenate([getattr(part, f.name) for part in parts])
                for f in fields(FlightCases)
            }
        )


NAMES = tuple(f.name for f in fields(FlightCases))


def taylor_derivatives(cases: FlightCases, count: int = TERMS) -> list[Array]:
    """Return Y' and on at the start, from the differential equation (entry 0 is unused)."""
    omega, zeta = cases.omega0.astype(REAL), cases.zeta.astype(REAL)
    square, drag = omega * omega, 2 * zeta * omega
    frequency, phase = cases.force_freq.astype(REAL), cases.force_phase0.astype(REAL)
    acc = cases.force_acc.astype(REAL)
    sine, cosine = np.sin(phase), np.cos(phase)
    x = [cases.x0.astype(REAL), cases.v0.astype(REAL)]
    y = [np.zeros_like(x[0]), cases.w0.astype(REAL)]
    for k in range(count - 2):
        force = (acc * (sine, cosine, -sine, -cosine)[k % 4]).sum(axis=1)
        acc = acc * frequency
        following = -square * x[k] - drag * x[k + 1] + force
        if k == 0:
            following = following + cases.const_acc
        x.append(following)
        y.append(cases.gz - following if k == 0 else -following)
    return y


def taylor_series(cases: FlightCases) -> Array:
    """Return the Taylor coefficients of Y', one flight per column."""
    rows = np.stack(taylor_derivatives(cases))
    factorial = np.cumprod(np.maximum(np.arange(-1, TERMS - 1), 1).astype(REAL))
    return np.asarray(rows / factorial[:, None])


def taylor(
    series: Array, index: Array, t: Array, terms: int = TERMS
) -> tuple[Array, Array, Array]:
    """
    Return S = Y - y0, Y' and Y'' by the Taylor series, for (flight, time) pairs.

    All terms are enough below 1 / fastest.  Nothing cancels against the positions, so that
    flights far smaller than their round-off are resolved.
    """
    a = np.zeros(t.shape, dtype=REAL)
    s, u = a.copy(), a.copy()
    for k in range(terms - 1, 1, -1):
        c = series[k][index]
        a = a * t + c * (k - 1)
        u = u * t + c
        s = s * t + c / k
    w = series[1][index]
    return t * (w + t * s), w + t * u, a


def closed_form(cases: FlightCases, t: Array) -> tuple[Array, Array, Array]:
    """
    Return S = Y - y0, Y' and Y'' at times t (n, p), in the precision of t.

    Free response plus the response from rest, written with complex exponentials whose
    differences are taken by expm1, so that nothing cancels at or near resonance.
    """
    dtype = t.dtype

    def column(values: Array) -> Array:
        return np.asarray(values.astype(dtype)[:, None])

    omega, zeta = column(cases.omega0), column(cases.zeta)
    alpha = zeta * omega
    omega_d = omega * np.sqrt((1 - zeta) * (1 + zeta))
    x0, v0 = column(cases.x0), column(cases.v0)
    push, gz = column(cases.const_acc), column(cases.gz)
    em = np.expm1(-alpha * t)
    e = 1 + em
    half = np.sin(omega_d * t / 2)
    quarter = np.cos(omega_d * t / 2)
    sn = 2 * half * quarter
    drop = 2 * half * half
    cs = 1 - drop
    c2 = e * sn / omega_d
    fall = em * cs - drop + alpha * c2
    equilibrium = push / omega**2
    dx = (x0 - equilibrium) * fall + v0 * c2
    v = -omega * omega * (x0 - equilibrium) * c2 + v0 * (e * cs - alpha * c2)
    ec, es = e * cs, e * sn
    exciting = push + np.zeros_like(t)
    for j in range(cases.force_acc.shape[1]):
        acc, freq, phase = (
            column(c[:, j]) for c in (cases.force_acc, cases.force_freq, cases.force_phase0)
        )
        turn = phase + freq * t
        c, s = np.cos(turn), np.sin(turn)
        cp, sp = np.cos(phase), np.sin(phase)
        detuning = omega_d - freq
        detuning = np.where(detuning == 0, dtype.type(1e-25) * omega, detuning)
        h, q = np.sin(detuning * t / 2), np.cos(detuning * t / 2)
        re = em * (1 - 2 * h * h) - 2 * h * h
        im = e * 2 * h * q
        # e^{i turn} - e^{i phase + s t}, over (i freq - s); and the same with conj(s).
        wr, wi = s * im - c * re, -(s * re + c * im)
        norm = alpha * alpha + detuning * detuning
        d1r, d1i = (wr * alpha - wi * detuning) / norm, (wi * alpha + wr * detuning) / norm
        wr, wi = c - (cp * ec + sp * es), s - (sp * ec - cp * es)
        total = omega_d + freq
        norm = alpha * alpha + total * total
        d2r, d2i = (wr * alpha + wi * total) / norm, (wi * alpha - wr * total) / norm
        gain = -acc / (2 * omega_d)
        dx = dx + gain * (d1r - d2r)
        v = v + gain * (alpha * (d2r - d1r) - omega_d * (d1i + d2i))
        exciting = exciting + acc * s
    w = column(cases.w0) + v0
    a = gz - (exciting - omega * omega * (x0 + dx) - 2 * alpha * v)
    return (w + gz * t / 2) * t - dx, column(cases.w0) + gz * t - (v - v0), a


def precise(
    cases: FlightCases, index: Array, t: Array, series: Array | None = None
) -> tuple[Array, Array, Array]:
    """
    Return S, Y' and Y'' in 80 bits for a list of (flight, time) pairs.

    `series`, the `taylor_series` of all cases, saves time when there are many calls.
    """
    if series is None:
        cases, index = cases.take(index), np.arange(len(index))
        series = taylor_series(cases)
    t = t.astype(REAL)
    s, u, a = (np.empty(len(t), dtype=REAL) for _ in range(3))
    angle = t * cases.fastest[index]
    tiny, late = angle <= 1 / 32, angle > 1
    for part, terms in ((tiny, 13), (~(tiny | late), TERMS)):
        if part.any():
            s[part], u[part], a[part] = taylor(series, index[part], t[part], terms)
    if late.any():
        values = closed_form(cases.take(index[late]), t[late][:, None])
        s[late], u[late], a[late] = (value[:, 0] for value in values)
    return s, u, a


def round_off(cases: FlightCases, index: Array, t: Array, unit: str) -> tuple[Array, Array]:
    """
    Return the natural double-precision round-off of Y and of Y' at (flight, time) pairs.

    unit 'position': of positions and velocities as such, eps * (|x| + |y| + ...), with the phase
    errors of long flights.  unit 'local': the same, but early in a flight only what the terms of
    its Taylor series carry, so that Y - y0 must be right to a relative eps.
    """
    c = cases.take(index)
    t = t.astype(float)
    omega_d = c.omega0 * np.sqrt(1 - c.zeta**2)
    near = np.hypot((c.zeta * c.omega0)[:, None], c.force_freq - omega_d[:, None])
    tt, od, w = t[:, None], omega_d[:, None], c.omega0[:, None]
    f = np.abs(c.force_acc)
    with np.errstate(divide='ignore', over='ignore'):
        reach = np.minimum(np.minimum(tt * tt / 2, tt / od), 2 / (od * near))
        speed = np.minimum(tt, 2 * w / (od * near))
    amplitude = np.abs(c.x0) + np.abs(c.v0) * np.minimum(t, 1 / omega_d)
    amplitude += np.abs(c.const_acc) * np.minimum(t * t / 2, 2 / c.omega0**2)
    amplitude += (f * reach).sum(axis=1)
    pace = c.omega0 * np.abs(c.x0) + np.abs(c.v0) + (f * speed).sum(axis=1)
    pace += np.abs(c.const_acc) * np.minimum(t, 1 / c.omega0)
    turns = 1 + cases.fastest[index] * t
    drift = np.abs(c.w0) + np.abs(c.v0)
    position = np.abs(c.y0) + c.half_gap + drift * t + np.abs(c.gz) * t * t / 2 + amplitude * turns
    velocity = drift + np.abs(c.gz) * t + pace * turns
    if unit == 'local':
        start = np.minimum(np.abs(c.half_gap - c.y0), np.abs(c.half_gap + c.y0))
        early = np.abs(c.w0) * t + c.strength * t * t / 2
        position = np.minimum(position, start + early)
        velocity = np.minimum(velocity, np.abs(c.w0) + c.strength * t)
    elif unit != 'position':
        raise ValueError(f"unit is 'local' or 'position', not {unit!r}")
    return EPS * position, EPS * velocity


def exact_motion(cases: FlightCases, i: int) -> Motion:
    """Return X of one flight in multiprecision."""
    omega, zeta, x, v, push = (
        mp.mpf(float(a[i]))
        for a in (cases.omega0, cases.zeta, cases.x0, cases.v0, cases.const_acc)
    )
    rows = zip(cases.force_acc[i], cases.force_freq[i], cases.force_phase0[i], strict=True)
    harmonics = [Harmonic(*map(mp.mpf, map(float, row))) for row in rows if row[0]]
    oscillator = Oscillator(mp.mpf(1), 2 * zeta * omega, omega * omega, harmonics)
    return Motion(oscillator, mp.mpf(0), x, v, push)
