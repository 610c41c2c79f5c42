"""Energy account of a run: what went in and out between two instants, by accurate quadrature."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros import EventKind, Rig, RigParameters, Sample

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)


def parts(parameters: RigParameters, sample: Sample) -> tuple[float, float]:
    """Return the energy of motion and spring of M and m, and minus that of the weight of m."""
    p = parameters
    kinetic = p.primary_mass * sample.primary_velocity**2 + p.damper_mass * (
        sample.damper_velocity**2
    )
    weight = p.damper_mass * p.gravity * math.sin(p.angle)
    return 0.5 * (kinetic + p.stiffness * sample.x**2), weight * sample.z


def energy(parameters: RigParameters, sample: Sample) -> float:
    """Return the mechanical energy of M and m, from the static equilibrium of M."""
    own, weight = parts(parameters, sample)
    return own - weight


def turnover(parameters: RigParameters, sample: Sample) -> float:
    """Return the sum of the moduli of all parts of the energy."""
    return sum(map(abs, parts(parameters, sample)))


class Account:
    """
    The energy of a rig whose parameters stay as they are, while stops may be moved.

    Attributes
    ----------
    spent : float
        Work of the force less what dashpot, friction, impacts and air have taken, J.
    turned : float
        Sum of the moduli of all that.
    """

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        # An impact with which it starts is in the state already.
        rig.advance(rig.time)
        self.start = energy(rig.parameters, rig.sample())
        p = rig.parameters
        self.largest = turnover(p, rig.sample()) + max(map(abs, p.force_amplitudes)) ** 2 / (
            p.stiffness
        )
        self.spent = self.turned = 0.0
        self.last_stop = rig.snapshot()['origin']['last_stop']
        self.force = [
            np.array(v) for v in (p.force_amplitudes, p.force_frequencies, p.force_phases)
        ]
        self.fastest = max(p.omega, *p.force_frequencies)
        self.grip = p.friction * p.gravity * math.cos(p.angle) * p.damper_mass

    def book(self, work: float) -> None:
        self.spent += work
        self.turned += abs(work)

    def impacts(self, events: list) -> None:
        """Book the loss of the impacts among some events."""
        p = self.rig.parameters
        for e in events:
            if e.kind == EventKind.IMPACT:
                before = e.damper_velocity_before - e.primary_velocity_before
                after = e.damper_velocity_after - e.primary_velocity_after
                reduced = p.damper_mass / (1.0 + p.mass_ratio)
                self.book(-0.5 * reduced * (before * before - after * after))
                self.last_stop = e.stop

    def advance(self, time: float) -> list:
        """Advance the rig, and book what happens until then."""
        # What a command has left to happen at this very instant
        done = self.rig.advance(self.rig.time)
        self.impacts(done)
        events = Rig.restore(self.rig.snapshot()).advance(time)
        for end in [*(e.time for e in events), time]:
            if end > self.rig.time:
                done += self._smooth(end)
        return done

    def _smooth(self, end: float) -> list:
        """Book a stretch that ends with an event, or without one."""
        rig, p = self.rig, self.rig.parameters
        start, before = rig.time, rig.sample()
        panels = max(1, math.ceil((end - start) * self.fastest / 1.5))
        length = (end - start) / panels
        work = 0.0
        for k in range(panels):
            for node, weight in zip(_NODES, _WEIGHTS, strict=True):
                t = start + (k + 0.5 + 0.5 * node) * length
                if not rig.time <= t < end:
                    t = max(rig.time, min(t, math.nextafter(end, 0.0)))
                # An event of a command may be stamped a round-off before the instant it is due.
                late = rig.advance(t)
                assert all(event.time <= start for event in late)
                self.impacts(late)
                v = rig.sample().primary_velocity
                amplitude, frequency, phase = self.force
                force = float(np.sum(amplitude * np.sin(frequency * t + phase)))
                work += 0.5 * length * weight * (force * v - p.damping * v * v)
        self.book(work)
        # Just before whatever happens at the end; nothing jumps but velocities.
        events = rig.advance(end)
        after = rig.sample()
        way = (after.z - after.x) - (before.z - before.x)
        self.book(-self.grip * abs(way))
        self.book(p.air_force * way * {0: 0.0, 1: -1.0, 2: 1.0}[self.last_stop])
        self.impacts(events)
        self.largest = max(self.largest, turnover(p, after))
        return events

    @property
    def imbalance(self) -> float:
        """What is missing in the energy, relative to all that has been turned over."""
        now = energy(self.rig.parameters, self.rig.sample())
        return abs(now - self.start - self.spent) / (self.largest + self.turned)
