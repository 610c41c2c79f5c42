"""
Fits of random rigs: whether 95 % intervals hold, how often there is an answer, what it takes.

    python benchmarks/fit_rig.py [--rigs 60] [--rates 200 1000] [--jobs 1] [--json FILE]

Random rigs on a bench (`test/fit/random_rigs.py`) are measured from rest over 100 impacts with a
noise of 1 % of the amplitude, at 200 Hz and at 1 kHz, with impact times of 0.5 ms (5 % of them
missing, 2 % more that are none) and without, and fitted again. Their seeds are drawn anew after
the last change of the method, and no fit to them is looked at before.

Intervals are judged of accepted fits. Their width is compared with the Cramer-Rao bound: the
deviation that the same record allows if all impacts, reversals and sticks were known. Rigs
that have fewer than 100 impacts in a minute are left out, before anything is fitted.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any

import numpy as np
from timing import options, say, table, write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from fit.random_rigs import (
    DEVIATION,
    LONGEST,
    bounds_of,
    guess_of,
    measure,
    random_rig,
    true_values,
)

from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.fit.rig_fit import fit_rig

#: Draws the seeds of the rigs.
SEED = 1005904592
NOISE, IMPACTS = 0.01, 100
TIMES = {'missing': 0.05, 'false': 0.02}
WITHIN = 1.959964


def seeds(count: int) -> list[int]:
    """Return the seeds of the first rigs that have enough impacts."""
    drawn = np.random.default_rng(SEED).integers(2**31, size=2 * count)
    return list(islice(filter(rattles, map(int, drawn)), count))


def rattles(seed: int) -> bool:
    """Return whether a rig has the impacts within the longest record, from its start there."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    start = InitialConditions(initial_damper_velocity=float(rng.uniform(-0.3, 0.3)))
    running, count = Rig(rig, start), 0
    while count <= IMPACTS and running.time < LONGEST:
        count += len(running.run(running.time + 5.0).impacts())
    return count > IMPACTS


def case(seed: int, rate: float, timed: bool) -> dict[str, Any]:
    """Measure one rig, fit it, and compare it with what it is."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    measurement = measure(
        rig, rng, impacts=IMPACTS, rate=rate, noise=NOISE, timed=timed, **(TIMES if timed else {})
    )
    guess = guess_of(rig, rng)
    began = process_time()
    row: dict[str, Any] = {'seed': seed, 'rate': rate, 'timed': timed}
    try:
        fit = fit_rig(measurement.record, guess)
    except Exception as error:  # a crash is a result
        return row | {'error': repr(error), 'cpu': process_time() - began, 'accepted': False}
    row |= {'cpu': process_time() - began, 'accepted': fit.accepted, 'reasons': fit.reasons}
    if fit.parameters:
        row['chi'] = fit.chi_squared**0.5
        row['flights'] = len(fit.flights), sum(flight.used for flight in fit.flights)
        row['fitted'] = {n: fit.parameters[n][:2] for n in true_values(rig)}
    return row | {'true': true_values(rig), 'bound': bounds_of(rig, measurement)}


def scores(rows: list[dict[str, Any]]) -> tuple[np.ndarray, np.ndarray]:
    """Return errors in standard deviations, and widths over the bound, of each parameter."""
    z, width = [], []
    for row in rows:
        names = list(row['true'])
        z.append([(row['fitted'][n][0] - row['true'][n]) / row['fitted'][n][1] for n in names])
        width.append([row['fitted'][n][1] / row['bound'][n] for n in names])
    return np.abs(z).reshape(len(rows), -1), np.array(width).reshape(len(rows), -1)


def summary(rows: list[dict[str, Any]]) -> Iterator[list[str]]:
    """Yield a row of the table for each kind of record."""
    for rate, timed in sorted({(row['rate'], row['timed']) for row in rows}, key=str):
        own = [row for row in rows if (row['rate'], row['timed']) == (rate, timed)]
        accepted = [row for row in own if row['accepted']]
        z, width = scores(accepted)
        cpu = [row['cpu'] for row in own]
        yield [
            f'{rate:g} Hz, {"with" if timed else "without"} impact times',
            str(len(own)),
            f'{100 * len(accepted) / len(own):.0f} %',
            f'{100 * (z < WITHIN).mean():.1f} %' if len(z) else '-',
            f'{z.max():.1f}' if len(z) else '-',
            f'{np.median(width):.2f}' if len(z) else '-',
            f'{median(cpu):.1f} s',
            f'{max(cpu):.1f} s',
            str(sum('error' in row for row in own)),
        ]


def fits(arguments: Any) -> list[dict[str, Any]]:
    """Fit all rigs, or read what has been fitted before; each is written at once."""
    path = arguments.progress
    rows: list[dict[str, Any]] = []
    if path and path.exists():
        rows = [json.loads(line) for line in path.read_text(encoding='utf-8').splitlines()]
    done = {(row['seed'], row['rate'], row['timed']) for row in rows}
    tasks = [
        (seed, rate, timed)
        for seed in seeds(arguments.rigs)
        for rate in arguments.rates
        for timed in (True, False)
        if (seed, rate, timed) not in done
    ]
    if not tasks:
        return rows
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for row in pool.map(case, *zip(*tasks, strict=True)):
            rows.append(row)
            say(f'{len(rows)}: rig {row["seed"]} at {row["rate"]:g} Hz took {row["cpu"]:.1f} s')
            if path:
                with path.open('a', encoding='utf-8') as file:
                    file.write(json.dumps(row) + '\n')
    return rows


def main() -> int:
    """Run and print."""
    parser = options(__doc__ or '', 1)
    parser.add_argument('--rigs', type=int, default=60, help='number of rigs [60]')
    parser.add_argument('--rates', type=float, nargs='+', default=[200.0, 1000.0], metavar='HZ')
    parser.add_argument('--jobs', type=int, default=1, help='processes [1]')
    parser.add_argument(
        '--progress',
        type=Path,
        metavar='FILE',
        help='write each fit there, and go on from what is in it',
    )
    arguments = parser.parse_args()
    rows = fits(arguments)
    head = ['record', 'rigs', 'accepted', 'intervals hold', 'worst z', 'width over bound']
    head += ['CPU', 'most', 'crashes']
    print(f'noise {NOISE:g} of the amplitude, {IMPACTS} impacts, times of {DEVIATION:g} s\n')
    print(table(head, summary(rows)))
    write_results(arguments.json, {'rows': rows})
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
