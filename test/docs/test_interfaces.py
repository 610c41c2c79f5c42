"""Interfaces change with a line in the changelog, since other programs rely on them."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NOW = ROOT / 'docs' / 'reference' / 'interfaces.json'
CHANGELOG = (ROOT / 'CHANGELOG.rst').read_text(encoding='utf-8')
#: As the museums have it of versions that are released, with a date
KEPT = [
    path
    for path in sorted((ROOT / 'test' / 'museum').glob('*/interfaces.json'))
    if re.search(rf'^{re.escape(path.parent.name)}\.\d+ \(', CHANGELOG, re.MULTILINE)
]


def changed(kept, now, path=()):
    """Yield the names of what is new, gone, or another."""
    if isinstance(kept, dict) and isinstance(now, dict):
        for name in {**kept, **now}:
            if name in kept and name in now:
                yield from changed(kept[name], now[name], (*path, name))
            else:
                yield (*path, name)
    elif kept != now:
        yield path


def named(path, text):
    """Return whether a text names what has changed: the innermost name that is one of a user."""
    *_, name = (part for part in path if part not in ATTRIBUTES)
    return all(f'``{one}``' in text for one in name.split(', ')[-1:])


#: Of a parameter, topic or option
ATTRIBUTES = (
    *('kind', 'unit', 'low', 'high', 'least', 'default', 'choices', 'effect'),
    *('type', 'reliability', 'durability', 'frame_id', 'metavar', 'count', 'required'),
    *('arguments', 'options', 'exit codes'),
)


@pytest.mark.skipif(not KEPT, reason='no version is released')
def test_each_change_has_a_line():
    kept, now = (json.loads(path.read_text(encoding='utf-8')) for path in (KEPT[-1], NOW))
    missing = [' / '.join(path) for path in changed(kept, now) if not named(path, CHANGELOG)]
    assert missing == [], 'name each in double backquotes under Forthcoming in CHANGELOG.rst'


@pytest.mark.parametrize(
    ('path', 'line', 'is_named'),
    [
        (('parameters', 'node', 'gap', 'high'), 'The range of ``gap`` ends at 2 m.', True),
        (('parameters', 'node', 'gap', 'high'), 'Gaps may be 2 m wide.', False),
        (('commands', 'sweep_rig', 'options', '-o, --output'), '``--output`` is gone.', True),
        (('commands', 'fit_rig', 'exit codes'), '``fit_rig`` may end with 3.', True),
        (('json', 'fit_rig', 'rig', 'gap'), '``rig_gap`` is new', False),
    ],
)
def test_a_line_names_what_has_changed(path, line, is_named):
    assert named(path, line) is is_named


def test_all_kinds_of_changes_are_found():
    kept = {'a': {'low': 1.0, 'gone': {}}, 'same': [1]}
    now = {'a': {'low': 2.0, 'new': {}}, 'same': [1]}
    assert {*changed(kept, now)} == {('a', 'low'), ('a', 'gone'), ('a', 'new')}
