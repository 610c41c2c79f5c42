"""
Single flights at any scale, at random or made to graze, as kernels take them and as the oracle.

    PYTHONPATH=.:test python -m rig.flights --count 10000

tries to break the certified first event by hand.
"""

from __future__ import annotations

import argparse
import math
import random
from dataclasses import dataclass, replace
from math import inf
from typing import Any

import numpy as np

from impact_damper_ros.rig.flight import begin_flight
from impact_damper_ros.rig.oscillator import Line, Oscillator, oscillators
from impact_damper_ros.rig.run import ALL_STEPS, find_event
from impact_damper_ros.rig.state import Mode, RigConstants, Run, Wave
from oracle import precise_motion as precise
from oracle.first_root import Watched, first_event, polish
from oracle.precise_motion import mp

EPS = 2.0**-52
#: Of the masses: the air force then gives M any constant acceleration, and m next to none.
_MASS_RATIO = 2.0**60


@dataclass(frozen=True)
class Case:
    """
    A flight X'' + 2 zeta omega X' + omega^2 X = push + sum f sin(w t + p), Z'' = pull.

    `slide` is the sign of Y' that friction watches, or 0; `harmonics` are rows (f, w, p).
    """

    omega: float
    zeta: float
    x: float
    velocity: float
    y: float
    relative_velocity: float
    half_gap: float
    pull: float
    push: float
    harmonics: tuple[tuple[float, float, float], ...]
    one_sided: bool
    slide: int
    horizon: float

    @property
    def fastest(self) -> float:
        """Circular frequency of the fastest of spring and harmonics."""
        return max(self.omega, *(w for _, w, _ in self.harmonics))

    def primary(self) -> precise.Motion:
        """Return X with 110 digits."""
        omega = mp.mpf(self.omega)
        rows = [precise.Harmonic(*map(mp.mpf, row)) for row in self.harmonics]
        oscillator = precise.Oscillator(mp.mpf(1), 2 * mp.mpf(self.zeta) * omega, omega**2, rows)
        start = map(mp.mpf, (0.0, self.x, self.velocity, self.push))
        return precise.Motion(oscillator, *start)

    def relative(self) -> precise.Relative:
        """Return Y with 110 digits."""
        velocity = mp.mpf(self.velocity) + mp.mpf(self.relative_velocity)
        return precise.Relative(self.primary(), mp.mpf(self.y), velocity, mp.mpf(self.pull))

    def flight(self) -> tuple[RigConstants, list[Line], Run, list[Wave]]:
        """Return the flight as arguments of kernels, begun."""
        rows = np.array([self.harmonics])
        square, dashpot = self.omega**2, 2.0 * self.zeta * self.omega
        given = (np.array([v]) for v in (1.0, square, dashpot))
        constants, of_lines = oscillators(*given, rows[:, :, 0], rows[:, :, 1])
        of_lines['phase'] = rows[:, :, 2]
        free = Oscillator(**{name: float(value[0]) for name, value in constants.items()})
        lines = [
            Line(**{name: float(value[0, j]) for name, value in of_lines.items()})
            for j in range(len(self.harmonics))
        ]
        rig = RigConstants(*[0.0] * len(RigConstants._fields))._replace(
            free=free,
            joint=free,
            harmonics=len(lines),
            mass_ratio=_MASS_RATIO,
            slope=self.pull,
            air=-self.push / _MASS_RATIO,
            half_gap=self.half_gap,
            one_sided=self.one_sided,
        )
        half = self.half_gap
        run = Run(
            mode=int({0: Mode.FREE, 1: Mode.SLIDE_DOWN, -1: Mode.SLIDE_UP}[self.slide]),
            x=self.x,
            velocity=self.velocity,
            relative_velocity=self.relative_velocity,
            clearance_1=half - self.y,
            clearance_2=inf if self.one_sided else half + self.y,
            stop_1=half,
            stop_2=-half,
            target_1=half,
            target_2=-half,
            last_stop=2,
            steps=ALL_STEPS,
        )
        flight = rig, lines * 2, run, [Wave() for _ in lines]
        begin_flight(*flight)
        return flight

    def size(self, tau: float) -> tuple[float, float]:
        """Return the size of what makes up position and velocity, with errors of the phases."""
        omega, t, turns = self.omega, tau, 1.0 + self.fastest * tau
        drift = abs(self.relative_velocity) + abs(self.velocity)
        position = abs(self.x) + abs(self.velocity) * min(t, 1.0 / omega)
        position += abs(self.push) * min(t * t / 2.0, 2.0 / omega**2)
        pace = omega * abs(self.x) + abs(self.velocity) + abs(self.push) * min(t, 1.0 / omega)
        for force, circular, _ in self.harmonics:
            near = math.hypot(self.zeta * omega, circular - omega) + 1e-300
            position += abs(force) * min(t * t / 2.0, t / omega, 2.0 / (omega * near))
            pace += abs(force) * min(t, 2.0 / near)
        position = position * turns + abs(self.y) + self.half_gap
        return (
            position + drift * t + abs(self.pull) * t * t / 2.0,
            drift + abs(self.pull) * t + pace * turns,
        )


def log_uniform(rng: random.Random, low: float, high: float) -> float:
    """Return a number whose logarithm is uniform between those of low and high."""
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def random_case(rng: random.Random) -> Case:
    """Return a flight over wide ranges of everything, from resonance to far from it."""
    omega, length = log_uniform(rng, 1e-2, 1e3), log_uniform(rng, 1e-6, 1e3)
    speed, pull = omega * length, omega**2 * length

    def some(low: float, high: float, share: float = 1.0) -> float:
        sign = rng.choice([-1.0, 1.0])
        return sign * log_uniform(rng, low, high) if rng.random() < share else 0.0

    def harmonic() -> tuple[float, float, float]:
        ratio = rng.choice([1.0, 1.0 + some(1e-12, 1e-1), *[log_uniform(rng, 1e-2, 1e2)] * 4])
        return pull * some(1e-3, 1e2), omega * ratio, rng.uniform(0.0, math.tau)

    half = length * log_uniform(rng, 1e-3, 1e2)
    one_sided = rng.random() < 0.2
    y, velocity = half * rng.uniform(-1.0, 1.0), speed * some(1e-6, 10.0)
    if rng.random() < 0.5:
        # Just after an impact, inwards
        y = half if one_sided else rng.choice([half, -half])
        velocity = math.copysign(velocity, -y)
    case = Case(
        omega=omega,
        zeta=rng.choice([0.0, log_uniform(rng, 1e-6, 0.99), rng.uniform(0.0, 0.99)]),
        x=length * some(1e-4, 1.0, 0.85),
        velocity=speed * some(1e-4, 1.0, 0.85),
        y=y,
        relative_velocity=velocity,
        half_gap=half,
        pull=pull * some(1e-4, 10.0, 0.6),
        push=pull * some(1e-4, 1.0, 0.5),
        harmonics=tuple(harmonic() for _ in range(rng.choice([1, 1, 1, 2, 3]))),
        one_sided=one_sided,
        slide=int(math.copysign(1, velocity)) if rng.random() < 0.4 else 0,
        horizon=0.0,
    )
    return replace(case, horizon=log_uniform(rng, 0.1, 20.0) * math.tau / case.fastest)


def turning_points(case: Case, order: int) -> list[tuple[float, float]]:
    """Return times between which Y^(order) has an extremum, up to the horizon."""
    times = np.arange(0.05, case.horizon * case.fastest, 0.2) / case.fastest
    slopes = case.relative().grid(times, order + 1)
    turns = np.flatnonzero(slopes[:-1] * slopes[1:] < 0.0)
    return [(times[k], times[k + 1]) for k in turns.tolist()]


def extremum(case: Case, order: int, bracket: tuple[float, float]) -> tuple[Any, Any]:
    """Return where Y^(order) has its extremum, and its value there."""
    watched = Watched('', case.relative(), 1, order, mp.mpf(0), 0)
    time = polish(watched, *map(mp.mpf, bracket), 1)
    return time, watched(time)[0]


def grazing_case(rng: random.Random) -> Case:
    """Return a flight with an extremum of what is watched so near to zero as 1e-12 of its size."""
    while True:
        case = random_case(rng)
        delta = rng.choice([-1.0, 1.0]) * log_uniform(
            rng, *rng.choice([(1e-12, 0.1), (1e-5, 0.1)])
        )
        order = int(case.slide != 0 and rng.random() < 0.5)
        turns = turning_points(case, order)
        if not turns:
            continue
        bracket = rng.choice(turns[:12])
        time, value = extremum(case, order, bracket)
        if order:
            # Y' comes to zero where it is least, and turns
            velocity = case.relative_velocity - float(value) * (1.0 - delta)
            room = 1e3 * (case.half_gap + float(abs(value)) * case.horizon)
            slide = int(math.copysign(1, velocity))
            case = replace(case, y=0.0, half_gap=room, relative_velocity=velocity, slide=slide)
        elif abs(case.y) == case.half_gap and rng.random() < 0.5:
            # m comes back to the stop it has left, and turns there
            for _ in range(4):
                pull = mp.mpf(case.pull) - 2 * (value - mp.mpf(case.y)) / time**2
                case = replace(case, pull=float(pull))
                turns = turning_points(case, 0)
                if not turns:
                    break
                time, value = extremum(case, 0, min(turns, key=lambda t: abs(t[0] - bracket[0])))
            case = replace(case, pull=case.pull * (1.0 + delta))
        else:
            half = float(abs(value)) * (1.0 - delta)
            if half <= abs(case.y):
                continue
            case = replace(case, half_gap=half)
        if case.relative_velocity != 0.0 and abs(case.y) <= case.half_gap:
            return case


def precise_first(case: Case) -> tuple[int, Any, Any]:
    """Return kind (1, 2 for the stops, 3 for a reversal) and instant of the first event."""
    motion, half = case.relative(), mp.mpf(case.half_gap)
    functions = [Watched('1', motion, -1, 0, half, int(case.y == case.half_gap))]
    if not case.one_sided:
        functions.append(Watched('2', motion, 1, 0, half, int(case.y == -case.half_gap)))
    if case.slide:
        functions.append(Watched('3', motion, case.slide, 1, mp.mpf(0), 0))
    found = first_event(functions, mp.mpf(0.26) / case.fastest, mp.mpf(case.horizon))
    if found is None:
        return 0, mp.mpf(case.horizon), mp.mpf(1)
    kind, time = int(found[0]), found[1]
    return kind, time, abs(motion.derivatives(time)[2 if kind == 3 else 1])


def claimed_first(case: Case) -> tuple[int, float]:
    """Return kind and instant of the first event as the kernels find it."""
    flight = case.flight()
    find_event(*flight, case.horizon)
    run = flight[2]
    return (run.kind, run.tau) if run.kind and run.tau <= case.horizon else (0, case.horizon)


#: Round-offs of position or velocity that a claim may be away from the event.
TOLERANCE = 1024.0


def fault(case: Case, claim: tuple[int, float]) -> str:
    """Return what is wrong with a claim; nothing if it is the first event, to round-off."""
    kind, time = claim
    want, instant, rate = precise_first(case)
    motion, unit = case.relative(), [TOLERANCE * EPS * v for v in case.size(time)]
    if (kind, want) == (0, 0):
        return ''
    if kind == want:
        allowed = unit[kind == 3] / float(rate) + 4.0 * EPS * time
        if abs(mp.mpf(time) - instant) <= allowed:
            return ''
    # A graze closer than round-off may be taken either way: how deep is it?
    watched = {
        1: lambda t: mp.mpf(case.half_gap) - motion.derivatives(t)[0],
        2: lambda t: mp.mpf(case.half_gap) + motion.derivatives(t)[0],
        3: lambda t: case.slide * motion.derivatives(t)[1],
    }
    if kind and time <= instant:
        depth = abs(watched[kind](mp.mpf(time)))
        return '' if depth <= unit[kind == 3] else f'false: {kind} at {time!r}, not {want}'
    times = [instant + (mp.mpf(time) - instant) * k / 64 for k in range(1, 65)]
    depth = -min(watched[want](t) for t in times)
    return '' if depth <= unit[want == 3] else f'missed: {want} at {float(instant)!r}'


def main() -> None:
    """Print the flights whose first event is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.strip().splitlines()[0])
    parser.add_argument('--count', type=int, default=10_000)
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    rng = random.Random(options.seed)
    for _ in range(options.count):
        case = rng.choice([random_case, grazing_case])(rng)
        if wrong := fault(case, claimed_first(case)):
            print(wrong, case)


if __name__ == '__main__':
    main()
