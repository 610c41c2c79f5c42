"""
The equations of N impacts in k force cycles, and the error that the periodic solvers raise.

Bapat (1995), equations (3)-(15), derived again. Between impacts the damper mass has constant
acceleration, so that the displacements X_i and instants t_i of the impacts give its velocities;
momentum and restitution then give those of the primary mass before and after each impact; and
its closed-form flight must lead from each impact to the next. These are 2N equations. For fixed
instants they are linear in X_1 .. X_N and in the cosine and sine of the force's phase at the
first impact: an N-impact motion has only N-1 non-linear unknowns. In this form they give the
starts from which `segments` solves the boundary-value problem.

The forced part of a flight is written as the response from rest, a divided difference of the
exponential. Unlike the steady response it is finite for an undamped rig at resonance, and nothing
cancels near there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.rig import ParameterError, RigParameters
from impact_damper_ros.rig.oscillator import Oscillator
from impact_damper_ros.rig.parameter_spec import number_between, whole_number
from impact_damper_ros.rig.quoting import shown
from impact_damper_ros.rig.state import constants_of

#: Most impacts in a period for which all stop sequences are listed.
MOST_LISTED_IMPACTS = 6
#: Most impacts, and cycles of the force, in a period; the equations grow with both.
MOST_IMPACTS = MOST_CYCLES = 1000

_WHOLE = 1e-12
#: Least frequency of the force, over the natural one.
_SLOWEST = 1e-6
#: An angle, rad, to which no other adds anything.
_RESONANT = 1e-100
#: Where M loses this much of a free vibration, in powers of e, nothing is left of it.
_LOST = 500.0


class OrbitError(ValueError):
    """A periodic motion that cannot be asked for; the text holds the remedy."""


def single_harmonic(parameters: RigParameters) -> bool:
    """Return whether the force has no other active harmonic than its first."""
    return parameters.multisine_level == 0.0 and not any(parameters.force_amplitudes[1:])


def check_forcing(parameters: RigParameters, cycles: int | None = None) -> None:
    """
    Raise `OrbitError` if the force does not have the requested period.

    It must repeat after so many cycles of its first harmonic, or be one harmonic if they are
    not given, as the periodic theory assumes.
    """
    amplitude, first = parameters.force_amplitudes[0], parameters.force_frequencies[0]
    if 0.0 < first < _SLOWEST * parameters.omega:
        raise OrbitError(
            f'the first harmonic of the force has a frequency of {first:g} rad/s, '
            f'{parameters.frequency_ratio:.3g} of the natural one: motion so slow is no '
            f'vibration, give at least {_SLOWEST * parameters.omega:.3g} rad/s'
        )
    if parameters.periodic_force:
        return
    lasting = 'periodic motion repeats with the first harmonic of the force'
    if parameters.multisine_level > 0.0:
        raise OrbitError(
            f'multisine_level is {parameters.multisine_level:g} N: {lasting}, give 0, which '
            'switches the multisine off'
        )
    if parameters.sweep_mode != 'off':
        raise OrbitError(
            f'sweep_mode is {parameters.sweep_mode!r}: {lasting}, give off, and the frequency '
            'asked for in force_frequencies'
        )
    if amplitude == 0.0 or first == 0.0:
        raise OrbitError(
            f'the first harmonic of the force has amplitude {amplitude:g} N and frequency '
            f'{first:g} rad/s: periodic motion is counted in its cycles, give both different '
            'from 0'
        )
    if cycles is None:
        raise OrbitError(
            f'the force has {len(parameters.force_amplitudes)} harmonics: the impact equations '
            'are for one, give force_amplitudes, force_frequencies and force_phases one entry '
            'each, or use find_orbits'
        )
    for force, frequency in zip(
        parameters.force_amplitudes, parameters.force_frequencies, strict=True
    ):
        turns = cycles * frequency / first
        if force != 0.0 and abs(turns - round(turns)) > _WHOLE * max(1.0, turns):
            raise OrbitError(
                f'the harmonic of {frequency:g} rad/s turns {turns:.6g} times in {cycles} cycles '
                f'of the first one, {first:g} rad/s: a periodic motion needs a whole number, '
                'give frequencies in ratios of whole numbers and as many cycles as these ask for'
            )


def period_of_force(parameters: RigParameters, longest: int) -> int:
    """Return the period of the force in cycles of its first harmonic; or raise `OrbitError`."""
    for cycles in range(1, longest):
        with suppress(OrbitError):
            check_forcing(parameters, cycles)
            return cycles
    check_forcing(parameters, longest)
    return longest


def checked_number(name: str, value: Any, low: float, high: float) -> float:
    """Return a number of any kind as a float; or raise an `OrbitError`."""
    try:
        return number_between(name, value, low, high)
    except ParameterError as error:
        raise OrbitError(str(error)) from None


def checked_whole(name: str, value: Any, low: int, high: int) -> int:
    """Return a whole number of any kind as an int; or raise an `OrbitError`."""
    try:
        return whole_number(name, value, low, high)
    except ParameterError as error:
        raise OrbitError(str(error)) from None


def check_cycles(cycles: Any) -> int:
    """Return a period in cycles of the force; or raise an `OrbitError`."""
    try:
        return whole_number('cycles', cycles, 1, MOST_CYCLES)
    except ParameterError:
        raise OrbitError(
            f'{shown(cycles)} force cycles: give a period of at least 1 cycle, a whole number up '
            f'to {MOST_CYCLES}'
        ) from None


def _listed(stops: Any) -> Any:
    return ','.join(map(str, stops)) if isinstance(stops, list | tuple) else stops


def check_stops(parameters: RigParameters, given: Sequence[int], cycles: int) -> tuple[int, ...]:
    """Check a stop sequence and a number of force cycles; return the sequence."""
    try:
        whole = list(islice(given, MOST_IMPACTS + 1))
        stops = tuple(whole_number('stop', stop, 1, 2) for stop in whole)
    except (ParameterError, TypeError):
        stops = ()
    if not stops:
        text = shown(given if isinstance(given, str) else _listed(given))
        raise OrbitError(
            f'stop sequence {text}: give the stops hit in one period, in order, each 1 (the '
            'lower) or 2, such as 1,2'
        )
    if parameters.one_sided and 2 in stops:
        raise OrbitError(
            f'stop sequence {",".join(str(s) for s in stops)}: the rig is one-sided and has no '
            'stop 2, give stop 1 only, or one_sided: false'
        )
    if len(stops) > MOST_IMPACTS:
        raise OrbitError(f'{len(stops)} impacts or more: give at most {MOST_IMPACTS} in a period')
    check_cycles(cycles)
    return stops


def pressed_to(parameters: RigParameters, stop: int) -> bool:
    """Return whether weight, friction or air can press m to a stop, on average of a period."""
    machine, _ = constants_of(parameters)
    weight = machine.slope if stop == 1 else -machine.slope
    return weight - machine.air + machine.grip > 0.0


def plausible_stops(parameters: RigParameters, impacts: int) -> list[tuple[int, ...]]:
    """
    List the stop sequences of N impacts in a period.

    Parameters
    ----------
    parameters : RigParameters
        The rig: a one-sided one has stop 1 only.
    impacts : int
        Impacts N in one period.

    Returns
    -------
    list of tuple of int
        Each sequence once, whatever impact it is counted from, beginning with stop 1 if that is
        hit; the one that alternates comes first. Those of one stop come last, if weight or
        friction can press m to it as much as impacts and air push it away; (1,) if there is none.

    Raises
    ------
    OrbitError
        If N is not positive, or too large to list all.
    """
    try:
        impacts = whole_number('impacts', impacts, 1, MOST_IMPACTS)
    except ParameterError:
        raise OrbitError(
            f'{shown(impacts)} impacts: give at least 1 in a period, a whole number up to '
            f'{MOST_IMPACTS}'
        ) from None
    if parameters.one_sided:
        return [(1,) * impacts]
    if impacts > MOST_LISTED_IMPACTS:
        raise OrbitError(
            f'{impacts} impacts have too many stop sequences to try all: name one, such as '
            f'{",".join("12"[i % 2] for i in range(impacts))}'
        )
    found = {(stop,) * impacts for stop in (1, 2) if pressed_to(parameters, stop)}
    for code in range(1, 2**impacts - 1):
        word = tuple(1 + (code >> i) % 2 for i in range(impacts))
        found.add(min(word[i:] + word[:i] for i in range(impacts)))
    changes = {w: sum(a != b for a, b in zip(w, w[1:] + w[:1], strict=True)) for w in found}
    return sorted(found, key=lambda word: (-changes[word], word)) or [(1,)]


Array = NDArray[np.float64]


def free_response(oscillator: Oscillator, spans: Array) -> tuple[Array, Array, Array]:
    """Return what X is after spans (s) from a unit X, and what X and X' are from a unit X'."""
    envelope = np.exp(-oscillator.decay * spans)
    impulse = envelope * np.sin(oscillator.frequency * spans) / oscillator.frequency
    cosine = envelope * np.cos(oscillator.frequency * spans)
    return cosine + oscillator.decay * impulse, impulse, cosine - oscillator.decay * impulse


def forced_response(
    decay: Array | float, damped: Array | float, frequency: Array | float, spans: Array
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return X and X' after spans (s) of the response from rest to exp(i frequency tau)."""
    root = -decay + 1j * np.asarray(damped)
    drive = 1j * np.asarray(frequency)
    near = np.where(decay * spans < _LOST, spans, 0.0)
    free = np.exp(root * near)
    parts = []
    for eigenvalue, factor in ((root, free), (root.conjugate(), free.conjugate())):
        apart = drive - eigenvalue
        # So close to resonance, the quotient is the same; its parts may be no floats.
        close = np.abs(apart) < _RESONANT
        grown = factor * np.expm1(apart * near)
        if (near != spans).any():
            grown = np.where(near < spans, np.exp(drive * spans), grown)
        if close.any():
            quotient = grown / np.where(close, 1.0, apart)
            parts.append(np.where(close, spans * factor, quotient))
        else:
            parts.append(grown / apart)
    x = (parts[0] - parts[1]) / (2j * np.asarray(damped))
    return x, root * x + parts[1]


class ImpactEquations:
    """
    The 2N equations of one stop sequence.

    Parameters
    ----------
    parameters : RigParameters
        The rig, driven by one harmonic.
    stops : tuple of int
        Stops hit in one period, in order.
    cycles : int
        Period k in cycles of the force.

    Attributes
    ----------
    impacts : int
        Number of impacts N.
    period : float
        Period of the motion, s.
    length, rate : float
        Scales of displacement (m) and frequency (rad/s), by which residuals are divided.
    air, accelerations : ndarray, shape (N,)
        Acceleration of m in the flight after each impact: by the air, and in all.
    pushes : ndarray, shape (N,)
        Constant acceleration of M by friction and air in that flight.

    Raises
    ------
    OrbitError
        If the rig or the sequence is outside the theory; with friction also if a flight returns
        to the stop it came from, since friction reverses within it.
    """

    def __init__(self, parameters: RigParameters, stops: tuple[int, ...], cycles: int) -> None:
        check_forcing(parameters)
        check_stops(parameters, stops, cycles)
        machine, lines = constants_of(parameters)
        self.parameters = parameters
        self.stops = stops
        self.cycles = cycles
        self.impacts = len(stops)
        self.frequency = parameters.force_frequencies[0]
        self.phase = parameters.force_phases[0]
        self.cycle = math.tau / self.frequency
        self.period = cycles * self.cycle
        # The paper's lambda of the flight after each impact; 0 if it returns to the same stop
        self.directions = tuple(a - b for a, b in zip(stops, stops[1:] + stops[:1], strict=True))
        if machine.grip > 0.0 and 0 in self.directions:
            raise OrbitError(
                f'stop sequence {",".join(map(str, stops))} with friction '
                f'{parameters.friction:g}: a flight that returns to the same stop reverses, and '
                'friction with it; use find_orbits'
            )
        mass_ratio = machine.mass_ratio
        first = np.array(stops) == 1
        restitution = np.where(first, machine.restitution_1, machine.restitution_2)
        # M's velocities at an impact from those of m just after and just before it
        self._before_from_after = (1.0 + mass_ratio) / (1.0 + restitution)
        self._before_from_before = (restitution - mass_ratio) / (1.0 + restitution)
        self._after_from_after = (1.0 - mass_ratio * restitution) / (1.0 + restitution)
        self._after_from_before = (1.0 + mass_ratio) * restitution / (1.0 + restitution)
        direction = np.array(self.directions)
        self.air: Array = np.where(first, -machine.air, machine.air)
        self.accelerations: Array = machine.slope - direction * machine.grip + self.air
        self.pushes: Array = mass_ratio * (direction * machine.grip - self.air)
        self._next = np.roll(np.arange(self.impacts), -1)
        self._last = np.roll(np.arange(self.impacts), 1)
        offsets = np.where(first, machine.half_gap, -machine.half_gap)
        self._travel: Array = offsets[self._next] - offsets
        self._oscillator = machine.free
        self._stiffness = machine.free.omega_squared
        self._force = lines[0].force
        self.rate = math.sqrt(self._stiffness)
        swing = abs(self._force) / self._stiffness
        fall = float(np.max(np.abs(self.accelerations))) / self.frequency**2
        self.length = max(swing, fall, float(np.max(np.abs(self._travel))))

    def durations(self, instants: Array) -> Array:
        """Return the durations of the flights between instants that rise within one period, s."""
        lasts: Array = instants[..., self._next] - instants
        lasts[..., -1] += self.period
        return lasts

    def _mean_velocity(self, lasts: Array) -> Array:
        """Return m's mean velocity in each flight by X_1..X_N, without its constant part."""
        n = self.impacts
        inverse = 1.0 / lasts
        mean = np.zeros((*lasts.shape, n))
        for i in range(n):
            mean[..., i, (i + 1) % n] += inverse[..., i]
            mean[..., i, i] -= inverse[..., i]
        return mean

    def linear_system(self, instants: Array) -> Array:
        """
        Return the equations for fixed instants after the first impact, (..., N), s.

        Each of the 2N rows times (X_1, .., X_N, cos, sin, 1) is zero, where cos and sin are of
        the force's phase at the first impact; displacements first, then velocities over the
        natural frequency.
        """
        n = self.impacts
        lasts = self.durations(instants)
        unit, impulse, slope = free_response(self._oscillator, lasts)
        free = self._oscillator
        x_forced, v_forced = forced_response(free.decay, free.frequency, self.frequency, lasts)
        turn = self._force * np.exp(1j * self.frequency * instants)
        constant = self._travel * (1.0 / lasts)
        half = 0.5 * self.accelerations * lasts
        after_0 = self._after_from_after * (constant - half)
        after_0 += self._after_from_before * (constant + half)[..., self._last]
        before_0 = self._before_from_after * (constant - half)
        before_0 += self._before_from_before * (constant + half)[..., self._last]
        rows = np.zeros((*lasts.shape[:-1], 2 * n, n + 3))
        rows[..., :n] = self._by_x(lasts, unit, impulse, slope)
        place = rows[..., :n, :]
        speed = rows[..., n:, :]
        place[..., n] = -(turn * x_forced).imag
        place[..., n + 1] = -(turn * x_forced).real
        speed[..., n] = -(turn * v_forced).imag
        speed[..., n + 1] = -(turn * v_forced).real
        place[..., n + 2] = -impulse * after_0 - self.pushes / self._stiffness * (1.0 - unit)
        speed[..., n + 2] = before_0[..., self._next] - slope * after_0 - self.pushes * impulse
        speed[..., n:] /= self.rate
        return rows

    def _by_x(self, lasts: Array, unit: Array, impulse: Array, slope: Array) -> Array:
        """Return the columns of `linear_system` for X_1 .. X_N, given the free response."""
        n = self.impacts
        mean = self._mean_velocity(lasts)
        after = mean * self._after_from_after[:, None]
        after += mean[..., self._last, :] * self._after_from_before[:, None]
        before = mean * self._before_from_after[:, None]
        before += mean[..., self._last, :] * self._before_from_before[:, None]
        rows = np.empty((*lasts.shape[:-1], 2 * n, n))
        place, speed = rows[..., :n, :], rows[..., n:, :]
        place[...] = -impulse[..., None] * after
        speed[...] = before[..., self._next, :] - slope[..., None] * after
        for i in range(n):
            place[..., i, (i + 1) % n] += 1.0
            place[..., i, i] -= unit[..., i]
            speed[..., i, i] += self._stiffness * impulse[..., i]
        speed /= self.rate
        return rows

    def states(self, x: Array, instants: Array) -> Array:
        """Return the states just after the impacts as `Segments` has them, (..., N, 4)."""
        lasts = self.durations(instants)
        mean = (x[..., self._next] - x + self._travel) / lasts
        half = 0.5 * self.accelerations * lasts
        damper = mean - half
        velocity = self._after_from_after * damper
        velocity += self._after_from_before * (mean + half)[..., self._last]
        return np.stack([x, velocity, np.zeros_like(x), damper - velocity], axis=-1)
