"""The public surface: every name is there and documented, and its examples run."""

import doctest
from importlib import import_module
from inspect import isfunction

import pytest

from impact_damper_ros import RigParameters, best_design, find_orbits, follow

FOLDERS = ('', '.bag', '.compare', '.replay', '.report', '.sweep')
LEVEL = RigParameters(gravity=0.0)


def docstrings(thing):
    """Return the docstrings of a function, or of a class and its members."""
    members = vars(thing).values() if isinstance(thing, type) else ()
    written = [one for one in members if isfunction(one) or isinstance(one, property)]
    return [one.__doc__ or '' for one in (thing, *written)]


NAMES = sorted(
    {
        (thing.__module__, thing.__name__)
        for folder in FOLDERS
        for surface in [import_module(f'impact_damper_ros{folder}')]
        for name in surface.__all__
        for thing in [getattr(surface, name)]
        if callable(thing) and any('>>>' in text for text in docstrings(thing))
    }
)


@pytest.mark.parametrize('folder', FOLDERS)
def test_all_names_are_there_and_documented(folder):
    surface = import_module(f'impact_damper_ros{folder}')
    assert surface.__all__
    for name in surface.__all__:
        assert getattr(surface, name).__doc__, name
    with pytest.raises(AttributeError, match='no attribute'):
        _ = surface.nothing


def test_every_public_name_has_an_example():
    surface = import_module('impact_damper_ros')
    things = {name: getattr(surface, name) for name in surface.__all__}
    assert [
        name
        for name, thing in things.items()
        if callable(thing) and not any('>>>' in text for text in docstrings(thing)[:1])
    ] == []


@pytest.mark.parametrize(('module', 'name'), NAMES)
def test_examples_of_public_names(module, name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scope = vars(import_module(module))
    texts = doctest.DocTestFinder(recurse=True).find(scope[name], name, globs=dict(scope))
    assert any(text.examples for text in texts)
    for text in texts:
        assert doctest.DocTestRunner(optionflags=doctest.ELLIPSIS).run(text).failed == 0


def test_motions_are_iterated_indexed_and_put_into_a_table():
    search = find_orbits(LEVEL, (1, 2))
    assert list(search) == list(search.orbits)
    assert (len(search), search[0]) == (2, search.orbits[0])
    branch = follow(search[0], 'gap', 30.0, 40.0)
    assert branch.at('35 m') == branch.at(35.0) == branch.at([35.0])[0]
    table = branch.to_frame()
    assert tuple(table['gap']) == branch.values
    assert list(table['x_max']) == [orbit.x_max for orbit in branch.orbits]
    assert list(filter(None, table['special'])) == [one.kind.value for one in branch.special]


@pytest.mark.parametrize(
    ('call', 'words'),
    [
        (
            lambda: find_orbits('bench_rig', (1, 2)),
            "parameters is 'bench_rig': give RigParameters",
        ),
        (lambda: best_design(None), 'rig is None: give RigParameters'),
        (lambda: find_orbits(LEVEL, 2), 'stop sequence 2: give the stops hit in one period'),
        (lambda: find_orbits(LEVEL, ([1], 2)), r'stop sequence .*: give the stops hit'),
    ],
)
def test_wrong_arguments(call, words):
    with pytest.raises((TypeError, ValueError), match=words):
        call()
