"""The study of the gap control in quick form, and its measures against closed forms."""

import csv
import math
import runpy
import sys
from pathlib import Path

import pytest

pytest.importorskip('matplotlib')
pytest.importorskip('numba')

STUDY = Path(__file__).parents[2] / 'examples' / 'gap_control'
sys.path.append(str(STUDY))

import study  # noqa: E402

from impact_damper_ros import Rig, run_flights  # noqa: E402


@pytest.fixture
def run(monkeypatch, tmp_path):
    """Run a script in quick form and return the rows of its table."""

    def script(name):
        monkeypatch.setattr(sys, 'argv', [name, '--quick', '--out', str(tmp_path)])
        runpy.run_path(str(STUDY / f'{name}.py'), run_name='__main__')
        assert (tmp_path / f'{name}.png').stat().st_size > 20_000
        with (tmp_path / f'{name}.csv').open(encoding='utf-8', newline='') as file:
            return list(csv.DictReader(file))

    return script


def test_level(run, capsys):
    rows = {
        (int(row['angle [deg]']), row['law']): [float(row[f'{level} N']) for level in (0.25, 1, 4)]
        for row in run('level')
    }
    timed, ideal, fixed = (rows[0, name] for name in ('timed', 'ideal', 'fixed'))
    assert timed == pytest.approx([1.0066 * value for value in ideal], rel=0.002)
    assert max(timed) - min(timed) < 1e-4
    assert rows[0, 'amplitude'] == pytest.approx([0.0558] * 3, rel=0.02)
    # A fixed gap is right for one level.
    assert fixed[1] < 0.1 < min(fixed[0], fixed[2])
    # Friction on the inclines costs more at small forces.
    assert rows[15, 'timed'] == pytest.approx(rows[15, 'ideal'], rel=0.02)
    assert rows[15, 'ideal'][0] > 1.5 * rows[15, 'ideal'][2]
    assert '| timed, independent stops | 1.287 | 0.0771' in capsys.readouterr().out


def test_broadband(run):
    rows = {(row['case'], row['gap']): float(row['rms, seed 1']) for row in run('broadband')}
    best = min(rms for (case, _), rms in rows.items() if case == 'fixed')
    assert rows['timed', ''] < 0.75 * best
    assert rows['timed, real', ''] < 0.75 * best
    assert rows['timed', ''] < rows['timed symmetric', '']


def test_a_controller_that_knows_the_model_is_better():
    """Than the timed law, at resonance and under broadband excitation."""
    rms_under_control = runpy.run_path(str(STUDY / 'predictive.py'))['rms_under_control']
    for rig, settle, watch in ((study.RIG, 25.0, 5.0), (study.broadband_rig(1), 10.0, 20.0)):
        timed = study.watched(rig, study.law('timed', rig), settle=settle, watch=watch).rms
        assert rms_under_control(rig, settle, watch) < timed


def test_stepped_sine(run):
    rows = run('stepped_sine')
    assert [float(row['frequency ratio']) for row in rows] == pytest.approx(
        [0.8, 0.9, 1.0, 1.1, 1.2]
    )
    up, down = ([float(row[f'timed, {way}']) for row in rows] for way in ('up', 'down'))
    assert up == pytest.approx(down, rel=0.03)
    assert max(up) < 3.1


def test_load(run):
    rows = run('load')
    assert len(rows) == 120
    last = [float(rows[k]['timed']) for k in (39, 79, 119)]
    ideals = [
        study.ideal_amplitude(study.RIG.replace(force_amplitudes=(level,)))
        for level in (1.0, 4.0, 0.25)
    ]
    assert last == pytest.approx(ideals, rel=0.05)
    assert float(rows[79]['fixed']) > 25.0


def test_sensitivity(run):
    rows = {
        (row['disturbance'], float(row['value']), row['law'], row['where'][:9]): float(row['rms'])
        for row in run('sensitivity')
    }
    for what, value in (('delay', 0.15), ('speed', 6.0), ('noise', 0.02), ('sampling', 16.0)):
        assert rows[what, value, 'timed', 'resonance'] == pytest.approx(1.005, abs=0.01)
        assert rows[what, value, 'timed', 'broadband'] < 0.85


def test_what_is_measured():
    """A rig that meets no stop: amplitude, peak and power of a plain oscillator."""
    rig = study.RIG.replace(gap=1000.0, damping=0.2)
    run = study.watched(rig, settle=60.0, watch=20.0)
    assert (run.peak, run.amplitude) == pytest.approx((5.0, 5.0), rel=1e-6)
    # Mean power of the force, F A omega / 2
    assert run.dashpot_power == pytest.approx(2.5, rel=1e-6)
    assert (run.impact_power, run.actuator_power) == (0.0, 0.0)
    (rms,) = study.rms_over_gaps(rig, [1000.0], settle=60.0, watch=20.0)
    assert rms == pytest.approx(run.rms, rel=1e-6)


def test_power_is_balanced():
    """What the force puts in, impacts and dashpot take; what actuators spend is no part of it."""
    control = study.law('timed', study.RIG, **study.REAL)
    run = study.watched(study.RIG, control, settle=160.0, watch=40.0)
    rig = Rig(study.RIG, control=control, compiled=None)
    rig.run(math.tau * 160.0)
    flights = run_flights(rig, math.tau * 200.0)
    work = (flights.integrals()[0].force - flights.stored_energy()) / (math.tau * 40.0)
    assert run.impact_power + run.dashpot_power == pytest.approx(work, rel=1e-9)
    assert run.actuator_power > 0.5 * work
