"""`design_damper` as a user runs it."""

import csv
import json

import pytest

from impact_damper_ros import load_parameters
from impact_damper_ros.cli.design_damper import main

STRUCTURE = ['--mass', '5kg', '--frequency', '10Hz', '--damping-ratio', '2%', '--base', '0.2g']


def test_files_and_words(tmp_path, capsys):
    outputs = {
        '--csv': tmp_path / 'designs.csv',
        '--json': tmp_path / 'design.json',
        '--figure': tmp_path / 'design.png',
        '--rig-out': tmp_path / 'rig.yaml',
    }
    words = [str(word) for pair in outputs.items() for word in pair]
    assert main([*STRUCTURE, '--mass-ratio', '5%', '--restitution', '0.5:0.7', *words]) == 0
    text = capsys.readouterr().out
    assert 'Chosen: 5 % of the mass, 250 g, for R = 0.6.' in text
    assert 'with R from 0.5 to 0.7 and the level from 0.5 to 2' in text
    assert 'tuned mass damper' in text
    assert 'Test plan' in text
    found = json.loads(outputs['--json'].read_text())
    (design,) = found['designs']
    assert design['mass_ratio'] == pytest.approx(0.05)
    assert design['reached_from_rest']
    assert design['starts_by_itself'] is None
    assert 0.0 < design['reduction'] < 0.25
    assert found['uncertain']['restitutions'] == [0.5, 0.6, 0.7]
    (row,) = csv.DictReader(outputs['--csv'].read_text().splitlines())
    assert float(row['gap']) == design['gap']
    rig, _, _ = load_parameters(outputs['--rig-out'])
    assert rig.gap == design['gap']
    assert (rig.base_amplitudes, rig.base_quantity) == ((0.2 * 9.80665,), 'acceleration')
    assert outputs['--figure'].read_bytes()[:4] == b'\x89PNG'


def test_a_light_damper_has_to_be_started(capsys):
    assert main([*STRUCTURE[:-2], '--force', '5 N', '--mass-ratio', '2%']) == 0
    assert 'm has to be started by a push' in capsys.readouterr().out


@pytest.mark.parametrize(
    ('words', 'problem'),
    [
        (['--base', '0.2kg'], "'kg' is no unit of it"),
        (['--base', '0'], 'the excitation is 0'),
        (['--base', '1mm', '--force', '1N'], 'not allowed with'),
        (['--base', '1mm', '--mass-ratio', '10%:1%'], 'LOW:HIGH with the low end first'),
        (['--base', '1mm', '--restitution', '1.2'], 'restitution_1 is 1.2: give a number'),
        (['--base', '1mm', '--levels', '2:3'], 'give a range of factors around 1'),
        (['--base', '1mm', '--damping-ratio', '0'], '--damping-ratio is 0'),
        (['--base', '1mm', '--mass', 'nan'], 'primary_mass'),
        ([], 'one of the arguments --base --force is required'),
    ],
)
def test_refusals(words, problem, capsys):
    try:
        code = main([*STRUCTURE[:-2], *words])
    except SystemExit as end:
        code = end.code
    assert code == 2
    assert problem in capsys.readouterr().err
