"""
A second run for a few tests that failed while others ran beside them.

With `--again-alone N`, up to N tests that failed run once more after all others, each in a process
of its own with no other beside it. One that fails again has failed. One that passes is counted as
passed and as run again, and is listed at the end with its first failure.
"""

import subprocess
import sys
from copy import copy

import pytest

AGAIN = 'rerun'


def pytest_addoption(parser):
    """Add what `.ci/run` asks for."""
    parser.addoption(
        '--again-alone',
        type=int,
        metavar='N',
        help='run up to N tests that failed once more, each alone, after all others',
    )


def pytest_configure(config):
    """Hold failures back where they get a second run; the processes of pytest-xdist do not."""
    if (most := config.getoption('--again-alone')) and not hasattr(config, 'workerinput'):
        config.pluginmanager.register(RunAlone(config, most))


class RunAlone:
    """Holds the failures back until it is known whether they are failures alone, too."""

    def __init__(self, config, most):
        self._config, self._most = config, most
        self._held = {}
        self._holds = True
        self._passed_alone = []

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_logreport(self, report):
        if self._holds and report.failed:
            self._held.setdefault(report.nodeid, []).append(report)
            report.outcome = AGAIN

    @pytest.hookimpl(tryfirst=True)
    def pytest_report_teststatus(self, report):
        counted = '' if self._holds else AGAIN
        return (counted, 'R', ('RERUN', {'yellow': True})) if report.outcome == AGAIN else None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtestloop(self):
        try:
            result = yield
            if len(self._held) <= self._most:
                for test in self._held:
                    if self._passes(test):
                        self._passed_alone.append(test)
        finally:
            self._holds = False
            for test, reports in self._held.items():
                if test not in self._passed_alone:
                    for report in reports:
                        self._report(report, 'failed')
                else:
                    self._report(reports[0], AGAIN)
                    if reports[0].when != 'teardown':
                        self._report(reports[0], 'passed')
        return result

    def _passes(self, test):
        print(f'\n\nonce more, alone: {test}', flush=True)
        command = [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', test]
        return subprocess.run(command, cwd=self._config.rootpath, check=False).returncode == 0

    def _report(self, report, outcome):
        report = copy(report)
        report.outcome = outcome
        report.when = 'call' if outcome == 'passed' else report.when
        self._config.hook.pytest_runtest_logreport(report=report)

    def pytest_terminal_summary(self, terminalreporter):
        if self._passed_alone:
            terminalreporter.section('failed under load, passed alone', yellow=True, bold=True)
        for test in self._passed_alone:
            for report in self._held[test]:
                terminalreporter.write_line(f'{report.longrepr}\n')
            terminalreporter.write_line(f'failed under load, passed alone: {test}', yellow=True)
