"""The public surface: every name that the package offers is there and documented."""

import ast
from importlib import import_module
from pathlib import Path

import pytest

FOLDERS = ('', '.bag', '.compare', '.replay', '.report', '.sweep')


@pytest.mark.parametrize('folder', FOLDERS)
def test_all_names_are_there_and_documented(folder):
    surface = import_module(f'impact_damper_ros{folder}')
    assert surface.__all__
    for name in surface.__all__:
        assert getattr(surface, name).__doc__, name
    with pytest.raises(AttributeError, match='no attribute'):
        _ = surface.nothing


@pytest.mark.parametrize('folder', FOLDERS[:-1])
def test_type_checkers_are_shown_the_same_names(folder):
    """The names that are imported where types are checked are those that are found at run time."""
    surface = import_module(f'impact_damper_ros{folder}')
    tree = ast.parse(Path(surface.__file__).read_text(encoding='utf-8'))
    shown = {
        alias.asname: node.module
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.module != 'lazy_names'
        for alias in node.names
        if alias.asname
    }
    assert sorted(shown) == sorted({*surface.__all__} - {'__version__'})
    for name, module in shown.items():
        home = import_module(f'{surface.__name__}.{module}')
        assert getattr(surface, name) is getattr(home, name)
