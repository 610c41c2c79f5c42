"""The public surface: every name that the package offers is there and documented."""

from importlib import import_module

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
