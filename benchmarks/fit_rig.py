"""
Fits of random rigs: acceptance of right and of wrong models, coverage of intervals, time.

    python benchmarks/fit_rig.py [--rigs 24] [--wrong 4] [--falling] [--seed N] [--jobs 1]
        [--progress FILE]

Random rigs on a bench (`test/fit/random_rigs.py`) are measured over 100 impacts with a noise of
1 % of the amplitude and fitted again. Right models go through all combinations in turn: at 200 Hz
and 1 kHz, with impact times of 0.5 ms (5 % of them missing, 2 % more that are none) and without,
displacement, velocity, and acceleration with an offset, from rest and cut out of the motion. The
constants of the file are off as their stated uncertainty says. With --falling their restitution
falls with the speed of impact, by a restitution_speed from 0.05 to 1 m/s.

Wrong models are rigs that the file or the model does not describe (`test/fit/other_rigs.py`), at
200 Hz with impact times. An accepted one is right if its errors are as small as those of a right
model: a constant that is wrong in the file is estimated, too.

The seeds are drawn anew after the last change of the method, and no fit to them is looked at
before. Rigs that have fewer than 100 impacts in a minute are left out, before anything is fitted.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import islice, product
from pathlib import Path
from statistics import median
from time import process_time
from typing import Any, NamedTuple

# Threads of BLAS that wait for each other would count as time of the fit
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import numpy as np
from timing import options, say, table, write_results

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / 'test'))
from fit.other_rigs import measure_other
from fit.random_rigs import DEVIATION, LONGEST, guess_of, measure, random_rig, true_values

from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.fit.rig_fit import fit_rig
from impact_damper_ros.fit.unknowns import CONSTANTS

#: Draws the seeds of the rigs.
SEED = 1005904592
NOISE, IMPACTS = 0.01, 100
TIMES = {'missing': 0.05, 'false': 0.02}
WITHIN = 1.959964
#: Into which part of the motion a record is cut, s, and the offset of an accelerometer, m/s^2.
CUT, OFFSET = 3.0, 0.05


class Kind(NamedTuple):
    """How a rig of a right model is measured."""

    rate: float
    timed: bool
    quantity: str
    cut: bool
    falls: bool = False


RIGHT = [
    Kind(rate, timed, quantity, cut)
    for cut, rate, quantity, timed in product(
        (False, True),
        (200.0, 1000.0),
        ('displacement', 'velocity', 'acceleration'),
        (True, False),
    )
]
#: What is wrong, and words of which one names it in the first reason.
WRONG: dict[str, tuple[str, ...]] = {
    'm 10 % too large': ('damper_mass',),
    'm 10 % too small': ('damper_mass',),
    'M 10 % too large': ('primary_mass', 'force'),
    'force 10 % too large': ('primary_mass', 'force'),
    'force by rms': ('rms',),
    'g called m/s^2': ('9.8',),
    'inches called mm': ('25.4',),
    'sensor reversed': ('reversed', 'other way'),
    'second mode': ('second mode', 'another mode'),
    'cubic spring': ('spring', 'stiffness'),
    'm stuck': ('moves with M', 'stuck'),
    'gap grows': ('gap',),
    'R falls with speed': ('speed',),
}


def seeds(seed: int, count: int) -> list[int]:
    """Return the seeds of the first rigs that have enough impacts."""
    drawn = np.random.default_rng(seed).integers(2**31, size=3 * count + 10)
    return list(islice(filter(rattles, map(int, drawn)), count))


def rattles(seed: int) -> bool:
    """Return whether a rig has the impacts within the longest record, from its start there."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    start = InitialConditions(initial_damper_velocity=float(rng.uniform(-0.3, 0.3)))
    running, count = Rig(rig, start), 0
    while count <= IMPACTS + 50 and running.time < LONGEST:
        count += len(running.run(running.time + 5.0).impacts())
    return count > IMPACTS + 50


def right_case(seed: int, kind: Kind) -> dict[str, Any]:
    """Measure one rig, fit it, and compare it with what it is."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    if kind.falls:
        rig = rig.replace(restitution_speed=float(rng.uniform(0.05, 1.0)))
    record = measure(
        rig,
        rng,
        impacts=IMPACTS,
        rate=kind.rate,
        noise=NOISE,
        quantity=kind.quantity,
        timed=kind.timed,
        cut=CUT if kind.cut else 0.0,
        **(TIMES if kind.timed else {}),
    ).record
    if kind.quantity == 'acceleration':
        record = record._replace(motion=record.motion + OFFSET)
    guess, off = guess_of(rig, rng), rng.normal(size=2)
    guess = guess.replace(
        damper_mass=guess.damper_mass * (1.0 + CONSTANTS['damper_mass'].uncertainty * off[0]),
        force_amplitudes=tuple(
            force * (1.0 + CONSTANTS['force_amplitudes'].uncertainty * off[1])
            for force in guess.force_amplitudes
        ),
    )
    return fitted({'seed': seed, **kind._asdict()}, record, guess, rig)


def wrong_case(seed: int, kind: str) -> dict[str, Any]:
    """Measure one rig that a model or a file does not describe, and fit it."""
    rng = np.random.default_rng(seed)
    rig = random_rig(rng)
    guess = guess_of(rig, rng)
    beside: dict[str, Any] = {
        'second mode': {'second_mode': 0.02},
        'cubic spring': {'cubic': 0.1},
        'gap grows': {'gap_growth': 0.1},
        'R falls with speed': {'fall': 0.3},
        'g called m/s^2': {'quantity': 'acceleration'},
        'm stuck': {'longest': 12.0},
    }.get(kind, {})
    measured = rig.replace(friction=5.0) if kind == 'm stuck' else rig
    record = measure_other(measured, rng, impacts=IMPACTS, noise=NOISE, **beside)
    factor = {'g called m/s^2': 1 / 9.80665, 'inches called mm': 1 / 25.4, 'sensor reversed': -1.0}
    record = record._replace(motion=factor.get(kind, 1.0) * record.motion)
    force = rig.force_amplitudes[0]
    guess = guess.replace(
        **{
            'm 10 % too large': {'damper_mass': 1.1 * rig.damper_mass},
            'm 10 % too small': {'damper_mass': 0.9 * rig.damper_mass},
            'M 10 % too large': {'primary_mass': 1.1 * rig.primary_mass},
            'force 10 % too large': {'force_amplitudes': (1.1 * force,)},
            'force by rms': {'force_amplitudes': (force / 2.0**0.5,)},
        }.get(kind, {})
    )
    row = fitted({'seed': seed, 'wrong': kind}, record, guess, rig)
    if kind == 'R falls with speed':
        row.get('z', {}).pop('restitution_1', None)  # It has no one value
    first = row.get('reasons') or ['']
    return row | {'named': any(word in first[0] for word in WRONG[kind])}


def fitted(row: dict[str, Any], record: Any, guess: Any, rig: Any) -> dict[str, Any]:
    """Return a row with the result of a fit."""
    began = process_time()
    try:
        fit = fit_rig(record, guess)
    except Exception as error:  # a crash is a result
        return row | {'error': repr(error), 'cpu': process_time() - began, 'accepted': False}
    row |= {'cpu': process_time() - began, 'accepted': fit.accepted, 'reasons': fit.reasons}
    if fit.parameters:
        row['chi'] = fit.chi_squared**0.5
        row['flights'] = len(fit.flights), sum(flight.used for flight in fit.flights)
        row['z'] = {
            name: (fit.parameters[name].value - value) / fit.parameters[name].standard_deviation
            for name, value in true_values(rig).items()
            if fit.parameters[name].standard_deviation
        }
        if (speed := fit.parameters.get('restitution_speed')) is not None:
            # Its inverse is what has a normal error
            missed = 1.0 / speed.value - rig.restitution_slowness
            row['z']['restitution_speed'] = missed * speed.value**2 / speed.standard_deviation
    return row


def case(task: tuple[int, Any]) -> dict[str, Any]:
    """Return the row of one rig."""
    seed, kind = task
    return wrong_case(seed, kind) if isinstance(kind, str) else right_case(seed, kind)


def of_right(rows: list[dict[str, Any]]) -> Iterator[list[str]]:
    """Yield a row of the table for all records of right models, and for each kind."""
    groups: list[tuple[str, dict[str, Any]]] = [('all', {})]
    groups += [('with impact times', {'timed': True}), ('without', {'timed': False})]
    groups += [(f'{rate:g} Hz', {'rate': rate}) for rate in (200.0, 1000.0)]
    groups += [(name, {'quantity': name}) for name in ('displacement', 'velocity', 'acceleration')]
    groups += [('from rest', {'cut': False}), ('cut', {'cut': True})]
    for name, asked in groups:
        own = [row for row in rows if all(row[key] == value for key, value in asked.items())]
        if not own:
            continue
        accepted = [row for row in own if row['accepted']]
        z = np.abs([value for row in accepted for value in row['z'].values()])
        cpu = [row['cpu'] for row in own]
        refused = [row['cpu'] for row in own if not row['accepted']]
        yield [
            name,
            str(len(own)),
            f'{100 * len(accepted) / len(own):.0f} %',
            f'{100 * (z < WITHIN).mean():.1f} %' if len(z) else '-',
            f'{z.max():.1f}' if len(z) else '-',
            f'{median(cpu):.1f} s',
            f'{max(cpu):.1f} s',
            f'{max(refused):.1f} s' if refused else '-',
            str(sum('error' in row for row in own)),
        ]


def of_wrong(rows: list[dict[str, Any]]) -> Iterator[list[str]]:
    """Yield a row of the table for each kind of wrong model."""
    for kind in (*WRONG, 'all'):
        own = [row for row in rows if kind in (row['wrong'], 'all')]
        if not own:
            continue
        accepted = [row for row in own if row['accepted']]
        false = [row for row in accepted if max(map(abs, row['z'].values())) > 4.0]
        refused = [row for row in own if not row['accepted']]
        yield [
            kind,
            str(len(own)),
            f'{100 * len(accepted) / len(own):.0f} %',
            f'{100 * len(false) / len(own):.0f} %',
            f'{100 * sum(row["named"] for row in refused) / len(refused):.0f} %'
            if refused
            else '-',
            f'{max(row["cpu"] for row in own):.1f} s',
            str(sum('error' in row for row in own)),
        ]


def fits(arguments: Any) -> list[dict[str, Any]]:
    """Fit all rigs, or read what has been fitted before; each is written at once."""
    path = arguments.progress
    rows: list[dict[str, Any]] = []
    if path and path.exists():
        rows = [json.loads(line) for line in path.read_text(encoding='utf-8').splitlines()]
    drawn = seeds(arguments.seed, arguments.rigs + arguments.wrong)
    kinds = [kind._replace(falls=arguments.falling) for kind in RIGHT]
    right = [(seed, kinds[k % len(kinds)]) for k, seed in enumerate(drawn[: arguments.rigs])]
    wrong = list(product(drawn[arguments.rigs :], WRONG))
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for row in pool.map(case, [*right, *wrong][len(rows) :]):
            rows.append(row)
            say(f'{len(rows)}: rig {row["seed"]} took {row["cpu"]:.1f} s')
            if path:
                with path.open('a', encoding='utf-8') as file:
                    file.write(json.dumps(row) + '\n')
    return rows


def main() -> int:
    """Run and print."""
    parser = options(__doc__ or '', 1)
    parser.add_argument('--rigs', type=int, default=24, help='rigs of right models [24]')
    parser.add_argument('--wrong', type=int, default=4, help='rigs of each wrong model [4]')
    parser.add_argument('--seed', type=int, default=SEED, help=f'draws the rigs [{SEED}]')
    parser.add_argument('--jobs', type=int, default=1, help='processes [1]')
    parser.add_argument(
        '--falling', action='store_true', help='let restitution fall with the speed of impact'
    )
    parser.add_argument(
        '--progress',
        type=Path,
        metavar='FILE',
        help='write each fit there, and go on from what is in it',
    )
    arguments = parser.parse_args()
    rows = fits(arguments)
    print(f'noise {NOISE:g} of the amplitude, {IMPACTS} impacts, times of {DEVIATION:g} s\n')
    head = ['right models', 'rigs', 'accepted', 'intervals hold', 'worst z']
    head += ['CPU', 'most', 'refusal', 'crashes']
    print(table(head, of_right([row for row in rows if 'wrong' not in row])))
    head = ['wrong models', 'rigs', 'accepted', 'beyond 4 deviations', 'named first']
    head += ['CPU', 'crashes']
    print('\n' + table(head, of_wrong([row for row in rows if 'wrong' in row])))
    write_results(arguments.json, {'rows': rows})
    return 0


if __name__ == '__main__':
    raise SystemExit(main())
