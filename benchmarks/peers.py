"""
The simulator against other ways to simulate the rig, in one run: speed, and error of the impacts.

    python benchmarks/peers.py [--rounds 7] [--json FILE] [--figure FILE]

The peers come from PyPI (extra ``peers``); one that is not installed is left out and named. All
run the golden cases from rest. Speed is forcing cycles per second of CPU time of the thread;
compiling is not counted. The error is the largest relative one of the first 30 impact times
against the multiprecision oracle of the tests. ``--figure`` draws both, as in
benchmarks/results.md.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from math import cos, exp, inf, sin, tau
from pathlib import Path
from typing import Any, NamedTuple

from golden_cases import CASES, Case, Impacts, impact_error, in_order, reference, run_plain
from heyoka_rigs import HeyokaBatchRig, HeyokaRig, lanes
from peer_rigs import MujocoRig, RungeKuttaRig, SolveIvpRig
from timing import in_turns, options, say, seconds_of, table, write_results

from impact_damper_ros import Rig, RigParameters

OURS = 'Rig, compiled'
PLAIN = 'Rig, plain Python'
BEST_PEER = 'heyoka, fast_math'
#: Rigs with neighbouring gaps, as many as heyoka recommends for its batch mode.
OUR_ENSEMBLE = 'Rig, neighbouring gaps'
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


def floor() -> float:
    """
    Return the CPU time of the arithmetic that an impact cannot do without, s.

    Two evaluations of two sincos and one exp each, in a chain, since the instant of each impact
    depends on the one before.
    """
    from numba import njit

    @njit(nogil=True)
    def chain(count: int) -> float:
        value = 0.3
        for _ in range(2 * count):
            first = sin(value) * cos(value)
            second = sin(0.71 * value) * cos(0.71 * value)
            value = 1.0 + 1e-3 * (first + second * exp(-0.01 * value))
        return value

    chain(1)
    return min(seconds_of(partial(chain, 200_000)) for _ in range(9)) / 200_000


def measure(case: Case, rounds: int) -> dict[str, Any]:
    """Measure all contenders in one case."""
    parameters = RigParameters(**case.changes)
    period = tau / parameters.force_frequencies[0]
    exact = reference(case)
    rows: dict[str, Any] = {}
    calls: dict[str, Callable[[], object]] = {}
    for name, contender in CONTENDERS.items():
        if CASES.index(case) not in contender.cases:
            continue
        if find_spec(contender.module) is None:
            say(f'{name}: left out, {contender.module} is not installed (extra "peers")')
            continue
        run = contender.make(parameters)
        impacts = run(exact[0][-1] * 1.02)
        end = contender.cycles * period
        rows[name] = {
            'impact_error': impact_error(impacts, exact),
            'impacts_in_order': in_order(impacts, exact),
            'impacts_per_cycle': len(run(end)[0]) / contender.cycles,
        }
        calls[name] = partial(run, end)
    for name, times in in_turns(calls, rounds, case.name).items():
        rigs = rigs_at_once() if CONTENDERS[name].ensemble else 1
        rows[name]['cycles_per_second'] = rigs * CONTENDERS[name].cycles / min(times)
    return rows


def text_of(rows: dict[str, Any]) -> str:
    """Return the results of a case as a table."""

    def shown(name: str, row: dict[str, Any]) -> tuple[str, ...]:
        ours = OUR_ENSEMBLE if CONTENDERS[name].ensemble else OURS
        faster = '-'
        if ours in rows and name != ours:
            faster = f'{rows[ours]["cycles_per_second"] / row["cycles_per_second"]:.3g} times'
        error = f'{row["impact_error"]:.0e}'
        if row['impact_error'] == inf:
            error = f'wrong stop after {row["impacts_in_order"]} impacts'
        return name, f'{row["cycles_per_second"]:.3g}', faster, error

    head = ('', 'cycles per second', 'Rig is faster', 'error of the first 30 impacts')
    return table(head, (shown(name, row) for name, row in rows.items()))


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


def main() -> int:
    """Measure and print."""
    parser = options(__doc__ or '', rounds=7)
    parser.add_argument('--figure', type=Path, metavar='FILE', help='draw speed against error')
    arguments = parser.parse_args()
    cases = {case.name: measure(case, arguments.rounds) for case in CASES}
    results: dict[str, Any] = {'floor_seconds': floor(), 'cases': cases}
    for label, rows in zip(LABELS, cases.values(), strict=True):
        print(f'\n**{label[0].upper()}{label[1:]}**\n\n{text_of(rows)}')
    per_impact = [
        1e9 / rows[OURS]['cycles_per_second'] / rows[OURS]['impacts_per_cycle']
        for rows in cases.values()
        if OURS in rows
    ]
    print(
        f'\nan impact takes Rig {min(per_impact):.0f} to {max(per_impact):.0f} ns, the floor is '
        f'{1e9 * results["floor_seconds"]:.0f} ns'
    )
    write_results(arguments.json, results)
    if arguments.figure:
        draw(results, arguments.figure)
    return 0


if __name__ == '__main__':
    sys.exit(main())
