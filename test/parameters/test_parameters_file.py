"""Parameters files: what ROS takes is taken, what is faulty is refused in a line with a remedy."""

import math
import os
import random
import shutil
import string
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

import impact_damper_ros
from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    ParameterError,
    ParametersFileError,
    RigParameters,
    load_parameters,
)
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.cli.solve_periodic import main as solve_periodic
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.parameters_file import MOST_BYTES, YamlError, presets, read_yaml
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS, PARAMETER_SPECS

ROOT = Path(impact_damper_ros.__file__).parents[1]
HEAD = '/**:\n  ros__parameters:\n'
BOMB = 'a0: &a0 [1]\n' + ''.join(
    f'a{k}: &a{k} [{", ".join([f"*a{k - 1}"] * 9)}]\n' for k in range(1, 40)
)
BOMB_OF_NODES = 'a0: &a0 {b: {c: 1}}\n' + ''.join(
    f'a{k}: &a{k} {{{", ".join(f"n{j}: *a{k - 1}" for j in range(9))}}}\n' for k in range(1, 40)
)


def written(tmp_path, content):
    path = tmp_path / 'rig.yaml'
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    'key', ['/**', 'sim_node', '/sim_node', '/ns/sim_node', '/a/b/sim_node', '"/**/sim_node"']
)
def test_good(tmp_path, key):
    text = (
        f'{key}:\n  ros__parameters:\n    gap: 30\n    damping: 1e-3\n    one_sided: true\n'
        '    force_amplitudes: [1, 2.5]\n    force_frequencies: [1e0, 2]\n    sweep_mode: off\n'
        '    force_phases: [0, -1E+0]\n    initial_damper_offset: -3\n    state_rate: 200\n'
        '    multisine_lines: 37.0\n'
    )
    # Those of other nodes do not matter.
    text += 'camera:\n  ros__parameters:\n    gap: -1\n'
    rig, initial, other = load_parameters(written(tmp_path, text))
    assert rig == RigParameters(
        gap=30.0,
        damping=0.001,
        one_sided=True,
        force_amplitudes=(1.0, 2.5),
        force_frequencies=(1.0, 2.0),
        force_phases=(0.0, -1.0),
        multisine_lines=37,
    )
    assert initial == InitialConditions(initial_damper_offset=-3.0)
    assert other == {'state_rate': 200}


@pytest.mark.parametrize('number', ['1e-3', '1.e-3', '.001', '1.0e-03', '0.001', '+1E-3'])
def test_numbers(tmp_path, number):
    assert load_parameters(written(tmp_path, f'{HEAD}    damping: {number}\n'))[0].damping == 1e-3


SIM_NODE = 'sim_node:\n  ros__parameters:\n    gap: 30.0\n'


@pytest.mark.parametrize(
    ('text', 'gap'),
    [
        (SIM_NODE + HEAD + '    gap: 20.0\n', 20.0),
        (HEAD + '    gap: 20.0\n' + SIM_NODE, 30.0),
        (HEAD + '    gap: 20.0\n' + SIM_NODE + '---\n' + HEAD + '    gap: 25.0\n', 30.0),
        (SIM_NODE + '---\n# no more\n---\n' + HEAD + '    gap: 25.0\n', 25.0),
        ('/rig1/**: {ros__parameters: {gap: 1.0}}\n' + HEAD + '    friction: 0.5\n', 1.0),
    ],
)
def test_the_last_block_counts(tmp_path, text, gap):
    """As for the node; test/node/test_rig_parameters.py compares this with rclpy."""
    for encoding in ('utf-8', 'utf-8-sig', 'utf-16'):
        assert load_parameters(written(tmp_path, text.encode(encoding)))[0].gap == gap


RIG_2 = '/rig2/sim_node: {ros__parameters: {gap: 2.0}}\n'
TWO_RIGS = f'/rig1/sim_node: {{ros__parameters: {{gap: 1.0}}}}\n{RIG_2}'


@pytest.mark.parametrize(
    ('text', 'names'),
    [
        (TWO_RIGS, ['/rig1/sim_node', '/rig2/sim_node']),
        (HEAD + '    angle: 0.1\n' + TWO_RIGS, ['/rig1/sim_node', '/rig2/sim_node']),
        (TWO_RIGS.replace('/sim_node', '/**'), ['/rig1/sim_node', '/rig2/sim_node']),
        (
            SIM_NODE + '/rig2: {sim_node: {ros__parameters: {gap: 2.0}}}',
            ['/sim_node', '/rig2/sim_node'],
        ),
    ],
)
def test_a_file_of_two_rigs(tmp_path, capsys, text, names):
    path = written(tmp_path, text)
    words = [str(path), '--duration', '0.1', '--set', 'gravity=0']
    assert simulate_rig(words) == 2
    refusal = f'{path}: describes several rigs, {", ".join(names)}: name one with --node'
    assert capsys.readouterr().err == f'simulate_rig: {refusal}\n'
    assert simulate_rig([*words, '--node', 'rig2/sim_node']) == 0
    assert '; gap 2 m;' in capsys.readouterr().err
    assert simulate_rig([*words, '--node', '/rig3/sim_node']) == (0 if HEAD in text else 2)


def test_all_parameters_of_the_node_may_stand_there(tmp_path):
    values = {name: spec.default for name, spec in ALL_SPECS.items()}
    values |= {'use_sim_time': False, 'start_type_description_service': True}
    plain = {n: list(v) if isinstance(v, tuple) else v for n, v in values.items()}
    text = yaml.safe_dump({'/**': {'ros__parameters': plain}})
    rig, initial, other = load_parameters(written(tmp_path, text))
    assert (rig, initial) == (RigParameters(), InitialConditions())
    control = GapControlParameters(**{name: other[name] for name in GAP_CONTROL_SPECS})
    assert control == GapControlParameters()
    assert set(other) == set(values) - set(PARAMETER_SPECS) - set(INITIAL_SPECS)
    assert load_parameters(written(tmp_path, HEAD))[0] == RigParameters()


NO_NAMES = 'no parameters for sim_node among '
#: Contents of files, and a part of what is said of them.
REFUSED = {
    'alias bomb': (BOMB, NO_NAMES + 'a0, a1, a2'),
    'alias bomb of nodes': (BOMB_OF_NODES, NO_NAMES + 'a0/b, a1/n0/b'),
    'alias bomb of a value': (f'{HEAD}    gap: [&a [1], &b [*a, *a], [*b, *b]]\n', 'gap is [[1]'),
    'itself': ('&a {/**: *a}', ('nested too deep', 'recursive node')),
    'alias of nothing': (HEAD + '    gap: *a\n', 'line 3: is not YAML: found undefined alias'),
    'merge': (HEAD + '    <<: {gap: 1.0}\n', 'line 3: unknown parameter <<: remove it'),
    'deep': ('/**: ' + '[' * 100_000, ('nested too deep', 'nesting depth', 'flow level')),
    'deep names': ('\n'.join(f'{" " * k}k:' for k in range(1300)), ('too deep', 'nesting depth')),
    'tag': (HEAD + '    one_sided: !!bool abc\n', "line 3: 'abc' is no value of the kind bool"),
    'tag of an object': (HEAD + '    gap: !!python/object:os.system x\n', 'line 3: is not YAML'),
    'digits': (HEAD + f'    gap: {"9" * 5000}\n', 'is no value of the kind int'),
    'list for a name': (HEAD + '    ? [a]\n    : 1\n', 'line 3: a list or mapping stands in'),
    'twice': (
        HEAD + '    gap: 3.0\n    stiffness: 1.0\n    "gap": 4.0\n',
        "line 5: 'gap' stands there twice, first in line 3: keep one of them",
    ),
    'node twice': (HEAD + '    gap: 3.0\n' + HEAD, "line 4: '/**' stands there twice"),
    'comments': ('# no\n' * 4_000_000, 'is longer than 1 MB'),
    'escape': (HEAD + '    "\\e[2Jgab": 1.0\n', r'line 3: unknown parameter \x1b[2Jgab'),
    'no text': (b'a: b\n\xe9: 1\n', 'line 2: cannot be read as text'),
    'zeros': (b'\x00\x93MCAP', 'cannot be read as text'),
    'long name': (HEAD + f'    {"g" * 900}: 1.0\n', 'characters'),
    'value': (HEAD + '    gap: 3.0\n\n    angle: 45\n', 'line 5: angle is 45.0 rad: give'),
    'unit': (HEAD + '    gap: 3 km\n', "line 3: gap is '3 km': 'km' is no unit of it: write m"),
    'nothing': ('', 'holds no parameters: start the file with "/**:"'),
    'a list': ('[1, 2]', 'holds no parameters'),
    'colon': (HEAD + '    gap: 3.0: 4\n', 'line 3: is not YAML: mapping values are not allowed'),
    'no node': ('gap: 3.0\n', NO_NAMES + 'gap: start the file with "/**:"'),
    'another node': ('camera:\n  ros__parameters:\n    gap: 3\n', 'or name one with --node'),
    'no block': ('/**:\n  gap: 3.0\n', '/** has no ros__parameters'),
    'a list for a block': (
        '/**:\n  ros__parameters: [gap, 3]\n',
        'is not a list of "name: value"',
    ),
    'a slip': (HEAD + '    gapp: 3.0\n', 'line 3: unknown parameter gapp: did you mean gap?'),
    'a number for a name': (HEAD + '    1: 2\n', 'line 3: unknown parameter 1: remove it'),
    **{
        line: (f'{HEAD}    {line}\n', f'line 3: {line.partition(":")[0]} ')
        for line in (
            *('gap: -3', 'gap:', 'gap: 1:30', 'gap: 2026-13-45', 'force_phases: [0, 1]'),
            'initial_damper_offset: 20',
        )
    },
}


@pytest.mark.parametrize('case', REFUSED)
def test_refused(case, tmp_path, capsys):
    content, words = REFUSED[case]
    path = written(tmp_path, content)
    assert solve_periodic([str(path), '--impacts', '2']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f'solve_periodic: {path}: ')
    words = words if isinstance(words, tuple) else (words,)
    assert any(part in line for part in words)
    assert len(line) < 700
    assert line.isprintable()


def test_missing_file_and_directory(tmp_path):
    with pytest.raises(ParametersFileError, match=r'none\.yaml: cannot be read .*No such file'):
        load_parameters(tmp_path / 'none.yaml')
    with pytest.raises(ParametersFileError, match='cannot be read'):
        load_parameters(str(tmp_path))


def test_units(tmp_path):
    text = '    gap: 12mm\n    force_amplitudes: [500 mN, 1]\n    force_frequencies: [4, 5 Hz]\n'
    rig, _, other = load_parameters(
        written(tmp_path, f'{HEAD}{text}    force_phases: "[0; 10 deg]"\n    state_rate: 1 kHz\n')
    )
    assert (rig.gap, rig.force_amplitudes) == (0.012, (0.5, 1.0))
    assert rig.force_frequencies == pytest.approx((8 * math.pi, 10 * math.pi))
    assert rig.force_phases == pytest.approx((0.0, math.pi / 18))
    assert other == {'state_rate': '1 kHz'}
    assert RigParameters(gap='12 mm', force_frequencies='5 Hz', angle='10°').gap == 0.012


@pytest.mark.parametrize('text', ['!!bool abc', '[' * 2000, '{a: 1, a: 2}', '1\n---\n2'])
def test_values_of_set_that_no_file_could_have(text, capsys):
    assert solve_periodic(['paper', '--impacts', '2', '--set', f'gap={text}']) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert 'is not a value: ' in line
    assert len(line) < 400


def test_at_the_limits(tmp_path):
    """What is just allowed is taken; so is a pipe."""
    text = HEAD + '    gap: 3.0\n'
    path = written(tmp_path, text + '#' * (MOST_BYTES - len(text)))
    assert load_parameters(path)[0].gap == 3.0
    with pytest.raises(YamlError, match='longer than 1 MB'):
        read_yaml(written(tmp_path, path.read_text() + '#'))
    reading, writing = os.pipe()
    os.write(writing, f'{HEAD}    gap: 3.5\n'.encode())
    os.close(writing)
    try:
        assert load_parameters(f'/dev/fd/{reading}')[0].gap == 3.5
    finally:
        os.close(reading)


def test_presets_by_name(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert set(presets()) == {'bench_rig', 'paper'}
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
        'from impact_damper_ros.parameters.parameters_file import presets\n'
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


NAMES = [*PARAMETER_SPECS, *INITIAL_SPECS, 'state_rate', 'gap_control', 'record']
#: What values are made of; one in a few is what a parameter can have.
VALUES = (
    *('1', '0.5', '1e-3', '[1.0]', '[1, 0.5]', 'true', 'off', '"off"', '-1', '37'),
    *('.nan', '-.inf', '1e999', '0x1F', '0o17', '1:30:15', '2026-13-45', '1_000', '~', ''),
    *('!!bool abc', '!!int x', '!!float []', '!!null {a: b}', '!!binary =', '!!set {a, b}'),
    *('!!timestamp x', '!!omap [a]', '!!map [a]', '!local x', '! y', '&a 1', '*a', '&a [*a]'),
    *('<<: {gap: 1}', '"\\x1b[2J"', "'\\n'", '|\n', '>-\n  text', '[[[[1]]]]', '{a: {b: c}}'),
    *('[', '}', '"', "'", '%TAG', '--- 1', '...', '? [a, b]', '@', '`', 'yes', 'No', '1.'),
    *('9' * 5000, '[' + '1,' * 2000 + ']', '"' + 'x' * 20000 + '"', '\t1', '\ufeff', '\u2028'),
    *('é', '\x00', '\x7f', '\ud7ff', '😀', '# comment', '1 # comment'),
)
PIECES = (*VALUES, *NAMES, ':', ': ', '\n', '\n    ', '-', ' - ', ',', '/**', 'ros__parameters')


def random_file(numbers):
    """Return the bytes of a file: any, of pieces, or as it should be but for some of it."""
    kind = numbers.random()
    if kind < 0.1:
        return numbers.randbytes(numbers.randrange(400))
    if kind < 0.3:
        return ''.join(numbers.choices(PIECES, k=numbers.randrange(30))).encode()
    head = numbers.choice(['/**', 'sim_node', '/rig1/sim_node', '/*', 'other', '"/**"'])
    names = numbers.choices(NAMES, k=numbers.randrange(1, 4))
    lines = [f'    {name}: {numbers.choice(VALUES)}' for name in names]
    text = '\n'.join([f'{head}:', '  ros__parameters:', *lines, ''])
    for _ in range(numbers.randrange(6) if kind > 0.5 else 0):
        begin = numbers.randrange(len(text) + 1)
        piece = numbers.choice([numbers.choice(PIECES), numbers.choice(string.printable), ''])
        text = text[:begin] + piece + text[begin + numbers.randrange(12) :]
    return text.encode('utf-8', 'surrogatepass')


def test_fuzz(tmp_path):
    """No other error than one line, not long, that names the file and the fault."""
    numbers, taken = random.Random(12), 0
    for _ in range(400):
        path = written(tmp_path, random_file(numbers))
        try:
            load_parameters(path)
        except (ParametersFileError, ParameterError) as error:
            said = str(error)
            assert said.isprintable(), path.read_bytes()
            assert said.startswith(f'{path}: ')
            assert len(said) < 1000 + len(str(path))
        else:
            taken += 1
    # Not all is refused
    assert 0 < taken < 360
