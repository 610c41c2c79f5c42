"""
Try to break the certified first event: random and near-grazing flights by the million.

    PYTHONPATH=.:test python -m rig.break_contact --count 2000000

Each flight's first event, as `first_event` claims it, is checked by the dense search of the
oracle. With numba the compiled kernels are tried; without it the plain ones.
"""

from __future__ import annotations

import argparse
import sys
import time
from math import cos, inf, sin

import numpy as np

from impact_damper_ros.rig import contact, kernels
from impact_damper_ros.rig.flight import Flight
from impact_damper_ros.rig.oscillator import acceleration_at, make_oscillator
from oracle.dense_check import FALSE, MISSED, Verdict, check
from oracle.flight_cases import EPS, FlightCases
from oracle.flight_generators import near_grazing_flights, random_flights

GENERATORS = {'random': random_flights, 'near-grazing': near_grazing_flights}

#: In round-offs of positions and velocities. All but a few in ten thousand are below 64 of them; a
#: drive a hundred times faster than the natural frequency costs the closed form some thousand.
TOLERANCE = 32768.0


def launchable(cases: FlightCases) -> FlightCases:
    """Leave out flights that no event begins: without speed, pressed onto the stop they are on."""
    push = np.where(cases.w0 == 0.0, cases.slide, 0)
    pressed = (push > 0) & (cases.y0 == cases.half_gap)
    pressed |= (push < 0) & (cases.y0 == -cases.half_gap) & ~cases.one_sided
    return cases.take(~pressed)


def flight_of(cases: FlightCases, i: int) -> Flight:
    """Return one of the oracle's flights as the package sees it."""
    omega, damping = float(cases.omega0[i]), float(cases.zeta[i])
    oscillator = make_oscillator(
        1.0,
        omega * omega,
        2.0 * damping * omega,
        tuple(cases.force_acc[i].tolist()),
        tuple(cases.force_freq[i].tolist()),
    )
    phases = cases.force_phase0[i].tolist()
    sines = tuple(sin(p) for p in phases)
    x, velocity, constant = float(cases.x0[i]), float(cases.v0[i]), float(cases.const_acc[i])
    acceleration = acceleration_at(oscillator, constant, sines, x, velocity)
    relative = float(cases.gz[i]) - acceleration
    speed = float(cases.w0[i])
    if speed == 0.0 and abs(relative) <= 1e3 * EPS * float(cases.strength[i]):
        relative = 0.0  # a release
    half, offset = float(cases.half_gap[i]), float(cases.y0[i])
    return Flight(
        oscillator=oscillator,
        constant=constant,
        sines=sines,
        cosines=tuple(cos(p) for p in phases),
        x=x,
        velocity=velocity,
        acceleration=acceleration,
        relative_velocity=speed,
        relative_acceleration=relative,
        clearance_1=half - offset,
        clearance_2=inf if cases.one_sided[i] else half + offset,
        joint=False,
        direction=int(cases.slide[i]) if cases.watch_reversal[i] else 0,
        arrival=inf,
        slope=0.0,
        support_low=-inf,
        support_high=inf,
    )


def claims(cases: FlightCases, first_event=contact.first_event) -> tuple[np.ndarray, np.ndarray]:
    """Return kind and instant of the first event of every flight."""
    kind, tau = np.zeros(len(cases), dtype=int), np.zeros(len(cases))
    for i in range(len(cases)):
        kind[i], tau[i] = first_event(flight_of(cases, i), 0.0, float(cases.horizon[i]))
    return kind, tau


def trial(name: str, count: int, seed: int, first_event=contact.first_event) -> Verdict:
    """Claim and check one batch of flights; round-off is that of positions and velocities."""
    cases = launchable(GENERATORS[name](count, np.random.default_rng(seed)))
    return check(cases, *claims(cases, first_event), tolerance=TOLERANCE, unit='position')


def main() -> int:
    """Run the trials and return the number of flights whose first event is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=2_000_000, help='flights in all')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--batch', type=int, default=20_000)
    parser.add_argument('--plain', action='store_true', help='leave numba aside')
    options = parser.parse_args()
    first_event = contact.first_event
    if not options.plain:
        try:
            (first_event,) = kernels.compiled('first_event')
        except ImportError:
            print('numba is not installed: plain kernels', file=sys.stderr)
    done = dict.fromkeys(GENERATORS, 0)
    wrong = {name: [0, 0] for name in GENERATORS}
    start, batch = time.monotonic(), 0
    while sum(done.values()) < options.count:
        name = list(GENERATORS)[batch % 2]
        size = min(options.batch, options.count - sum(done.values()))
        seed = options.seed * 1_000_000 + batch
        verdict = trial(name, size, seed, first_event)
        done[name] += len(verdict.status)
        wrong[name][0] += verdict.missed
        wrong[name][1] += verdict.false
        for i in np.flatnonzero((verdict.status == MISSED) | (verdict.status == FALSE))[:5]:
            print(f'\n{name}, seed {seed}, size {size}, flight {i}: status {verdict.status[i]}')
        batch += 1
        counts = ', '.join(
            f'{n} {done[n]} (missed {wrong[n][0]}, false {wrong[n][1]})' for n in GENERATORS
        )
        print(f'\r{time.monotonic() - start:6.0f} s: {counts}', end='', flush=True)
    print()
    return min(1, sum(map(sum, wrong.values())))


if __name__ == '__main__':
    sys.exit(main())
