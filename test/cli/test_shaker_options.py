"""`simulate_rig` on a random base, or under a measured record, as a user runs it."""

import csv
import json
import math
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from impact_damper_ros.cli import simulate_rig
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main
from impact_damper_ros.parameters.parameters_file import load_parameters

CONFIG = Path(__file__).parents[2] / 'config'
TABLE = 'f [Hz], level [g^2/Hz]\n3,1e-4\n5,1e-3\n8,1e-4\n'


@pytest.fixture
def table(tmp_path):
    path = tmp_path / 'psd.csv'
    path.write_text(TABLE)
    return path


def simulate(*words, rig='bench_rig'):
    return main([rig, *map(str, words)])


def rows_of(path):
    return list(csv.DictReader(path.read_text().splitlines()))


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
    assert (
        'transmissibility over 2 periods of 4 s, after 1; a vibration of the start has' in printed
    )
    rows = rows_of(spectra)
    columns = {name.split()[0]: np.array([float(r[name]) for r in rows]) for name in rows[0]}
    assert list(rows[0])[:2] == ['frequency [Hz]', 'base_level [(m/s^2)^2/Hz]']
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


FORCE, BASE = 't [s],force [N]\n', 't [s],a [g]\n'
#: What the options add to the refusals of any table, by option.
BAD = {
    '--base-psd': {
        'f [Hz],x [°C]\n3,1\n4,1\n': 'no column for the level',
        None: 'cannot be read (No such file or directory): give the path of a file',
    },
    '--force-psd': {TABLE: "has the unit 'g^2/Hz': write it behind the name, as level [N^2/"},
    '--force-record': {
        FORCE + '0,1\n0.1,\n0.2,1\n': "line 3, column 'force [N]': no",
        FORCE + '0,1\n0.1,nan\n0.2,1\n': 'line 3',
        FORCE + '0,1\n0.2,2\n0.1,3\n': 'the times go back: export the samples',
        FORCE + '0,1\n1,1\n2,1\n9,1\n': 'where the others are 1 s: fill the gap',
        FORCE + '0,1\n1,1\n2.4,1\n3,1\n4,1\n': 'give samples at equal intervals',
        't [s],a [g]\n0,1\n1,1\n': 'no column for the force',
    },
    '--base-record': {
        't [s],a [N]\n0,1\n1,1\n': "has the unit 'N'",
        't [s],base [mm]\n0,1\n1,1\n': "has the unit 'mm'",
        BASE + '0,1\n1,1\n2,1\n': '3 samples: give 4 to',
        't [ms],a [g]\n0,1\n1,1\n2,1\n3,1\n': 'lasts 0.003 s, less than a natural cycle',
        BASE + '0,1\n1,high\n': "'high' is no number",
    },
    '--sweep-levels': {
        'f [Hz],level [g]\n4,1\n5,0\n': "column 'level [g]': 0: give a positive number",
        'f [Hz],level [kg]\n4,1\n5,1\n': 'kg',
    },
}


@pytest.mark.parametrize(
    ('option', 'text', 'problem'),
    [(option, *row) for option, rows in BAD.items() for row in rows.items()],
)
def test_bad_tables(tmp_path, capsys, option, text, problem):
    path = tmp_path / 'table.csv'
    if text is not None:
        path.write_text(text)
    assert swept('--duration', 1, option, path) == 2
    printed = capsys.readouterr().err
    assert problem in printed
    assert 'Traceback' not in printed


@pytest.mark.parametrize(
    'words',
    [
        '',
        '--base-psd psd.csv --psd-lines 20',
        '--set sweep_mode=up --change 1:gap=9',
        '--set base_amplitudes=0.1g --set base_frequencies=3Hz',
    ],
)
def test_a_motion_is_drawn(words, table, monkeypatch):
    """Where no response over frequency is: at 64 instants a cycle, and m at its impacts, too."""
    drawn = []
    monkeypatch.chdir(table.parent)
    monkeypatch.setattr(simulate_rig, 'draw', lambda *given: drawn.append(given))
    outputs = ('--figure', 'a.png', '--states', 's.csv', '--impacts', 'i.csv')
    assert simulate('--duration', 2, *outputs, *words.split()) == 0
    ((path, draw, motion, records, title),) = drawn
    assert (path, records, draw) == (Path('a.png'), [], simulate_rig.record_figure)
    rows = rows_of(Path('s.csv'))
    assert len(motion.times) == 642
    times = np.array([float(row['time']) for row in rows])
    x, z, stop = (np.array([float(r[name]) for r in rows]) for name in ('x', 'z', 'stop_1'))
    assert np.interp(motion.times, times, x) == pytest.approx(motion.displacement, abs=1e-3)
    instants, y = motion.offset
    assert np.interp(instants, times, z - x) == pytest.approx(y, abs=2e-3)
    hits = [float(row['time']) for row in rows_of(Path('i.csv'))]
    assert np.isin(hits, instants).all()
    sides = (
        2.0
        * y[np.isin(instants, hits)]
        / np.interp(hits, motion.times, np.ptp(motion.stops, axis=1))
    )
    assert abs(sides) == pytest.approx(1.0)
    assert np.interp(0.9, times, stop - x) == pytest.approx(motion.stops[0, 0])
    figure = draw(motion, records, title)
    primary, damper = figure.axes
    assert np.ptp(primary.lines[0].get_ydata()) > 0.0
    assert primary.get_ylabel().startswith('X [')
    assert len(damper.lines) == 3


def test_records_of_force_and_base(tmp_path, capsys):
    """The tables, the figure and the words of both."""
    states, impacts, figure = (tmp_path / name for name in ('s.csv', 'i.csv', 'f.png'))
    records = ('--base-record', CONFIG / 'base_record.csv')
    outputs = ('--states', states, '--impacts', impacts, '--figure', figure)
    assert simulate('--set', 'force_amplitudes=0', *records, *outputs) == 0
    printed = capsys.readouterr().err
    assert 'base_record.csv: acceleration of the base of 1000 samples in 19.98 s, 50 Hz' in printed
    # As long as the record, whose last sample is held for half an interval, too
    assert 'simulated   19.99 s' in printed
    assert 'largest |X|' not in printed
    shown = dict(line.split(maxsplit=1) for line in printed.splitlines()[-2:])
    largest = float(shown['records'].split()[3])
    rows = rows_of(states)
    apart = [abs(float(row['x']) - float(row['base'])) for row in rows]
    assert max(apart) == pytest.approx(largest, rel=0.02)
    assert f"b' = {float(rows[-1]['base_velocity']):.3g}"[:9] in shown['base']
    assert len(impacts.read_text().splitlines()) > 20
    assert figure.read_bytes()[:4] == b'\x89PNG'
    blow = ('--force-record', CONFIG / 'force_record.csv', '--set', 'force_amplitudes=0')
    assert simulate(*blow, '--set', 'gap=10', '--set', 'friction=0', '--duration', 3) == 0
    # The impulse is 60 N 8 ms/2; M of 2 kg then swings with omega = 31.4/s.
    expected = 60.0 * 0.008 / 2.0 / 2.0 / math.sqrt(1974.0 / 2.0)
    shown = dict(line.split(maxsplit=1) for line in capsys.readouterr().err.splitlines()[-1:])
    assert float(shown['records'].split()[1]) == pytest.approx(expected, rel=0.03)


def test_a_file_of_a_rig_with_a_record(tmp_path, capsys):
    """The parameters file of a node with a record is the same rig to the command."""
    rig, states = tmp_path / 'rig.yaml', [tmp_path / f'{name}.csv' for name in ('a', 'b')]
    text = (CONFIG / 'bench_rig.yaml').read_text()
    record = CONFIG / 'force_record.csv'
    rig.write_text(f'{text.rstrip()}\n    force_record: {record}\n')
    assert simulate('--quiet', '--states', states[0], rig=str(rig)) == 0
    assert simulate('--quiet', '--states', states[1], '--force-record', record) == 0
    assert states[0].read_text() == states[1].read_text()
    assert len(states[0].read_text().splitlines()) == 201
    words = ('--quiet', '--duration', 1, '--set', 'force_record=none')
    assert simulate(*words, '--states', states[0], rig=str(rig)) == 2
    capsys.readouterr()


def test_a_file_is_obeyed_wholly_or_refused(tmp_path, monkeypatch, capsys):
    """Records and a law of a parameters file, and of one that is written."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    Path('own.py').write_text('def still(seen, memory):\n    return 0.006, -0.006\n')
    law = ('--law', 'own:still', '--duration', 1)
    record = ('--force-record', CONFIG / 'force_record.csv')
    for number, options in enumerate((record, law, (*record, *law))):
        out, tables = f'{number}.yaml', (f'{number}a.csv', f'{number}b.csv')
        assert simulate(*options, '--rig-out', out, '--states', tables[0]) == 0
        again = [] if options == record else ['--duration', 1]
        assert simulate(*again, '--states', tables[1], rig=out) == 0
        assert Path(tables[0]).read_text() == Path(tables[1]).read_text()
    capsys.readouterr()
    for command, words, why in (
        ('sweep_rig', '0.yaml --vary gap=1,2 -o a.csv', 'force_record is'),
        ('solve_periodic', '0.yaml --impacts 2', 'force_record is'),
        ('solve_periodic', '1.yaml --impacts 2', 'gap_control is timed: this command is for'),
        ('ring_down', '1.yaml --from 9mm', 'gap_control is timed: this command is for stops'),
        ('design_damper', '--check 1.yaml', 'gap_control is timed: this command is for stops'),
        ('fit_rig', '0a.csv --rig 0.yaml', 'force_record is'),
    ):
        assert import_module(f'impact_damper_ros.cli.{command}').main(words.split()) == 2
        assert why in capsys.readouterr().err
    # Released, it has neither force nor record; swept, it has its law
    words = '0.yaml --from 9mm --releases 1'
    assert import_module('impact_damper_ros.cli.ring_down').main(words.split()) == 0
    few = '1.yaml --vary gap=0.02,0.03 --cycles 2 --watch 21 -o a.csv'
    assert import_module('impact_damper_ros.cli.sweep_rig').main(few.split()) == 0
    assert '"law": "own:still"' in Path('a.csv').read_text()


def test_a_fine_record_is_the_harmonic_force(tmp_path, capsys):
    """The file of a sine at 2 kHz moves the rig as the parameters do."""
    path, tables = tmp_path / 'sine.csv', [tmp_path / f'{name}.csv' for name in ('a', 'b')]
    times = np.arange(0.0, 3.0, 5e-4)
    rows = [f'{1e3 * t:.10g},{1.2 * math.sin(31.416 * t):.10g}' for t in times]
    path.write_text('\n'.join(['time [ms],load [N]', *rows]) + '\n')
    assert simulate('--duration', 2, '--quiet', '--impacts', tables[0]) == 0
    words = ('--set', 'force_amplitudes=0', '--force-record', path, '--impacts', tables[1])
    assert simulate('--duration', 2, *words) == 0
    one, other = map(rows_of, tables)
    assert [row['stop'] for row in one] == [row['stop'] for row in other]
    assert [float(row['time']) for row in one] == pytest.approx(
        [float(row['time']) for row in other], abs=3e-5
    )
    assert 'records     |X| ' in capsys.readouterr().err


def test_a_recorded_run_under_records_is_replayed_and_measured_without_theory(tmp_path, capsys):
    """A bag has copies of the records; each stretch is measured at its samples and events."""
    bag, again, found = (tmp_path / name for name in ('bag', 'again.csv', 'found.json'))
    tables = {name: tmp_path / f'{name}.csv' for name in ('states', 'impacts')}
    words = [
        f'--{quantity}-record={CONFIG / f"{quantity}_record.csv"}'
        for quantity in ('force', 'base')
    ]
    words += ['--duration', 3, '--change', '1.0037:gap=0.004', '--set', 'force_amplitudes=0']
    outputs = [word for name, path in tables.items() for word in (f'--{name}', path)]
    assert simulate(*words, '--bag', bag, *outputs) == 0
    assert replay_run([str(bag), '--states', str(again)]) == 0
    assert 'identical: the run is reproduced bit for bit' in capsys.readouterr().out
    rows = rows_of(tables['states'])
    replayed = [(row['x'], row['base']) for row in rows_of(again)]
    assert replayed == [(row['x'], row['base']) for row in rows]
    assert compare_run([str(bag), '--score']) == 2
    assert 'a measured record acts on its rig' in capsys.readouterr().err
    hits = tables['impacts'].read_text().count(',impact\n')
    assert hits > 5
    time, x = (np.array([float(row[name]) for row in rows]) for name in ('time', 'x'))
    assert compare_run([str(bag), '--json', str(found), '--report', str(tmp_path)]) == 0
    result = json.loads(found.read_text())
    assert (result['overall']['impacts'], result['overall']['force_work']) == (hits, None)
    for stretch, inside in zip(result['stretches'], (time < 1.0037, time > 1.0037), strict=True):
        assert (stretch['log'], stretch['verdict']) == ('reproduced', 'no prediction')
        assert 'a measured record acts on the rig' in stretch['sentence']
        overall = stretch['overall']
        assert np.abs(x[inside]).max() <= overall['x_max'] < 1.05 * np.abs(x).max()
        late = inside & (time >= stretch['measured']['start'])
        for part, samples in ((overall, inside), (stretch['measured'], late)):
            assert part['x_rms'] == pytest.approx(np.sqrt(np.mean(x[samples] ** 2)), rel=1e-9)
    # A what-if run is measured in the same way.
    assert replay_run([str(bag), '--set', 'gap=0.004', '--json', str(found)]) == 0
    both = json.loads(found.read_text())['what_if']
    assert both['recorded']['x_rms'] == result['overall']['x_rms']
    assert both['recorded']['x_rms'] != both['what_if']['x_rms'] > 0.0


# Sweeps


SWEEP = (
    *('force_amplitudes=0', 'base_amplitudes=0.06g', 'sweep_mode=up_down', 'sweep_low=4Hz'),
    *('sweep_high=6Hz', 'sweep_step=0.5Hz', 'sweep_dwell=4'),
)
NOTCHED = 'f [Hz],level [g]\n4.6,0.06\n4.8,0.02\n5.2,0.02\n5.4,0.06\n'


def swept(*words, settings=SWEEP):
    words = [*words, *(word for setting in settings for word in ('--set', setting))]
    return simulate('--duration', 36, *words)


def test_the_response_to_a_sweep(tmp_path, capsys):
    response, figure = tmp_path / 'response.csv', tmp_path / 'response.pdf'
    assert swept('--response', response, '--figure', figure) == 0
    rows = rows_of(response)
    assert [(r['way'], round(float(r['frequency [Hz]']), 9)) for r in rows] == [
        *(('up', 4.0 + 0.5 * k) for k in range(5)),
        *(('down', 5.5 - 0.5 * k) for k in range(4)),
    ]
    for row in rows:
        assert float(row['level [g]']) == pytest.approx(0.06, rel=1e-6)
        hertz, mm = float(row['frequency [Hz]']), float(row['x without damper [mm]'])
        spring = 1974.0 + 1.26j * math.tau * hertz
        base = 60.0 * 9.80665 / (math.tau * hertz) ** 2
        expected = base * abs(spring / (spring - 2.0 * (math.tau * hertz) ** 2))
        assert mm == pytest.approx(expected, rel=1e-6)
        ratios = (float(row[f'transmissibility{of}']) for of in ('', ' without damper'))
        sizes = (float(row[name]) for name in ('x [mm]', 'x without damper [mm]'))
        assert list(ratios) == pytest.approx([size / base for size in sizes], rel=1e-6)
        assert float(row['acceleration without damper [g]']) == pytest.approx(
            mm * (math.tau * hertz) ** 2 / 9806.65, rel=1e-6
        )
    at_resonance = [float(r['x [mm]']) for r in rows if r['frequency [Hz]'] == '5']
    assert all(value < 10.0 for value in at_resonance)
    assert figure.read_bytes()[:4] == b'%PDF'
    printed = capsys.readouterr().err
    assert 'sweep       9 frequencies from 4 Hz to 6 Hz at 0.06 g' in printed
    assert 'largest |X|' in printed
    assert 'without damper 29.' in printed


def test_a_notched_sweep(tmp_path, capsys):
    table, response, rig = (tmp_path / n for n in ('levels.csv', 'response.csv', 'rig.yaml'))
    table.write_text(NOTCHED)
    assert swept('--sweep-levels', table, '--response', response, '--rig-out', rig) == 0
    levels = [float(r['level [g]']) for r in rows_of(response)]
    assert levels == pytest.approx(
        [0.06, 0.06, 0.02, 0.06, 0.06, 0.06, 0.02, 0.06, 0.06], rel=1e-6
    )
    parameters = load_parameters(rig)[0]
    assert parameters.base_quantity == 'acceleration'
    assert parameters.sweep_notch_factors == pytest.approx((1.0, 1 / 3, 1 / 3, 1.0))
    # A table of forces, in newtons, acts on M.
    table.write_text('Frequenz [Hz];Kraft [N]\n4;1,5\n6;0,5\n')
    assert swept('--sweep-levels', table, '--response', response, settings=SWEEP[2:]) == 0
    assert "reads frequency 'Frequenz [Hz]', level 'Kraft [N]'" in capsys.readouterr().err
    levels = [float(r['level [N]']) for r in rows_of(response)]
    assert levels[::4] == pytest.approx([1.5, 0.5, 1.5])
    assert 'x - b [mm]' not in rows_of(response)[0]
