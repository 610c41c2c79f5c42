"""The public surface: every name that the package offers is there and documented."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

import impact_damper_ros

FOLDERS = ('', '.bag', '.compare', '.replay', '.report', '.sweep')


@pytest.mark.parametrize('folder', FOLDERS)
def test_all_names_are_there_and_documented(folder):
    surface = import_module(f'impact_damper_ros{folder}')
    assert surface.__all__
    for name in surface.__all__:
        assert getattr(surface, name).__doc__, name
    with pytest.raises(AttributeError, match='no attribute'):
        _ = surface.nothing


def test_type_checkers_are_shown_the_same_names():
    """The names that are imported where types are checked are those that are found at run time."""
    tree = ast.parse(Path(impact_damper_ros.__file__).read_text(encoding='utf-8'))
    shown = {
        alias.asname: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level == 1
        for alias in node.names
    }
    assert shown == impact_damper_ros._HOME
