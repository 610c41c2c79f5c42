"""The examples of docstrings run, and print what they show."""

import doctest
from importlib import import_module
from pathlib import Path

import pytest

import impact_damper_ros

PACKAGE = Path(impact_damper_ros.__file__).parent
MODULES = [
    '.'.join(('impact_damper_ros', *path.relative_to(PACKAGE).with_suffix('').parts))
    for path in sorted(PACKAGE.rglob('*.py'))
    if '    >>> ' in path.read_text(encoding='utf-8')
]


@pytest.mark.parametrize('module', MODULES)
def test_examples(module, tmp_path, monkeypatch):
    for extra in ('numba', 'pandas'):
        pytest.importorskip(extra)
    monkeypatch.chdir(tmp_path)
    result = doctest.testmod(import_module(module))
    assert result.failed == 0
    assert result.attempted > 0
