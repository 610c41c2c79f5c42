"""
What theory costs, here and at another commit, in turns: branches, a search, a design, compiling.

    python benchmarks/theory.py [--beside COMMIT] [--quick] [--json FILE]

CPU time of the process and its children, and of commands the time by the clock, too: the least of
the rounds; compiling once, in an empty cache.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tarfile
import tempfile
import time
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from timing import options, say, table, write_results

ROOT = Path(__file__).resolve().parents[1]
BYTECODE = Path(tempfile.gettempdir()) / 'theory-bytecode'
#: Units of what is measured, where it is not seconds.
UNITS = {
    'follow, two impacts': 'us a point',
    'follow, sticking': 'us a point',
    'follow, over the frequency': 'us a point',
    'find_orbits, two impacts': 'ms',
    'find_orbits, three impacts': 'ms',
}
_DESIGN = (
    '--mass 5kg --frequency 10Hz --damping-ratio 2% --base 0.2g '
    '--restitution 0.5:0.7 --rig-out damper.yaml'
)
COMMANDS = {
    'solve_periodic': 'bench_rig --impacts 1:4 --cycles 1:3 --viable',
    'design_damper': _DESIGN,
    'design_damper, and its figure': f'{_DESIGN} --figure design.png',
    'compare_run, report of 60 s': 'BAG --report report',
}
_CLI = 'impact_damper_ros.cli'


def least(call: Callable[[], Any], times: int = 3) -> float:
    """Return the least CPU time of some calls, s."""
    spent = []
    for _ in range(times):
        began = time.process_time()
        call()
        spent.append(time.process_time() - began)
    return min(spent)


def in_process() -> dict[str, float]:
    """Measure what needs no process of its own."""
    from impact_damper_ros import RigParameters, find_orbits, follow, load_parameters

    bench = load_parameters('bench_rig')[0]
    rubbing = RigParameters(angle=0.7853981633974483, friction=0.5, gravity=2.0, gap=20.0).replace(
        force_frequencies=1.02
    )
    results = {}
    frequency = bench.force_frequencies[0]
    for name, rig, path, low, high in (
        ('two impacts', bench, 'gap', 0.004, 0.06),
        ('sticking', rubbing, 'gap', 19.0, 64.0),
        ('over the frequency', bench, 'force_frequencies', 0.9 * frequency, 1.1 * frequency),
    ):
        orbit = next(o for o in find_orbits(rig, (1, 2)).orbits if o.viable)
        points = len(follow(orbit, path, low, high).points)
        spent = least(lambda at=(orbit, path, low, high): follow(*at))
        results[f'follow, {name}'] = 1e6 * spent / points
    for name, stops, gap in (('two impacts', (1, 2), 0.02), ('three impacts', (1, 1, 2), 0.01)):
        # Other rigs, whose motions are not kept
        rigs = iter([bench.replace(gap=gap * (1.0 + 1e-4 * k)) for k in range(3)])
        spent = least(lambda at=(rigs, stops): find_orbits(next(at[0]), at[1]))
        results[f'find_orbits, {name}'] = 1e3 * spent
    return results


class Ran(NamedTuple):
    """Output of a program that has run, and its time by CPU and by the clock, s."""

    output: str
    spent: float
    clock: float


def run(tree: Path, words: list[str], **variables: str) -> Ran:
    """Run Python in the package of a tree."""
    before, began = os.times(), time.perf_counter()
    # Sources are compiled once, as where a package is installed
    environment = {**os.environ, 'PYTHONPATH': str(tree), 'PYTHONPYCACHEPREFIX': str(BYTECODE)}
    environment.pop('PYTHONDONTWRITEBYTECODE', None)
    environment |= variables
    with tempfile.TemporaryDirectory() as directory:
        done = subprocess.run(
            [sys.executable, *words],
            check=True,
            env=environment,
            cwd=directory,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
    after, clock = os.times(), time.perf_counter() - began
    spent = after.children_user + after.children_system
    return Ran(done.stdout, spent - before.children_user - before.children_system, clock)


def measured(tree: Path, bag: Path) -> dict[str, float]:
    """Measure a tree once, the report of a bag among it."""
    results: dict[str, float] = json.loads(run(tree, [__file__, '--of-this']).output)
    if not bag.exists():
        run(
            tree,
            ['-m', f'{_CLI}.simulate_rig', 'bench_rig', '--duration', '60', '--bag', str(bag)],
        )
    for name, text in COMMANDS.items():
        given = text.replace('BAG', str(bag)).split()
        ran = run(tree, ['-m', f'{_CLI}.{name.partition(",")[0]}', *given])
        results[name], results[f'{name}, by the clock'] = ran.spent, ran.clock
    return results


def compiling(tree: Path) -> float:
    """Return what all compilations together take: the runs of rigs, and what theory needs."""
    text = (
        'import sys; from impact_damper_ros import Rig, RigParameters, find_orbits, follow;'
        'two = dict(force_amplitudes=(1.0, 0.1), force_frequencies=(1.0, 2.0),'
        ' force_phases=(0.0, 0.0));'
        '[Rig(rig, compiled=True).run(1.0) for rig in (RigParameters(), RigParameters(**two))];'
        'orbit = find_orbits(RigParameters(gravity=0.0), (1, 2)).orbits[0];'
        'find_orbits(RigParameters(gravity=0.0, gap=16.0), (1, 1, 2));'
        'follow(orbit, "gap", 36.0, 38.0)'
    )
    with tempfile.TemporaryDirectory() as empty:
        cold, kept = (run(tree, ['-c', text], NUMBA_CACHE_DIR=empty).spent for _ in range(2))
        return cold - kept


def checked_out(commit: str, place: Path) -> Path:
    """Write the files of a commit to a place."""
    archive = subprocess.run(
        ['git', 'archive', commit],
        check=True,
        cwd=ROOT,
        stdout=subprocess.PIPE,
    )
    with tarfile.open(fileobj=BytesIO(archive.stdout)) as files:
        files.extractall(place, filter='data')
    return place


def main() -> int:
    """Measure both and print the table."""
    if sys.argv[1:] == ['--of-this']:
        print(json.dumps(in_process()))
        return 0
    parser = options(__doc__, 3)
    parser.add_argument('--beside', metavar='COMMIT', help='measure another commit, too')
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as place:
        trees = {'here': ROOT}
        if arguments.beside:
            before = checked_out(arguments.beside, Path(place) / 'tree')
            trees = {arguments.beside: before, **trees}
        results: dict[str, dict[str, float]] = {name: {} for name in trees}
        for name, tree in trees.items():
            say(f'{name}: compiling ...')
            results[name]['compiling'] = compiling(tree)
        for turn in range(arguments.rounds):
            for name, tree in trees.items():
                say(f'{name}: round {turn + 1} of {arguments.rounds}')
                for measure, value in measured(tree, Path(place) / f'{name}-bag').items():
                    best = results[name].get(measure, value)
                    results[name][measure] = min(best, value)
    rows = [
        (f'{name} [{UNITS.get(name, "s")}]', *(f'{one[name]:.3g}' for one in results.values()))
        for name in results['here']
    ]
    print(table(['', *results], rows))
    write_results(arguments.json, results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
