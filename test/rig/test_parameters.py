"""Parameters of the rig: ranges, messages, derived values, and the file they come in."""

import dataclasses
import itertools
import math
import re

import numpy as np
import pytest
import yaml

from impact_damper_ros.rig import (
    ALL_SPECS,
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
    SETTING_SPECS,
    GapControlParameters,
    InitialConditions,
    ParameterError,
    RigParameters,
    load_parameters,
)
from impact_damper_ros.rig.parameters_file import ParametersFileError

DOUBLES = [s for s in PARAMETER_SPECS.values() if s.kind == 'double']
ARRAYS = [s for s in PARAMETER_SPECS.values() if s.kind == 'double_array']
NUMBERS = DOUBLES + ARRAYS
INITIAL = list(INITIAL_SPECS.values())
# Stiff and heavy enough that any single damping value of its range can be tried.
STIFF = {'stiffness': 1e15, 'primary_mass': 1e9}


def build(spec, value):
    """Return a rig with one value, and what else that value needs."""
    if spec in INITIAL:
        return InitialConditions(**{spec.name: value})
    support = {}
    if spec.name == 'damping':
        support = STIFF
    elif spec.name in ('stiffness', 'primary_mass'):
        support = {'damping': 0.0}
    return RigParameters(**{**support, spec.name: value})


def test_no_name_stands_for_two_parameters():
    tables = PARAMETER_SPECS, INITIAL_SPECS, GAP_CONTROL_SPECS, SETTING_SPECS
    assert len(ALL_SPECS) == sum(map(len, tables))


def wrap(spec, number):
    return [number] if spec.kind == 'double_array' else number


@pytest.mark.parametrize('spec', NUMBERS + INITIAL, ids=lambda s: s.name)
class TestRange:
    @pytest.mark.parametrize('end', ['low', 'high'])
    def test_end_is_in(self, spec, end):
        value = getattr(spec, end)
        got = getattr(build(spec, wrap(spec, value)), spec.name)
        assert got == ((value,) if spec.kind == 'double_array' else value)

    @pytest.mark.parametrize(('end', 'side'), [('low', -math.inf), ('high', math.inf)])
    def test_next_float_is_out(self, spec, end, side):
        value = math.nextafter(getattr(spec, end), side)
        with pytest.raises(ParameterError) as caught:
            build(spec, wrap(spec, value))
        assert caught.value.name == spec.name

    @pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 10**400])
    def test_not_finite(self, spec, value):
        with pytest.raises(ParameterError) as caught:
            build(spec, wrap(spec, value))
        assert caught.value.name == spec.name

    @pytest.mark.parametrize('value', ['1.0', None, True, 1j, [[1.0]], {}, b'1', object()])
    def test_wrong_type(self, spec, value):
        with pytest.raises(ParameterError) as caught:
            build(spec, wrap(spec, value))
        assert caught.value.name == spec.name

    def test_message_names_value_range_and_remedy(self, spec):
        value = 2.0 * spec.high + 1.0
        with pytest.raises(ParameterError) as caught:
            build(spec, wrap(spec, value))
        text = str(caught.value)
        assert spec.name in text
        assert repr(value) in text
        assert f'{spec.low:g} to {spec.high:g}' in text
        assert 'give' in text
        assert not spec.unit or spec.unit in text


@pytest.mark.parametrize('spec', [*PARAMETER_SPECS.values(), *INITIAL], ids=lambda s: s.name)
def test_spec_is_complete(spec):
    assert spec.description.endswith('.')
    if spec.kind == 'bool':
        assert spec.low is None
        assert spec.high is None
        assert spec.default is False
        assert spec.span == 'true, false'
        return
    if spec.kind == 'string':
        assert spec.default in spec.choices
        assert spec.span == ', '.join(spec.choices)
        return
    assert math.isfinite(spec.low)
    assert math.isfinite(spec.high)
    for number in spec.default if spec.kind == 'double_array' else (spec.default,):
        assert spec.low <= number <= spec.high
    assert spec.label == (f'{spec.name} [{spec.unit}]' if spec.unit else spec.name)


def test_defaults_are_the_papers_basic_rig():
    assert RigParameters().as_dict() == {
        'primary_mass': 1.0,
        'stiffness': 1.0,
        'damping': 0.01,
        'damper_mass': 0.042,
        'gap': 37.0,
        'restitution_1': 0.75,
        'restitution_2': 0.75,
        'angle': 0.0,
        'friction': 0.0,
        'gravity': 9.81,
        'air_force': 0.0,
        'one_sided': False,
        'force_amplitudes': (1.0,),
        'force_frequencies': (1.0,),
        'force_phases': (0.0,),
        'multisine_level': 0.0,
        'multisine_low': 0.5,
        'multisine_high': 1.5,
        'multisine_lines': 64,
        'multisine_seed': 1,
        'sweep_mode': 'off',
        'sweep_low': 0.5,
        'sweep_high': 1.5,
        'sweep_step': 0.01,
        'sweep_dwell': 100.0,
    }
    assert list(RigParameters().as_dict()) == list(PARAMETER_SPECS)
    assert InitialConditions().as_dict() == dict.fromkeys(INITIAL_SPECS, 0.0)


def test_integers_become_floats_and_lists_tuples():
    rig = RigParameters(
        gap=37, force_amplitudes=[1, 2], force_frequencies=(1, 3), force_phases=[0, 1]
    )
    assert type(rig.gap) is float
    assert rig.force_amplitudes == (1.0, 2.0)
    for name in ('force_amplitudes', 'force_frequencies', 'force_phases'):
        value = getattr(rig, name)
        assert type(value) is tuple
        assert all(type(v) is float for v in value)


@pytest.mark.parametrize('one', [2, 2.0, np.float64(2.0)])
def test_scalar_becomes_an_array(one):
    assert RigParameters(force_amplitudes=one).force_amplitudes == (2.0,)


def test_numpy_values():
    rig = RigParameters(gap=np.float32(2.5), stiffness=np.int64(3), force_phases=np.array([0.5]))
    assert (rig.gap, rig.stiffness, rig.force_phases) == (2.5, 3.0, (0.5,))
    assert type(rig.gap) is float
    assert type(rig.force_phases[0]) is float


@pytest.mark.parametrize('value', [1, 0, 'true', None, 1.0, [True]])
def test_bool_takes_only_bools(value):
    with pytest.raises(ParameterError, match=r'one_sided is .*true or false'):
        RigParameters(one_sided=value)


@pytest.mark.parametrize('given', [37, 37.0, np.int32(37), np.float64(37.0)])
def test_integers_take_whole_numbers(given):
    lines = RigParameters(multisine_lines=given).multisine_lines
    assert lines == 37
    assert type(lines) is int


@pytest.mark.parametrize('given', [0, 513, 37.5, math.nan, math.inf, True, '37', None, [37]])
def test_integers_take_nothing_else(given):
    with pytest.raises(ParameterError, match=r'multisine_lines is .*whole number from 1 to 512'):
        RigParameters(multisine_lines=given)


def test_texts_are_choices():
    for mode in ('off', 'up', 'down', 'up_down'):
        assert RigParameters(sweep_mode=mode).sweep_mode == mode
    # What YAML makes of an unquoted off
    assert RigParameters(sweep_mode=False).sweep_mode == 'off'
    for given in ('sideways', '', True, None, 1, ['up'], b'up'):
        with pytest.raises(ParameterError, match=r'sweep_mode is .*one of off, up, down, up_down'):
            RigParameters(sweep_mode=given)


@pytest.mark.parametrize(
    ('values', 'name', 'words'),
    [
        (
            {'multisine_level': 0.1, 'multisine_low': 2.0},
            'multisine_high',
            ['multisine_low is 2.0 rad/s', 'multisine_high 1.5 rad/s', 'more than 2', 'both'],
        ),
        (
            {'sweep_mode': 'up', 'sweep_high': 0.5},
            'sweep_high',
            ['sweep_low is 0.5 rad/s', 'sweep_high 0.5 rad/s', 'less than 0.5'],
        ),
        (
            {'sweep_mode': 'down', 'sweep_step': 1e-6},
            'sweep_step',
            ['sweep_step is 1e-06 rad/s', '1e+06 steps', 'at least 1e-05 rad/s'],
        ),
    ],
)
def test_excitation_is_judged_as_a_whole(values, name, words):
    with pytest.raises(ParameterError) as caught:
        RigParameters(**values)
    assert caught.value.name == name
    assert all(word in str(caught.value) for word in words)
    # Switched off, the numbers can be set one by one.
    off = {n: v for n, v in values.items() if n not in ('multisine_level', 'sweep_mode')}
    RigParameters(**off)


@pytest.mark.parametrize('name', ['force_frequencies', 'force_phases'])
def test_array_lengths_must_agree(name):
    with pytest.raises(ParameterError, match='2 entries but force_amplitudes has 1') as caught:
        RigParameters(**{name: [1.0, 2.0]})
    assert caught.value.name == name


def test_longer_amplitudes_alone_are_refused():
    with pytest.raises(ParameterError, match='same length'):
        RigParameters(force_amplitudes=[1.0, 2.0])


@pytest.mark.parametrize('value', [[], [1.0] * 1025, 'abc', None, {1.0: 2.0}.items()])
def test_bad_arrays(value):
    with pytest.raises(ParameterError) as caught:
        RigParameters(force_phases=value)
    assert caught.value.name == 'force_phases'


def test_array_error_says_which_entry():
    with pytest.raises(ParameterError, match=re.escape('force_frequencies[1] is -1.0 rad/s')):
        RigParameters(force_amplitudes=[1, 1], force_frequencies=[1, -1], force_phases=[0, 0])


@pytest.mark.parametrize('harmonics', [1, 2, 1024])
def test_numbers_of_harmonics(harmonics):
    rig = RigParameters(
        **dict.fromkeys(
            ('force_amplitudes', 'force_frequencies', 'force_phases'), [1.0] * harmonics
        )
    )
    assert len(rig.force_phases) == harmonics


def test_overdamped_is_refused_and_says_the_limit():
    assert RigParameters(damping=1.9998).zeta == pytest.approx(0.9999, rel=1e-15)
    for damping in (1.99981, 2.0, 5.0):
        with pytest.raises(ParameterError, match=r'underdamped, give at most 1\.9998') as caught:
            RigParameters(damping=damping)
        assert caught.value.name == 'damping'
    with pytest.raises(ParameterError, match='damping'):
        RigParameters(damping=1.0).replace(stiffness=0.01)


def test_frozen():
    for instance in (RigParameters(), InitialConditions()):
        name = next(iter(instance.as_dict()))
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(instance, name, 2.0)
        with pytest.raises((AttributeError, TypeError)):
            instance.other = 1.0
    assert hash(RigParameters()) == hash(RigParameters(gap=37))
    assert RigParameters() == RigParameters(force_phases=[0])


def test_replace_is_atomic():
    rig = RigParameters()
    # Each of the two alone is not admissible.
    both = rig.replace(stiffness=0.01, damping=0.001)
    assert (both.stiffness, both.damping) == (0.01, 0.001)
    soft = RigParameters(damping=1.5)
    with pytest.raises(ParameterError):
        soft.replace(stiffness=0.1)
    three = rig.replace(force_amplitudes=[1, 2], force_frequencies=[1, 2], force_phases=[0, 0])
    assert three.force_amplitudes == (1.0, 2.0)
    with pytest.raises(ParameterError):
        rig.replace(gap=10.0, friction=-1.0)
    assert rig == RigParameters()
    with pytest.raises(ParameterError, match='gapp is not a parameter of the rig') as caught:
        rig.replace(gapp=1.0)
    assert caught.value.name == 'gapp'


def test_positional_and_unknown_arguments():
    with pytest.raises(TypeError):
        RigParameters(1.0)
    with pytest.raises(TypeError):
        RigParameters(mass=1.0)


@pytest.mark.parametrize('seed', range(20))
def test_derived_values(seed):
    rng = np.random.default_rng(seed)
    M, K, m, F, W = 10.0 ** rng.uniform(-3, 3, 5)
    zeta = rng.uniform(0, 0.999)
    rig = RigParameters(
        primary_mass=M,
        stiffness=K,
        damping=2 * zeta * math.sqrt(K * M),
        damper_mass=m,
        angle=rng.uniform(-1.57, 1.57),
        force_amplitudes=[-F],
        force_frequencies=[W],
    )
    r = W / math.sqrt(K / M)
    gain = 1 / complex(1 - r * r, 2 * zeta * r)
    assert rig.omega == pytest.approx(math.sqrt(K / M), rel=1e-14)
    assert rig.zeta == pytest.approx(zeta, rel=1e-14)
    assert rig.eta == pytest.approx(math.sqrt(1 - rig.zeta**2), rel=1e-12)
    assert rig.mass_ratio == pytest.approx(m / M, rel=1e-15)
    assert rig.frequency_ratio == pytest.approx(r, rel=1e-14)
    assert rig.response_amplitude == pytest.approx(F / K * abs(gain), rel=1e-10)
    assert rig.static_deflection == pytest.approx(M * 9.81 * math.sin(rig.angle) / K, rel=1e-14)


def test_resonance_without_damping():
    rig = RigParameters(damping=0.0)
    assert rig.response_amplitude == math.inf
    assert rig.replace(force_amplitudes=[0.0]).response_amplitude == 0.0
    assert RigParameters().response_amplitude == pytest.approx(100.0, rel=1e-14)


def test_initial_conditions_within_the_gap():
    rig = RigParameters(gap=2.0)
    for offset in (-1.0, 0.0, 1.0):
        InitialConditions(initial_damper_offset=offset).check_within(rig)
    for offset in (math.nextafter(1.0, 2.0), math.nextafter(-1.0, -2.0)):
        with pytest.raises(ParameterError, match='from -1 to 1 m') as caught:
            InitialConditions(initial_damper_offset=offset).check_within(rig)
        assert caught.value.name == 'initial_damper_offset'
    InitialConditions(initial_damper_offset=-50.0).check_within(rig.replace(one_sided=True))


class TestParametersFile:
    def load(self, tmp_path, text, **options):
        path = tmp_path / 'rig.yaml'
        if isinstance(text, bytes):
            path.write_bytes(text)
        else:
            path.write_text(text, encoding='utf-8')
        return load_parameters(path, **options)

    @pytest.mark.parametrize(
        'key', ['/**', 'sim_node', '/sim_node', '/ns/sim_node', '/a/b/sim_node', '"/**/sim_node"']
    )
    def test_good(self, tmp_path, key):
        rig, initial, other = self.load(
            tmp_path,
            f'{key}:\n  ros__parameters:\n    gap: 30\n    damping: 1e-3\n    one_sided: true\n'
            '    force_amplitudes: [1, 2.5]\n    force_frequencies: [1e0, 2]\n'
            '    force_phases: [0, -1E+0]\n    initial_damper_offset: -3\n    state_rate: 200\n',
        )
        assert rig == RigParameters(
            gap=30.0,
            damping=0.001,
            one_sided=True,
            force_amplitudes=(1.0, 2.5),
            force_frequencies=(1.0, 2.0),
            force_phases=(0.0, -1.0),
        )
        assert initial == InitialConditions(initial_damper_offset=-3.0)
        assert other == {'state_rate': 200}

    def test_node_wins_over_wildcard(self, tmp_path):
        text = (
            'sim_node:\n  ros__parameters:\n    gap: 30.0\n'
            '/**:\n  ros__parameters:\n    gap: 20.0\n    friction: 0.5\n'
        )
        rig, _, _ = self.load(tmp_path, text)
        assert (rig.gap, rig.friction) == (30.0, 0.5)

    def test_other_nodes_do_not_matter(self, tmp_path):
        text = 'camera:\n  ros__parameters:\n    gap: -1\n/**:\n  ros__parameters:\n    gap: 20\n'
        assert self.load(tmp_path, text)[0].gap == 20.0

    @pytest.mark.parametrize('number', ['1e-3', '1.e-3', '.001', '1.0e-03', '0.001', '+1E-3'])
    def test_numbers(self, tmp_path, number):
        text = f'/**:\n  ros__parameters:\n    damping: {number}\n'
        assert self.load(tmp_path, text)[0].damping == 0.001

    def test_integers_and_texts(self, tmp_path):
        text = (
            '/**:\n  ros__parameters:\n    multisine_lines: 37.0\n    multisine_level: 2\n'
            '    multisine_seed: 5\n    sweep_mode: off\n'
        )
        rig = self.load(tmp_path, text)[0]
        assert (rig.multisine_lines, rig.multisine_level, rig.multisine_seed) == (37, 2.0, 5)
        assert rig.sweep_mode == 'off'
        assert self.load(tmp_path, text.replace('off', 'up'))[0].sweep_mode == 'up'

    def test_empty_block_gives_defaults(self, tmp_path):
        assert self.load(tmp_path, '/**:\n  ros__parameters:\n')[0] == RigParameters()

    def test_all_parameters_of_the_node_may_stand_there(self, tmp_path):
        values = {name: spec.default for name, spec in ALL_SPECS.items()}
        values |= {'use_sim_time': False, 'start_type_description_service': True}
        plain = {n: list(v) if isinstance(v, tuple) else v for n, v in values.items()}
        rig, initial, other = self.load(
            tmp_path, yaml.safe_dump({'/**': {'ros__parameters': plain}})
        )
        assert (rig, initial) == (RigParameters(), InitialConditions())
        control = GapControlParameters(**{name: other[name] for name in GAP_CONTROL_SPECS})
        assert control == GapControlParameters()
        assert set(other) == set(values) - set(PARAMETER_SPECS) - set(INITIAL_SPECS)

    def test_unknown_names_do_not_pass(self, tmp_path):
        text = '/**:\n  ros__parameters:\n    colour_of_m: red\n'
        with pytest.raises(ParametersFileError, match='unknown parameter colour_of_m'):
            self.load(tmp_path, text)

    def test_unknown_name_has_a_hint(self, tmp_path):
        with pytest.raises(ParametersFileError, match='gapp: did you mean gap') as caught:
            self.load(tmp_path, '/**:\n  ros__parameters:\n    gapp: 3.0\n')
        assert 'rig.yaml' in str(caught.value)
        with pytest.raises(ParametersFileError, match='xyzzy: remove it'):
            self.load(tmp_path, '/**:\n  ros__parameters:\n    xyzzy: 3.0\n')

    @pytest.mark.parametrize(
        ('text', 'message'),
        [
            ('', 'holds no parameters'),
            ('# nothing\n', 'holds no parameters'),
            ('- 1\n- 2\n', 'holds no parameters'),
            ('just text', 'holds no parameters'),
            ('{: [', 'is not YAML'),
            ('a: b: c', 'is not YAML'),
            ('\tgap: 3', 'is not YAML'),
            ('gap: 3.0\n', 'no parameters for sim_node among gap'),
            ('camera:\n  ros__parameters:\n    gap: 3\n', 'no parameters for sim_node'),
            ('/**:\n  gap: 3.0\n', 'has no ros__parameters'),
            ('/**: 3\n', 'has no ros__parameters'),
            ('/**:\n', 'has no ros__parameters'),
            ('/**:\n  ros__parameters: 3\n', 'name: value'),
            ('/**:\n  ros__parameters: [gap, 3]\n', 'name: value'),
            (b'\x00\xff\xfe\x93MCAP\x80', 'cannot be read'),
        ],
    )
    def test_bad_files(self, tmp_path, text, message):
        with pytest.raises(ParametersFileError, match=message) as caught:
            self.load(tmp_path, text)
        assert 'rig.yaml' in str(caught.value)

    def test_control_characters(self, tmp_path):
        with pytest.raises(ParametersFileError, match='is not YAML'):
            self.load(tmp_path, b'gap: \x01\x02')

    def test_keys_that_are_not_text(self, tmp_path):
        with pytest.raises(ParametersFileError):
            self.load(tmp_path, '1: 2\n')
        with pytest.raises(ParametersFileError):
            self.load(tmp_path, '/**:\n  ros__parameters:\n    1: 2\n')

    def test_missing_file_and_directory(self, tmp_path):
        with pytest.raises(
            ParametersFileError, match=r'none\.yaml: cannot be read .*No such file'
        ):
            load_parameters(tmp_path / 'none.yaml')
        with pytest.raises(ParametersFileError, match='cannot be read'):
            load_parameters(str(tmp_path))

    @pytest.mark.parametrize(
        ('line', 'name'),
        [
            ('gap: -3', 'gap'),
            ('gap: .nan', 'gap'),
            ('gap: .inf', 'gap'),
            ('gap: "37"', 'gap'),
            ('gap: [1.0]', 'gap'),
            ('gap:', 'gap'),
            ('one_sided: 1', 'one_sided'),
            ('force_phases: [0, 1]', 'force_phases'),
            ('damping: 3', 'damping'),
            ('initial_damper_offset: 20', 'initial_damper_offset'),
        ],
    )
    def test_bad_values(self, tmp_path, line, name):
        with pytest.raises(ParameterError) as caught:
            self.load(tmp_path, f'/**:\n  ros__parameters:\n    {line}\n')
        assert caught.value.name == name


@pytest.mark.parametrize('kind', [np.float32, np.int64, np.array])
def test_one_number_of_any_kind_for_an_array(kind):
    assert RigParameters(force_amplitudes=kind(2)).force_amplitudes == (2.0,)


def test_entries_without_end():
    """They once filled the memory."""
    with pytest.raises(ParameterError, match='force_amplitudes has 1025 or more entries: give 1'):
        RigParameters(force_amplitudes=itertools.count())
    with pytest.raises(ParameterError, match='force_amplitudes has 2000 entries: give 1 to 1024'):
        RigParameters(force_amplitudes=[1.0] * 2000)
