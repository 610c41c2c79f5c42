"""
A page of the documentation as its reader works through it, block by block, in one directory.

A ``python`` or ``yaml`` block that begins with the name of a file as a comment is saved under that
name; other ``python`` blocks share one namespace. ``bash`` blocks run in bash, but for those that
are only commands of this package; a node or page goes on in the background. A ``text`` block is
what the block before it prints: '...' stands for anything, and numbers agree to one unit of their
last digit.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import signal
import subprocess
import sys
from importlib import import_module

from running import DEADLINE_S, Running
from setup_file import COMMANDS, ROOT

MARK = '<!-- test/docs/test_tutorials.py works through this page from top to bottom -->'
#: The pages that are worked through.
PAGES = [
    page
    for page in sorted((ROOT / 'docs').rglob('*.md'))
    if MARK in page.read_text(encoding='utf-8')
]
#: What goes on in the background, with what it prints once it has started.
LIVE = {'sim_node': 'real time', 'rig_page': 'the page is at'}
#: Of others: ROS 2 as installed, and the set-up.
FOREIGN = ('make', 'pip', 'ros2', 'source')
#: A node's clock runs ahead of the reader's, who also waits for plain Python.
_FASTER = 'real_time_factor'
_LONG = {
    'Rig(rig), cycles=22_000': 'Rig(rig, compiled=None), cycles=22_000',
    'control, law=law)': 'control, law=law, compiled=not law and None)',
}
#: Less of the same: points of a curve, with those that the page prints among them; the part of a
#: record that suffices to refuse a wrong mass; a design at one level, which chooses the same gap.
_LESS = {
    '7.6Hz:12.4Hz:25': '7.6Hz:12.4Hz:7',
    '--set damper_mass=0.06': '--set damper_mass=0.06 --to 4s',
    '--fitted fit.json': '--fitted fit.json --levels 1:1',
}

_FENCE = re.compile(r'^```(python|yaml|bash|text)\n(.*?)^```$', re.DOTALL | re.MULTILINE)
#: What only a shell understands.
_SHELL = re.compile(r'[|;&<>$]')
_NUMBER = re.compile(r'-?\d+(?:\.\d+)?(?:e[-+]?\d+)?')


def differences(shown, printed):
    """Return the lines of a page that are not those printed."""
    lines = printed.splitlines()
    found = []
    for line in shown.splitlines():
        if line.strip() == '...':
            continue
        while lines and not agrees(line, lines[0]):
            found.append(f'printed, not shown: {lines.pop(0)!r}')
        if not lines:
            return [*found, f'shown, not printed: {line!r}']
        lines.pop(0)
    return [] if '...' in shown.splitlines() else found


def agrees(line, printed):
    """Return whether a line of a page is the one printed."""
    words = [re.escape(part).replace(r'\.\.\.', '.*') for part in _NUMBER.split(line)]
    # Columns may move with the length of a number.
    pattern = re.sub(r'(\\ )+', r'\\s+', f'({_NUMBER.pattern})'.join(words))
    match = re.fullmatch(pattern.rstrip(), printed.rstrip())
    if match is None:
        return False
    pairs = zip(_NUMBER.findall(line), match.groups(), strict=True)
    return all(abs(float(one) - float(other)) <= 1.001 * last_digit(one) for one, other in pairs)


def last_digit(number):
    """Return the unit of the last digit of a printed number; 0 of a whole one."""
    mantissa, _, exponent = number.partition('e')
    decimals = len(mantissa.partition('.')[2])
    return 10.0 ** (int(exponent or 0) - decimals) if decimals or exponent else 0.0


class Reader:
    """One who follows a page, in a directory."""

    def __init__(self, page, place):
        self.page = page
        self.place = place
        self.names = {'__name__': '__main__'}
        self.printed = ''
        self.live = []
        # What a reader has in the checkout
        (place / 'examples').symlink_to(ROOT / 'examples')
        tools = place / 'bin'
        tools.mkdir()
        for name in COMMANDS:
            self._tool(tools / name, f'-m impact_damper_ros.cli.{name}')
        self._tool(tools / 'python', '')
        self.environment = {
            **os.environ,
            'MPLBACKEND': 'agg',
            'PATH': f'{tools}:{os.environ["PATH"]}',
            'PYTHONPATH': os.pathsep.join(filter(None, [str(ROOT), os.environ.get('PYTHONPATH')])),
        }

    def _tool(self, path, arguments):
        path.write_text(f'#!/bin/sh\nexec {sys.executable} {arguments} "$@"\n')
        path.chmod(0o755)

    def read(self):
        """Do all that the page says; raise an AssertionError where it is not so."""
        path = sys.path.copy()
        try:
            for language, text in _FENCE.findall(self.page.read_text(encoding='utf-8')):
                getattr(self, f'_{language}')(text)
        finally:
            # Modules of the page are not for other tests.
            sys.path[:] = path
            for name, module in list(sys.modules.items()):
                if str(getattr(module, '__file__', '')).startswith(f'{self.place}{os.sep}'):
                    del sys.modules[name]
            for process in self.live:
                process.send(signal.SIGINT)
            for process in self.live:
                process.wait()

    def _saved(self, text):
        name = re.match(r'# (\w+\.\w+)\n', text)
        if name:
            (self.place / name[1]).write_text(text, encoding='utf-8')
        return name

    def _yaml(self, text):
        assert self._saved(text), text

    def _python(self, text):
        if self._saved(text):
            return
        printed = io.StringIO()
        for plain, compiled in _LONG.items():
            text = text.replace(plain, compiled)
        with contextlib.chdir(self.place), contextlib.redirect_stdout(printed):
            exec(compile(text, str(self.page), 'exec'), self.names)
        self.printed = printed.getvalue()

    def _bash(self, text):
        lines, text = [], text.replace('\\\n', ' ')
        for longer, shorter in _LESS.items():
            text = text.replace(longer, shorter)
        for line in text.splitlines():
            words = shlex.split(line, comments=True)
            if words and words[0] in LIVE:
                self._start(words)
            elif words and words[0] not in FOREIGN:
                lines.append(line)
        commands = [shlex.split(line, comments=True) for line in lines]
        if all(words[0] in COMMANDS for words in commands) and not _SHELL.search(''.join(lines)):
            self.printed = ''.join(map(self._command, commands))
        else:
            self._shell(lines)

    def _command(self, words):
        """Return what a command prints; it runs in this process, which has all loaded."""
        name, *words = words
        printed = io.TextIOWrapper(io.BytesIO(), encoding='utf-8', write_through=True)
        words += ['--jobs', '1'] if name == 'sweep_rig' else []
        with (
            contextlib.chdir(self.place),
            contextlib.redirect_stdout(printed),
            contextlib.redirect_stderr(printed),
        ):
            code = import_module(f'impact_damper_ros.cli.{name}').main(words)
        text = printed.buffer.getvalue().decode()
        assert code == 0, text
        return text

    def _shell(self, lines):
        done = subprocess.run(
            ['bash', '-e', '-c', '\n'.join(lines)],
            cwd=self.place,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=DEADLINE_S,
            check=False,
        )
        assert done.returncode == 0, done.stdout
        self.printed = done.stdout

    def _start(self, words):
        words += ['--port', '0'] if words[0] == 'rig_page' else ['-p', f'{_FASTER}:=3.0']
        program = self.place / 'bin' / words[0]
        process = Running(self.place, program, *words[1:], environment=self.environment)
        self.live.append(process)
        process.until(lambda: LIVE[words[0]] in process.output)
        if words[0] == 'rig_page':
            # No block of a page uses it; while it is live, it takes time from those
            process.send(signal.SIGINT)

    def _text(self, shown):
        found = differences(shown, self.printed)
        assert not found, '\n'.join([*found, 'all that was printed:', self.printed])


def pictures(page):
    """Return the names of the pictures that a page makes and shows."""
    text = page.read_text(encoding='utf-8')
    made = set(re.findall(r"savefig\('([\w.]+)'", text))
    made |= set(re.findall(r'--figure ([\w.]+\.png)', text))
    return sorted(name for name in made if f']({name})' in text)
