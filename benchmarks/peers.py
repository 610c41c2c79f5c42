"""
The simulator against other ways to simulate the rig, in one run: speed, and error of the impacts.

    python benchmarks/peers.py [--rounds 7] [--json FILE] [--docs]

The peers come from PyPI (extra ``peers``); one that is not installed is left out and named. All
run the golden cases from rest. Speed is forcing cycles per second of CPU time of the thread, the
best of the rounds, which the contenders take in turns; compiling is not counted. The error is the
largest relative one of the first 30 impact times against the multiprecision oracle of the tests.
With ``--docs`` the table and the figure of docs/performance.md are made.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from importlib.util import find_spec
from math import inf, tau
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple

from floor_chain import floor
from heyoka_rigs import HeyokaBatchRig, HeyokaRig, lanes
from peer_rigs import MujocoRig, RungeKuttaRig, SolveIvpRig
from simulator import CASES, Case, Impacts, impact_error, reference, run_plain, say

from impact_damper_ros import Rig, RigParameters

DOCS = Path(__file__).resolve().parents[1] / 'docs'
OURS = 'Rig, compiled'
PLAIN = 'Rig, plain Python'
BEST_PEER = 'heyoka, fast_math'
#: Rigs with neighbouring gaps, as many as heyoka recommends for its batch mode.
OUR_ENSEMBLE = 'Rig, neighbouring gaps in turn'
BATCH = 'heyoka, batch of neighbouring gaps'
LABELS = ('level, at resonance', '45°, frictionless, r = 1.02', '45°, friction 0.5, r = 1.02')


class Contender(NamedTuple):
    """
    A way to simulate the rig.

    Attributes
    ----------
    module : str
        What it needs.
    make : callable
        Makes it for a rig.
    cycles : int
        Cycles enough to time it.
    ensemble : bool
        Whether it runs several rigs; the cycles of all of them count.
    cases : tuple of int
        Where it takes part.
    """

    module: str
    make: Callable[[RigParameters], Callable[[float], Impacts]]
    cycles: int
    ensemble: bool = False
    cases: tuple[int, ...] = (0, 1, 2)


def _compiled(parameters: RigParameters) -> Callable[[float], Impacts]:
    Rig(parameters, compiled=True).run(1.0)

    def run(end: float) -> Impacts:
        impacts = Rig(parameters, compiled=True).run(end).impacts()
        return impacts['time'], impacts['stop']

    return run


def rigs_at_once() -> int:
    """Return how many rigs an ensemble has."""
    return lanes() if find_spec('heyoka') else 8


def neighbours(parameters: RigParameters) -> list[float]:
    """Return gaps from that of a rig on, each wider by a thousandth of it."""
    return [parameters.gap * (1.0 + 1e-3 * k) for k in range(rigs_at_once())]


def _ensemble(parameters: RigParameters) -> Callable[[float], Impacts]:
    runs = [_compiled(parameters.replace(gap=gap)) for gap in neighbours(parameters)]

    def run_all(end: float) -> Impacts:
        first, *_ = [run(end) for run in runs]
        return first

    return run_all


CONTENDERS: dict[str, Contender] = {
    OURS: Contender('numba', _compiled, 20_000),
    PLAIN: Contender('math', lambda p: lambda end: run_plain(p, end), 200),
    'heyoka': Contender('heyoka', lambda p: HeyokaRig(p).run, 1000),
    BEST_PEER: Contender('heyoka', lambda p: HeyokaRig(p, fast_math=True).run, 1000),
    OUR_ENSEMBLE: Contender('numba', _ensemble, 10_000, ensemble=True, cases=(0, 1)),
    BATCH: Contender(
        'heyoka',
        lambda p: HeyokaBatchRig(p, neighbours(p), fast_math=True).run,
        500,
        ensemble=True,
        cases=(0, 1),
    ),
    'RK4, 100 steps a cycle': Contender('numba', lambda p: RungeKuttaRig(p, 100).run, 400),
    'RK4, 2000 steps a cycle': Contender('numba', lambda p: RungeKuttaRig(p, 2000).run, 100),
    'solve_ivp, DOP853, 1e-10': Contender('scipy', lambda p: SolveIvpRig(p).run, 30),
    'MuJoCo, 500 steps a cycle': Contender(
        'mujoco', lambda p: MujocoRig(p, 500).run, 100, cases=(0,)
    ),
    'MuJoCo, 2000 steps a cycle': Contender('mujoco', lambda p: MujocoRig(p, 2000).run, 40),
    'MuJoCo, 8000 steps a cycle': Contender(
        'mujoco', lambda p: MujocoRig(p, 8000).run, 20, cases=(0,)
    ),
}


def shown_error(impacts: Impacts, exact: Impacts) -> float:
    """Return the error of the first impact times; infinite where their order is wrong."""
    times, stops = ([v.item() if hasattr(v, 'item') else v for v in row] for row in impacts)
    if len(times) < len(exact[0]):
        return inf
    return impact_error((times, stops), exact)


def in_order(impacts: Impacts, exact: Impacts) -> int:
    """Return how many of the first impacts are at the right stops."""
    right = [a == b for a, b in zip(impacts[1], exact[1], strict=False)]
    return right.index(False) if False in right else len(right)


def measure(case: Case, rounds: int) -> dict[str, Any]:
    """Measure all contenders in one case."""
    parameters = RigParameters(**case.changes)
    period = tau / parameters.force_frequencies[0]
    exact = reference(case)
    rows: dict[str, Any] = {}
    runs: dict[str, Callable[[float], Impacts]] = {}
    for name, contender in CONTENDERS.items():
        if CASES.index(case) not in contender.cases:
            continue
        if find_spec(contender.module) is None:
            say(f'{name}: left out, {contender.module} is not installed (extra "peers")')
            continue
        runs[name] = contender.make(parameters)
        impacts = runs[name](exact[0][-1] * 1.02)
        rows[name] = {
            'impact_error': shown_error(impacts, exact),
            'impacts_in_order': in_order(impacts, exact),
            'cycles_per_second': 0.0,
        }
    for turn in range(rounds):
        say(f'{case.name}: round {turn + 1} of {rounds}')
        for name, run in runs.items():
            cycles = CONTENDERS[name].cycles
            rigs = rigs_at_once() if CONTENDERS[name].ensemble else 1
            # The first one of two pays for pages of memory that the contender before gave back.
            run(cycles * period)
            began = thread_time()
            impacts = run(cycles * period)
            speed = rigs * cycles / (thread_time() - began)
            row = rows[name]
            row['impacts_per_cycle'] = len(impacts[0]) / cycles
            row['cycles_per_second'] = max(row['cycles_per_second'], speed)
    return rows


def table(results: dict[str, Any]) -> list[str]:
    """Return the results as lines of Markdown."""
    lines = []
    for label, rows in zip(LABELS, results['cases'].values(), strict=True):
        lines += [
            '',
            f'**{label[0].upper()}{label[1:]}**',
            '',
            '| | cycles per second | Rig is faster | error of the first 30 impacts |',
            '| --- | ---: | ---: | ---: |',
        ]
        for name, row in rows.items():
            speed, error = row['cycles_per_second'], row['impact_error']
            ours = OUR_ENSEMBLE if CONTENDERS[name].ensemble else OURS
            ratio = '-'
            if ours in rows and name != ours:
                ratio = f'{rows[ours]["cycles_per_second"] / speed:.3g} times'
            shown = f'{error:.0e}'
            if error == inf:
                shown = f'wrong stop after {row["impacts_in_order"]} impacts'
            lines.append(f'| {name} | {speed:.3g} | {ratio} | {shown} |')
    return lines


def draw(results: dict[str, Any], path: Path) -> None:
    """Draw speed against error."""
    import matplotlib as mpl

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    colors = mpl.colormaps['tab20']
    figure, axes = plt.subplots(1, 3, figsize=(12.0, 4.4), sharey=True, layout='constrained')
    for label, axis, rows in zip(LABELS, axes, results['cases'].values(), strict=True):
        for name, row in rows.items():
            wrong = row['impact_error'] == inf
            error = 1.0 if wrong else max(row['impact_error'], 1e-16)
            # A ring, since it mostly lies on the point of a single rig
            ensemble = CONTENDERS[name].ensemble
            axis.plot(
                row['cycles_per_second'],
                error,
                'x' if wrong else 'o',
                color=colors(list(CONTENDERS).index(name)),
                markersize=14 if ensemble else 8,
                markerfacecolor='none' if ensemble else None,
                markeredgewidth=1.8,
                label=name + (' (x: wrong order)' if wrong else ''),
            )
        axis.set(
            xscale='log', yscale='log', title=label, xlabel='forcing cycles per second of CPU'
        )
        axis.set_xlim(10, 1e7)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel('largest relative error of 30 impact times [-]')
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside lower center', ncols=4, frameon=False)
    figure.savefig(path, dpi=110)


def write_docs(results: dict[str, Any]) -> None:
    """Write the page with its figure."""
    draw(results, DOCS / 'performance.png')
    per_impact = [
        1e9 / rows[OURS]['cycles_per_second'] / rows[OURS]['impacts_per_cycle']
        for rows in results['cases'].values()
    ]
    floor_ns = 1e9 * results['floor_seconds']
    text = [
        '# Performance',
        '',
        'Made by `python benchmarks/peers.py --docs` (with the extras `peers`, `plot`, `test`).',
        'Forcing cycles per second of CPU time on one core, best of rounds in turns, of the',
        'golden cases from rest; compiling is not counted. The error is the largest relative one',
        'of the first 30 impact times, against a simulation with 110 digits that shares no code',
        'with the package. Ratios of one run mean more than the numbers, which depend on the',
        'machine.',
        '',
        '![Speed against error](performance.png)',
        *table(results),
        '',
        f'An impact took Rig {min(per_impact):.0f} to {max(per_impact):.0f} ns, written',
        'into a table, as all others do. The floor, two evaluations of two sincos and one exp',
        f'each in a chain, was {floor_ns:.0f} ns in the same run:',
        f'{min(per_impact) / floor_ns:.1f} to {max(per_impact) / floor_ns:.1f} times as much.',
        'Where the rest goes stands in [benchmarks/README.md](../benchmarks/README.md).',
        '',
        '- heyoka: Taylor integrator at its default tolerance (round-off) with terminal events,',
        '  whose callbacks, in Python, do the impacts; friction and sticking as a parameter and a',
        '  second integrator. `fast_math` is its option. Its batch mode (with `fast_math`) runs',
        '  as many rigs at once as it recommends, here with neighbouring gaps, without friction;',
        '  the cycles of all of them count, as those of the same rigs run by Rig in turn.',
        '- RK4: the classical method with fixed steps, compiled by numba, with bisection.',
        '- solve_ivp: DOP853 with rtol and atol 1e-10 and terminal events.',
        '- MuJoCo: two slide joints with a limit that is 20 steps stiff and damped to the',
        '  restitution, its RK4 integrator, stepped in C by `mujoco.rollout`; in the first case',
        '  with fewer and with more steps, too. An impact is where m passes the limit.',
        '',
    ]
    (DOCS / 'performance.md').write_text('\n'.join(text), encoding='utf-8')


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--rounds', type=int, default=7, help='rounds of all in turns')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    parser.add_argument('--docs', action='store_true', help='make docs/performance.md anew')
    arguments = parser.parse_args()
    results: dict[str, Any] = {'floor_seconds': floor()}
    results['cases'] = {case.name: measure(case, arguments.rounds) for case in CASES}
    print('\n'.join(table(results)))
    results['floor_seconds'] = min(results['floor_seconds'], floor())
    print(f'\nfloor: {1e9 * results["floor_seconds"]:.0f} ns per impact')
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    if arguments.docs:
        write_docs(results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
