"""
The rig as most people would simulate it: scipy's solve_ivp from event to event.

DOP853 with terminal events for the stops, for the reversal of the relative velocity (friction
changes sign there) and, while m sticks, for the end of sticking. It is meant to be a good program
of its kind: the relative motion is a state of its own, so that an event is no difference of large
numbers; every event state is set exactly (m on the stop, or no relative velocity), so that the
flight which begins there does not find its own start again; and the mode changes only at events,
so that the integrator never sees a discontinuity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf, sin
from typing import Any

import scipy

from impact_damper_ros import RigParameters

__all__ = ['ATOL', 'RTOL', 'OdeRig']

RTOL = 1e-10
#: X, Y and the velocities are of order 1 to 20 in the golden cases, so the relative tolerance
#: rules nearly everywhere; the absolute one keeps the steps finite where a state crosses zero.
ATOL = 1e-10


@dataclass
class Impact:
    """One impact: when, and at which stop."""

    time: float
    stop: int


class OdeRig:
    """
    The motion from rest in the middle of the gap; two stops, one harmonic, no air.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    max_step : float, optional
        Longest step of the integrator, s.
    """

    def __init__(self, parameters: RigParameters, max_step: float = inf) -> None:
        """Take the constants out of the parameters."""
        p = parameters
        if p.one_sided or p.air_force or len(p.force_amplitudes) != 1:
            raise ValueError('OdeRig knows two stops, one harmonic and no air force')
        self.p = p
        self.max_step = max_step
        self.slope = p.gravity * sin(p.angle)
        self.grip = p.friction * p.gravity * cos(p.angle)
        self.time = 0.0
        self.state: Sequence[float] = (0.0, 0.0, 0.0, 0.0)
        self.slide = 0
        self.impacts: list[Impact] = []
        self.events: list[tuple[str, float]] = []
        self.evaluations = 0
        self.sticks = self._choose_mode()

    def need(self, t: float, x: float, v: float) -> float:
        """Return X'' - g sin(angle) of the joint motion: what m needs from friction."""
        p = self.p
        force = p.force_amplitudes[0] * sin(p.force_frequencies[0] * t + p.force_phases[0])
        load = force - p.damping * v - p.stiffness * x + p.damper_mass * self.slope
        return load / (p.primary_mass + p.damper_mass) - self.slope

    def _choose_mode(self) -> bool:
        """Set the direction of sliding at zero relative velocity; return whether m sticks."""
        x, v = self.state[:2]
        need = self.need(self.time, x, v)
        if self.grip > 0.0 and abs(need) <= self.grip:
            self.slide = 0
            return True
        self.slide = (1 if need < 0.0 else -1) if self.grip > 0.0 else 0
        return False

    def run(self, end: float, most_impacts: float = inf) -> None:
        """Integrate to an instant, or to a number of impacts."""
        while self.time < end and len(self.impacts) < most_impacts:
            if self.sticks:
                self._stick(end)
            else:
                self._fly(end)

    def _solve(self, rates: Any, state: Sequence[float], watched: list[Any], end: float) -> str:
        solution = scipy.integrate.solve_ivp(
            rates,
            (self.time, end),
            state,
            method='DOP853',
            events=watched,
            rtol=RTOL,
            atol=ATOL,
            max_step=self.max_step,
        )
        if solution.status < 0:
            raise RuntimeError(solution.message)
        self.evaluations += solution.nfev
        self.time = float(solution.t[-1])
        self.state = tuple(map(float, solution.y[:, -1]))
        for event, instants in zip(watched, solution.t_events, strict=True):
            if solution.status == 1 and len(instants):
                return str(event.kind)
        return ''

    def _fly(self, end: float) -> None:
        p = self.p
        mass, damping, stiffness = p.primary_mass, p.damping, p.stiffness
        amplitude, frequency, phase = (
            p.force_amplitudes[0],
            p.force_frequencies[0],
            p.force_phases[0],
        )
        half = 0.5 * p.gap
        drag = self.slide * self.grip
        push = p.damper_mass * drag
        fall = self.slope - drag

        def rates(t: float, state: Any) -> tuple[float, float, float, float]:
            x, v, _, u = state.tolist()
            force = amplitude * sin(frequency * t + phase)
            a = (force + push - damping * v - stiffness * x) / mass
            return v, a, u, fall - a

        def stop_1(_: float, state: Any) -> float:
            return float(state[2]) - half

        def stop_2(_: float, state: Any) -> float:
            return float(state[2]) + half

        def reversal(_: float, state: Any) -> float:
            return float(state[3])

        watched = [_terminal(stop_1, 'stop_1', 1), _terminal(stop_2, 'stop_2', -1)]
        if self.slide:
            watched.append(_terminal(reversal, 'reversal', -self.slide))
        kind = self._solve(rates, self.state, watched, end)
        x, v, y, u = self.state
        if kind in ('stop_1', 'stop_2'):
            stop = 1 if kind == 'stop_1' else 2
            restitution = p.restitution_1 if stop == 1 else p.restitution_2
            share = p.damper_mass / (p.primary_mass + p.damper_mass)
            v += share * (1.0 + restitution) * u
            u = -restitution * u
            self.state = (x, v, half if stop == 1 else -half, u)
            self.slide = (1 if u > 0.0 else -1) if self.grip > 0.0 else 0
            self.impacts.append(Impact(self.time, stop))
        elif kind == 'reversal':
            self.state = (x, v, y, 0.0)
            self.sticks = self._choose_mode()
        self._note('stick' if self.sticks else kind)

    def _stick(self, end: float) -> None:
        p = self.p
        x, v, y, _ = self.state

        def rates(t: float, state: Any) -> tuple[float, float]:
            x, v = state.tolist()
            return v, self.need(t, x, v) + self.slope

        def upwards(t: float, state: Any) -> float:
            return self.need(t, state[0], state[1]) - self.grip

        def downwards(t: float, state: Any) -> float:
            return self.need(t, state[0], state[1]) + self.grip

        if abs(y) >= 0.5 * p.gap:
            raise NotImplementedError('OdeRig does not rest on a stop')
        watched = [_terminal(upwards, 'up', 1), _terminal(downwards, 'down', -1)]
        kind = self._solve(rates, (x, v), watched, end)
        self.state = (*self.state, y, 0.0)
        if kind:
            self.slide = -1 if kind == 'up' else 1
            self.sticks = False
            self._note('release')

    def _note(self, kind: str) -> None:
        if kind:
            self.events.append((kind, self.time))


def _terminal(function: Any, kind: str, direction: int) -> Any:
    function.terminal = True
    function.kind = kind
    function.direction = direction
    return function
