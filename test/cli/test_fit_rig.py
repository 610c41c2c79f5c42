"""`fit_rig`: from files of measured data to a fitted rig, its intervals and its report."""

import json
import re
from pathlib import Path
from runpy import run_path

import numpy as np
import pytest
from rigs import TWIN as TRUE

from impact_damper_ros import Rig, load_parameters
from impact_damper_ros.cli.fit_rig import main
from impact_damper_ros.cli.simulate_rig import main as simulate_rig

TWIN = Path(__file__).parents[2] / 'examples' / 'twin'


def _intervals(path):
    """Return the intervals that stand as comments in a parameters file."""
    found = re.findall(
        r'^ +(\w+): .*# .*95 %: (\S+) to (\S+)$', path.read_text('utf-8'), re.MULTILINE
    )
    assert found
    return {name: (float(low), float(high)) for name, low, high in found}


FITTED = ('stiffness', 'damping', 'restitution_1', 'restitution_2', 'friction', 'gap')


def test_the_files_of_the_tutorial_are_those_of_its_program(tmp_path, monkeypatch):
    monkeypatch.setattr('sys.argv', ['measure.py', str(tmp_path)])
    run_path(str(TWIN / 'measure.py'), run_name='__main__')
    for name in ('free.csv', 'start.csv', 'hits.csv', 'bounces.csv'):
        made, there = (
            np.array([row.replace(',', '.').replace(';', ',').split(',') for row in rows], float)
            if name == 'free.csv'
            else np.genfromtxt(rows, delimiter=',')
            for rows in (
                (folder / name).read_text('utf-8').splitlines()[1:] for folder in (tmp_path, TWIN)
            )
        )
        # To the last digit that is written
        np.testing.assert_allclose(made, there, atol=1.1e-3)


@pytest.fixture(scope='module')
def structure(tmp_path_factory):
    place = tmp_path_factory.mktemp('structure')
    arguments = [str(TWIN / 'free.csv'), '--structure', '--rig', str(TWIN / 'rig.yaml')]
    outputs = ['--rig-out', str(place / 'start.yaml'), '--json', str(place / 'free.json')]
    assert main([*arguments, *outputs, '--report', str(place / 'report')]) == 0
    return place


def test_the_structure(structure):
    found = json.loads((structure / 'free.json').read_text('utf-8'))
    assert found['accepted'] is True
    assert found['reasons'] == []
    for name, true in (
        ('natural_frequency', TRUE.omega / np.pi / 2),
        ('damping_ratio', TRUE.zeta),
    ):
        one = found['parameters'][name]
        assert abs(one['value'] - true) < 3.5 * one['standard_deviation']
        assert one['interval'][0] < one['value'] < one['interval'][1]
    rig, _, _ = load_parameters(structure / 'start.yaml')
    assert rig.stiffness == pytest.approx(TRUE.stiffness, rel=1e-3)
    assert rig.damping == pytest.approx(TRUE.damping, rel=0.01)
    low, high = _intervals(structure / 'start.yaml')['damping']
    assert low < rig.damping < high
    page = (structure / 'report' / 'report.html').read_text('utf-8')
    assert '<script' not in page
    assert 'Over the amplitude' in page
    assert json.loads((structure / 'report' / 'report.json').read_text('utf-8')) == found


@pytest.fixture(scope='module')
def fitted(structure):
    arguments = [str(TWIN / 'start.csv'), '--impacts', str(TWIN / 'hits.csv')]
    outputs = ['--rig-out', str(structure / 'fitted.yaml'), '--json', str(structure / 'fit.json')]
    more = ['--rig', str(structure / 'start.yaml'), '--report', str(structure / 'fit')]
    assert main([*arguments, *more, *outputs, '--impact-deviation', '0.3ms']) == 0
    return structure


def test_the_rig_is_found(fitted):
    found = json.loads((fitted / 'fit.json').read_text('utf-8'))
    assert found['accepted'] is True
    assert set(found) >= {
        *('accepted', 'reasons', 'parameters', 'correlations', 'chi_squared', 'fit_percent'),
        *('impacts', 'flights'),
    }
    assert list(found['parameters']) == [*FITTED, 'damper_mass', 'force_amplitudes']
    for name in FITTED:
        one = found['parameters'][name]
        assert abs(one['value'] - getattr(TRUE, name)) < 3.5 * one['standard_deviation'], name
    assert found['parameters']['stiffness']['start'] == pytest.approx(TRUE.stiffness, rel=1e-3)
    assert found['parameters']['gap']['interval'][1] - TRUE.gap < 1e-4
    assert found['correlations']['gap']['gap'] == pytest.approx(1.0)
    assert len(found['flights']) == len(found['impacts']) - 1
    assert found['fit_percent'] > 98.0


def test_the_fitted_rig_is_a_parameters_file_with_intervals(fitted):
    rig, _, _ = load_parameters(fitted / 'fitted.yaml')
    found = json.loads((fitted / 'fit.json').read_text('utf-8'))['parameters']
    for name in FITTED:
        assert getattr(rig, name) == found[name]['value']
    # That of the file, known to 1 %, corrected by what the record says
    assert rig.force_amplitudes == (found['force_amplitudes']['value'],)
    assert rig.force_amplitudes == pytest.approx((1.5,), rel=0.01)
    for name, ends in _intervals(fitted / 'fitted.yaml').items():
        assert ends == pytest.approx(found[name]['interval'], rel=1e-3)
    assert simulate_rig([str(fitted / 'fitted.yaml'), '--duration', '2']) == 0


def test_the_page_has_all(fitted):
    page = (fitted / 'fit' / 'report.html').read_text('utf-8')
    for words in ('✓ accepted', 'Data and model', 'Intervals', 'Correlations', 'Flights'):
        assert words in page
    assert '<script' not in page
    assert 'http://' not in page.replace('http://www.w3.org', '')


def test_a_recording_of_a_rig_names_it(tmp_path, capsys):
    bag = tmp_path / 'run'
    assert simulate_rig(['bench_rig', '--duration', '8', '--bag', str(bag)]) == 0
    result = tmp_path / 'fit.json'
    assert main([str(bag), '--json', str(result)]) == 0
    found = json.loads(result.read_text('utf-8'))
    rig, _, _ = load_parameters('bench_rig')
    for name in FITTED:
        one = found['parameters'][name]
        assert one['value'] == pytest.approx(getattr(rig, name), rel=1e-5), name
    text = capsys.readouterr().out
    assert 'those of rounding' in text
    assert 'restitution_2 and' not in text
    assert 'and restitution_2' not in text


def test_a_fit_that_is_not_accepted_writes_no_rig(tmp_path, capsys):
    """The record of a forced motion is refused: it does not ring down."""
    rig, result = tmp_path / 'out.yaml', tmp_path / 'out.json'
    words = ['--structure', '--rig', str(TWIN / 'rig.yaml'), '--rig-out', str(rig)]
    assert main([str(TWIN / 'start.csv'), *words, '--json', str(result)]) == 1
    assert not rig.exists()
    found = json.loads(result.read_text('utf-8'))
    assert found['accepted'] is False
    said = capsys.readouterr()
    assert 'NOT accepted' in said.out
    assert found['reasons'][0] in said.out
    assert 'out.yaml is not written: the model does not fit' in said.err


def shaken(path, dropped):
    """Write the start of the bench rig on a table, without the rows between two instants."""
    rig = load_parameters('bench_rig')[0].replace(
        force_amplitudes=0.0, base_amplitudes=0.6, base_frequencies=31.4
    )
    time = np.arange(2400) / 200.0
    samples = Rig(rig).run(time[-1], time).samples
    rng = np.random.default_rng(4)
    x = 1e3 * samples['x'] + rng.normal(0.0, 0.05, len(time))
    base = 0.6 * np.sin(31.4 * time) + rng.normal(0.0, 0.005, len(time))
    rows = [
        f'{t:.3f},{a:.4f},{b:.5f}'
        for t, a, b in zip(time, x, base, strict=True)
        if not dropped[0] <= t < dropped[1]
    ]
    path.write_text('\n'.join(['t [s],x [mm],base [m/s^2]', *rows]), 'utf-8')


def test_a_logger_that_dropped_rows(tmp_path, capsys):
    """The base is known beside the gap as before; only a long one is refused, as a gap."""
    place, rig = tmp_path / 'run.csv', tmp_path / 'rig.yaml'
    rig.write_text(
        '/**: {ros__parameters: {primary_mass: 2.0, natural_frequency: 5.05, damping_ratio: 0.012,'
        ' damper_mass: 0.1}}',
        'utf-8',
    )
    true = load_parameters('bench_rig')[0]
    shaken(place, (5.0, 5.09))
    code = main([str(place), '--rig', str(rig), '--json', str(tmp_path / 'fit.json')])
    said = capsys.readouterr().out
    assert code == 0, said
    assert '18 missing samples' in said
    found = json.loads((tmp_path / 'fit.json').read_text('utf-8'))['parameters']
    assert found['gap']['value'] == pytest.approx(true.gap, rel=0.01)
    shaken(place, (5.0, 5.4))
    assert main([str(place), '--rig', str(rig)]) == 1
    said = capsys.readouterr().out
    assert 'has a gap of 0.405 s from 4.995 s' in said
    assert 'fit the parts one by one, with --to and --from' in said
    assert 'tones' not in said


def test_a_structure_whose_base_is_not_known_for_a_while(tmp_path, capsys):
    """Two rows may be missing; of more nobody knows what they did."""
    place = tmp_path / 'run.csv'
    time = np.arange(2000) / 200.0
    rig = load_parameters('bench_rig')[0].replace(
        force_amplitudes=0.0, base_amplitudes=0.6, base_frequencies=31.4, gap=10.0
    )
    base = -600.0 / 31.4**2 * np.sin(31.4 * time)
    x = 1e3 * Rig(rig).run(time[-1], time).samples['x']
    x += np.random.default_rng(4).normal(0.0, 0.01, len(x))
    for missing, code in ((2, 0), (3, 2)):
        rows = [f'{t},{a},{b}' for t, a, b in zip(time, x, base, strict=True)]
        del rows[1000 : 1000 + missing]
        place.write_text('\n'.join(['t [s],x [mm],base [mm]', *rows]), 'utf-8')
        assert main([str(place), '--structure']) == code
    assert 'the base is not known from 4.995 to 5.015 s' in capsys.readouterr().err
