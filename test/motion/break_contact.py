"""
Try to break the certified first event: random and near-grazing flights by the million.

    PYTHONPATH=.:test python -m motion.break_contact --count 2000000

Each flight's first event, as `next_event` claims it, is checked by the dense search of the oracle.
With numba the compiled kernels are tried; without it the plain ones.
"""

from __future__ import annotations

import argparse
import sys
import time
from math import inf

import numpy as np

from impact_damper_ros.motion.flight import begin_flight
from impact_damper_ros.motion.kernels import compiled_kernel, has_numba, kernel
from impact_damper_ros.motion.next_event import ALL_STEPS, next_event
from impact_damper_ros.motion.oscillator import Line, Oscillator, oscillators
from impact_damper_ros.motion.records import rows_of
from impact_damper_ros.motion.state import Mode, Moving, RigConstants, Run, Wave
from oracle.dense_check import FALSE, MISSED, Verdict, check
from oracle.flight_cases import EPS, FlightCases
from oracle.flight_generators import near_grazing_flights, random_flights

GENERATORS = {'random': random_flights, 'near-grazing': near_grazing_flights}

#: In round-offs of positions and velocities. All but a few in ten thousand are below 64 of them; a
#: drive a hundred times faster than the natural frequency costs the closed form some thousand.
TOLERANCE = 32768.0
#: Of the masses: the air force then gives M any constant acceleration, and m next to none.
MASS_RATIO = 2.0**60


def launchable(cases: FlightCases) -> FlightCases:
    """Leave out flights that no event begins: without speed, pressed onto the stop they are on."""
    push = np.where(cases.w0 == 0.0, cases.slide, 0)
    pressed = (push > 0) & (cases.y0 == cases.half_gap)
    pressed |= (push < 0) & (cases.y0 == -cases.half_gap) & ~cases.one_sided
    return cases.take(~pressed)


def flights_of(cases: FlightCases):
    """Return rigs, harmonics, states and waves of the oracle's flights."""
    mass = np.ones(len(cases))
    square, dashpot = cases.omega0**2, 2.0 * cases.zeta * cases.omega0
    oscillator, lines = oscillators(
        mass, square, dashpot, cases.force_acc, cases.force_freq, cases.force_phase0
    )
    rigs = rows_of(
        RigConstants,
        len(cases),
        free=oscillator,
        joint=oscillator,
        harmonics=cases.force_acc.shape[1],
        mass_ratio=MASS_RATIO,
        slope=cases.gz,
        air=-cases.const_acc / MASS_RATIO,
        half_gap=cases.half_gap,
        one_sided=cases.one_sided,
    )
    waves = rows_of(Wave, cases.force_acc.shape)
    force = (cases.force_acc * np.sin(cases.force_phase0)).sum(axis=1)
    drag = square * cases.x0 + dashpot * cases.v0
    relative = cases.gz - (cases.const_acc + force - drag)
    flat = np.abs(relative) <= 1e3 * EPS * cases.strength
    sliding = np.where(cases.slide > 0, Mode.SLIDE_DOWN, Mode.SLIDE_UP)
    runs = rows_of(
        Run,
        len(cases),
        mode=np.where(cases.watch_reversal, sliding, Mode.FREE),
        x=cases.x0,
        velocity=cases.v0,
        relative_velocity=cases.w0,
        clearance_1=cases.half_gap - cases.y0,
        clearance_2=np.where(cases.one_sided, inf, cases.half_gap + cases.y0),
        stop_1=cases.half_gap,
        stop_2=-cases.half_gap,
        target_1=cases.half_gap,
        target_2=-cases.half_gap,
        last_stop=2,
        released=(cases.w0 == 0.0) & flat,
        steps=ALL_STEPS,
    )
    return rigs, lines, runs, waves


@kernel
def find_all(rigs, lines, runs, waves, horizons):
    """Find the first event of each flight."""
    for i in range(len(runs)):
        moving = Moving(rigs[i], lines[i], runs[i], waves[i], ())
        begin_flight(moving)
        next_event(moving, horizons[i])


def compiled_find_all(*flights):
    """Find the first event of each flight by the compiled kernels."""
    compiled_kernel('find_all', flights)(*flights)


def plain(rigs, lines, runs, waves):
    """Return the same as objects of plain Python."""
    return (
        [
            RigConstants(Oscillator(*row[0]), Oscillator(*row[1]), *row[2:])
            for row in rigs.tolist()
        ],
        [[Line(*row) for row in of_one] for of_one in lines.tolist()],
        [Run(*row) for row in runs.tolist()],
        [[Wave(*row) for row in of_one] for of_one in waves.tolist()],
    )


def plain_find_all(rigs, lines, runs, waves, horizons):
    """Find the first event of each flight by the plain kernels."""
    flights = plain(rigs, lines, runs, waves)
    find_all(*flights, horizons.tolist())
    for name in ('kind', 'tau', 'searched'):
        runs[name] = [getattr(run, name) for run in flights[2]]


def claims(cases: FlightCases, find=plain_find_all) -> tuple[np.ndarray, np.ndarray]:
    """Return kind and instant of each first event; no kind: how far there is none."""
    rigs, lines, runs, waves = flights_of(cases)
    find(rigs, lines, runs, waves, cases.horizon)
    return runs['kind'], np.where(runs['kind'] == 0, runs['searched'], runs['tau'])


def trial(name: str, count: int, seed: int, find=plain_find_all) -> Verdict:
    """Claim and check one batch of flights; round-off is that of positions and velocities."""
    cases = launchable(GENERATORS[name](count, np.random.default_rng(seed)))
    return check(cases, *claims(cases, find), tolerance=TOLERANCE, unit='position')


def main() -> int:
    """Run the trials and return the number of flights whose first event is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--count', type=int, default=2_000_000, help='flights in all')
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--batch', type=int, default=20_000)
    parser.add_argument('--plain', action='store_true', help='leave numba aside')
    options = parser.parse_args()
    find = plain_find_all
    if not options.plain:
        if has_numba():
            find = compiled_find_all
        else:
            print('numba is not installed: plain kernels', file=sys.stderr)
    done = dict.fromkeys(GENERATORS, 0)
    wrong = {name: [0, 0] for name in GENERATORS}
    start, batch = time.monotonic(), 0
    while sum(done.values()) < options.count:
        name = list(GENERATORS)[batch % 2]
        size = min(options.batch, options.count - sum(done.values()))
        seed = options.seed * 1_000_000 + batch
        verdict = trial(name, size, seed, find)
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
