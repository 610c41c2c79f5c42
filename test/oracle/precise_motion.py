"""
Closed forms of the rig's linear motions in multiprecision arithmetic.

The classical form is used throughout: particular solution of each harmonic plus a decaying
homogeneous part.  At 110 digits its cancellation near resonance does not matter.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import mpmath
import numpy as np

mp = mpmath.mp.clone()
mp.dps = 110

ORDERS = 7
"""Derivatives 0 to 6 are available; the searches need four beyond the acceleration."""


class Harmonic(NamedTuple):
    """One harmonic of the force, amplitude * sin(frequency * t + phase)."""

    amplitude: Any
    frequency: Any
    phase: Any


class Oscillator:
    """
    A mass on the spring and the damper, with the response to each harmonic.

    Parameters
    ----------
    mass, damping, stiffness : mpf
        Of the oscillator; the mass is that of both bodies while they move together.
    harmonics : list of Harmonic
        The exciting force.

    """

    def __init__(self, mass: Any, damping: Any, stiffness: Any, harmonics: list[Harmonic]) -> None:
        self.mass, self.stiffness, self.harmonics = mass, stiffness, harmonics
        self.decay = damping / (2 * mass)
        square = stiffness / mass - self.decay**2
        if not square > 0:
            raise ValueError('the oracle handles underdamped rigs only')
        self.omega_d = mp.sqrt(square)
        self.omega = mp.sqrt(stiffness / mass)
        self.root = mp.mpc(-self.decay, self.omega_d)
        self.response: list[tuple[bool, Any]] = []
        for amplitude, frequency, _ in harmonics:
            stiff = mp.mpc(stiffness - mass * frequency**2, damping * frequency)
            secular = abs(stiff) < mp.mpf(10) ** -90 * stiffness
            # At undamped resonance the particular solution grows: t times a harmonic.
            gain = mp.mpc(0, -amplitude / (2 * mass * frequency)) if secular else amplitude / stiff
            self.response.append((secular, gain))


class Motion:
    """
    The displacement X(tau) of an oscillator from an initial state.

    Parameters
    ----------
    oscillator : Oscillator
        What moves.
    start : mpf
        Absolute time at tau = 0, which fixes the phases of the force.
    x, v : mpf
        Position and velocity at tau = 0.
    force : mpf
        A constant force on the mass, besides the harmonics.

    """

    def __init__(self, oscillator: Oscillator, start: Any, x: Any, v: Any, force: Any) -> None:
        self.decay, self.omega_d, self.omega = (
            oscillator.decay,
            oscillator.omega_d,
            oscillator.omega,
        )
        self.offset = force / oscillator.stiffness
        # Per harmonic and derivative: (coefficient, coefficient of tau), complex.
        self.frequencies: list[Any] = []
        self.forced: list[list[tuple[Any, Any]]] = []
        for harmonic, (secular, gain) in zip(
            oscillator.harmonics, oscillator.response, strict=True
        ):
            turn = mp.expj(harmonic.frequency * start + harmonic.phase)
            i_omega = mp.mpc(0, harmonic.frequency)
            rows = []
            for k in range(ORDERS):
                if secular:
                    constant = gain * turn * k * i_omega ** (k - 1) if k else mp.mpc(0)
                    rows.append((constant, gain * turn * i_omega**k))
                else:
                    rows.append((gain * turn * i_omega**k, mp.mpc(0)))
            self.frequencies.append(harmonic.frequency)
            self.forced.append(rows)
        self.pushes = [
            (abs(h.amplitude) / oscillator.mass, h.frequency) for h in oscillator.harmonics
        ]
        from_offset = x - self.offset
        self.start = mp.mpc(from_offset, -(v + self.decay * from_offset) / self.omega_d)
        x_h = x - self.offset - sum((rows[0][0].imag for rows in self.forced), mp.mpf(0))
        v_h = v - sum((rows[1][0].imag for rows in self.forced), mp.mpf(0))
        self.free = [
            mp.mpc(x_h, -(v_h + self.decay * x_h) / self.omega_d) * oscillator.root**k
            for k in range(ORDERS)
        ]

    def derivatives(self, tau: Any) -> list[Any]:
        """Return X and its first derivatives at tau."""
        cosine, sine = mp.cos_sin(self.omega_d * tau)
        e = mp.exp(-self.decay * tau)
        ec, es = e * cosine, e * sine
        values = [c.real * ec - c.imag * es for c in self.free]
        values[0] += self.offset
        for frequency, rows in zip(self.frequencies, self.forced, strict=True):
            cosine, sine = mp.cos_sin(frequency * tau)
            for k, (constant, rate) in enumerate(rows):
                c = constant + rate * tau if rate else constant
                values[k] += c.imag * cosine + c.real * sine
        return values

    def terms(self, order: int, horizon: Any) -> Any:
        """Return the sum of the magnitudes that make up X^(order), which may cancel."""
        forced = (abs(rows[order][0]) + abs(rows[order][1]) * horizon for rows in self.forced)
        constant = mp.mpf(0) if order else abs(self.offset)
        return constant + abs(self.free[order]) + sum(forced, mp.mpf(0))

    def bounds(self, horizon: Any) -> list[Any]:
        """Return bounds of |X^(k)| over [0, horizon], for k >= 2 (lower ones omit the offset)."""
        bounds = []
        for k in range(ORDERS):
            split = self.terms(k, horizon)
            # The response from rest stays moderate next to resonance, where the parts do not.
            from_rest = abs(self.start) * self.omega**k
            for push, frequency in self.pushes:
                top = max(self.omega, frequency)
                from_rest += push / self.omega_d * (top**k * horizon + k * top ** max(k - 1, 0))
            bounds.append(min(split, from_rest))
        return bounds

    def grid(self, tau: np.ndarray, order: int) -> np.ndarray:
        """Return X^(order) at many instants in double precision, for a first look."""
        free = complex(self.free[order])
        root = complex(-self.decay, self.omega_d)
        values: np.ndarray = (free * np.exp(root * tau)).real
        if order == 0:
            values = values + float(self.offset)
        for frequency, rows in zip(self.frequencies, self.forced, strict=True):
            constant, rate = (complex(c) for c in rows[order])
            values = values + ((constant + rate * tau) * np.exp(1j * float(frequency) * tau)).imag
        return values


class Relative:
    """
    The relative displacement Y(tau) = Z - X while the two bodies move apart.

    Parameters
    ----------
    motion : Motion
        Of the primary mass.
    y, w : mpf
        Relative displacement, and velocity of the damper mass, at tau = 0.
    acceleration : mpf
        Of the damper mass, constant.

    """

    def __init__(self, motion: Motion, y: Any, w: Any, acceleration: Any) -> None:
        self.motion, self.y, self.w, self.acceleration = motion, y, w, acceleration
        self.x0, self.v0 = motion.derivatives(mp.mpf(0))[:2]

    def derivatives(self, tau: Any) -> list[Any]:
        """Return Y and its first derivatives at tau."""
        values = [-value for value in self.motion.derivatives(tau)]
        values[0] += self.x0 + self.y + tau * (self.w + self.acceleration * tau / 2)
        values[1] += self.w + self.acceleration * tau
        values[2] += self.acceleration
        return values

    def terms(self, order: int, horizon: Any) -> Any:
        """Return the sum of the magnitudes that make up Y^(order)."""
        own = (abs(self.y) + abs(self.x0), abs(self.w), abs(self.acceleration))
        free = sum((own[k] * horizon ** (k - order) for k in range(order, 3)), mp.mpf(0))
        return self.motion.terms(order, horizon) + free

    def bounds(self, horizon: Any) -> list[Any]:
        """Return bounds of |Y^(k)| over [0, horizon], for k >= 2."""
        values = self.motion.bounds(horizon)
        values[2] += abs(self.acceleration)
        return values

    def grid(self, tau: np.ndarray, order: int) -> np.ndarray:
        """Return Y^(order) at many instants in double precision."""
        values = -self.motion.grid(tau, order)
        w, acceleration = float(self.w), float(self.acceleration)
        if order == 0:
            return values + float(self.x0 + self.y) + tau * (w + acceleration * tau / 2)
        if order == 1:
            return values + w + acceleration * tau
        return values + acceleration if order == 2 else values
