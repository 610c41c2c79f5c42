"""Faulty parameters files: refused in one line, with place and remedy."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.cli.solve_periodic import main as solve_periodic
from impact_damper_ros.cli.sweep_rig import main as sweep_rig
from impact_damper_ros.rig import ParameterError, ParametersFileError, load_parameters
from impact_damper_ros.rig import parameters_file as presets
from impact_damper_ros.rig.parameters_file import MOST_BYTES, MOST_ENTRIES, YamlError, check_yaml
from rig.fuzz_parameters_file import run

ROOT = Path(impact_damper_ros.__file__).parents[1]
HEAD = '/**:\n  ros__parameters:\n'
BOMB = 'a0: &a0 [1]\n' + ''.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]\n' for k in range(1, 40)
)
HOSTILE = {
    'alias bomb': (BOMB, 'line 1: &a0 is an anchor or alias, which ROS does not read'),
    'itself': ('&a {/**: *a}', 'line 1: &a is an anchor or alias'),
    'alias alone': (HEAD + '    gap: *a\n', 'line 3: *a is an anchor or alias'),
    'merge': (HEAD + '    <<: {gap: 1.0}\n', 'line 3: "<<" merges other lines in'),
    'deep': ('/**: ' + '[' * 100_000, 'line 1: is nested more than 16 deep'),
    'deep names': (
        '\n'.join(f'{" " * k}k:' for k in range(950)),
        'line 17: is nested more than 16 deep',
    ),
    'tag': (HEAD + '    one_sided: !!bool abc\n', "line 3: 'abc' is no value of the kind bool"),
    'tag of an object': (
        HEAD + '    gap: !!python/object:os.system x\n',
        'line 3: is not YAML: could not determine a constructor',
    ),
    'date': (HEAD + '    gap: 2026-13-45\n', "line 3: '2026-13-45' is no value of the kind time"),
    'digits': (HEAD + f'    gap: {"9" * 5000}\n', 'is no value of the kind int'),
    'list for a name': (HEAD + '    ? [a]\n    : 1\n', 'stands in place of a name'),
    'twice': (
        HEAD + '    gap: 3.0\n    stiffness: 1.0\n    "gap": 4.0\n',
        "line 5: 'gap' stands there twice, first in line 3: keep one of them",
    ),
    'node twice': (HEAD + '    gap: 3.0\n' + HEAD, "line 4: '/**' stands there twice"),
    'two documents': (HEAD + '    gap: 3.0\n---\n' + HEAD, 'line 4: a second document begins'),
    'comments': ('# no\n' * 4_000_000, 'is longer than 1 MB'),
    'names': (
        HEAD + ''.join(f'    p{k}: {k}\n' for k in range(50_000)),
        'there are more than 20000 names and values',
    ),
    'entries': (
        HEAD + f'    force_amplitudes: [{", ".join(["1.0"] * 100_000)}]\n',
        'line 3: there are more than 20000 names and values',
    ),
    'escape': (HEAD + '    "\\e[2Jgab": 1.0\n', r'line 3: unknown parameter \x1b[2Jgab'),
    'control character': (
        HEAD + '    gap: \x1b[2J\n',
        r"line 3: is not YAML: holds the control character '\x1b'",
    ),
    'long name': (HEAD + f'    {"g" * 900}: 1.0\n', 'characters'),
    'long value': (HEAD + f'    gap: {"g" * 100_000}\n', 'gap is'),
    'value': (HEAD + '    gap: 3.0\n\n    angle: 45\n', 'line 5: angle is 45.0 rad: give'),
    'nothing': ('', 'holds no parameters'),
    'a list': ('[1, 2]', 'holds no parameters'),
    'colon': (HEAD + '    gap: 3.0: 4\n', 'line 3: is not YAML: mapping values are not allowed'),
}


def written(tmp_path, content):
    path = tmp_path / 'rig.yaml'
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize('case', HOSTILE)
def test_hostile_files_are_refused_in_a_line(case, tmp_path, capsys):
    content, words = HOSTILE[case]
    path = written(tmp_path, content)
    assert solve_periodic([str(path), '--impacts', '2']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'solve_periodic: {path}: ')
    assert words in line
    assert len(line) < 700
    assert line.isprintable()


@pytest.mark.parametrize('command', [simulate_rig, sweep_rig])
def test_other_commands_refuse_them_too(command, tmp_path, capsys):
    path = written(tmp_path, BOMB)
    words = ['--duration', '1'] if command is simulate_rig else ['-o', 'a.csv', '--vary', 'gap=1']
    assert command([str(path), *words]) == 2
    assert 'line 1: &a0 is an anchor' in capsys.readouterr().err
    assert sweep_rig(['paper', '--ranges', str(path), '-o', str(tmp_path / 'a.csv')]) == 2
    assert 'line 1: &a0 is an anchor' in capsys.readouterr().err


@pytest.mark.parametrize('content', [b'\xff\xfe\x00', b'a: b\n\xe9: 1\n', bytes(range(256))])
def test_files_that_are_no_text(content, tmp_path):
    words = r'line \d: (cannot be read as UTF-8 text|is not YAML: holds the control)'
    with pytest.raises(ParametersFileError, match=words):
        load_parameters(written(tmp_path, content))


def test_at_the_limits(tmp_path):
    """What is just allowed is taken."""
    count = MOST_ENTRIES // 2 - 3
    others = 'other:\n  ros__parameters:\n' + ''.join(f'    p{k}: {k}\n' for k in range(count - 3))
    text = HEAD + '    gap: 3.0\n' + others
    text += '#' * (MOST_BYTES - len(text))
    path = written(tmp_path, text)
    assert load_parameters(path)[0].gap == 3.0
    path.write_text(text + '#')
    with pytest.raises(YamlError, match='longer than 1 MB'):
        check_yaml(path)


def test_a_pipe_is_read_and_one_without_a_writer_is_not_waited_for(tmp_path):
    pipe = tmp_path / 'pipe.yaml'
    os.mkfifo(pipe)
    with pytest.raises(ParametersFileError, match='holds no parameters'):
        load_parameters(pipe)
    reading, writing = os.pipe()
    os.write(writing, f'{HEAD}    gap: 3.5\n'.encode())
    os.close(writing)
    try:
        assert load_parameters(f'/dev/fd/{reading}')[0].gap == 3.5
    finally:
        os.close(reading)


def test_fuzz():
    result = run(seed=12, count=1000)
    assert result['read'] == 1000
    # Not all is refused
    assert 10 < result['taken'] < 900


@pytest.mark.parametrize(
    'text', ['!!bool abc', '&a [*a]', '[' * 1000, '2026-13-45', '{a: 1, a: 2}']
)
def test_values_of_set_that_no_file_could_have(text, capsys):
    assert solve_periodic(['paper', '--impacts', '2', '--set', f'gap={text}']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'is not a value: ' in line
    assert len(line) < 400


def test_presets_by_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert set(presets.presets()) == {'bench_rig', 'paper'}
    assert load_parameters('bench_rig') == load_parameters(ROOT / 'config' / 'bench_rig.yaml')
    # A directory of that name is no file
    Path('bench_rig').mkdir()
    assert load_parameters('bench_rig')[0].gap == 0.024
    # A file of that name wins
    Path('bench_rig').rmdir()
    Path('bench_rig').write_text(HEAD + '    gap: 5.0\n')
    assert load_parameters('bench_rig')[0].gap == 5.0
    assert simulate_rig(['bench_rg', '--duration', '1']) == 2
    assert 'or a preset: bench_rig, paper' in capsys.readouterr().err


@pytest.mark.parametrize('layout', ['lib/python3.12/site-packages', 'local/lib/python3/x', '.'])
def test_presets_of_an_installation(layout, tmp_path):
    """As pip and colcon lay it out: the package below the prefix that has share/."""
    place = tmp_path / layout
    place.mkdir(parents=True, exist_ok=True)
    shutil.copytree(
        ROOT / 'impact_damper_ros',
        place / 'impact_damper_ros',
        ignore=shutil.ignore_patterns('__pycache__'),
    )
    share = tmp_path / 'share' / 'impact_damper_ros' / 'config'
    shutil.copytree(ROOT / 'config', share)
    code = (
        'from impact_damper_ros.rig.parameters_file import presets\n'
        'for name, path in presets().items(): print(name, path)'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'PYTHONPATH': str(place)},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    expected = [f'{name} {share / name}.yaml' for name in ('bench_rig', 'paper')]
    assert done.stdout.splitlines() == expected


@pytest.mark.parametrize('text', ['1:30', '1:30.5', '-1:0', '190:20:30'])
def test_no_number_counts_in_sixties(tmp_path, text):
    """YAML 1.1 would make 90 of the first; ROS takes all of them for texts."""
    path = tmp_path / 'rig.yaml'
    path.write_text(f'/**:\n  ros__parameters:\n    gap: {text}\n')
    with pytest.raises(ParameterError, match=f"line 3: gap is '{text}': give a number from"):
        load_parameters(path)
