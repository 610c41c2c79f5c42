"""The command, run as users run it: from a parameters file, with files and exit codes."""

import csv
import json
import math
import re
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros import find_orbits, load_parameters
from impact_damper_ros.cli import command_line
from impact_damper_ros.cli.solve_periodic import main

ROOT = Path(impact_damper_ros.__file__).parents[1]
PAPER = ROOT / 'config' / 'paper.yaml'
INCLINED = ('angle=0.7853981633974483', 'gravity=1', 'force_frequencies=[1.02]')


def run(tmp_path, *arguments, settings=(), params=PAPER):
    """Run the command in this process; return exit code and motions."""
    path = tmp_path / 'orbits.json'
    overrides = [word for setting in settings for word in ('--set', setting)]
    code = main([str(params), '--json', str(path), *arguments, *overrides])
    return code, json.loads(path.read_text()) if path.exists() else None


def test_file_is_what_the_library_finds(tmp_path):
    code, orbits = run(tmp_path, '--impacts', '2', settings=(*INCLINED, 'friction=0.5'))
    rig = load_parameters(PAPER)[0].replace(
        angle=0.7853981633974483, gravity=1.0, force_frequencies=1.02, friction=0.5
    )
    assert code == 0
    assert orbits == [orbit.as_dict() for orbit in find_orbits(rig, (1, 2)).orbits]
    assert set(orbits[0]) >= {
        *('stops', 'cycles', 'phases', 'x', 'primary_velocity_after', 'damper_velocity_after'),
        *('x_max', 'multipliers', 'stable', 'viable', 'reason', 'residual', 'residual_history'),
    }
    assert math.hypot(*orbits[0]['multipliers'][0]) == pytest.approx(0.94107, abs=0.51e-5)
    assert 'from beyond it' in orbits[1]['reason']


def test_all_sequences_if_none_is_named(tmp_path, capsys):
    settings = ('gap=8', 'force_frequencies=[1.02]')
    code, orbits = run(tmp_path, '--impacts', '4', '--cycles', '1', settings=settings)
    assert code == 0
    assert orbits[0]['stops'] == [1, 1, 2, 2]
    assert orbits[0]['stable']
    assert orbits[0]['viable']
    assert {tuple(orbit['stops']) for orbit in orbits} == {
        (1, 1, 2, 2),
        (1, 1, 1, 2),
        (1, 2, 2, 2),
    }
    output = capsys.readouterr().out
    led = 'to motions of other stops or fewer impacts'
    assert f'stops 1,2,1,2: 0 found; 15 of 615 starts converged, {led}' in output
    assert f'starts converged, to these, or {led}' in output


def test_ranges_of_impacts_and_cycles(tmp_path, capsys):
    """Those of the single numbers, the viable ones alone; no period that the force has not."""
    settings = ('gap=18', 'force_frequencies=[1.02]')
    single = []
    for impacts in ('2', '3'):
        single += run(tmp_path, '--impacts', impacts, settings=settings)[1]
    capsys.readouterr()
    ranges = ('--impacts', '2:3', '--cycles', '1:1', '--viable')
    code, orbits = run(tmp_path, *ranges, settings=settings)
    assert code == 0
    viable = [one for one in single if one['viable']]
    assert orbits == sorted(viable, key=lambda one: not one['stable'])
    assert [tuple(one['stops']) for one in orbits] == [(1, 1, 2), (1, 2, 2), (1, 2)]
    said = capsys.readouterr().out
    assert re.search(
        r'^2 impacts in 1 cycle: 1 viable, \d+ not, all solutions$', said, re.MULTILINE
    )
    assert re.search(r'^3 impacts in 1 cycle: 2 viable, \d+ not$', said, re.MULTILINE)
    assert 'NOT VIABLE' not in said
    several = ('force_amplitudes=[1, 0.1]', 'force_frequencies=[1, 1.5]', 'force_phases=[0, 0]')
    run(tmp_path, '--impacts', '2:3', '--cycles', '1:2', settings=several)
    assert (
        re.findall(r'^\d impacts in (\d cycles?):', capsys.readouterr().out, re.MULTILINE)
        == ['2 cycles'] * 2
    )


def test_viable_motions_include_the_settled_one(tmp_path, capsys):
    """It has more impacts than were asked for; without it there was none."""
    settings = ('angle=30 deg', 'friction=0.3')
    ranges = ('--impacts', '1:2', '--viable')
    code, orbits = run(tmp_path, *ranges, settings=settings, params='bench_rig')
    assert code == 0
    (orbit,) = orbits
    assert orbit['stops'] == [1] * 21
    assert (orbit['stable'], orbit['cycles']) == (True, 1)
    assert 'rest' in {node['kind'] for node in orbit['nodes']}
    said = capsys.readouterr().out
    assert '21 impacts in 1 cycle, added to the list' in said
    assert 'the search ends at 2 impacts and 1 cycle: ' in said
    # One that is known is not listed twice, and one that is named is alone
    assert len(run(tmp_path, *ranges, settings=('gravity=0',))[1]) == 1
    assert 'added' not in capsys.readouterr().out
    named = ('--impacts', '2', '--stops', '1,2', '--viable')
    assert run(tmp_path, *named, params='bench_rig', settings=settings) == (4, [])


def test_table_has_units_and_numbers(capsys):
    code = main([str(PAPER), '--impacts', '2', '--set', 'gravity=0'])
    assert code == 0
    output = capsys.readouterr().out
    assert 'stops 1,2: all solutions, 2 found' in output
    assert 'phase [cycles]' in output
    assert '0.733783806     9.9293552   -3.4542642   -1.9339743' in output
    assert 'largest |X|  10.4644051 m, 0.1046441 of the 100 m without impacts' in output
    assert 'multipliers  0.949520 (pair at +-9.34 deg), 0.574083 (pair at +-41.02 deg)' in output
    assert 'NOT VIABLE' in output
    assert max(len(line) for line in output.splitlines() if 'not viable' not in line) <= 99


@pytest.mark.parametrize(('frequency', 'gap'), [(1.5, 37), (0.5, 20)])
def test_motions_of_a_rig_without_losses_are_neutral(tmp_path, capsys, frequency, gap):
    """Their multipliers are on the unit circle; round-off once decided whether they are stable."""
    lossless = ('gravity=0', 'damping=0', 'restitution_1=1', 'restitution_2=1', f'gap={gap}')
    settings = (*lossless, f'force_frequencies=[{frequency}]')
    code, orbits = run(tmp_path, '--impacts', '2', settings=settings)
    assert code == 0
    on_circle = [o for o in orbits if abs(math.hypot(*o['multipliers'][0]) - 1.0) < 1e-6]
    assert on_circle
    assert all((orbit['neutral'], orbit['stable']) == (True, False) for orbit in on_circle)
    assert not any(orbit['neutral'] for orbit in orbits if orbit not in on_circle)
    output = capsys.readouterr().out
    assert output.count(' s), neutral, viable') == len(on_circle)
    assert ' s), stable' not in output


def test_json_to_stdout_keeps_the_table_apart(capsys):
    assert main([str(PAPER), '--impacts', '2', '--json', '-']) == 0
    captured = capsys.readouterr()
    assert len(json.loads(captured.out)) == 2
    assert 'all solutions' in captured.err


def test_quiet(capsys):
    assert main([str(PAPER), '--impacts', '2', '--quiet']) == 0
    assert capsys.readouterr() == ('', '')


def test_no_solution(tmp_path, capsys):
    code, orbits = run(tmp_path, '--impacts', '1')
    assert code == 3
    assert orbits == []
    assert 'no periodic motion with 1 impact in 1 cycle' in capsys.readouterr().err


def test_not_viable(tmp_path, capsys):
    code, orbits = run(tmp_path, '--impacts', '2', '--cycles', '3')
    assert code == 4
    assert orbits
    assert not any(orbit['viable'] for orbit in orbits)
    message = capsys.readouterr().err
    assert 'none of the 12 solutions' in message
    assert 'm would pass stop' in message


VERTICAL = {
    'damping': 0.1,
    'damper_mass': 0.01,
    'angle': 1.5707963267948966,
    'gravity': 1,
    'one_sided': 'true',
    'force_amplitudes': [0.9],
    'force_frequencies': [10.0],
}


@pytest.mark.parametrize(('angle', 'stop'), [(0.5 * math.pi, 1), (-0.5 * math.pi, 2)])
@pytest.mark.parametrize(('cycles', 'force', 'impacts'), [(1, 0.8, 1), (2, 1.2, 2)])
def test_motions_on_one_of_two_stops(tmp_path, angle, stop, cycles, force, impacts):
    """The last rig of the paper with a second stop out of reach, either way up."""
    one_sided = {**VERTICAL, 'force_amplitudes': [force]}
    two_sided = {**one_sided, 'angle': angle, 'one_sided': 'false', 'gap': 2}
    counts = ('--impacts', str(impacts), '--cycles', str(cycles))
    (_, expected), (code, orbits) = (
        run(tmp_path, *counts, settings=[f'{name}={value}' for name, value in rig.items()])
        for rig in (one_sided, two_sided)
    )
    assert code == 0
    assert orbits[0]['stops'] == [stop] * impacts
    assert orbits[0]['stable']
    assert orbits[0]['viable']
    assert orbits[0]['x_max'] == pytest.approx(expected[0]['x_max'], rel=1e-12)


def test_first_motion_is_followed_through_its_special_points(tmp_path, capsys):
    words = [word for item in VERTICAL.items() for word in ('--set', '{}={}'.format(*item))]
    table, figure = tmp_path / 'branch.csv', tmp_path / 'branch.png'
    outputs = ('--csv', str(table), '--figure', str(figure))
    asked = ('--impacts', '1', '--follow', 'force_amplitudes=0.3:1.2')
    assert main([str(PAPER), *asked, *outputs, *words]) == 0
    text = capsys.readouterr().out
    assert 'motion 1, force_amplitudes varied:' in text
    doubling = re.search(r'^  period doubling at force_amplitudes = (\S+)$', text, re.MULTILINE)
    fold = re.search(r'^  fold at force_amplitudes = (\S+)$', text, re.MULTILINE)
    branch = text.split('branch from the period doubling at')[1]
    assert branch.split()[2].rstrip(',') == doubling[1]
    assert re.search(r'\d+ motions, largest \|X\| between', branch)
    assert f'at force_amplitudes = {fold[1]} (fold)' in text
    # The table has every motion of both branches, and the special points among them
    with table.open() as lines:
        rows = list(csv.DictReader(lines))
    special = [(row['special'], float(row['force_amplitudes'])) for row in rows if row['special']]
    assert special[:2] == [
        ('fold', pytest.approx(float(fold[1]), rel=1e-8)),
        ('period doubling', pytest.approx(float(doubling[1]), rel=1e-8)),
    ]
    assert {row['stops'] for row in rows} == {'1', '1 1'}
    for row in rows[:: len(rows) // 7]:
        value = float(row['force_amplitudes'])
        rig = load_parameters(PAPER)[0].replace(
            damping=0.1, damper_mass=0.01, angle=0.5 * math.pi, gravity=1.0, one_sided=True,
            force_amplitudes=value, force_frequencies=10.0,
        )  # fmt: skip
        stops = tuple(map(int, row['stops'].split()))
        orbits = find_orbits(rig, stops, len(stops), simulate=False).orbits
        nearest = min(orbits, key=lambda orbit: abs(orbit.x_max - float(row['x_max'])))
        assert float(row['x_max']) == pytest.approx(nearest.x_max, rel=1e-6)
        assert (row['stable'], row['viable']) == (str(int(nearest.stable)), '1')
    assert figure.read_bytes().startswith(b'\x89PNG')


def test_the_settled_motion_gives_period_and_stops(tmp_path, capsys):
    """Eight impacts in two cycles, the last of them before a rest: too many to try all stops."""
    settings = (
        *('gravity=1', 'friction=0.1', 'angle=0.98', 'gap=31.31', 'damper_mass=0.1'),
        *('restitution_1=0.16', 'restitution_2=0.33', 'force_frequencies=[0.89]', 'damping=0.09'),
    )
    code, orbits = run(tmp_path, '--settled', settings=settings)
    assert code == 0
    (orbit,) = orbits
    assert (len(orbit['stops']), orbit['stable'], orbit['viable']) == (8, True, True)
    assert re.search(
        r'^after \d+ cycles of the force the rig repeats to within \S+e-\d+: '
        r'8 impacts in 2 cycles$',
        capsys.readouterr().out,
        re.MULTILINE,
    )
    assert orbit['residual'] < 1e-12
    # From rest the paper's rig settles into the motion that the search lists first
    _, settled = run(tmp_path, '--settled', settings=('gravity=0',))
    _, listed = run(tmp_path, '--impacts', '2', settings=('gravity=0',))
    assert settled[0]['phases'] == pytest.approx(listed[0]['phases'], abs=1e-12)


def test_a_rig_that_does_not_settle(tmp_path, capsys):
    settings = ('gravity=0', 'gap=5', 'force_frequencies=[1.02]')
    code, orbits = run(tmp_path, '--settled', settings=settings)
    assert (code, orbits) == (3, None)
    assert 'its motion is chaotic after 2000 cycles' in capsys.readouterr().err
    assert run(tmp_path, '--settled', settings=('gravity=0', 'gap=900', 'damping=0.1'))[0] == 3
    assert 'its motion is without impacts after' in capsys.readouterr().err


def test_a_long_search_says_that_it_goes_on(monkeypatch, capsys):
    """It once said nothing for minutes, as for a force of a thousandth of M's own frequency."""
    monkeypatch.setattr(command_line, 'PATIENCE', 1e-3)
    words = ['paper', '--impacts', '2', '--set', 'primary_mass=0.01', '--set', 'damping=0.01']
    assert main([*words, '--quiet']) in (0, 3, 4)
    assert 'still searching' not in capsys.readouterr().err
    # Another rig, since what was found is kept
    assert main([*words, '--set', 'gap=36']) in (0, 3, 4)
    assert (
        'solve_periodic: still searching; the time grows with the impacts, the cycles and the '
        'ratio of the natural frequency to that of the force, here 10; Ctrl-C ends the search'
    ) in capsys.readouterr().err
