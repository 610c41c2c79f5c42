"""`simulate_rig` on a random base, and under a random force, as a user runs it."""

import csv
import math

import numpy as np
import pytest

from impact_damper_ros.cli.simulate_rig import main
from impact_damper_ros.parameters.parameters_file import load_parameters

TABLE = 'f [Hz], level [g^2/Hz]\n3,1e-4\n5,1e-3\n8,1e-4\n'


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'psd.csv'
    path.write_text(TABLE)
    return path


def simulate(*words, rig='bench_rig'):
    return main([rig, *map(str, words)])


def test_a_linear_rig_on_a_random_base(table, tmp_path, capsys):
    """Without impacts and friction the transmissibility by Welch is the closed form."""
    spectra, figure, rig = (tmp_path / name for name in ('t.csv', 't.png', 'rig.yaml'))
    settings = ('force_amplitudes=0', 'friction=0', 'gap=10', 'damping=12.6')
    words = [word for setting in settings for word in ('--set', setting)]
    random = ('--base-psd', table, '--psd-lines', 20, '--seed', 3, '--duration', 12)
    outputs = ('--transmissibility', spectra, '--figure', figure, '--rig-out', rig)
    assert simulate(*words, *random, *outputs) == 0
    printed = capsys.readouterr().err
    # The first and the last of the bins have half the width.
    assert 'random acceleration of 21 lines from 3 Hz to 8 Hz: 0.04394 g rms' in printed
    assert '0.04394 g by the integral of the table; repeats after 4 s' in printed
    assert 'transmissibility over 2 periods of 4 s' in printed
    rows = list(csv.DictReader(spectra.read_text().splitlines()))
    columns = {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}
    w = math.tau * columns['frequency']
    spring = 1974.0 + 12.6j * w
    for name, expected in {
        'transmissibility': abs(spring / (spring - 2.0 * w**2)),
        'relative_transmissibility': abs(2.0 * w**2 / (spring - 2.0 * w**2)),
    }.items():
        assert columns[f'{name}_without_damper'] == pytest.approx(expected, rel=1e-9)
        assert columns[name] == pytest.approx(expected, rel=0.02)
    level = np.exp(np.interp(np.log(columns['frequency']), np.log([3, 5, 8]), np.log([1, 10, 1])))
    assert columns['base_level'][1:-1] / 9.80665**2 == pytest.approx(1e-4 * level[1:-1], rel=0.06)
    assert figure.read_bytes()[:4] == b'\x89PNG'
    # The file is the same rig: a run of it ends in the same state to the last bit.
    assert len(load_parameters(rig)[0].base_amplitudes) == 21
    states = tmp_path / 'one.csv', tmp_path / 'other.csv'
    assert simulate(*words, *random[:6], '--duration', 1, '--states', states[0]) == 0
    assert simulate('--duration', 1, '--states', states[1], rig=str(rig)) == 0
    assert states[0].read_bytes() == states[1].read_bytes()


def test_seeds_of_base_and_force(table, tmp_path, capsys):
    force = tmp_path / 'force.csv'
    force.write_text('f [Hz];level [N^2/Hz]\n3;0,01\n8;0,01\n')
    rigs = [tmp_path / f'{k}.yaml' for k in range(3)]
    for rig, seed in zip(rigs, (1, 1, 2), strict=True):
        options = ('--base-psd', table, '--force-psd', force, '--seed', seed, '--psd-lines', 8)
        assert simulate('--duration', 0.1, *options, '--rig-out', rig) == 0
    assert 'random force of 9 lines from 3.125 Hz to 8.125 Hz: 0.2236 N rms' in (
        capsys.readouterr().err
    )
    one, same, other = (load_parameters(rig)[0] for rig in rigs)
    assert one == same
    assert one.base_amplitudes == other.base_amplitudes
    assert one.base_phases != other.base_phases
    assert one.force_phases[:9] != one.base_phases[:9]
    assert one.base_quantity == 'acceleration'
    rms = math.sqrt(sum(a * a for a in one.force_amplitudes) / 2.0)
    assert rms == pytest.approx(math.sqrt(0.01 * 5.0))


@pytest.mark.parametrize(
    ('text', 'option', 'problem'),
    [
        ('f [Hz],level [g^2/Hz]\n3,1e-4\n', '--base-psd', '1 rows: give at least 2'),
        ('f [Hz],level [g^2/Hz]\n3,1\n3,1\n', '--base-psd', "line 3, column 'f [Hz]': 3 after 3"),
        ('f [Hz],level [g^2/Hz]\n3,1\n4,\n', '--base-psd', "line 3, column 'level [g^2/Hz]': no"),
        ('f [Hz],level\n3,1\n4,1\n', '--base-psd', "column 'level' has no unit"),
        ('f [Hz],level [N^2/Hz]\n3,1\n4,1\n', '--base-psd', "has the unit 'N^2/Hz'"),
        (TABLE, '--force-psd', "has the unit 'g^2/Hz': write it behind the name, as level [N^2/"),
        ('f [Hz],x [g^2/Hz]\n3,1\n4,1\n', '--base-psd', 'no column for the level'),
        ('', '--base-psd', 'empty; give a header'),
        (
            None,
            '--base-psd',
            'cannot be read (No such file or directory): give the path of a table',
        ),
    ],
)
def test_bad_tables(tmp_path, capsys, text, option, problem):
    path = tmp_path / 'psd.csv'
    if text is not None:
        path.write_text(text)
    assert simulate('--duration', 1, option, path) == 2
    assert problem in capsys.readouterr().err


def test_too_short_for_an_average(table, tmp_path, capsys):
    options = ('--base-psd', table, '--transmissibility', tmp_path / 't.csv')
    assert simulate('--duration', 1, *options) == 2
    assert 'repeats after 40 s: give a --duration of at least 40 s' in capsys.readouterr().err
    assert not (tmp_path / 't.csv').exists()
    assert simulate('--duration', 1, '--transmissibility', tmp_path / 't.csv') == 2
    assert 'the base moves by 0 lines' in capsys.readouterr().err
