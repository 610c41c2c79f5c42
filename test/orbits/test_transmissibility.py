"""Transmissibility against closed forms, in a sweep and in the summary of a run."""

import csv
import json
import math
import re

import pytest
from rigs import TABLE

from impact_damper_ros import Rig, RigParameters, find_orbits, settle, transmissibility
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.cli.solve_periodic import main as solve_periodic
from impact_damper_ros.orbits.flight_arrays import run_flights
from impact_damper_ros.orbits.transmissibility import TRANSMISSIBILITIES, Transmissibility
from impact_damper_ros.sweep import Grid, sweep

LOCKED = {
    'primary_mass': 2.0,
    'stiffness': 1974.0,
    'damping': 12.6,
    'damper_mass': 0.1,
    'gap': 1e-9,
    'friction': 50.0,
    'force_amplitudes': 0.0,
    'base_amplitudes': 1e-3,
    'base_quantity': 'displacement',
}


def expected(rate, mass=2.1):
    """Return absolute, relative and acceleration transmissibility of a mass."""
    pull = complex(1974.0, 12.6 * rate)
    dynamic = pull - mass * rate**2
    absolute = abs(pull / dynamic)
    return absolute, mass * rate**2 / abs(dynamic), absolute


def measured(rig, end):
    return run_flights(rig, end).integrals()[0].transmissibility


@pytest.mark.parametrize('ratio', [0.5, 1.0, 2.0])
def test_of_one_mass(ratio):
    rate = ratio * math.sqrt(1974.0 / 2.1)
    parameters = RigParameters(**LOCKED, base_frequencies=rate)
    rig = Rig(parameters)
    cycle = math.tau / rate
    rig.run(40 * cycle)
    assert measured(rig, 50 * cycle) == pytest.approx(expected(rate), rel=1e-4)
    alone = Transmissibility.without_damper(parameters)
    assert alone == pytest.approx(expected(rate, 2.0), rel=1e-12)


def test_of_several_lines_without_the_damper():
    """A force, and two lines of one frequency that add up to one."""
    parameters = RigParameters(**LOCKED).replace(
        damper_mass=1e-9,
        gap=1e3,
        friction=0.0,
        force_amplitudes=2.0,
        force_frequencies=20.0,
        base_amplitudes=(1e-3, 5e-4, 2e-3),
        base_frequencies=(20.0, 20.0, 30.0),
        base_phases=(0.0, 1.0, 2.0),
    )
    rig, cycle = Rig(parameters), math.tau / 10.0
    rig.run(60 * cycle)
    alone = Transmissibility.without_damper(parameters)
    assert measured(rig, 80 * cycle) == pytest.approx(alone, rel=1e-6)


def test_an_undamped_rig_at_resonance_takes_up_all():
    rig = RigParameters(**LOCKED)
    resonant = rig.replace(primary_mass=4.0, stiffness=4.0, damping=0.0, base_frequencies=1.0)
    assert Transmissibility.without_damper(resonant) == (math.inf,) * 3


def test_a_base_at_rest_has_none():
    assert all(map(math.isnan, measured(Rig(RigParameters()), 50.0)))
    assert all(map(math.isnan, Transmissibility.without_damper(RigParameters())))


def test_of_a_periodic_motion():
    """Theory and the run from rest agree, and both differ by a tenth from the relative one."""
    orbit = next(o for o in find_orbits(TABLE, (1, 2)).orbits if o.viable and o.stable)
    rig = Rig(TABLE)
    settle(rig, tolerance=1e-12)
    found = transmissibility(orbit)
    assert found == pytest.approx(measured(rig, rig.time + 0.1), rel=1e-9)
    assert found.relative == pytest.approx(5.307232, rel=1e-6)
    assert found.relative / found.absolute > 1.1
    unviable = [o for o in find_orbits(TABLE, (1, 2)).orbits if not o.viable]
    assert unviable
    assert all(map(math.isnan, transmissibility(unviable[0])))


def test_sweep_over_the_frequency_of_the_base():
    rates = [20.0, 30.0, 40.0]
    rig = RigParameters(**LOCKED)
    table = sweep(Grid(rig, base_frequencies=rates), jobs=1)
    for row, rate in zip(table.itertuples(), rates, strict=True):
        found = (getattr(row, name) for name in TRANSMISSIBILITIES)
        assert tuple(found) == pytest.approx(expected(rate), rel=1e-6)


#: The same rig on the command line.
OPTIONS = [
    word
    for setting in (
        'primary_mass=5kg',
        'natural_frequency=10Hz',
        'damping_ratio=2%',
        'mass_ratio=0.05',
        'restitution_1=0.6',
        'restitution_2=0.6',
        'friction=0',
        'gap=18mm',
        'force_amplitudes=0',
        'base_amplitudes=0.2g',
        'base_frequencies=10Hz',
    )
    for word in ('--set', setting)
]
SHOWN = ('4.70808 (25.02 without', '5.30723 (25 without', '5.3115 (25.02 without')


def test_summary_of_a_run(capsys):
    assert simulate_rig(['bench_rig', '--duration', '60', *OPTIONS]) == 0
    text = ''.join(capsys.readouterr())
    assert all(number in text for number in SHOWN)
    assert '0.1916935 of the 0.0124302 m without impacts' in text


def test_summary_counts_from_the_last_change(capsys):
    options = ['gap=1m' if word.startswith('gap=') else word for word in OPTIONS]
    words = ['bench_rig', '--duration', '60', *options]
    assert simulate_rig([*words, '--change', '58.5:base_amplitudes=0.1g']) == 0
    found = re.search(r'rms X/rms b ([\d.]+) \(25.02', ''.join(capsys.readouterr()))
    # X has not settled again, and is on its way from 25.02 to twice as much of half the motion
    assert 25.1 < float(found[1]) < 50.0


def test_theory_of_a_rig(tmp_path, capsys):
    path, table = tmp_path / 'orbits.json', tmp_path / 'branch.csv'
    words = ['--impacts', '2', '--json', str(path), '--csv', str(table)]
    assert solve_periodic(['bench_rig', *OPTIONS, *words, '--follow', 'gap=17mm:19mm']) == 0
    text = capsys.readouterr().out
    assert all(number in text for number in SHOWN)
    first = json.loads(path.read_text())[0]
    assert first['transmissibility'] == pytest.approx(4.708077, rel=1e-6)
    assert first['relative_transmissibility_without_damper'] == pytest.approx(25.0)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    near = [float(row['transmissibility']) for row in rows if 0.0175 < float(row['gap']) < 0.0185]
    assert 4.4 < min(near) < 4.708 < max(near) < 5.0


def test_comparison_of_a_recording(tmp_path, capsys):
    bag, path = tmp_path / 'bag', tmp_path / 'compared.json'
    assert simulate_rig(['bench_rig', '--duration', '30', *OPTIONS, '--bag', str(bag)]) == 0
    assert compare_run([str(bag), '--json', str(path)]) == 0
    text = capsys.readouterr().out
    assert re.search(r'rms X/rms b +4.708077 +4.708077', text)
    assert re.search(r'rms \(X - b\)/rms b +5.307232 +5.307232', text)
    assert 'Without the damper the transmissibilities are 25.02, 25, 25.02.' in text
    assert 'work of the base' in text
    assert 'work of the force' not in text
    measured = json.loads(path.read_text())['stretches'][0]['measured']
    assert measured['acceleration_transmissibility'] == pytest.approx(5.311503, rel=1e-6)
