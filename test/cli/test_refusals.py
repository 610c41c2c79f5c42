"""What each command refuses, before any work: a line that says why, exit code 2, no file."""

import shutil
import sys
from importlib import import_module
from pathlib import Path

import pytest

from impact_damper_ros.cli import command_line

TWIN = Path(__file__).parents[2] / 'examples' / 'twin'
BLOW = TWIN.parents[1] / 'config' / 'force_record.csv'
#: Arguments with which a command works, before those that it refuses.
GIVEN = {
    'compare_run': 'no_bag',
    'design_damper': '--mass 5kg --frequency 10Hz --damping-ratio 2%',
    'fit_rig': '',
    'replay_run': 'no_bag',
    'rig_page': '',
    'ring_down': 'bench_rig',
    'simulate_rig': 'paper --duration 80',
    'solve_periodic': 'paper --set gravity=0',
    'sweep_rig': 'paper -o a.parquet --set gravity=0',
}
FIGURE = 'give a name that ends in .png, .svg or .pdf'
REFUSALS = {
    'compare_run': [
        ('--json no_bag', 'is an input, or lies in one'),
        ('--report=', 'the name is empty: give that of a file or directory'),
        ('', "cannot read 'no_bag': there is no such file or directory; name a bag directory"),
    ],
    'design_damper': [
        ('--base 0.2kg', "'kg' is no unit of it"),
        ('--base 0', 'the excitation is 0'),
        ('--base 1mm --force 1N', 'not allowed with'),
        ('--base 1mm --mass-ratio 10%:1%', 'LOW:HIGH with the low end first'),
        ('--base 1mm --restitution 1.2', 'restitution_1 is 1.2: give a number'),
        ('--base 1mm --restitution 0.5-0.7', 'a range is LOW:HIGH: write 0.5:0.7'),
        ('--base 1mm --levels 200%:300%', 'give a range of factors around 1'),
        ('--base 1mm --damping-ratio 0', '--damping-ratio is 0'),
        ('--base 1mm --damping-ratio 2', 'from 0 to 0.9999, or 2 %'),
        ('--base 1mm --mass-ratio 5', 'give at most 1, or 5%'),
        ('--base 1mm --mass nan', 'primary_mass'),
        ('--base 1mm --mass -5kg', 'primary_mass is -5.0 kg: give a number from'),
        ('', 'the excitation is not known: give --base or --force'),
    ],
    'fit_rig': [
        ('', 'the following arguments are required: FILE'),
        ('no.csv --rig bench_rig', 'no.csv: cannot be read (No such file'),
        ('free.csv', 'masses and force are not known: give the parameters file'),
        ('free.csv --structure --rig-out o.yaml', '--rig-out needs the masses'),
        ('free.csv --structure --from 9s', 'no samples from 9 to inf s: give a part'),
        ('free.csv --structure --saturation 16g', '--saturation is an acceleration'),
        ('free.csv --structure --saturation 16', 'acceleration with its unit, such as 10mm'),
        ('free.csv --structure --column y', "no column 'y' for the motion among"),
        ('free.csv --rig rig.yaml --also mass', "invalid choice: 'mass'"),
        ('start.csv --structure --json start.csv', 'is an input, or lies in one'),
    ],
    'replay_run': [
        ('', "cannot read 'no_bag': there is no such file or directory; name a bag directory"),
        ('--set gap=1 --figure a.gif', f'a.gif: {FIGURE}'),
        ('--set gap=1 --figure a', f'a: {FIGURE}'),
        ('--states no_bag/a.mcap', 'is an input, or lies in one: give the output another name'),
        ('--states a.csv --impacts a.csv', 'two outputs have the same name'),
        ('--states - --json -', 'two outputs go to the standard output: give one of them a file'),
        ('--json=', 'the name is empty: give that of a file or directory'),
    ],
    'rig_page': [
        ('--bag m.csv', 'm.csv is no bag: give a file .mcap, or a'),
        ('--bag no_bag', 'no_bag: there is no such bag or directory'),
        *(
            (f'--port={port}', f'{port!r}: give a whole number from 0 to 65535')
            for port in ('abc', '-1', '65536', '80.0', '')
        ),
        ('--node a-b', "'a-b': no node has such a name; give one such as /sim_node"),
    ],
    'ring_down': [
        (f'--from={start}', 'such as 10mm, 2m/s or 3g')
        for start in ('10', '10kg', '-3mm', 'nan', 'ten', '0g')
    ],
    'simulate_rig': [
        # Of a rig all at once: the table is asked, and what is said has the place before it
        ('--set gap=-1 --set angle=0.1', 'gap is -1.0 m: give a number from 1e-09 to 1e+09 m'),
        ('--set gap', '--set gap: give NAME=VALUE'),
        ('--set gap=3 --set gap=4', '--set gap=4: gap is given twice: give it once'),
        ('--change 2:gap=30 --change 2s:gap=31', 'gap=31: gap is given twice: give it once'),
        ('--set gap:=3', '--set gap:=3: write gap=3'),
        ('--set gab=3', '--set gab=3: there is no parameter gab to set: did you mean gap?'),
        ('--set restitution=0.6', 'did you mean restitution_1 and restitution_2?'),
        ('--set xyzzy=3', 'simulate_rig --parameters lists all parameters'),
        ('--set initial_damper_offset=20', '18.5'),
        *(
            (f'--change {at}:gap=30', 'above 0 s and up to the 80 s of the run')
            for at in ('90', '0', 'nan')
        ),
        ('--change gap=30', 'give TIME:NAME=VALUE'),
        ('--change 5:gap=-3', '--change at 5 s: gap is -3'),
        *((f'--duration {t}', 'from 1e-09 to 1e+13 s') for t in ('nan', '1e-320', '1e14')),
        *((f'--rate {rate}', 'from 1e-12 to 1e+09 Hz') for rate in ('inf', '1e-320', '1e300')),
        ('--bag=', 'the name is empty: give that of a file or directory'),
        ('--states a.csv --rate 1e9', '8e+10 samples: give a rate of at most 1.25e+07 Hz'),
        ('--bag m --states m', 'two outputs have the same name'),
        ('--sweep-levels m.csv', '--sweep-levels needs a sweep: give --set sweep_mode=up'),
        ('--max-bag-size 7', 'give 0 (no limit) or a number from 100000 to 1e+15 B'),
        ('--states a.csv --impacts a.csv', 'two outputs have the same name'),
        ('--law catch', 'the law catch'),
        ('--law no_such_module:catch', 'the law no_such_module:catch'),
        ('--law math:catch', 'the law math:catch'),
        (
            '--duration 1 --base-psd psd.csv --transmissibility t.csv',
            'repeats after 40 s: give a --duration of at least 40 s',
        ),
        ('--transmissibility t.csv', 'give --base-psd, or leave it out'),
        (
            f'--set stiffness=50 --force-record {BLOW} --transmissibility t.csv',
            'without records or a sweep: leave it out',
        ),
        ('--response r.csv', '--response needs a sweep: give --set sweep_mode=up, too'),
        (
            '--set sweep_mode=up --response r.csv --change 3:gap=20',
            'leave it out, or --change and the records',
        ),
    ],
    'solve_periodic': [
        ('', '--impacts'),
        *((f'--impacts {text}', '--impacts') for text in ('0', 'x', '3:2', '1:2:3')),
        ('--impacts 2 --stops 1,3', '--stops'),
        ('--impacts 2 --set gap_max=20', 'there is no parameter gap_max to set'),
        ('--impacts 3 --stops 1,2', '--stops 1,2 names 2 impacts'),
        ('--impacts 2 --stops 1,2 --set one_sided=true', 'no stop 2'),
        ('--impacts 2 --set force_amplitudes=[0]', 'give force_amplitudes or base_amplitudes'),
        (
            '--impacts 2 --set force_amplitudes=[1,1] --set force_frequencies=[1,2.5] '
            '--set force_phases=[0,0]',
            'turns 2.5 times in 1 cycle of the first one',
        ),
        ('--impacts 9', 'name one, such as 1,2,1,2,1,2,1,2,1'),
        ('--impacts 2 --follow gap', '--follow'),
        ('--impacts 2 --follow gap=60:20', '--follow'),
        ('--impacts 2 --follow gap=20:', '--follow'),
        ('--impacts 2 --follow gravy=1:2', 'gravy'),
        (
            '--impacts 2 --follow gap=1:40 --csv a.csv --json a.csv',
            'two outputs have the same name',
        ),
        ('--impacts 2 --follow gap=20:60 --figure a.bmp', FIGURE),
        (
            '--impacts 2 --follow restitution=0.4:0.9 --set restitution_2=0.8',
            'vary restitution_1 or restitution_2',
        ),
        ('--settled --set force_amplitudes=[0]', 'give force_amplitudes or base_amplitudes'),
    ],
    'sweep_rig': [
        ('', 'nothing is varied'),
        ('--vary gab=1:2:3', "'gab' is not a parameter of the rig: did you mean gap?"),
        ('--vary gap=1:2:0', 'gap=1:2:0: 0 values'),
        ('--vary gap=nan:2:3', "'nan' is not a finite number"),
        (
            '--vary angle=0:45:4',
            'angle: angle is 15.0 rad: give a number from -1.5708 to 1.5708 rad (10° = 0.1745',
        ),
        ('--vary gap_min=1,2', 'gap_min is varied, but gap_control is off'),
        ('--vary initial_damper_offset=0,1 --follow up', 'cannot be followed'),
        ('--vary gap=1,2 --set sweep_mode=up', 'has no steady state; give --set sweep_mode=off'),
        ('--vary gap=1,2 --cycles 0', 'cycles is 0: give a whole number'),
        ('--vary gap=1,2 --figure a.gif', 'a name that ends in .png, .svg or .pdf'),
        ('--vary gap=1,2 --figure a.parquet', 'two outputs have the same name'),
        (
            '--vary gap=1 --vary friction=0 --vary angle=0 --figure a.png',
            'a figure shows one axis or two, not 3',
        ),
        *(
            (f'--vary gap=1,2 -o {name}', 'a name that ends in .parquet')
            for name in ('a.txt', 'a', 'a.parquet.bak', '.csv')
        ),
    ],
}
ROWS = [(command, *row) for command, rows in REFUSALS.items() for row in rows]


def run(command, words):
    """Run a command in this process, and return its exit code."""
    try:
        return import_module(f'impact_damper_ros.cli.{command}').main(words)
    except SystemExit as ended:
        return ended.code


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Go to a directory of some files that are wrong."""
    (tmp_path / 'm.csv').write_text('f [Hz],level [g]\n4,1\n5,1\n')
    (tmp_path / 'psd.csv').write_text('f [Hz],level [g^2/Hz]\n3,1e-4\n8,1e-4\n')
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(('command', 'words', 'message'), ROWS)
def test_what_is_wrong_is_said_before_any_work(command, words, message, place, capsys):
    pytest.importorskip('pyarrow')
    if command == 'fit_rig':
        for name in ('free.csv', 'start.csv', 'rig.yaml'):
            shutil.copy(TWIN / name, place)
    there = sorted(place.iterdir())
    assert run(command, [*GIVEN[command].split(), *words.split()]) == 2
    said = capsys.readouterr()
    assert said.out == ''
    line = said.err.splitlines()[-1]
    assert line.startswith(f'{command}: ')
    assert message in line.replace("law '", 'law ')
    assert sorted(place.iterdir()) == there


@pytest.mark.parametrize(
    ('command', 'words'),
    [
        ('compare_run', '--report'),
        ('compare_run', '--json'),
        ('replay_run', '--json'),
        ('replay_run', '--set gap=0.02 --bag'),
        ('simulate_rig', '--bag'),
        ('replay_run', '--set gap=0.02 --figure'),
        ('solve_periodic', '--impacts 2 --stops 1 --json'),
        ('sweep_rig', '--vary gap=1,2 --figure'),
        ('sweep_rig', '--vary gap=1,2 --json'),
    ],
)
@pytest.mark.usefixtures('place')
def test_a_place_that_cannot_be_written(command, words, capsys):
    """Found out first: each has something else to complain of, once the work has begun."""
    assert run(command, [*GIVEN[command].split(), *words.split(), 'm.csv/place.png']) == 1
    said = capsys.readouterr()
    assert 'cannot write m.csv/place.png: a part of the path is a file' in said.err
    assert (said.out, said.err.count('\n')) == ('', 1)


@pytest.mark.parametrize('command', ['simulate_rig', 'replay_run'])
def test_a_bag_that_exists_is_left_alone(command, place, capsys):
    (place / 'run').mkdir()
    assert run(command, [*GIVEN[command].split(), '--set', 'gap=0.02', '--bag', 'run']) == 1
    assert 'cannot write run: it exists already: choose another name' in capsys.readouterr().err
    assert list((place / 'run').iterdir()) == []


@pytest.mark.parametrize(
    ('command', 'words'),
    [
        ('compare_run', '--report report'),
        ('replay_run', '--set gap=0.02 --figure a.png'),
        ('sweep_rig', '--vary gap=5:9:2 --figure a.png'),
    ],
)
def test_a_missing_matplotlib(command, words, place, monkeypatch, capsys):
    monkeypatch.setattr(command_line, 'find_spec', lambda _: None)
    there = sorted(place.iterdir())
    assert run(command, [*GIVEN[command].split(), *words.split()]) == 2
    assert 'matplotlib, which draws the figures, is not installed' in capsys.readouterr().err
    assert sorted(place.iterdir()) == there


@pytest.mark.parametrize(
    ('missing', 'words', 'message'),
    [
        ('pyarrow', '', '"pip install pyarrow", or the package with its extra [sweep], or'),
        ('pandas', '', '"pip install pandas", or the package with its extra [sweep], or'),
        ('pandas', '-o a.csv --figure a.png', 'pandas, which makes figures'),
    ],
)
def test_a_missing_library_of_sweeps(missing, words, message, place, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, missing, None)
    there = sorted(place.iterdir())
    given = [*GIVEN['sweep_rig'].split(), '--vary', 'gap=1,2', *words.split()]
    assert run('sweep_rig', given) == 2
    assert message in capsys.readouterr().err
    assert sorted(place.iterdir()) == there


def test_a_sweep_into_csv_without_pandas(place, monkeypatch, capsys):
    for name in ('pandas', 'pyarrow'):
        monkeypatch.setitem(sys.modules, name, None)
    given = [*GIVEN['sweep_rig'].split(), '--vary', 'gap=1,2', '-o', 'a.csv']
    assert run('sweep_rig', given) == 0
    capsys.readouterr()
    table = (place / 'a.csv').read_bytes()
    assert run('sweep_rig', given) == 0
    assert '2 rigs' in capsys.readouterr().err
    assert (place / 'a.csv').read_bytes() == table


@pytest.mark.parametrize('text', ['', '{', 'other:\n  a: 1\n'])
def test_files_that_hold_no_rig(text, place, capsys):
    (place / 'rig.yaml').write_text(text)
    for command in ('simulate_rig', 'solve_periodic', 'sweep_rig'):
        words = GIVEN[command].replace('paper', 'rig.yaml').split()
        words += ['--impacts', '2'] if command == 'solve_periodic' else []
        assert run(command, words) == 2
        assert capsys.readouterr().err.startswith(f'{command}: rig.yaml')


@pytest.mark.parametrize('name', ['nowhere.yaml', 'bench_rig', '/'])
def test_a_node_without_its_parameters_file(name, capsys):
    """A sentence with the remedy, before ROS is loaded."""
    from impact_damper_ros.cli.sim_node import main as sim_node

    assert sim_node(['--ros-args', '-p', 'gap:=0.02', '--params-file', name]) == 2
    text = capsys.readouterr().err
    assert f"--params-file '{name}': there is no such file" in text
    assert text.rstrip().endswith('bench_rig.yaml')
