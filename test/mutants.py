"""
Which altered operators the tests of a room notice: `make mutants ROOM=rig COUNT=60`.

Of all places in a room where one operator can be altered, a fixed draw is taken. Each is altered
in a copy of the package by cosmic-ray. The room's own tests run until one fails: first those that
run the altered line, then the others of their files. Places without a failure are printed. Altered
kernels run as plain Python: compiling them anew takes longest.
"""

import argparse
import os
import random
import re
import shlex
import shutil
import sys
import tempfile
from pathlib import Path

import coverage
from cosmic_ray.commands import init
from cosmic_ray.modules import find_modules
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.testing import run_tests
from cosmic_ray.work_db import WorkDB, use_db

ROOT = Path(__file__).parents[1]
#: What the tests read
FOLDERS = 'impact_damper_ros', 'test', 'config', 'examples', 'docs', 'benchmarks', 'resource'
SWAPS = ('Add_Sub', 'Sub_Add', 'Mul_Div', 'Div_Mul')
ORDERS = ('Eq_NotEq', 'NotEq_Eq', 'Lt_LtE', 'LtE_Lt', 'Gt_GtE', 'GtE_Gt', 'Lt_Gt', 'Gt_Lt')
OPERATORS = {
    *(f'core/ReplaceBinaryOperator_{swap}' for swap in SWAPS),
    *(f'core/ReplaceComparisonOperator_{order}' for order in ORDERS),
    'core/ReplaceAndWithOr',
    'core/ReplaceOrWithAnd',
    'core/ReplaceUnaryOperator_Delete_Not',
    'core/ReplaceUnaryOperator_Delete_USub',
}
#: In the copy: as if numba were not installed.
PLAIN = """
import importlib.metadata as metadata, sys
installed = metadata.version

def version(name):
    if name == 'numba':
        raise metadata.PackageNotFoundError(name)
    return installed(name)

metadata.version = version
sys.modules['numba'] = None
"""


def tests_by_line(place: Path) -> dict[tuple[str, int], set[str]]:
    """Return which tests run each line of a room, by coverage; '' where it is imported."""
    data = coverage.CoverageData(str(place / '.coverage'))
    data.read()
    return {
        (path, line): {context.partition('|')[0] for context in contexts}
        for path in data.measured_files()
        for line, contexts in data.contexts_by_lineno(path).items()
    }


def words_of(tests: set[str]) -> str:
    """Return tests, and then all of their files, as words of a command."""
    files = {test.partition('::')[0] for test in tests}
    return ' '.join(map(shlex.quote, [*sorted(tests), *sorted(files)]))


def main() -> int:
    """Draw, alter, test, and print what is not noticed."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('room', help='a folder of the package and of test/')
    parser.add_argument('--count', type=int, default=60, help='size of the draw [60]')
    parser.add_argument('--seed', type=int, default=1, help='of the draw [1]')
    parser.add_argument('--tests', nargs='+', help='in place of the tests of the room')
    parser.add_argument('--timeout', type=float, default=600.0, help='for the tests of one, s')
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix='mutants_') as folder:
        place = Path(folder)
        for name in FOLDERS:
            shutil.copytree(ROOT / name, place / name, ignore=shutil.ignore_patterns('_build'))
        for path in filter(Path.is_file, ROOT.iterdir()):
            shutil.copy(path, place)
        room = place / 'impact_damper_ros' / given.room
        if any('@kernel' in path.read_text() for path in room.glob('*.py')):
            (place / 'sitecustomize.py').write_text(PLAIN)
        # Python looks there first.
        os.chdir(place)
        tests = ' '.join(given.tests or [f'test/{given.room}'])
        command = (
            f'env -u _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONPATH={place} '
            f'{sys.executable} -m pytest -q -p no:cacheprovider'
        )
        # Those that need a compiler are left out.
        look = f'--tb=no --cov=impact_damper_ros/{given.room} --cov-context=test --cov-report='
        outcome, output = run_tests(f'{command} {look} {tests}', 10.0 * given.timeout)
        command += ' -x'
        for name in re.findall(r'^FAILED (\S+)', output, re.MULTILINE):
            print(f'left out: {name}', flush=True)
            command += f' --deselect {shlex.quote(name)}'
        lines = tests_by_line(place)
        if not lines:
            print(output)
            return 1
        with use_db(str(place / 'mutants.sqlite'), WorkDB.Mode.create) as work:
            modules = sorted(find_modules([room]))
            init(modules, work, {})
            items = [
                item for item in work.work_items if item.mutations[0].operator_name in OPERATORS
            ]
        items.sort(key=lambda item: (item.mutations[0].module_path, item.mutations[0].start_pos))
        drawn = random.Random(given.seed).sample(items, min(given.count, len(items)))
        noticed = 0
        for number, item in enumerate(drawn, 1):
            (where,) = item.mutations
            path, line = where.module_path.relative_to(place), where.start_pos[0]
            places = range(line, where.end_pos[0] + 1)
            those = set().union(*(lines.get((str(where.module_path), n), ()) for n in places))
            some = tests if '' in those else words_of(those) if those else '--version'
            result = mutate_and_test(item.mutations, f'{command} {some}', given.timeout)
            noticed += result.is_killed
            outcome = 'noticed' if result.is_killed else 'NOT noticed'
            print(f'{number}: {path}:{line} {where.operator_name[5:]}: {outcome}', flush=True)
            if not result.is_killed:
                print(result.diff, flush=True)
        print(f'{given.room}: {noticed} of {len(drawn)} are noticed ({len(items)} places)')
    return 0


if __name__ == '__main__':
    sys.exit(main())
