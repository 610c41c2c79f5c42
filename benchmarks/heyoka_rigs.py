"""
The rig with heyoka's Taylor integrators: one rig at a time, and as many as fit into a vector.

As in `peer_rigs`, `run(end)` returns the times and stops of all impacts, of the first rig.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sin, sqrt
from typing import Any

import numpy as np

from impact_damper_ros import RigParameters

__all__ = ['HeyokaBatchRig', 'HeyokaRig', 'lanes']

Impacts = tuple[Sequence[float], Sequence[int]]


def lanes() -> int:
    """Return how many rigs heyoka recommends to run at once on this machine."""
    import heyoka as hy

    count: int = hy.recommended_simd_size()
    return count


class HeyokaRig:
    """
    heyoka's Taylor integrator with terminal events, whose callbacks do the impacts.

    With friction, a second integrator moves both masses while m sticks, and the reversal of the
    relative velocity is an event of the first.
    """

    def __init__(self, parameters: RigParameters, **options: Any) -> None:
        import heyoka as hy

        p = parameters
        self._mass_ratio = p.mass_ratio
        self._restitution = (p.restitution_1, p.restitution_2)
        self._half = 0.5 * p.gap
        slope = p.gravity * sin(p.angle)
        self._grip = p.friction * p.gravity * sqrt(1.0 - sin(p.angle) ** 2)
        x, v, y, u = hy.make_vars('x', 'v', 'y', 'u')
        force = p.force_amplitudes[0] * hy.sin(p.force_frequencies[0] * hy.time)
        load = force - p.damping * v - p.stiffness * x
        drag = hy.par[0]
        free = (load + p.damper_mass * drag) / p.primary_mass
        together = p.primary_mass + p.damper_mass
        joint = (load + p.damper_mass * slope) / together
        up, down = hy.event_direction.positive, hy.event_direction.negative
        self._impacts: list[tuple[float, int]] = []
        watched = [
            hy.t_event(y - self._half, callback=self._hit(1), direction=up),
            hy.t_event(y + self._half, callback=self._hit(2), direction=down),
        ]
        if self._grip > 0.0:
            watched.append(hy.t_event(u, callback=self._turn()))
        self._free = hy.taylor_adaptive(
            [(x, v), (v, free), (y, u), (u, slope - drag - free)],
            [0.0] * 4,
            t_events=watched,
            pars=[0.0],
            **options,
        )
        self._joint: Any = None
        if self._grip > 0.0:
            need = joint - slope
            self._joint = hy.taylor_adaptive(
                [(x, v), (v, joint)],
                [0.0, 0.0],
                t_events=[
                    hy.t_event(need - self._grip, direction=up),
                    hy.t_event(need + self._grip, direction=down),
                ],
                **options,
            )
        self._need = lambda t, x, v: (
            (
                p.force_amplitudes[0] * sin(p.force_frequencies[0] * t)
                - p.damping * v
                - p.stiffness * x
                + p.damper_mass * slope
            )
            / together
            - slope
        )
        self._sticks = False

    def _hit(self, stop: int) -> Any:
        share = self._mass_ratio / (1.0 + self._mass_ratio) * (1.0 + self._restitution[stop - 1])

        def callback(integrator: Any, _: int) -> bool:
            state = integrator.state
            relative = state[3]
            state[1] += share * relative
            state[2] = self._half if stop == 1 else -self._half
            state[3] = -self._restitution[stop - 1] * relative
            integrator.pars[0] = self._grip if state[3] > 0.0 else -self._grip
            self._impacts.append((integrator.time, stop))
            return True

        return callback

    def _turn(self) -> Any:
        def callback(integrator: Any, _: int) -> bool:
            state = integrator.state
            state[3] = 0.0
            need = self._need(integrator.time, state[0], state[1])
            if abs(need) <= self._grip:
                self._sticks = True
                return False
            integrator.pars[0] = self._grip if need < 0.0 else -self._grip
            return True

        return callback

    def _set_off(self) -> None:
        """Let m move where its support has failed."""
        free = self._free
        way = 1.0 if self._need(free.time, *free.state[:2]) < 0.0 else -1.0
        free.pars[0] = way * self._grip
        # Where speed and acceleration are zero the event of the reversal would find its own start.
        free.state[3] = way * 1e-30
        free.reset_cooldowns()

    def run(self, end: float) -> Impacts:
        """Run from rest."""
        free, joint = self._free, self._joint
        self._impacts.clear()
        free.time = 0.0
        free.state[:] = 0.0
        free.pars[0] = 0.0
        free.reset_cooldowns()
        self._sticks = joint is not None and abs(self._need(0.0, 0.0, 0.0)) <= self._grip
        if joint is not None:
            self._set_off()
        while free.time < end:
            if not self._sticks:
                free.propagate_until(end)
                continue
            joint.time = free.time
            joint.state[:] = free.state[:2]
            joint.reset_cooldowns()
            joint.propagate_until(end)
            free.time = joint.time
            free.state[:2] = joint.state
            self._sticks = False
            self._set_off()
        times = [t for t, _ in self._impacts]
        return times, [stop for _, stop in self._impacts]


class HeyokaBatchRig:
    """
    heyoka's batch mode: a rig without friction in each lane, all but for the gap the same.

    The impacts are terminal events whose callbacks set the state of their own lane.

    Parameters
    ----------
    parameters : RigParameters
        The rigs, but for their gaps.
    gaps : sequence of float
        Their gaps, m.
    options
        Of the integrator.

    Raises
    ------
    ValueError
        If there is friction: m would stick in one lane and slide in another, and all lanes have
        the same equations.
    """

    def __init__(self, parameters: RigParameters, gaps: Sequence[float], **options: Any) -> None:
        import heyoka as hy

        p = parameters
        if p.friction * p.gravity > 0.0:
            raise ValueError('HeyokaBatchRig has no friction')
        self._mass_ratio = p.mass_ratio
        self._restitution = (p.restitution_1, p.restitution_2)
        self._halves = 0.5 * np.array(gaps)
        x, v, y, u = hy.make_vars('x', 'v', 'y', 'u')
        force = p.force_amplitudes[0] * hy.sin(p.force_frequencies[0] * hy.time)
        free = (force - p.damping * v - p.stiffness * x) / p.primary_mass
        up, down = hy.event_direction.positive, hy.event_direction.negative
        half = hy.par[0]
        self._impacts: list[list[tuple[float, int]]] = [[] for _ in gaps]
        self._batch = hy.taylor_adaptive_batch(
            [(x, v), (v, free), (y, u), (u, p.gravity * sin(p.angle) - free)],
            np.zeros((4, len(gaps))),
            t_events=[
                hy.t_event_batch(y - half, callback=self._hit(1), direction=up),
                hy.t_event_batch(y + half, callback=self._hit(2), direction=down),
            ],
            pars=self._halves[None, :].copy(),
            **options,
        )

    def _hit(self, stop: int) -> Any:
        restitution = self._restitution[stop - 1]
        share = self._mass_ratio / (1.0 + self._mass_ratio) * (1.0 + restitution)
        places = (self._halves if stop == 1 else -self._halves).tolist()

        def callback(integrator: Any, _: int, lane: int) -> bool:
            state = integrator.state
            relative = state[3, lane]
            state[1, lane] += share * relative
            state[2, lane] = places[lane]
            state[3, lane] = -restitution * relative
            self._impacts[lane].append((float(integrator.time[lane]), stop))
            return True

        return callback

    def run_all(self, end: float) -> list[Impacts]:
        """Run all rigs from rest; return the impacts of each."""
        batch = self._batch
        for impacts in self._impacts:
            impacts.clear()
        batch.set_time(0.0)
        batch.state[:] = 0.0
        batch.reset_cooldowns()
        batch.propagate_until(end)
        return [([t for t, _ in one], [stop for _, stop in one]) for one in self._impacts]

    def run(self, end: float) -> Impacts:
        """Run all rigs from rest; return the impacts of the first one."""
        return self.run_all(end)[0]
