"""
The whole hybrid motion of the rig in multiprecision: the reference for the exact simulator.

Conventions are those of the design: axis positive down the incline, X from the static equilibrium
of M alone, Y = Z - X, stop 1 at Y = +gap/2.  Choices the model leaves open are made so:

- A mode held at time 0 (sticking, resting) is no event; neither is a start on a stop.
- With no friction (friction * gravity * cos(angle) = 0) there are no reversals and no sticking.
- An impact that leaves no relative velocity (restitution 0) is an 'impact', then, if m stays,
  a 'rest' at the same instant.
- The last impacts of a chatter, below CHATTER_FLOOR of the largest impact speed so far, are
  replaced by their geometric series; the error is of the order of the floor squared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oracle.first_root import Watched, first_event
from oracle.precise_motion import Harmonic, Motion, Oscillator, Relative, mp

DEFAULTS: dict[str, Any] = {
    'primary_mass': 1.0,
    'stiffness': 1.0,
    'damping': 0.01,
    'damper_mass': 0.042,
    'gap': 37.0,
    'restitution_1': 0.75,
    'restitution_2': 0.75,
    'restitution_speed': 0.0,
    'restitution_exponent': 0.25,
    'angle': 0.0,
    'friction': 0.0,
    'gravity': 9.81,
    'air_force': 0.0,
    'one_sided': False,
    'force_amplitudes': (1.0,),
    'force_frequencies': (1.0,),
    'force_phases': (0.0,),
}
INITIAL_DEFAULTS: dict[str, Any] = {
    'initial_primary_position': 0.0,
    'initial_primary_velocity': 0.0,
    'initial_damper_offset': 0.0,
    'initial_damper_velocity': 0.0,
}
CHATTER_FLOOR = mp.mpf(10) ** -30
NIL = mp.mpf(10) ** -85


@dataclass(frozen=True)
class OracleEvent:
    """One event; velocities before and after are equal unless it is an impact."""

    kind: str
    time: Any
    stop: int
    x: Any
    primary_velocity_before: Any
    primary_velocity_after: Any
    damper_velocity_before: Any
    damper_velocity_after: Any


class HybridMotion:
    """
    The rig, run event by event.

    Parameters
    ----------
    params, initial : mapping
        Fields of RigParameters and InitialConditions; what is missing has its default.

    """

    def __init__(
        self, params: Mapping[str, Any], initial: Mapping[str, Any] | None = None
    ) -> None:
        unknown = set(params) - set(DEFAULTS) | set(initial or {}) - set(INITIAL_DEFAULTS)
        if unknown:
            raise KeyError(f'unknown parameters: {sorted(unknown)}')
        p: dict[str, Any] = {**DEFAULTS, **params}
        start: dict[str, Any] = {**INITIAL_DEFAULTS, **(initial or {})}
        M, m, angle, g = (
            mp.mpf(p[k]) for k in ('primary_mass', 'damper_mass', 'angle', 'gravity')
        )
        self.m, self.mu = m, m / M
        self.half_gap = mp.mpf(p['gap']) / 2
        self.restitution = {1: mp.mpf(p['restitution_1']), 2: mp.mpf(p['restitution_2'])}
        self.falls_from = mp.mpf(p['restitution_speed'])
        self.exponent = mp.mpf(p['restitution_exponent'])
        self.incline = g * mp.sin(angle)
        self.grip = mp.mpf(p['friction']) * g * mp.cos(angle)
        self.air = mp.mpf(p['air_force'])
        self.one_sided = bool(p['one_sided'])
        names = ('force_amplitudes', 'force_frequencies', 'force_phases')
        harmonics = [
            Harmonic(*map(mp.mpf, row)) for row in zip(*(p[name] for name in names), strict=True)
        ]
        C, K = mp.mpf(p['damping']), mp.mpf(p['stiffness'])
        self.alone = Oscillator(M, C, K, harmonics)
        self.joined = Oscillator(M + m, C, K, harmonics)
        fastest = max([self.alone.omega, *(h.frequency for h in harmonics if h.amplitude)])
        self.step = 2 * mp.pi / fastest / 24
        # State: absolute time, X, X', Y, Y'; air force on m; mode; orders of vanishing.
        self.time = mp.mpf(0)
        self.x = mp.mpf(start['initial_primary_position'])
        self.v = mp.mpf(start['initial_primary_velocity'])
        self.y = mp.mpf(start['initial_damper_offset'])
        self.u = mp.mpf(start['initial_damper_velocity']) - self.v
        self.press = mp.mpf(0)
        self.mode = 'free'
        self.slide = 0
        self.smooth = False
        self.fastest_impact = mp.mpf(0)
        self.events: list[OracleEvent] = []
        self.pieces: list[tuple[Any, Motion | Relative, Any]] = []
        if self.y > self.half_gap or (self.y < -self.half_gap and not self.one_sided):
            raise ValueError('the damper mass starts outside the gap')
        stop = self._stop()
        if stop and self.u * (1 if stop == 1 else -1) > 0:
            self._impact(stop)
        else:
            self._choose_mode()

    def _stop(self) -> int:
        """Return the stop that m touches, or 0."""
        if self.y == self.half_gap:
            return 1
        return 2 if self.y == -self.half_gap and not self.one_sided else 0

    def _stuck(self) -> Motion:
        """Return the motion of both bodies together from the present state."""
        return Motion(self.joined, self.time, self.x, self.v, self.m * self.incline)

    def _release_conditions(self, motion: Motion, mode: str) -> list[Watched]:
        """Return the functions that stay positive while m is held; n is what m needs."""
        pull = self.incline + self.press / self.m
        upper = Watched('up', motion, -1, 2, self.grip + pull, 0)
        lower = Watched('down', motion, 1, 2, self.grip - pull, 0)
        return {'stick': [upper, lower], 'rest1': [upper], 'rest2': [lower]}[mode]

    @staticmethod
    def _leading(f: Watched) -> tuple[int, int]:
        """Return the sign of f just after the start, and the order of its root there."""
        for order, value in enumerate(f(mp.mpf(0))):
            if abs(value) > NIL * (1 + abs(f.offset)):
                return (1 if value > 0 else -1), order
        return 1, 0

    def _choose_mode(self) -> str:
        """Decide what follows from the present state, and return the mode."""
        self.smooth = False
        self.slide = (1 if self.u > 0 else -1) if self.u else 0
        stop = self._stop()
        if self.u or not (stop or self.grip):
            self.mode = 'free'
            return self.mode
        mode = f'rest{stop}' if stop else 'stick'
        broken = [
            f for f in self._release_conditions(self._stuck(), mode) if self._leading(f)[0] < 0
        ]
        if broken:
            self.slide = -1 if broken[0].kind == 'up' else 1
            # The relative acceleration may vanish here too, as after sticking.
            self.smooth = self._leading(broken[0])[1] > 0
            self.mode = 'free'
        else:
            self.mode = mode
        return self.mode

    def _record(self, kind: str, stop: int, v: Any, w: Any) -> None:
        after = self.v, self.v + self.u
        self.events.append(OracleEvent(kind, self.time, stop, self.x, v, after[0], w, after[1]))

    def _impact(self, stop: int) -> None:
        """Hit a stop, and end a chatter if this was one of its last impacts."""
        self.y = self.half_gap if stop == 1 else -self.half_gap
        v, w, speed = self.v, self.v + self.u, abs(self.u)
        R, mu = self.restitution[stop], self.mu
        if self.falls_from:
            R *= (self.falls_from / (self.falls_from + speed)) ** self.exponent
        self.v = ((1 - mu * R) * v + mu * (1 + R) * w) / (1 + mu)
        self.u = -R * self.u
        self.press = self.air * (-1 if stop == 1 else 1)
        self.fastest_impact = max(self.fastest_impact, speed)
        self._record('impact', stop, v, w)
        if self.u and abs(self.u) < CHATTER_FLOOR * self.fastest_impact:
            self._accumulate(stop, R)
        if self._choose_mode() == f'rest{stop}':
            self._record('rest', stop, self.v, self.v)

    def _accumulate(self, stop: int, R: Any) -> None:
        """Move to the end of a chatter, if m is pressed back to the stop and R < 1."""
        side = 1 if stop == 1 else -1
        stuck = self._stuck()
        n, rate = stuck.derivatives(mp.mpf(0))[2:4]
        n = side * (n - self.incline - self.press / self.m)
        away, back = ((1 + self.mu) * (self.grip * s - n) for s in (1, -1))
        u = abs(self.u)
        if not back > 0 or u * (abs(rate) + back * self.alone.omega) > mp.mpf(10) ** -20 * back**2:
            return
        ratio = R * mp.sqrt(back / away)
        if ratio >= 1 - mp.mpf(10) ** -12:
            return
        span = u * (1 / away + 1 / mp.sqrt(away * back)) / (1 - ratio)
        # Momentum of the two bodies carries over; m ends with the velocity of M.
        self.v += self.mu / (1 + self.mu) * self.u
        self.u = mp.mpf(0)
        self.pieces.append((self.time, self._stuck(), self.y))
        self.x, self.v = self._stuck().derivatives(span)[:2]
        self.time += span

    def advance(self, end: Any) -> bool:
        """Go to the next event or to `end`; return whether there was an event."""
        if self.mode == 'free':
            return self._fly(end)
        motion = self._stuck()
        self.pieces.append((self.time, motion, self.y))
        conditions = self._release_conditions(motion, self.mode)
        for f in conditions:
            f.order = self._leading(f)[1]
        found = first_event(conditions, self.step, end - self.time)
        tau = found[1] if found else end - self.time
        self.x, self.v = motion.derivatives(tau)[:2]
        self.time += tau
        if not found:
            return False
        self.slide = -1 if found[0] == 'up' else 1
        self.mode, self.smooth = 'free', True
        self._record('release', self._stop(), self.v, self.v)
        return True

    def _fly(self, end: Any) -> bool:
        drag = self.slide * self.grip
        motion = Motion(self.alone, self.time, self.x, self.v, self.m * drag - self.press)
        relative = Relative(
            motion, self.y, self.v + self.u, self.incline - drag + self.press / self.m
        )
        self.pieces.append((self.time, relative, self.y))
        stop = self._stop()
        flat = (0 if self.u else 1) + (1 if self.smooth else 0)
        watched = [Watched('1', relative, -1, 0, self.half_gap, 1 + flat if stop == 1 else 0)]
        if not self.one_sided:
            watched.append(
                Watched('2', relative, 1, 0, self.half_gap, 1 + flat if stop == 2 else 0)
            )
        if self.grip:
            watched.append(Watched('0', relative, self.slide, 1, mp.mpf(0), flat))
        found = first_event(watched, self.step, end - self.time)
        tau = found[1] if found else end - self.time
        self.x, self.v = motion.derivatives(tau)[:2]
        self.y, self.u = relative.derivatives(tau)[:2]
        self.time += tau
        if not found:
            return False
        if found[0] != '0':
            self._impact(int(found[0]))
            return True
        self.u = mp.mpf(0)
        kind = 'stick' if self._choose_mode() == 'stick' else 'reversal'
        self._record(kind, 0, self.v, self.v)
        return True

    def state(self, time: Any) -> tuple[Any, Any, Any, Any]:
        """Return (X, X', Z, Z') at an instant already passed, after any event there."""
        time = mp.mpf(time)
        start, piece, held = next(p for p in reversed(self.pieces) if p[0] <= time)
        if isinstance(piece, Motion):
            x, v = piece.derivatives(time - start)[:2]
            return x, v, x + held, v
        x, v = piece.motion.derivatives(time - start)[:2]
        y, u = piece.derivatives(time - start)[:2]
        return x, v, x + y, v + u


def run(
    params: Mapping[str, Any],
    duration: Any,
    initial: Mapping[str, Any] | None = None,
    max_events: int | None = None,
) -> HybridMotion:
    """Run the rig, and return the motion with its events."""
    motion = HybridMotion(params, initial)
    end = mp.mpf(duration)
    while max_events is None or len(motion.events) < max_events:
        if not motion.advance(end):
            break
    return motion


def simulate(
    params: Mapping[str, Any],
    duration: Any,
    initial: Mapping[str, Any] | None = None,
    max_events: int | None = None,
) -> list[OracleEvent]:
    """
    Return the events of the rig up to `duration`, exact to far more than 30 digits.

    Parameters
    ----------
    params : mapping
        Fields of RigParameters; floats are taken exactly as they are.
    duration : float or mpf
        Length of the run, s.
    initial : mapping, optional
        Fields of InitialConditions.
    max_events : int, optional
        Where to stop early.

    """
    events: Sequence[OracleEvent] = run(params, duration, initial, max_events).events
    return list(events if max_events is None else events[:max_events])
