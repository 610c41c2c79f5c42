"""Transmissibility against closed forms, in a sweep and in the summary of a run."""

import math
import re

import pytest

from impact_damper_ros import Rig, RigParameters
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.orbits.flight_arrays import run_flights
from impact_damper_ros.orbits.transmissibility import transmissibility
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


def expected(rate):
    """Return absolute and relative transmissibility of a mass M + m."""
    pull = complex(1974.0, 12.6 * rate)
    dynamic = pull - 2.1 * rate**2
    return abs(pull / dynamic), 2.1 * rate**2 / abs(dynamic)


@pytest.mark.parametrize('ratio', [0.5, 1.0, 2.0])
def test_of_one_mass(ratio):
    rate = ratio * math.sqrt(1974.0 / 2.1)
    rig = Rig(RigParameters(**LOCKED, base_frequencies=rate))
    cycle = math.tau / rate
    rig.run(40 * cycle)
    found = transmissibility(run_flights(rig, 50 * cycle))
    assert found == pytest.approx(expected(rate), rel=1e-4)


def test_a_base_at_rest_has_none():
    rig = Rig(RigParameters())
    assert all(map(math.isnan, transmissibility(run_flights(rig, 50.0))))


def test_sweep_over_the_frequency_of_the_base():
    rates = [20.0, 30.0, 40.0]
    rig = RigParameters(**LOCKED)
    table = sweep(Grid(rig, base_frequencies=rates), jobs=1)
    for row, rate in zip(table.itertuples(), rates, strict=True):
        both = row.transmissibility, row.relative_transmissibility
        assert both == pytest.approx(expected(rate), rel=1e-6)


def test_summary(capsys):
    options = ['force_amplitudes=0', 'base_amplitudes=1mm', 'base_frequencies=20 rad/s']
    options += ['gap=1e-6mm', 'friction=50', 'damping=12.6']
    words = [word for option in options for word in ('--set', option)]
    assert simulate_rig(['bench_rig', '--duration', '20', *words]) == 0
    text = ''.join(capsys.readouterr())
    found = re.search(r'rms X/rms b ([\d.]+); rms \(X - b\)/rms b ([\d.]+)', text)
    assert tuple(map(float, found.groups())) == pytest.approx(expected(20.0), rel=1e-3)
