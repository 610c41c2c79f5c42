"""
The rig as one would build it with other tools, each from rest, with two stops and one harmonic.

Every class has `run(end)`, which returns the times and stops of all impacts. What is made once,
such as compiled code, is made in the constructor. Those of heyoka are in `heyoka_rigs`.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import log, pi, sin, sqrt
from typing import Any

import numpy as np
from ode_rig import OdeRig

from impact_damper_ros import RigParameters

__all__ = ['MujocoRig', 'RungeKuttaRig', 'SolveIvpRig']

Impacts = tuple[Sequence[float], Sequence[int]]


class SolveIvpRig:
    """scipy's DOP853 with terminal events (`ode_rig`)."""

    def __init__(self, parameters: RigParameters) -> None:
        self._parameters = parameters

    def run(self, end: float) -> Impacts:
        """Run from rest."""
        rig = OdeRig(self._parameters)
        rig.run(end)
        return [i.time for i in rig.impacts], [i.stop for i in rig.impacts]


def _compiled_runge_kutta() -> Any:
    """Return the classical Runge-Kutta rig as one compiled function."""
    from numba import njit

    @njit
    def rates(t, x, v, u, c):  # type: ignore[no-untyped-def]
        force = c[3] * np.sin(c[4] * t)
        a = (force + c[5] * c[8] - c[2] * v - c[1] * x) / c[0]
        return v, a, u, c[6] - c[8] - a

    @njit
    def step(t, s, h, c):  # type: ignore[no-untyped-def]
        x, v, y, u = s
        a1, b1, c1, d1 = rates(t, x, v, u, c)
        k = 0.5 * h
        a2, b2, c2, d2 = rates(t + k, x + k * a1, v + k * b1, u + k * d1, c)
        a3, b3, c3, d3 = rates(t + k, x + k * a2, v + k * b2, u + k * d2, c)
        a4, b4, c4, d4 = rates(t + h, x + h * a3, v + h * b3, u + h * d3, c)
        w = h / 6.0
        return (
            x + w * (a1 + 2.0 * a2 + 2.0 * a3 + a4),
            v + w * (b1 + 2.0 * b2 + 2.0 * b3 + b4),
            y + w * (c1 + 2.0 * c2 + 2.0 * c3 + c4),
            u + w * (d1 + 2.0 * d2 + 2.0 * d3 + d4),
        )

    @njit
    def happened(s, half, slide):  # type: ignore[no-untyped-def]
        if s[2] >= half and s[3] > 0.0:
            return 1
        if s[2] <= -half and s[3] < 0.0:
            return 2
        return 3 if slide * s[3] < 0.0 else 0

    @njit
    def need(t, x, v, c):  # type: ignore[no-untyped-def]
        force = c[3] * np.sin(c[4] * t)
        return (force - c[2] * v - c[1] * x + c[5] * c[6]) / (c[0] + c[5]) - c[6]

    @njit
    def stuck(t, x, v, h, c):  # type: ignore[no-untyped-def]
        k = 0.5 * h
        a1 = need(t, x, v, c) + c[6]
        a2 = need(t + k, x + k * v, v + k * a1, c) + c[6]
        a3 = need(t + k, x + k * (v + k * a1), v + k * a2, c) + c[6]
        a4 = need(t + h, x + h * (v + k * a2), v + h * a3, c) + c[6]
        w = h / 6.0
        return x + h * v + h * w * (a1 + a2 + a3), v + w * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    @njit
    def run(c, half, restitution, mass_ratio, h, end, times, stops):  # type: ignore[no-untyped-def]
        t = 0.0
        s = (0.0, 0.0, 0.0, 0.0)
        grip = c[7]
        sticks = grip > 0.0
        slide = 0.0
        count = 0
        while t < end:
            if sticks:
                x, v = stuck(t, s[0], s[1], h, c)
                left = 1.0
                if abs(need(t + h, x, v, c)) > grip:
                    low = 0.0
                    for _ in range(60):
                        half_way = 0.5 * (low + left)
                        x, v = stuck(t, s[0], s[1], half_way * h, c)
                        if abs(need(t + half_way * h, x, v, c)) > grip:
                            left = half_way
                        else:
                            low = half_way
                    x, v = stuck(t, s[0], s[1], left * h, c)
                    sticks = False
                    slide = 1.0 if need(t + left * h, x, v, c) < 0.0 else -1.0
                    c[8] = slide * grip
                s = (x, v, s[2], 0.0)
                t += left * h
                continue
            new = step(t, s, h, c)
            kind = happened(new, half, slide)
            if kind == 0:
                s = new
                t += h
                continue
            low = 0.0
            high = 1.0
            for _ in range(60):
                middle = 0.5 * (low + high)
                if happened(step(t, s, middle * h, c), half, slide) == 0:
                    low = middle
                else:
                    high = middle
            new = step(t, s, high * h, c)
            kind = happened(new, half, slide)
            t += high * h
            x, v, y, u = new
            if kind == 3:
                n = need(t, x, v, c)
                sticks = abs(n) <= grip
                slide = 1.0 if n < 0.0 else -1.0
                s = (x, v, y, 0.0)
            else:
                r = restitution[kind - 1]
                v += mass_ratio / (1.0 + mass_ratio) * (1.0 + r) * u
                u = -r * u
                s = (x, v, half if kind == 1 else -half, u)
                if grip > 0.0:
                    slide = 1.0 if u > 0.0 else -1.0
                if count < len(times):
                    times[count] = t
                    stops[count] = kind
                    count += 1
            c[8] = slide * grip
        return count

    return run


class RungeKuttaRig:
    """
    The classical Runge-Kutta method with fixed steps, compiled; bisection of the step at events.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    steps : int
        Steps per cycle of the force.
    """

    _loop: Any = None

    def __init__(self, parameters: RigParameters, steps: int) -> None:
        p = parameters
        if RungeKuttaRig._loop is None:
            RungeKuttaRig._loop = _compiled_runge_kutta()
        slope = p.gravity * sin(p.angle)
        grip = p.friction * p.gravity * sqrt(1.0 - sin(p.angle) ** 2)
        constants = (
            *(p.primary_mass, p.stiffness, p.damping, p.force_amplitudes[0]),
            *(p.force_frequencies[0], p.damper_mass, slope, grip, 0.0),
        )
        self._constants = np.array(constants)
        self._rest = (0.5 * p.gap, np.array([p.restitution_1, p.restitution_2]), p.mass_ratio)
        self._step = 2.0 * pi / p.force_frequencies[0] / steps
        self.run(1.0)

    def run(self, end: float) -> Impacts:
        """Run from rest."""
        most = 100 + int(10 * end)
        times, stops = np.empty(most), np.empty(most, dtype=np.int64)
        self._constants[8] = 0.0
        count = RungeKuttaRig._loop(self._constants, *self._rest, self._step, end, times, stops)
        return times[:count].tolist(), stops[:count].tolist()


class MujocoRig:
    """
    MuJoCo with two slide joints; the stops are soft limits of the second one.

    Their stiffness makes a contact last some steps, their damping gives the restitution.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    steps : int
        Steps per cycle of the force.
    """

    def __init__(self, parameters: RigParameters, steps: int) -> None:
        import mujoco

        p = parameters
        self._step = 2.0 * pi / p.force_frequencies[0] / steps
        self._force = p.force_amplitudes[0], p.force_frequencies[0]
        # A contact of 20 steps; the limit's own terms are per unit of the effective mass.
        stiffness = (pi / (20.0 * self._step)) ** 2
        decay = -log(p.restitution_1) / (20.0 * self._step)
        half = 0.5 * p.gap
        loss = p.friction * p.damper_mass * p.gravity * sqrt(1.0 - sin(p.angle) ** 2)
        slope = p.gravity * sin(p.angle)
        self._offset = p.primary_mass * slope
        joint = 'type="slide" axis="1 0 0"'
        ball = '<geom type="sphere" size="0.1" contype="0" conaffinity="0"'
        self._model = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{self._step!r}" gravity="{slope!r} 0 0" integrator="RK4"/>'
            f'<worldbody><body><joint name="M" {joint} stiffness="{p.stiffness!r}" '
            f'damping="{p.damping!r}"/>{ball} mass="{p.primary_mass!r}"/><body>'
            f'<joint name="m" {joint} limited="true" range="{-half!r} {half!r}" '
            f'frictionloss="{loss!r}" solreflimit="{-stiffness!r} {-2.0 * decay!r}" '
            f'solimplimit="0.9999 0.9999 0.001"/>{ball} mass="{p.damper_mass!r}"/></body></body>'
            '</worldbody><actuator><motor joint="M"/></actuator></mujoco>'
        )
        self._data = mujoco.MjData(self._model)
        self._half = half

    def run(self, end: float) -> Impacts:
        """Run from rest; an impact is where m goes beyond a limit, told by a straight line."""
        import mujoco
        from mujoco import rollout

        count = int(end / self._step)
        amplitude, frequency = self._force
        mujoco.mj_resetData(self._model, self._data)
        # Held for a step at its value in the middle of it
        middle = self._step * (np.arange(count) + 0.5)
        control = amplitude * np.sin(frequency * middle) - self._offset
        size = mujoco.mj_stateSize(self._model, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        initial = np.empty(size)
        mujoco.mj_getState(self._model, self._data, initial, mujoco.mjtState.mjSTATE_FULLPHYSICS)
        states, _ = rollout.rollout(self._model, self._data, initial, control[None, :, None])
        time, y = states[0, :, 0], states[0, :, 2]
        beyond = np.abs(y) - self._half
        entered = np.flatnonzero((beyond[:-1] <= 0.0) & (beyond[1:] > 0.0))
        share = beyond[entered] / (beyond[entered] - beyond[entered + 1])
        stops = np.where(y[entered] > 0.0, 1, 2)
        return (time[entered] + share * self._step).tolist(), stops.tolist()
