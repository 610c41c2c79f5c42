"""How parameters are read, judged and described, without a running node."""

import re

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from impact_damper_ros import ParameterError, ParametersFileError, RigParameters, load_parameters
from impact_damper_ros.node.parameters import (
    NodeParameters,
    admissible_part,
    coerce,
    descriptor,
    nearest_name,
    normalise,
    parameters_from_overrides,
    readable,
    values_in,
)
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.parameters_file import values_given
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS, PARAMETER_SPECS

Type = Parameter.Type


HAS = {*ALL_SPECS, 'use_sim_time'}.__contains__


def changed(*request, **values):
    """Return the parameters after a request, as the node has them."""
    now = NodeParameters.from_values(values)
    return now.with_changes(values_in(readable(request, now.rig, HAS)))


@pytest.mark.parametrize(
    ('name', 'given', 'meant'),
    [
        ('gap', 37, 37.0),
        ('gap', '12 mm', 0.012),
        ('gap', 'wide', 'wide'),
        ('gap', [37.0], [37.0]),
        ('one_sided', 1, 1),
        ('force_amplitudes', 2, [2.0]),
        ('force_amplitudes', [1, 2], [1.0, 2.0]),
        ('force_amplitudes', '[1, 0.5]', [1.0, 0.5]),
        ('force_amplitudes', ['1', '500 mN'], [0.001, 0.5]),
        ('force_amplitudes', ['a'], ['a']),
        ('bag_directory', 2024, '2024'),
        ('multisine_lines', 37.0, 37),
        ('multisine_lines', '1e2', 100),
        ('multisine_lines', 37.5, 37.5),
        ('sweep_mode', False, 'off'),
    ],
)
def test_values_are_read_as_they_are_meant(name, given, meant):
    value = coerce(Parameter(name, value=given)).value
    assert value == meant
    assert type(value) is type(meant)


def test_an_empty_list_is_a_list_of_numbers():
    for kind in (Type.BYTE_ARRAY, Type.BOOL_ARRAY, Type.STRING_ARRAY, Type.INTEGER_ARRAY):
        assert coerce(Parameter('force_phases', kind, [])).type_ is Type.DOUBLE_ARRAY


@pytest.mark.parametrize(
    ('given', 'expected'),
    [
        ({'force_amplitudes': [2.0, 3.0]}, ((2.0, 3.0), (1.0, 0.0), (0.0, 0.0))),
        ({'force_frequencies': [2.0, 3.0]}, ((1.0, 0.0), (2.0, 3.0), (0.0, 0.0))),
        ({'force_phases': [0.0, 1.0]}, ((1.0, 0.0), (1.0, 0.0), (0.0, 1.0))),
        (
            {'force_phases': [0.0, 1.0], 'force_amplitudes': [1.0, 5.0]},
            ((1.0, 5.0), (1.0, 0.0), (0.0, 1.0)),
        ),
        ({'force_phases': [0.5]}, ((1.0,), (1.0,), (0.5,))),
    ],
)
def test_force_arrays_follow_each_other_in_length(given, expected):
    rig = changed(*(Parameter(name, value=v) for name, v in given.items())).rig
    assert (rig.force_amplitudes, rig.force_frequencies, rig.force_phases) == expected
    meant = normalise([Parameter('force_frequencies', value=[7.0])], rig)
    assert {p.name: len(p.value) for p in meant} == dict.fromkeys([p.name for p in meant], 1)


@pytest.mark.parametrize(
    ('parameter', 'words'),
    [
        (Parameter('gap', value=-1.0), ['gap', '-1.0 m', 'from']),
        (Parameter('gpa', value=1.0), ['gpa', 'did you mean gap?']),
        (Parameter('xyzzy', value=1.0), ['xyzzy', 'simulate_rig --parameters']),
        (Parameter('state_rate', value=100), ['state_rate', 'fixed', '-p state_rate:=100']),
        (Parameter('initial_damper_offset', value=20.0), ['from -18.5 to 18.5 m']),
        (Parameter('force_amplitudes', Type.BOOL_ARRAY, []), ['0 entries']),
        (Parameter('gap_control', value='always'), ["'always'", 'one of off']),
        (Parameter('use_sim_time', value=True), ['use_sim_time is true', 'give publish_clock']),
        (Parameter('sweep_mode', value=3), ["'3'", 'one of off, up, down, up_down']),
        (Parameter('bag_directory', value='~nobody-of-this-name/runs'), ['write it out']),
    ],
)
def test_an_objection_names_value_range_and_remedy(parameter, words):
    with pytest.raises(ParameterError) as refused:
        changed(parameter)
    assert all(word in str(refused.value) for word in words), refused.value


def test_a_request_is_judged_as_a_whole():
    stiff = [Parameter('damping', value=5), Parameter('stiffness', value=100)]
    assert changed(*stiff).rig == RigParameters(damping=5.0, stiffness=100.0)
    lengths = [
        Parameter(f'force_{name}', value=[1.0] * n)
        for name, n in (('amplitudes', 2), ('phases', 3))
    ]
    for request in (stiff[:1], [*stiff, Parameter('gap', value=0)], lengths):
        with pytest.raises(ParameterError):
            changed(*request)


def test_of_a_list_all_is_set_that_can_be():
    """Whatever its order: a base of two lines, and a range that moves past itself."""
    now = NodeParameters.from_values({'gap_min': 0.5, 'gap_max': 1.0})
    good = {
        'base_amplitudes': [0.1, 0.2],
        'base_frequencies': [10.0, 20.0],
        'base_phases': [0.0, 0.0],
        'gap_min': 2.0,
        'gap_max': 3.0,
        'initial_damper_offset': 30.0,
        'gap': 80.0,
    }
    bad = {'stifness': 1.0, 'restitution_1': 1.5, 'state_rate': 500.0, 'damping': 50.0}
    values = {**bad, **good}
    for names in (list(values), list(values)[::-1], sorted(values)):
        request = [Parameter(name, value=values[name]) for name in names]
        together, reasons = admissible_part(request, now, HAS)
        assert [one.name for one in together] == [name for name in names if name in good]
        assert set(reasons) == set(bad)
        assert all(name in reason for name, reason in reasons.items())
    assert admissible_part([Parameter('gap_min', value=2.0)], now, HAS)[0] == []
    # Where it is the damping that stays which contradicts a value
    soft = [Parameter('stiffness', value=1e-6), Parameter('gap', value=2.0)]
    together, reasons = admissible_part(soft, now, HAS)
    assert (together, list(reasons)) == (soft[1:], ['stiffness'])
    assert 'underdamped' in reasons['stiffness']


def test_overrides_are_read_tolerantly():
    warnings = []
    given = {
        'gap': 30,
        'force_amplitudes': [1, 2],
        'robot_description': '<robot/>',
        'use_sim_time': False,
        'qos_overrides./clock.subscription.depth': 1,
        'record': False,
    }
    parameters = parameters_from_overrides(given, ('use_sim_time',), warnings.append)
    assert parameters.rig == RigParameters(gap=30.0).replace(
        force_amplitudes=(1.0, 2.0), force_frequencies=(1.0, 0.0), force_phases=(0.0, 0.0)
    )
    (warning,) = warnings
    assert 'robot_description' in warning
    # A misspelt name, and a time of others, are errors.
    for name, words in (('dampermass', 'write damper_mass'), ('use_sim_time', 'publish_clock')):
        with pytest.raises(ParameterError, match=words):
            parameters_from_overrides({name: 1}, ('use_sim_time',), pytest.fail)


def test_limits_to_files():
    for name, least in (('max_bag_size', 100_000), ('max_bag_duration', 1.0)):
        for good in (0, least):
            value = type(least)(good)
            assert getattr(NodeParameters.from_values({name: value}), name) == good
        assert f'0, or at least {least:g}.' in descriptor(ALL_SPECS[name]).additional_constraints


def test_nearest_name():
    assert nearest_name('restitution1') == 'restitution_1'
    assert nearest_name('zzzz') == ''


@pytest.mark.parametrize('name', ALL_SPECS)
def test_descriptors_say_it_all(name):
    spec = ALL_SPECS[name]
    made = descriptor(spec)
    assert made.name == name
    assert made.description.startswith(spec.description)
    assert (f'Unit: {spec.unit}.' in made.description) == bool(spec.unit)
    fixed = ('state_rate', 'publish_clock', 'real_time_priority')
    fixed += ('measurement_rate', 'control_law', 'lock_step', 'force_record', 'base_record')
    assert made.read_only == (name in fixed)
    if spec.choices:
        assert made.additional_constraints.startswith(f'One of {", ".join(spec.choices)}.')
    if spec.low is None:
        assert not made.floating_point_range
        assert not made.integer_range
    elif spec.kind == 'integer':
        (limits,) = made.integer_range
        assert (limits.from_value, limits.to_value, limits.step) == (spec.low, spec.high, 1)
        assert not made.floating_point_range
    else:
        (limits,) = made.integer_range or made.floating_point_range
        assert (limits.from_value, limits.to_value) == (spec.low, spec.high)


def test_defaults_are_those_of_the_rig():
    values = NodeParameters.from_values({}).as_dict()
    for name, spec in {**PARAMETER_SPECS, **INITIAL_SPECS}.items():
        assert values[name] == spec.default
    assert set(values) == set(ALL_SPECS)


def test_directory_of_recordings_in_the_home_directory(monkeypatch):
    monkeypatch.setenv('HOME', '/home/rig')
    for text, directory in (
        ('~/runs', '/home/rig/runs'),
        ('~', '/home/rig'),
        ('runs/~x', 'runs/~x'),
        ('./~', './~'),
        ('a b/ü', 'a b/ü'),
    ):
        node = NodeParameters.from_values({'bag_directory': text})
        assert node.bag_directory == directory
        assert NodeParameters.from_values({}).with_changes({'bag_directory': text}) == node


#: Entries of a parameters file in which the order, the namespace or a wildcard decides.
ENTRIES = {
    'two rigs': '/rig1/sim_node: {gap: 2.0}\n/rig2/sim_node: {gap: 3.0}',
    'in common': '/**: {gap: 1.0, friction: 0.1}\n/rig1/sim_node: {gap: 2.0}',
    'in common, last': '/rig1/sim_node: {gap: 2.0}\n/**: {gap: 1.0, friction: 0.1}',
    'bare name': 'sim_node: {gap: 4.0}\n/rig2/other: {gap: 5.0}',
    'nested': 'rig2:\n  sim_node: {gap: 3.0}\n/a:\n  b:\n    sim_node: {angle: 0.9}',
    'nested with a slash': '/rig2/:\n  sim_node: {gap: 3.0}',
    'one part': '/*/sim_node: {damping: 0.5}\n/rig2/*: {angle: 0.5}\n/*: {gap: 6.0}',
    'any parts': '/**/sim_node: {gap: 0.5}\n/a/**: {gap: 7.0}\n/*/*: {friction: 0.3}',
    'any, then one': '/**: {gap: 1.0}\n/sim_node: {gap: 2.0}\n---\n/**: {gap: 3.0}',
    'one, then any': '/sim_node: {gap: 2.0}\n---\n/**: {gap: 3.0}',
}
NAMESPACES = ('', '/rig1', '/rig2', '/a/b')


def given_by_ros(words):
    """Return what ROS gives to a node in each namespace, by its full name."""
    context, given = Context(), {}
    context.init(['--ros-args', *words])
    try:
        for namespace in NAMESPACES:
            node = Node('sim_node', namespace=namespace, context=context, enable_rosout=False)
            overrides = {p: value.value for p, value in node._parameter_overrides.items()}
            given[node.get_fully_qualified_name()] = overrides
            node.destroy_node()
    finally:
        context.try_shutdown()
    return given


def write_entries(path, name, encoding='utf-8'):
    text = re.sub(r'\{(.+)\}', r'{ros__parameters: {\1}}', ENTRIES[name])
    path.write_text(text, encoding=encoding)
    return str(path)


@pytest.mark.parametrize('encoding', ['utf-8', 'utf-16'])
@pytest.mark.parametrize('entries', ENTRIES)
def test_the_rig_of_a_file_is_that_which_ros_gives_the_node(entries, encoding, tmp_path):
    path = write_entries(tmp_path / 'rigs.yaml', entries, encoding)
    for name, given in given_by_ros(['--params-file', path]).items():
        if given:
            assert load_parameters(path, node=name)[0] == RigParameters(**given), name
        else:
            with pytest.raises(ParametersFileError, match=f'no parameters for {name} among'):
                load_parameters(path, node=name)


#: Arguments, with files by the names of their `ENTRIES`.
GIVEN = [
    'FILE in common -p gap:=9.0',
    'FILE in common, last -p gap:=9.0',
    '-p gap:=9.0 FILE in common',
    'FILE in common -p sim_node:gap:=9.0 -p friction:=0.2',
    'FILE bare name FILE in common -p angle:=0.2 -p angle:=0.3',
    'FILE in common FILE bare name --param other:gap:=8.0',
]


@pytest.mark.parametrize('given', GIVEN)
def test_files_and_the_command_line_count_as_in_ros(given, tmp_path):
    words = []
    for part in re.split(r'(FILE [a-z ,]+?(?= FILE| -|$))', given):
        if part.startswith('FILE'):
            words += ['--params-file', write_entries(tmp_path / f'{part[5:]}.yaml', part[5:])]
        else:
            words += part.split()
    for name, of_ros in given_by_ros(words).items():
        assert values_given(['--ros-args', *words], name)[0] == of_ros


def test_the_last_value_counts_whatever_its_type(tmp_path):
    """In rcl there is one value of each type, and rclpy takes a whole number before a float."""
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text('/**: {ros__parameters: {gap: 1, friction: 0.5, force_amplitudes: [2]}}')
    second.write_text('/**/sim_node: {ros__parameters: {friction: 1}}')
    words = ['sim_node', '--ros-args', '--params-file', str(first), '--params-file', str(second)]
    words += ['-p', 'gap:=2.5', '-p', 'other:gap:=7', '-p', 'force_amplitudes:=[0.5]']
    words += ['--', '-p', 'gap:=8']
    given, idle, applied = values_given(words, '/rig/sim_node')
    assert given == {'gap': 2.5, 'friction': 1, 'force_amplitudes': [0.5]}
    assert not idle
    assert applied == [f'{first} (/**)', f'{second} (/**/sim_node)', 'the command line']
    assert values_given(['--ros-args', '-p', 'gap:=['], '/a') == ({}, [], [])


def test_the_unit_of_base_amplitudes_is_their_quantity():
    rig = RigParameters()
    meant = normalise([Parameter('base_amplitudes', value='2 mm')], rig)
    values = {parameter.name: parameter.value for parameter in meant}
    assert list(values['base_amplitudes']) == [0.002]
    assert values['base_quantity'] == 'displacement'
    # YAML 1.1 takes 5e-1 for a text.
    for given in ([0.5, 0.1], '[5e-1, 1e-1]'):
        meant = normalise([Parameter('base_amplitudes', value=given)], rig)
        values = {parameter.name: list(parameter.value) for parameter in meant}
        assert (values['base_amplitudes'], values['base_frequencies']) == ([0.5, 0.1], [1.0, 0.0])
        assert 'base_quantity' not in values
