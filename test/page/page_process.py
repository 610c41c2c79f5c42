"""The server of the page as a process."""

import contextlib
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

from node.rig_client import DEADLINE_S, SOURCE, until

#: The command, to which every request comes from another machine. A test has no other one.
ELSEWHERE = """
from impact_damper_ros.cli.rig_page import main
from impact_damper_ros.page import gate, server
gate.is_loopback = lambda host: False
server._Guarded._own_address = lambda handler: '192.0.2.1'
raise SystemExit(main())
"""


class PageProcess:
    """
    The server as a process of its own.

    It may have `files` open, and with `elsewhere` takes all pages for those of another machine.
    """

    def __init__(self, directory, *arguments, files=None, elsewhere=False):
        directory.mkdir(exist_ok=True)
        self.recordings = directory / 'runs'
        self._output = directory / 'page.txt'
        path = os.pathsep.join(filter(None, [str(SOURCE), os.environ.get('PYTHONPATH')]))
        program = ['-c', ELSEWHERE] if elsewhere else ['-m', 'impact_damper_ros.cli.rig_page']
        command = [sys.executable, *program, '--port', '0']
        if files is not None:
            command = ['sh', '-c', f'ulimit -n {files}; exec "$@"', 'sh', *command]
        with self._output.open('wb') as output:
            self._process = subprocess.Popen(
                [*command, '--recordings', str(self.recordings), *map(str, arguments)],
                cwd=directory,
                env={**os.environ, 'PYTHONPATH': path},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        self.address = until(self._printed_address, lambda: self.printed)
        self.port = int(re.search(r':(\d+)/', self.address)[1])
        self.place = Path('/proc', str(self._process.pid))

    @property
    def printed(self):
        """What it has printed."""
        return self._output.read_text()

    def nodes(self):
        """Return the numbers of the nodes that it has started and that run."""
        found = []
        for listed in self.place.glob('task/*/children'):
            for number in listed.read_text().split():
                with contextlib.suppress(OSError):  # it has ended meanwhile
                    if b'node.sim_node' in Path('/proc', number, 'cmdline').read_bytes():
                        found.append(int(number))
        return found

    def _printed_address(self):
        assert self._process.poll() is None, self.printed
        found = re.search(r'http://\S+:\d+/\S*', self.printed)
        return found and found[0]

    def close(self, number=signal.SIGTERM):
        """End the process with a signal; return its exit code."""
        self._process.send_signal(number)
        try:
            return self._process.wait(DEADLINE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
            raise
