"""Programs that run beside a test, as processes of their own."""

import itertools
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import impact_damper_ros

#: The folder of the package.
SOURCE = Path(impact_damper_ros.__file__).parents[1]
#: Longer than anything takes on a machine with much else to do; it only ends what hangs, s.
DEADLINE_S = 400.0

_numbers = itertools.count(1)


def until(condition, what='nothing happened', deadline=DEADLINE_S, pause=0.005):
    """Wait for a condition, looked at after pauses, and return its value."""
    end = time.monotonic() + deadline
    while not (value := condition()):
        assert time.monotonic() < end, what() if callable(what) else what
        time.sleep(pause)
    return value


def alive(pid):
    """Return whether a process runs."""
    try:
        return ') Z' not in Path(f'/proc/{pid}/stat').read_text()
    except (FileNotFoundError, ProcessLookupError):
        return False


class Running:
    """
    A program that runs, until it ends or, at the latest, the `with` block.

    Parameters
    ----------
    directory : Path
        Where it runs, and where files keep what it prints.
    *command : object
        Program and arguments; it has no input. Those of Python begin with an option, as
        `-m module` or `-c text`.
    errors : bool, optional
        Whether what it writes to its standard error is kept apart, in `errors`.
    path : sequence of Path, optional
        Where Python looks for modules, before the folder of the package.
    environment : dict, optional
        In place of the present one.
    """

    def __init__(self, directory, *command, errors=False, path=(), environment=None):
        words = [str(word) for word in command]
        if words[0].startswith('-'):
            words.insert(0, sys.executable)
        if environment is None:
            before = os.environ.get('PYTHONPATH')
            search = os.pathsep.join(map(str, filter(None, [*path, SOURCE, before])))
            environment = {**os.environ, 'PYTHONPATH': search}
        number = next(_numbers)
        self._output = directory / f'output_{number}.txt'
        self._errors = directory / f'errors_{number}.txt' if errors else self._output
        with self._output.open('ab') as output, self._errors.open('ab') as error_output:
            self._process = subprocess.Popen(
                words,
                cwd=directory,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=error_output,
            )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.kill()

    @property
    def pid(self):
        return self._process.pid

    @property
    def output(self):
        """What it has printed."""
        return self._output.read_text()

    @property
    def errors(self):
        """What it has printed to its standard error."""
        return self._errors.read_text()

    @property
    def code(self):
        """Its exit code; None while it runs."""
        return self._process.poll()

    def running(self):
        return self.code is None

    def until(self, condition):
        """Wait for a condition, while the program runs, and return its value."""

        def holds():
            value = condition()
            assert value or self.running(), self.output
            return value

        return until(holds, lambda: self.output)

    def send(self, number):
        self._process.send_signal(number)

    def wait(self):
        """Wait until it ends; return the exit code."""
        try:
            return self._process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self.kill()
            raise

    def stop(self, number=signal.SIGINT):
        """End it with a signal; return the exit code."""
        self.send(number)
        return self.wait()

    def kill(self):
        self._process.kill()
        self._process.wait()
