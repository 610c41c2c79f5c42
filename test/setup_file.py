"""What setup.py gives to `setup()`."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parents[1]
_CALL = next(
    node
    for node in ast.walk(ast.parse((ROOT / 'setup.py').read_text(encoding='utf-8')))
    if isinstance(node, ast.Call) and node.keywords
)


def setup_says(name):
    """Return an argument of `setup()`."""
    return ast.literal_eval(next(k.value for k in _CALL.keywords if k.arg == name))


def requirements(*lists):
    """Return the names of the distributions in lists of requirements."""
    return {re.split(r'[<>=]', entry)[0].lower() for each in lists for entry in each}


#: The names of all commands.
COMMANDS = sorted(
    script.partition(' = ')[0] for script in setup_says('entry_points')['console_scripts']
)
