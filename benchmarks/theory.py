"""
What theory costs, here and at another commit, in turns: branches, a search, a design, compiling.

    python benchmarks/theory.py [--beside COMMIT] [--quick] [--json FILE]

CPU time of the process and its children, the least of the rounds; compiling once, in an empty
cache.
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
from typing import Any

from timing import options, say, table, write_results

ROOT = Path(__file__).resolve().parents[1]
BYTECODE = Path(tempfile.gettempdir()) / 'theory-bytecode'
#: What is measured, in the order of the table, with its unit.
MEASURES = {
    'follow, two impacts': 'us a point',
    'follow, sticking': 'us a point',
    'follow, over the frequency': 'us a point',
    'find_orbits, two impacts': 'ms',
    'find_orbits, three impacts': 'ms',
    'solve_periodic': 's',
    'design_damper': 's',
    'compiling': 's',
}
COMMANDS = {
    'solve_periodic': 'bench_rig --impacts 1:4 --cycles 1:3 --viable',
    'design_damper': '--mass 5kg --frequency 10Hz --damping-ratio 2% --base 0.2g '
    '--restitution 0.5:0.7 --figure design.png --rig-out damper.yaml',
}


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


def run(tree: Path, words: list[str], **variables: str) -> tuple[str, float]:
    """Run Python in the package of a tree; return its output and CPU time, s."""
    before = os.times()
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
    after = os.times()
    spent = after.children_user + after.children_system
    return done.stdout, spent - before.children_user - before.children_system


def measured(tree: Path) -> dict[str, float]:
    """Measure a tree once."""
    results: dict[str, float] = json.loads(run(tree, [__file__, '--of-this'])[0])
    for name, words in COMMANDS.items():
        module = f'impact_damper_ros.cli.{name}'
        results[name] = run(tree, ['-m', module, *words.split()])[1]
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
        cold = run(tree, ['-c', text], NUMBA_CACHE_DIR=empty)[1]
        return cold - run(tree, ['-c', text], NUMBA_CACHE_DIR=empty)[1]


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
            trees = {arguments.beside: checked_out(arguments.beside, Path(place)), **trees}
        results: dict[str, dict[str, float]] = {name: {} for name in trees}
        for name, tree in trees.items():
            say(f'{name}: compiling ...')
            results[name]['compiling'] = compiling(tree)
        for turn in range(arguments.rounds):
            for name, tree in trees.items():
                say(f'{name}: round {turn + 1} of {arguments.rounds}')
                for measure, value in measured(tree).items():
                    best = results[name].get(measure, value)
                    results[name][measure] = min(best, value)
    rows = [
        (f'{name} [{unit}]', *(f'{values[name]:.3g}' for values in results.values()))
        for name, unit in MEASURES.items()
    ]
    print(table(['', *results], rows))
    write_results(arguments.json, results)
    return 0


if __name__ == '__main__':
    sys.exit(main())
