"""The server of the page as a process."""

import contextlib
import functools
import re
import signal
import sys
from pathlib import Path

from running import Running

#: The command at 12 frames per second: browsers of tests draw four, and 60 take half of all the
#: processor's time.
COMMAND = """
from impact_damper_ros.cli.rig_page import main
from impact_damper_ros.page import gate, server
server._FRAMES_PER_SECOND = 12.0
"""
#: Every request comes from another machine. A test has no other one.
ELSEWHERE = """
gate.is_loopback = lambda host: False
server._Guarded._own_address = lambda handler: '192.0.2.1'
"""


class PageProcess(Running):
    """
    The server of the page.

    With `elsewhere` it takes all pages for those of another machine.
    """

    def __init__(self, directory, *arguments, elsewhere=False):
        directory.mkdir(exist_ok=True)
        self.recordings = directory / 'runs'
        program = f'{COMMAND}{ELSEWHERE if elsewhere else ""}raise SystemExit(main())'
        command = [sys.executable, '-c', program, '--recordings', self.recordings, *arguments]
        self._begin = functools.partial(super().__init__, directory, *command)
        self.again(0)

    def again(self, port=None):
        """Start it, at the port that it had before unless another one is given."""
        self._begin('--port', self.port if port is None else port)
        address = r'http://\S+:(\d+)/\S*'
        found = self.until(lambda: re.search(address, self.output))
        self.address, self.port = found[0], int(found[1])
        self.place = Path('/proc', str(self.pid))

    def children(self, module='node.sim_node'):
        """Return the numbers of the processes of a module that it has started and that run."""
        found = []
        for listed in self.place.glob('task/*/children'):
            for number in listed.read_text().split():
                with contextlib.suppress(OSError):  # it has ended meanwhile
                    if module.encode() in Path('/proc', number, 'cmdline').read_bytes():
                        found.append(int(number))
        return found

    def close(self, number=signal.SIGTERM):
        """End the process with a signal; return its exit code."""
        return self.stop(number)
