"""
Speed and accuracy of the exact simulator against scipy's solve_ivp, on the golden cases.

Each contender runs the same rig from rest for the same forcing cycles, in turns within one run, so
that the load of the machine falls on all alike; a time is the CPU time of the thread, the number
shown its median over the rounds. Accuracy is the largest relative error of the first 30 impact
times against the multiprecision oracle of the tests, and the error of the impact phases in steady
state against the golden values, which are given to six or seven digits.

    python benchmarks/simulator.py [--quick] [--json FILE]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from time import perf_counter, thread_time
from typing import Any, NamedTuple

# The integrator's matrices are tiny; threads of a linear algebra library would only disturb.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
sys.path.insert(1, str(Path(__file__).resolve().parents[1] / 'test'))

from math import inf, pi, tau

from ode_rig import ATOL, RTOL, OdeRig

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.rig import EventKind

# The transient shrinks by 0.94 in each cycle: after these it is far below the golden digits.
CYCLES = 400
COMPARED_IMPACTS = 30
# Long enough for the oracle to see them all.
LONGEST_REFERENCE_S = 1000.0
# Rounds are repeated within one timing until they take at least this long.
SHORTEST_TIMING_S = 0.05


class Case(NamedTuple):
    """A golden case: the rig, and its impact phases in steady state at stops 1 and 2."""

    name: str
    changes: dict[str, Any]
    phases: tuple[float, float]
    digits: int


CASES = (
    Case('theta=0 r=1 g=0', {'gravity': 0.0}, (0.733784, 0.233784), 6),
    Case(
        'theta=45 g=1 gamma=0 r=1.02',
        {'angle': pi / 4, 'gravity': 1.0, 'force_frequencies': (1.02,)},
        (0.7513744, 0.2632173),
        7,
    ),
    Case(
        'theta=45 g=1 gamma=0.5 r=1.02',
        {'angle': pi / 4, 'gravity': 1.0, 'friction': 0.5, 'force_frequencies': (1.02,)},
        (0.7579950, 0.2697923),
        7,
    ),
)

#: Times and stops of the impacts of a run.
Impacts = tuple[Sequence[float], Sequence[int]]
Contender = Callable[[RigParameters, float], Impacts]


def run_plain(parameters: RigParameters, end: float) -> Impacts:
    """Run the simulator as the package does."""
    events = Rig(parameters).advance(end)
    impacts = [e for e in events if e.kind is EventKind.IMPACT]
    return [e.time for e in impacts], [e.stop for e in impacts]


def run_ode(parameters: RigParameters, end: float) -> Impacts:
    """Run solve_ivp from event to event."""
    rig = OdeRig(parameters)
    rig.run(end)
    return [i.time for i in rig.impacts], [i.stop for i in rig.impacts]


def compiled_contender() -> Contender:
    """Return a run in compiled code, the compiled code being there."""
    Rig(RigParameters(), compiled=True).run(1.0)

    def run(parameters: RigParameters, end: float) -> Impacts:
        impacts = Rig(parameters, compiled=True).run(end).impacts()
        return impacts['time'].tolist(), impacts['stop'].tolist()

    return run


def reference(case: Case) -> Impacts:
    """Return the first impacts of a case from the oracle, rounded to floats."""
    from oracle.hybrid_oracle import simulate

    impacts: list[Any] = []
    wanted = 2 * COMPARED_IMPACTS
    while len(impacts) < COMPARED_IMPACTS:
        events = simulate(case.changes, LONGEST_REFERENCE_S, max_events=wanted)
        impacts = [e for e in events if e.kind == 'impact'][:COMPARED_IMPACTS]
        wanted *= 2
    return [float(e.time) for e in impacts], [e.stop for e in impacts]


def impact_error(impacts: Impacts, exact: Impacts) -> float:
    """Return the largest relative error of the first impact times; infinite if one is missed."""
    times, stops = (row[:COMPARED_IMPACTS] for row in impacts)
    if list(stops) != list(exact[1]):
        return inf
    return max(abs(t - e) / e for t, e in zip(times, exact[0], strict=True))


def steady_phases(impacts: Impacts, period: float) -> tuple[float, ...]:
    """Return the phase of the last impact at each stop."""
    last = dict(zip(impacts[1], impacts[0], strict=True))
    return tuple((last[stop] / period) % 1.0 for stop in (1, 2))


def phase_difference(phases: Sequence[float], others: Sequence[float]) -> float:
    """Return the largest difference of phases, in cycles."""
    return max(abs((a - b + 0.5) % 1.0 - 0.5) for a, b in zip(phases, others, strict=True))


def timed(contender: Contender, parameters: RigParameters, end: float) -> float:
    """Return the CPU time of one run, s, from as many as it takes to measure it."""
    runs, began = 0, thread_time()
    while True:
        contender(parameters, end)
        runs += 1
        spent = thread_time() - began
        if spent >= SHORTEST_TIMING_S:
            return spent / runs


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def measure_case(
    case: Case, contenders: dict[str, Contender], cycles: int, rounds: int
) -> dict[str, Any]:
    """Time the contenders in turns and judge their impacts."""
    parameters = RigParameters(**case.changes)
    period = tau / parameters.force_frequencies[0]
    end = cycles * period
    say(f'{case.name}: first {COMPARED_IMPACTS} impacts from the oracle')
    exact = reference(case)
    times: dict[str, list[float]] = {name: [] for name in contenders}
    for turn in range(rounds):
        say(f'{case.name}: round {turn + 1} of {rounds}')
        for name, contender in contenders.items():
            times[name].append(timed(contender, parameters, end))
    runs = {name: contender(parameters, end) for name, contender in contenders.items()}
    slowest = median(times['solve_ivp'])
    rows = {}
    for name, impacts in runs.items():
        spent = median(times[name])
        # Ratios of the same round, so that a change of the machine's pace cancels.
        ratios = [b / a for a, b in zip(times[name], times['solve_ivp'], strict=True)]
        phases = steady_phases(impacts, period)
        rows[name] = {
            'cycles_per_second': cycles / spent,
            'spread': (max(times[name]) - min(times[name])) / spent,
            'ratio': median(ratios),
            'impacts': len(impacts[0]),
            'microseconds_per_impact': 1e6 * spent / len(impacts[0]),
            'impact_error': impact_error(impacts, exact),
            'phase_error': phase_difference(phases, case.phases),
            'phase_to_plain': phase_difference(phases, steady_phases(runs['plain'], period)),
            'same_bits_as_plain': impacts == runs['plain'],
        }
    return {
        'cycles': cycles,
        'golden_resolution': 0.5 * 10.0**-case.digits,
        'solve_ivp_seconds': slowest,
        'contenders': rows,
    }


LABELS = {'plain': 'plain Python', 'compiled': 'compiled (numba)', 'solve_ivp': 'solve_ivp DOP853'}


def table(results: dict[str, Any]) -> str:
    """Return the results as text."""
    lines = []
    for case, result in results['cases'].items():
        lines += [
            '',
            f'{case}, from rest, {result["cycles"]} forcing cycles',
            f'  {"":17}{"cycles/s":>10}{"ratio":>8}{"us/impact":>11}'
            f'{"impact error":>14}{"phase error":>13}{"to plain":>10}',
        ]
        resolution = result['golden_resolution']
        for name, row in result['contenders'].items():
            phase = row['phase_error']
            shown = f'<{resolution:.0e}' if phase <= resolution else f'{phase:.1e}'
            missed = row['impact_error'] == inf
            error = 'misses one' if missed else f'{row["impact_error"]:.1e}'
            apart = 'same bits' if row['same_bits_as_plain'] else f'{row["phase_to_plain"]:.1e}'
            lines.append(
                f'  {LABELS[name]:17}{row["cycles_per_second"]:>10.0f}{row["ratio"]:>8.1f}'
                f'{row["microseconds_per_impact"]:>11.1f}{error:>14}{shown:>13}'
                f'{"-" if name == "plain" else apart:>10}'
            )
    lines += [
        '',
        f'ratio: speed over solve_ivp (rtol {RTOL:g}, atol {ATOL:g}, terminal events), median of '
        f'{results["rounds"]} rounds in turns; CPU time.',
        f'impact error: largest relative error of the first {COMPARED_IMPACTS} impact times '
        'against the multiprecision oracle.',
        'phase error: of the last impact at each stop against the golden value, cycles; < is the '
        'half unit of its last digit. to plain: the same against the plain simulator.',
    ]
    if 'compile_seconds' in results:
        lines.append(
            f'compiled: Rig.run; compiling, or loading the compiled code, took '
            f'{results["compile_seconds"]:.1f} s and is not counted.'
        )
    else:
        lines.append('compiled kernels: left out, numba is not installed (extra "compiled").')
    return '\n'.join(lines)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('--quick', action='store_true', help='fewer rounds')
    parser.add_argument('--cycles', type=int, help='forcing cycles of a run')
    parser.add_argument('--rounds', type=int, help='rounds of all contenders in turns')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the results there too')
    arguments = parser.parse_args()
    cycles = arguments.cycles or CYCLES
    rounds = arguments.rounds or (3 if arguments.quick else 9)
    results: dict[str, Any] = {'rounds': rounds, 'cases': {}}
    contenders: dict[str, Contender] = {'plain': run_plain}
    try:
        say('compiling the kernels ...')
        began = perf_counter()
        contenders['compiled'] = compiled_contender()
        for case in CASES:
            contenders['compiled'](RigParameters(**case.changes), 1.0)
        results['compile_seconds'] = perf_counter() - began
    except ImportError:
        say('numba is not installed: without the compiled kernels')
        contenders.pop('compiled', None)
    contenders['solve_ivp'] = run_ode
    for case in CASES:
        results['cases'][case.name] = measure_case(case, contenders, cycles, rounds)
    print(table(results))
    if arguments.json:
        arguments.json.write_text(json.dumps(results, indent=2) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
