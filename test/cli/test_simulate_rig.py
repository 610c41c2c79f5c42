"""The headless command, run as users run it: as a process, with files."""

import csv
import io
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import impact_damper_ros
from impact_damper_ros import EventKind, GapControlParameters, Rig, RigParameters
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main

ROOT = Path(impact_damper_ros.__file__).parents[1]
PAPER = ROOT / 'config' / 'paper.yaml'
INCLINED = ('angle=0.7853981633974483', 'gravity=1', 'force_frequencies=[1.02]')


def table(path):
    return list(csv.DictReader(io.StringIO(path.read_text())))


def run(tmp_path, *arguments, settings=(), params=PAPER):
    """Run the command in this process; return exit code and impacts."""
    impacts = tmp_path / 'impacts.csv'
    overrides = [word for setting in settings for word in ('--set', setting)]
    code = main([str(params), '--impacts', str(impacts), *arguments, *overrides])
    rows = table(impacts) if impacts.exists() else []
    kinds = {'stop': int, 'kind': str}
    return code, [{k: kinds.get(k, float)(v) for k, v in r.items()} for r in rows]


def test_first_impacts_from_rest(tmp_path):
    code, rows = run(tmp_path, '--duration', '51', settings=['gravity=0'])
    assert code == 0
    assert [row['stop'] for row in rows] == [1, 2, 1, 2]
    expected = [43.62266009691099, 45.40718583180668, 46.77474766084761, 50.874097144989875]
    assert [row['time'] for row in rows] == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(
    'settings',
    [
        ['friction=0'],
        ['friction=0.5', 'angle=0.3'],
        ['force_amplitudes=[1.2, 0.4]', 'force_frequencies=[31.4, 70]', 'force_phases=[0, 1]'],
        ['one_sided=true', 'angle=1.2', 'air_force=0.1'],
        ['base_amplitudes=[2.0]', 'base_frequencies=[25.0]'],
    ],
)
def test_force_and_acceleration_of_the_states(tmp_path, settings):
    """By finite differences of the velocity, and by the definition of the force."""
    states, events = tmp_path / 'states.csv', tmp_path / 'events.csv'
    words = ['--duration', '1', '--rate', '4000', '--states', str(states)]
    code, _ = run(tmp_path, *words, '--events', str(events), settings=settings, params='bench_rig')
    assert code == 0
    samples = np.genfromtxt(states, delimiter=',', names=True)
    times = [float(event['time']) for event in table(events)]
    between = np.searchsorted(times, samples['time'])
    smooth = (between[:-2] == between[2:]).nonzero()[0] + 1
    assert len(smooth) > 3_500
    velocity, acceleration = samples['primary_velocity'], samples['primary_acceleration']
    slope = (velocity[smooth + 1] - velocity[smooth - 1]) * 2000.0
    assert slope == pytest.approx(acceleration[smooth], abs=2e-3)
    force = 1.2 * np.sin(31.416 * samples['time'])
    if 'force_amplitudes' in settings[0]:
        force = 1.2 * np.sin(31.4 * samples['time']) + 0.4 * np.sin(70.0 * samples['time'] + 1.0)
    assert samples['force'] == pytest.approx(force, abs=1e-9)


@pytest.mark.parametrize(
    ('words', 'said'),
    [
        ('--duration 1', 'in the last 5 cycles'),
        ('--duration 8', 'in the last 20 cycles'),
        ('--duration 8 --set gap=0.07', 'no impact   m has not hit a stop for 40 cycles: |Y| is'),
        ('--duration 8 --set gap=5', 'or an initial_damper_velocity'),
    ],
)
def test_what_a_summary_reports(words, said, capsys):
    assert main(['bench_rig', *words.split()]) == 0
    assert said in capsys.readouterr().err


def test_a_rig_that_is_hit_is_not_reported_as_without_impacts(capsys):
    assert main(['bench_rig', '--duration', '10']) == 0
    assert main(['bench_rig', '--duration', '10', '--set', 'gap=0.0000001']) == 0
    assert 'has not hit' not in capsys.readouterr().err


def test_sticking_and_release_are_events(tmp_path):
    events = tmp_path / 'events.csv'
    words = ('--duration', '26', '--events', str(events))
    code, rows = run(tmp_path, *words, settings=[*INCLINED, 'friction=0.5'])
    assert code == 0
    kinds = [row for row in table(events) if row['kind'] != 'reversal']
    instants = {row['kind']: float(row['time']) for row in kinds}
    assert instants['stick'] == pytest.approx(0.733769482104, abs=1e-12)
    assert instants['release'] == pytest.approx(1.71677134162, abs=1e-11)
    expected = [10.061379083930, 20.433504840227, 22.929063529950, 24.931810684244]
    assert [row['time'] for row in rows] == pytest.approx(expected, abs=1e-12)


def test_events_show_the_frequency(tmp_path):
    """That of the first harmonic from the event on; of a step, the one that it leads to."""
    events = tmp_path / 'events.csv'
    settings = ['sweep_mode=up_down', 'sweep_low=0.9', 'sweep_high=1.0', 'sweep_step=0.04']
    settings += ['gravity=0', 'sweep_dwell=60', 'gap=8']
    assert run(tmp_path, '--duration', '380', '--events', str(events), settings=settings)[0] == 0
    rows = [(r['kind'], float(r['time']), float(r['force_frequency'])) for r in table(events)]
    steps = [(instant, frequency) for kind, instant, frequency in rows if kind == 'frequency_step']
    expected = [0.94, 0.98, 1.0, 0.98, 0.94, 0.9]
    assert steps == [(60.0 * (k + 1), pytest.approx(w)) for k, w in enumerate(expected)]
    assert {kind for kind, *_ in rows} == {'impact', 'frequency_step'}
    for _, instant, frequency in rows:
        assert frequency == pytest.approx([0.9, *expected][int(instant // 60.0)])
    # One frequency all the time
    run(tmp_path, '--duration', '60', '--events', str(events), settings=['gravity=0'])
    assert {row['force_frequency'] for row in table(events)} == {'1'}


def test_seventeen_digits_round_trip(tmp_path):
    _, rows = run(tmp_path, '--duration', '200')
    exact = Rig(RigParameters(gravity=1.0)).advance(200.0)
    assert [row['time'] for row in rows] == [event.time for event in exact]
    assert [row['x'] for row in rows] == [event.x for event in exact]


def test_states_lie_on_the_grid_and_do_not_disturb(tmp_path):
    states = tmp_path / 'states.csv'
    _, alone = run(tmp_path, '--duration', '60')
    _, sampled = run(tmp_path, '--duration', '60', '--states', str(states), '--rate', '37')
    assert sampled == alone
    rows = table(states)
    assert [float(row['time']) for row in rows] == [k / 37 for k in range(60 * 37 + 1)]
    assert float(rows[0]['x']) == 0.0
    assert float(rows[0]['stop_1']) == 18.5


@pytest.mark.parametrize(
    ('settings', 'rests'),
    [
        # Hardly shaken, m bounces on stop 1 and comes to rest; in the other rig it leaves again
        (('angle=1.5708', 'gap=2', 'force_amplitudes=[0.001]'), 1),
        (('angle=1.5', 'restitution_1=0.4', 'gap=1'), None),
    ],
)
def test_a_chatter_is_reported_once_as_rest(tmp_path, settings, rests):
    code, rows = run(tmp_path, '--duration', '60', settings=('one_sided=true', *settings))
    assert code == 0
    kinds = [row['kind'] for row in rows]
    for row, kind in zip(rows, kinds, strict=True):
        for when in ('before', 'after'):
            same = row[f'damper_velocity_{when}'] == row[f'primary_velocity_{when}']
            assert same == (kind == 'rest')
    assert kinds[-1] == 'rest' if rests else {'impact', 'rest'} == set(kinds)
    assert kinds.count('rest') == rests or rests is None
    assert len(rows) < 400


def test_an_output_that_is_full():
    """The failure is a line and an exit code."""
    words = (sys.executable, '-m', 'impact_damper_ros.cli.simulate_rig', '--parameters')
    with Path('/dev/full').open('w') as full:
        ended = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True)
    assert ended.returncode == 1
    (line,) = ended.stderr.splitlines()
    assert line.startswith('simulate_rig: cannot write the standard output: the disk is full')


def test_gap_control_from_the_command_line(tmp_path):
    """The same control as in the library, and what the stops do among the events."""
    events, states = tmp_path / 'events.csv', tmp_path / 'states.csv'
    settings = ('gravity=0', 'gap_control=timed', 'gap_control_rate=5', 'actuator_speed=30')
    settings += ('actuator_delay=0.1',)
    files = ('--events', str(events), '--states', str(states), '--rate', '2')
    code, rows = run(tmp_path, '--duration', '400', *files, settings=settings)
    assert code == 0
    rig = Rig(
        RigParameters(gravity=0.0),
        control=GapControlParameters(
            gap_control='timed', gap_control_rate=5.0, actuator_speed=30.0, actuator_delay=0.1
        ),
    )
    expected = rig.advance(400.0)
    found = [(row['kind'], float(row['time'])) for row in table(events)]
    assert found == [(event.kind.name.lower(), event.time) for event in expected]
    assert {'crossing', 'stop_arrived', 'stop_touched', 'impact'} == {kind for kind, _ in found}
    assert len(rows) == sum(kind == 'impact' for kind, _ in found)
    # The stops are seen to move.
    gaps = {round(float(row['stop_1']) - float(row['stop_2']), 3) for row in table(states)}
    assert len(gaps) > 100


def test_gap_control_from_the_parameters_file(tmp_path, capsys):
    params = tmp_path / 'rig.yaml'
    head = '/**:\n  ros__parameters:\n    gravity: 0.0\n'
    params.write_text(head + '    gap_control: timed\n    gap_control_rate: 5\n')
    assert run(tmp_path, '--duration', '900', params=params)[0] == 0
    summary = capsys.readouterr().err
    assert 'gap control timed: ' in summary
    # From 0.27 of the motion without impacts, with the gap of the paper
    share = float(summary.partition(' m in the last 20 cycles, ')[2].partition(' ')[0])
    assert share == pytest.approx(0.0277, abs=0.0005)
    # Unquoted, YAML takes off for false.
    params.write_text(head + '    gap_control: off\n')
    assert run(tmp_path, '--duration', '50', params=params)[0] == 0
    assert 'gap control' not in capsys.readouterr().err


def test_parameters_change_during_the_run(tmp_path):
    """As `Rig.change` makes it; changes at one time take effect together."""
    words = ['--change', '20:gap=30', '--change', '33.25:friction=0.1', '--change', '20:angle=0.1']
    code, rows = run(tmp_path, '--duration', '80', *words, settings=['gravity=1'])
    rig = Rig(RigParameters(gravity=1.0))
    events = rig.advance(20.0)
    events += rig.change(rig.parameters.replace(gap=30.0, angle=0.1))
    events += rig.advance(33.25)
    events += rig.change(rig.parameters.replace(friction=0.1))
    events += rig.advance(80.0)
    impacts = [event for event in events if event.kind is EventKind.IMPACT]
    assert code == 0
    assert [row['time'] for row in rows] == [impact.time for impact in impacts]
    assert len(rows) > 3


def test_changes_are_recorded(tmp_path, capsys):
    words = ['--change', '5:gap_control=timed', '--change', '9.0001:gap_control=off']
    bag = tmp_path / 'bag'
    assert main(['bench_rig', '--duration', '14', '--bag', str(bag), '--quiet', *words]) == 0
    assert replay_run([str(bag)]) == 0
    assert 'meanwhile   2 changes' in capsys.readouterr().out
    assert compare_run([str(bag)]) == 0
    text = capsys.readouterr().out
    assert 'begins with: gap_control = timed (was off)\n' in text
    assert 'begins with: gap_control = off (was timed)\n' in text
    assert 'fault' not in text
