"""
Which altered operators the tests of a room notice: `make mutants ROOM=rig COUNT=60`.

Of all places in a room where one operator can be altered, a fixed draw is taken; cosmic-ray alters
one at a time. The tests of the room are imported once, in a copy of the package. For each place
they run in a process forked from there, in which the altered functions have their new code, until
one fails: first those that run the altered line, the shortest before the others, then the others
of their files. Where a module has to be imported anew they run in a process of their own. Places
without a failure are printed. Altered kernels run as plain Python, since compiling them anew takes
longest; of what is no kernel the tests run as they always do, those of compiled code among them.
"""

import argparse
import ast
import contextlib
import difflib
import gc
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import defaultdict
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType

import coverage
import pytest
from cosmic_ray.commands import init
from cosmic_ray.modules import find_modules
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator
from cosmic_ray.work_db import WorkDB, use_db

ROOT = Path(__file__).parents[1]
#: What the tests read
FOLDERS = (
    *('impact_damper_ros', 'test', 'config', 'examples', 'docs', 'benchmarks', 'resource'),
    *('launch', 'layouts'),
)
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
#: Where kernels are altered: as if numba were not installed.
PLAIN = """
import sys
sys.modules['numba'] = None
"""
#: What an endless loop may fill, bytes
MEMORY = 6 * 2**30


def new_codes(path: str, before: str, after: str) -> list[tuple[FunctionType, CodeType]] | None:
    """Return functions of a module with their new code; None if not only functions change."""
    functions = defaultdict(list)
    for one in gc.get_objects():
        if isinstance(one, FunctionType) and one.__code__.co_filename == path:
            functions[one.__code__].append(one)
    changes = []

    def compare(old: CodeType, new: CodeType, inside: bool) -> bool:
        changes.extend((one, new) for one in functions[old] if old != new)
        inside = inside or bool(functions[old])
        parts, others = (
            [c for c in code.co_consts if isinstance(c, CodeType)] for code in (old, new)
        )
        same = old.co_code == new.co_code and all(
            a == b for a, b in zip(old.co_consts, new.co_consts, strict=False) if a not in parts
        )
        pairs = zip(parts, others, strict=True)
        return (same or inside) and all(compare(*pair, inside) for pair in pairs)

    known = compare(compile(before, path, 'exec'), compile(after, path, 'exec'), False)
    return changes if known else None


class Course:
    """The tests of a room, which run for one altered place after another."""

    def __init__(self, place: Path, items: list, tests: list[str], timeout: float):
        self.place, self.mutants, self.tests, self.timeout = place, items, tests, timeout
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: list[str] = []
        self.last, self.since = False, 0.0
        self.noticed = 0

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Keep the processor time of a test and whether it fails, the end for an altered one."""
        self.since, before = time.process_time(), self.since
        self.seconds[report.nodeid] += self.since - before
        if report.failed:
            self.failed.append(report.nodeid)
            if self.last:
                (self.place / 'by').write_text(report.nodeid)
                os._exit(1)

    def forked(self, work, seconds: float) -> bool:
        """Do work in a process of its own; return whether it has come to its end."""
        if not (child := os.fork()):
            os.setsid()
            for number in (0, 1, 2):
                os.dup2(os.open(os.devnull, os.O_RDWR), number)
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
            resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
            try:
                work()
            except BaseException:
                (self.place / 'by').write_text(traceback.format_exc())
                os._exit(1)
            os._exit(0)
        end = time.monotonic() + 10.0 * seconds
        while not (ended := os.waitpid(child, os.WNOHANG))[0] and time.monotonic() < end:
            time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(child, signal.SIGKILL)
        if not ended[0]:
            ended = os.waitpid(child, 0)
        return ended[1] == 0

    def look(self) -> None:
        """Keep which tests run each line, and those that fail already or take no compiler."""
        cover = coverage.Coverage(
            data_file=self.place / '.coverage',
            config_file=False,
            include=[str(self.place / 'impact_damper_ros' / '*')],
        )
        cover.start()
        self.each(self.items, cover.switch_context)
        cover.stop()
        cover.save()
        self.note()

    def each(self, items, begin=None) -> None:
        """Run tests."""
        for number, item in enumerate(items, 1):
            if begin is not None:
                begin(item.nodeid)
            after = items[number] if number < len(items) else None
            item.config.hook.pytest_runtest_protocol(item=item, nextitem=after)

    def note(self) -> None:
        """Keep for the other processes what failed, and how long each test takes."""
        (self.place / 'seconds.json').write_text(json.dumps([self.failed, self.seconds]))

    def run(self, items, changes=None) -> None:
        """Run tests, with other code of functions until one fails."""
        self.last = changes is not None
        for function, code in changes or ():
            function.__code__ = code
        self.each(items)
        if changes is None:
            self.note()

    def imported(self) -> bool:
        """Run all tests in a process that imports everything anew; return whether all pass."""
        leave = [word for name in self.failed for word in ('--deselect', name)]
        words = [sys.executable, '-m', 'pytest', '-q', '-x', '-p', 'no:cacheprovider']
        process = subprocess.Popen(
            [*words, *leave, *self.tests],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            return process.wait(10.0 * self.timeout) == 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            return False

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Run the tests as they are, then for each altered place."""
        self.items = session.items
        items = self.items
        # Once for the lines, once in the order of what follows
        for look in (True, False):
            work = self.look if look else partial(self.run, items)
            self.forked(work, 20.0 * self.timeout)
            failed, seconds = json.loads((self.place / 'seconds.json').read_text())
            self.failed += failed
            items = [item for item in items if item.nodeid not in failed]
            items.sort(key=lambda item: seconds[item.nodeid])
        for name in self.failed:
            print(f'left out: {name}', flush=True)
        (self.place / 'by').write_text('by its end')
        cover = coverage.CoverageData(str(self.place / '.coverage'))
        cover.read()
        for number, mutant in enumerate(self.mutants, 1):
            path, lines = mutant.module_path, (mutant.start_pos[0], mutant.end_pos[0])
            tests = cover.contexts_by_lineno(str(path))
            those = {t for n in range(lines[0], lines[1] + 1) for t in tests.get(n, ())}
            files = {name.partition('::')[0] for name in those}
            first = [item for item in items if item.nodeid in those]
            then = [i for i in items if i.nodeid not in those and i.nodeid.split('::')[0] in files]
            before = path.read_text()
            operator = get_operator(mutant.operator_name)(**(mutant.operator_args or {}))
            after = mutate_code(before, operator, mutant.occurrence)
            changes = new_codes(str(path), before, after)
            # An endless loop is no test of minutes
            most = min(self.timeout, 10.0 + 5.0 * sum(seconds[i.nodeid] for i in first + then))
            path.write_text(after)
            # A compiled file of the same second and size would be taken for this one's.
            os.utime(path, (number, number))
            if changes is None:
                good = self.imported()
            else:
                good = self.forked(partial(self.run, first + then, changes), most)
            path.write_text(before)
            self.noticed += not good
            where = f'{path.relative_to(self.place)}:{lines[0]} {mutant.operator_name[5:]}'
            by = (self.place / 'by').read_text() if changes and not good else ''
            (self.place / 'by').write_text('by its end')
            print(f'{number}: {where}: {"NOT " * good}noticed {by}', flush=True)
            if good:
                lines = (before.splitlines(), after.splitlines())
                print(*list(difflib.unified_diff(*lines, lineterm='', n=1))[2:], sep='\n')
        return True


def alters_kernel(mutant) -> bool:
    """Return whether a place is in a kernel, or in a constant beside kernels."""
    text = mutant.module_path.read_text()
    (part,) = (
        node
        for node in ast.parse(text).body
        if min([node.lineno, *(d.lineno for d in getattr(node, 'decorator_list', ()))])
        <= mutant.start_pos[0]
        <= node.end_lineno
    )
    if isinstance(part, ast.FunctionDef):
        return any('kernel' in ast.unparse(one) for one in part.decorator_list)
    return not isinstance(part, ast.ClassDef) and '@kernel' in text


def drawn(room: Path, count: int, seed: int) -> tuple[list, int]:
    """Return a draw of places where an operator can be altered, and how many there are."""
    with use_db(str(room / f'{os.environ["MUTANTS"]}.sqlite'), WorkDB.Mode.create) as work:
        init(sorted(find_modules([room])), work, {})
        items = [item.mutations[0] for item in work.work_items]
    items = [item for item in items if item.operator_name in OPERATORS]
    items.sort(key=lambda item: (item.module_path, item.start_pos))
    return random.Random(seed).sample(items, min(count, len(items))), len(items)


def main() -> int:
    """Copy the package, draw, alter, test, and print what is not noticed."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').split('\n\n')[0].strip())
    parser.add_argument('room', help='a folder of the package and of test/')
    parser.add_argument('--count', type=int, default=60, help='size of the draw [60]')
    parser.add_argument('--seed', type=int, default=1, help='of the draw [1]')
    parser.add_argument('--tests', nargs='+', help='in place of the tests of the room')
    parser.add_argument('--timeout', type=float, default=300.0, help='processor time of one, s')
    given = parser.parse_args()
    if 'MUTANTS' not in os.environ:
        with tempfile.TemporaryDirectory(prefix='mutants_') as folder:
            for name in FOLDERS:
                # With compiled kernels
                left_out = shutil.ignore_patterns('_build')
                shutil.copytree(ROOT / name, Path(folder, name), ignore=left_out)
            for path in filter(Path.is_file, ROOT.iterdir()):
                shutil.copy(path, folder)
            plain = Path(folder, 'plain')
            plain.mkdir()
            (plain / 'sitecustomize.py').write_text(PLAIN)
            counts = []
            for kind, path in (('compiled', folder), ('plain', f'{folder}{os.pathsep}{plain}')):
                environment = {**os.environ, 'PYTHONPATH': path, 'MUTANTS': kind}
                environment.pop('_ROS_WHEELS_BOOTSTRAP_COMPLETE', None)
                words = [sys.executable, f'{folder}/test/mutants.py', *sys.argv[1:]]
                subprocess.run(words, cwd=folder, env=environment, check=True)
                counts.append(json.loads(Path(folder, 'counts.json').read_text()))
            noticed, tried, places = zip(*counts, strict=True)
            print(f'{given.room}: {sum(noticed)} of {sum(tried)} are noticed ({places[0]} places)')
            return 0
    tests = given.tests or [f'test/{given.room}']
    mutants, places = drawn(ROOT / 'impact_damper_ros' / given.room, given.count, given.seed)
    plain = os.environ['MUTANTS'] == 'plain'
    mutants = [mutant for mutant in mutants if alters_kernel(mutant) is plain]
    course = Course(ROOT, mutants, tests, given.timeout)
    options = ['-q', '-s', '-p', 'no:cacheprovider', '--basetemp', str(ROOT / 'scratch')]
    if mutants:
        pytest.main([*options, *tests], plugins=[course])
    counts = [course.noticed, len(mutants), places]
    (ROOT / 'counts.json').write_text(json.dumps(counts))
    return 0


if __name__ == '__main__':
    sys.exit(main())
