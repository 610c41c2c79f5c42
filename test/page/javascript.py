"""Node, which runs a script once and then calls what that has, as a console."""

import json
import shutil
import subprocess

import pytest

#: Answers an expression, a text of JSON in a line, with its value in a line.
_CONSOLE = """
const { createInterface } = require('node:readline');
const { readFileSync } = require('node:fs');
const strange = (x) => typeof x === 'bigint' || (typeof x === 'number' && !Number.isFinite(x));
const shown = (_, x) => (strange(x) ? { number: String(x) } : x);
(0, eval)(readFileSync(process.argv[1], 'utf8'));
createInterface({ input: process.stdin }).on('line', (line) => {
  let answer;
  try {
    answer = [true, (0, eval)(JSON.parse(line))];
  } catch (error) {
    answer = [false, error.stack];
  }
  console.log(JSON.stringify(answer, shown));
});
"""


def _number(entry):
    """Return a number that JSON has not."""
    text = entry.get('number')
    if not isinstance(text, str):
        return entry
    return int(text) if text.lstrip('-').isdigit() else float(text)


class JavaScript:
    """A process of Node; without Node the test is skipped."""

    def __init__(self, path):
        node = shutil.which('node')
        if node is None:
            pytest.skip('Node is not installed (Debian: apt install nodejs)')
        words = [node, '-e', _CONSOLE, str(path)]
        self._process = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )

    def evaluate(self, script, given=None):
        """Return the value of an expression, or of a function for what is given."""
        # As JavaScript reads numbers, NaN too
        text = script if given is None else f'({script})({json.dumps(given)})'
        print(json.dumps(text), file=self._process.stdin, flush=True)
        done, value = json.loads(self._process.stdout.readline(), object_hook=_number)
        assert done, value
        return value

    def close(self):
        """End it."""
        self._process.communicate()
