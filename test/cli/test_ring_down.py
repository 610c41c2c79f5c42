"""`ring_down` as a user runs it."""

import csv
import json
import math

import pytest

from impact_damper_ros import load_parameters
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.ring_down import main
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.parameters.parameters_file import rig_yaml


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


def test_a_small_amplitude(capsys):
    assert main(['bench_rig', '--from', '1e-12mm', '--releases', '1']) == 0
    assert math.isfinite(float(capsys.readouterr().out.split('Ψ ')[1].split()[0]))


def test_of_a_recording_is_that_of_the_rig(tmp_path, capsys):
    """M is let go at 40 mm with m at rest in the middle: the first of the releases."""
    bag, compared, ringing = (tmp_path / name for name in ('bag', 'c.json', 'r.json'))
    start = ['--set', 'force_amplitudes=0', '--set', 'initial_primary_position=40mm']
    words = ['bench_rig', *start, '--duration', '30', '--bag', str(bag), '--quiet']
    assert simulate_rig(words) == 0
    assert compare_run([str(bag), '--json', str(compared), '--report', str(tmp_path / 'r')]) == 0
    text = capsys.readouterr().out
    assert 'no force acts, and the base is at rest' in text
    assert 'from 36.' in text
    words = ['bench_rig', '--from', '40mm', '--releases', '1', '--json', str(ringing)]
    assert main(words) == 0
    here = json.loads(compared.read_text())['stretches'][0]['ring_down']
    there = json.loads(ringing.read_text())
    assert here['cycles'] > 15
    names = 'cycles', 'dashpot_loss', 'bound'
    # It ends at a hundredth of its own first amplitude, which is a little less than 40 mm
    assert there['cycles'] - 1 <= here['cycles'] <= there['cycles'] + 1
    assert [here[name] for name in names[1:]] == pytest.approx([there[name] for name in names[1:]])
    both = zip(here['curve']['median'][::-1], there['curve']['median'][::-1], strict=False)
    largest = [pair for pair, _ in zip(both, range(3), strict=False)]
    assert [one for one, _ in largest] == pytest.approx([other for _, other in largest])
    page = (tmp_path / 'r' / 'report.html').read_text()
    assert 'Loss of a cycle over amplitude' in page


def test_of_a_recording_begins_where_the_force_ends(tmp_path, capsys):
    bag, compared = tmp_path / 'bag', tmp_path / 'c.json'
    words = ['bench_rig', '--duration', '20', '--change', '8:force_amplitudes=0']
    assert simulate_rig([*words, '--bag', str(bag), '--quiet']) == 0
    assert compare_run([str(bag), '--json', str(compared)]) == 0
    first, second = json.loads(compared.read_text())['stretches']
    assert first['ring_down'] is None
    assert second['ring_down']['amplitude'] == pytest.approx(2.6e-3, rel=0.3)
    assert 'loss factor' in capsys.readouterr().out


def test_a_cycle_of_a_free_vibration_is_one_of_the_spring(tmp_path):
    """Also where the file gives the force, which has no amplitude, some frequency."""
    rig = load_parameters('bench_rig')[0]
    still, bag, compared = tmp_path / 'still.yaml', tmp_path / 'bag', tmp_path / 'c.json'
    still.write_text(rig_yaml(rig.replace(force_amplitudes=0.0, force_frequencies=1.0), 'Still'))
    words = ['--set', 'initial_primary_position=0.03', '--duration', '4', '--quiet']
    assert simulate_rig([str(still), *words, '--bag', str(bag)]) == 0
    assert compare_run([str(bag), '--json', str(compared)]) == 0
    measured = json.loads(compared.read_text())['stretches'][0]['measured']
    cycles = (measured['end'] - measured['start']) * rig.omega / math.tau
    assert measured['impacts'] > 0
    assert measured['impacts_per_cycle'] == pytest.approx(measured['impacts'] / cycles)
