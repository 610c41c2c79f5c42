"""The public surface: every name is there and documented; test/docs runs the examples."""

from importlib import import_module

import pytest

from impact_damper_ros import RigParameters, best_design, find_orbits, follow

FOLDERS = ('', '.bag', '.compare', '.replay', '.report', '.sweep')
LEVEL = RigParameters(gravity=0.0)


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
        if callable(thing) and '>>>' not in (thing.__doc__ or '')
    ] == []


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
