"""What `.ci/run` makes of tests that fail, in a folder of its own."""

import os
import re
import shutil
import signal

import pytest
from running import SOURCE, Running

pytest.importorskip('xdist', reason='pytest-xdist runs the tests side by side')
ONCE = """
from pathlib import Path

import pytest

def fails_once(name):
    there = Path(__file__).with_name(name)
    before = there.exists()
    there.touch()
    assert before, name

@pytest.fixture
def begun():
    fails_once('begun')

@pytest.fixture
def ended():
    yield
    fails_once('ended')

def test_nothing():
    pass

def test_call():
    fails_once('called')

def test_before(begun):
    pass

def test_after(ended):
    pass
"""
CRASH = """
def test_crash():
    import os

    try:
        fails_once('crashed')
    except AssertionError:
        os.abort()
"""
ALWAYS = """
@pytest.mark.parametrize('number', range({count}))
def test_always(number):
    assert number < 0, 'too much'
"""
LASTS = """
def test_lasts():
    import time

    Path(__file__).with_name('lasts').touch()
    time.sleep(1000.0)
"""
ALONE = {'test_call', 'test_before', 'test_after'}


@pytest.fixture
def tested(tmp_path):
    """Return a function that runs tests as `.ci/run` does, until they end."""
    shutil.copy(SOURCE / 'test' / 'run_alone.py', tmp_path / 'conftest.py')
    (tmp_path / 'pytest.ini').write_text('[pytest]\naddopts = -ra -p xdist.plugin\n')
    # Each test starts processes of pytest; plugins would take most of their time.
    environment = {**os.environ, 'PYTEST_DISABLE_PLUGIN_AUTOLOAD': '1', 'PYTHONUNBUFFERED': '1'}
    (options,) = re.findall(r"ARGS='(.+)'", (SOURCE / '.ci' / 'run').read_text(encoding='utf-8'))

    def run(*tests):
        (tmp_path / 'test_some.py').write_text('\n'.join(tests))
        # All are in one file, for which one process is enough.
        words = ['pytest', *options.replace('-n 4', '-n 1').split()]
        return Running(tmp_path, '-m', *words, environment=environment)

    return run


def listed(output):
    """Return the names of the tests that failed, and of those that passed alone."""
    failed = re.findall(r'^(?:FAILED|ERROR) test_some.py::(\w+)', output, re.MULTILINE)
    alone = re.findall(
        r'^failed under load, passed alone: test_some.py::(\w+)$', output, re.MULTILINE
    )
    return set(failed), set(alone)


def last_line(output):
    return re.sub(r'^=+ | in .*s.* =+$', '', output.splitlines()[-1])


def test_failures_under_load_that_pass_alone(tested):
    with tested(ONCE, CRASH) as process:
        assert process.wait() == 0, process.output
        output = process.output
    assert listed(output) == (set(), {*ALONE, 'test_crash'})
    assert last_line(output) == '6 passed, 4 rerun'
    # The first failure of each
    for words in ('AssertionError: called', 'begun', 'ended', "crashed while running 'test_some"):
        assert words in output.partition('= failed under load, passed alone =')[2]


def test_failure_alone_fails(tested):
    with tested(ONCE, ALWAYS.format(count=1)) as process:
        assert process.wait() == 1, process.output
        output = process.output
    assert listed(output) == ({'test_always'}, ALONE)
    assert last_line(output) == '1 failed, 4 passed, 3 rerun'


def test_many_failures_are_failures(tested):
    with tested(ONCE, ALWAYS.format(count=3)) as process:
        assert process.wait() == 1, process.output
        output = process.output
    assert listed(output) == ({*ALONE, 'test_always'}, set())
    assert 'alone' not in output
    assert last_line(output) == '4 failed, 2 passed, 2 errors'


def test_interrupted_run_shows_what_failed(tested, tmp_path):
    with tested(ONCE, LASTS) as process:
        process.until((tmp_path / 'lasts').exists)
        # Each failure so far is shown as an R in the line of progress; its report comes later.
        process.until(lambda: process.output.count('R') == len(ALONE))
        assert process.stop(signal.SIGINT) == 2, process.output
        output = process.output
    assert listed(output) == (ALONE, set()), output
    assert 'KeyboardInterrupt' in output
