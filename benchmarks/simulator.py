"""
Speed and accuracy of the exact simulator against scipy's solve_ivp, on the golden cases.

Each contender runs the same rig from rest for the same forcing cycles; a time is the CPU time of
the thread. Accuracy is the largest relative error of the first 30 impact times against the
multiprecision oracle of the tests, and the error of the impact phases in steady state against the
golden values, which are given to six or seven digits.

    python benchmarks/simulator.py [--rounds 9] [--json FILE]
"""

from __future__ import annotations

import os
import sys
from functools import partial
from math import inf, tau
from time import perf_counter
from typing import Any

# The integrator's matrices are tiny; threads of a linear algebra library would only disturb.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from golden_cases import (
    CASES,
    COMPARED_IMPACTS,
    Case,
    Impacts,
    impact_error,
    phase_difference,
    reference,
    run_compiled,
    run_plain,
    steady_phases,
)
from ode_rig import ATOL, RTOL, OdeRig
from timing import in_turns, options, ratio, say, table, write_results

from impact_damper_ros import RigParameters

# The transient shrinks by 0.94 in each cycle: after these it is far below the golden digits.
CYCLES = 400


def run_ode(parameters: RigParameters, end: float) -> Impacts:
    """Run solve_ivp from event to event."""
    rig = OdeRig(parameters)
    rig.run(end)
    return [i.time for i in rig.impacts], [i.stop for i in rig.impacts]


CONTENDERS = {
    'plain Python': run_plain,
    'compiled (numba)': run_compiled,
    'solve_ivp DOP853': run_ode,
}


def measure_case(case: Case, contenders: dict[str, Any], cycles: int, rounds: int) -> Any:
    """Time the contenders in turns and judge their impacts."""
    parameters = RigParameters(**case.changes)
    period = tau / parameters.force_frequencies[0]
    end = cycles * period
    say(f'{case.name}: first {COMPARED_IMPACTS} impacts from the oracle')
    exact = reference(case)
    calls = {name: partial(run, parameters, end) for name, run in contenders.items()}
    times = in_turns(calls, rounds, case.name)
    runs = {name: call() for name, call in calls.items()}
    plain = runs['plain Python']
    return {
        name: {
            'seconds': times[name],
            'cycles_per_second': cycles / min(times[name]),
            'ratio': ratio(times[name], times['solve_ivp DOP853']),
            'microseconds_per_impact': 1e6 * min(times[name]) / len(impacts[0]),
            'impact_error': impact_error(impacts, exact),
            'phase_error': phase_difference(steady_phases(impacts, period), case.phases),
            'phase_to_plain': phase_difference(
                steady_phases(impacts, period), steady_phases(plain, period)
            ),
            'same_bits_as_plain': impacts == plain,
        }
        for name, impacts in runs.items()
    }


def text_of(case: Case, rows: dict[str, Any]) -> str:
    """Return the results of a case as a table."""
    resolution = 0.5 * 10.0**-case.digits

    def shown(name: str, row: dict[str, Any]) -> list[str]:
        error, phase = row['impact_error'], row['phase_error']
        apart = 'same bits' if row['same_bits_as_plain'] else f'{row["phase_to_plain"]:.1e}'
        return [
            name,
            f'{row["cycles_per_second"]:.0f}',
            f'{row["ratio"]:.1f}',
            f'{row["microseconds_per_impact"]:.1f}',
            'misses one' if error == inf else f'{error:.1e}',
            f'<{resolution:.0e}' if phase <= resolution else f'{phase:.1e}',
            '-' if name == 'plain Python' else apart,
        ]

    head = ('', 'cycles/s', 'ratio', 'us/impact', 'impact error', 'phase error', 'to plain')
    return table(head, (shown(name, row) for name, row in rows.items()))


def main() -> int:
    """Measure and print."""
    parser = options(__doc__ or '', rounds=9)
    parser.add_argument('--cycles', type=int, default=CYCLES, help='forcing cycles of a run')
    arguments = parser.parse_args()
    contenders = dict(CONTENDERS)
    try:
        say('compiling the kernels ...')
        began = perf_counter()
        run_compiled(RigParameters(**CASES[0].changes), 1.0)
        say(f'compiled, or loaded, in {perf_counter() - began:.1f} s, which is not counted')
    except ImportError:
        say('numba is not installed (extra "compiled"): without the compiled kernels')
        del contenders['compiled (numba)']
    results: dict[str, Any] = {}
    for case in CASES:
        rows = measure_case(case, contenders, arguments.cycles, arguments.rounds)
        results[case.name] = rows
        print(f'\n{case.name}, from rest, {arguments.cycles} forcing cycles\n')
        print(text_of(case, rows))
    print(
        f'\nratio: speed over solve_ivp (rtol {RTOL:g}, atol {ATOL:g}, terminal events) in the '
        f'same round, median of {arguments.rounds}; CPU time.\n'
        f'impact error: largest relative error of the first {COMPARED_IMPACTS} impact times '
        'against the multiprecision oracle.\n'
        'phase error: of the last impact at each stop against the golden value, cycles; < is the '
        'half unit of its last digit. to plain: the same against the plain simulator.'
    )
    write_results(arguments.json, results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
