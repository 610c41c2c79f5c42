"""`ring_down` as a user runs it."""

import csv
import json
import math

import pytest

from impact_damper_ros.cli.ring_down import main


def test_files_and_words(tmp_path, capsys):
    outputs = [tmp_path / name for name in ('cycles.csv', 'curve.json', 'loss.png')]
    options = zip(('--csv', '--json', '--figure'), map(str, outputs), strict=True)
    words = [word for pair in options for word in pair]
    assert main(['bench_rig', '--from', '40mm', '--releases', '6', *words]) == 0
    text = capsys.readouterr().out
    assert 'of 6 releases, from 40 mm down' in text
    assert 'dashpot alone: Ψ 0.118' in text
    rows = list(csv.DictReader(outputs[0].read_text().splitlines()))
    assert {row['release'] for row in rows} == set('012345')
    assert float(rows[0]['velocity']) / 31.4159 == pytest.approx(
        float(rows[0]['amplitude']), rel=1e-3
    )
    curve = json.loads(outputs[1].read_text())
    assert curve['cycles'] == len(rows)
    assert curve['amplitude'] == 0.04
    assert outputs[2].read_bytes()[:4] == b'\x89PNG'


@pytest.mark.parametrize(('start', 'metres'), [('1.2566370614m/s', 0.04), ('4.024g', 0.04)])
def test_velocity_and_acceleration(tmp_path, start, metres):
    path = tmp_path / 'curve.json'
    assert main(['bench_rig', '--from', start, '--releases', '1', '--json', str(path)]) == 0
    assert json.loads(path.read_text())['amplitude'] == pytest.approx(metres, rel=1e-3)


@pytest.mark.parametrize('start', ['10', '10 kg', '-3mm', 'nan', 'ten', '0g'])
def test_refusals(start, capsys):
    with pytest.raises(SystemExit) as end:
        main(['bench_rig', f'--from={start}'])
    assert end.value.code == 2
    assert 'such as 10mm, 2m/s or 3g' in capsys.readouterr().err


def test_a_small_amplitude(capsys):
    assert main(['bench_rig', '--from', '1e-12mm', '--releases', '1']) == 0
    assert math.isfinite(float(capsys.readouterr().out.split('Ψ ')[1].split()[0]))
