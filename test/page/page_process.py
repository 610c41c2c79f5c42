"""The server of the page as a process."""

import os
import re
import signal
import subprocess
import sys

from node.rig_client import DEADLINE_S, SOURCE, until


class PageProcess:
    """The server as a process of its own."""

    def __init__(self, directory, *arguments):
        directory.mkdir(exist_ok=True)
        self.recordings = directory / 'runs'
        self._output = directory / 'page.txt'
        path = os.pathsep.join(filter(None, [str(SOURCE), os.environ.get('PYTHONPATH')]))
        command = [sys.executable, '-m', 'impact_damper_ros.cli.rig_page', '--port', '0']
        with self._output.open('wb') as output:
            self._process = subprocess.Popen(
                [*command, '--recordings', str(self.recordings), *map(str, arguments)],
                cwd=directory,
                env={**os.environ, 'PYTHONPATH': path},
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
            )
        self.address = until(self._said, lambda: self._output.read_text())

    @property
    def said(self):
        """What it has printed."""
        return self._output.read_text()

    def children(self):
        """Return the numbers of its nodes."""
        listed = subprocess.run(
            ['ps', '--ppid', str(self._process.pid), '-o', 'pid=,args='],
            capture_output=True,
            text=True,
            check=False,
        )
        lines = listed.stdout.splitlines()
        return [int(line.split()[0]) for line in lines if 'sim_node' in line]

    def _said(self):
        assert self._process.poll() is None, self._output.read_text()
        found = re.search(r'http://\S+:\d+/\S*', self._output.read_text())
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
