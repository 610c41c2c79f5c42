"""The parameters of a running node, over the services that `ros2 param` uses."""

import json
import math

import pytest
import rclpy
from rcl_interfaces.msg import Parameter, ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from running import DEADLINE_S, until

from impact_damper_ros import load_parameters
from impact_damper_ros.cli.simulate_rig import main
from impact_damper_ros.node import engine
from impact_damper_ros.node.parameters import descriptor
from impact_damper_ros.node.sim_node import SimNode
from impact_damper_ros.parameters.parameters_file import values_given
from impact_damper_ros.parameters.rig_parameters import ALL_SPECS


def test_every_parameter_is_declared_and_described(rig):
    """By the descriptors of `test_rig_parameters`."""
    assert set(ALL_SPECS) <= set(rig.parameters.names())
    assert rig.parameters.describe(*ALL_SPECS) == [descriptor(s) for s in ALL_SPECS.values()]


@pytest.mark.parametrize(
    ('name', 'given', 'stored'),
    [
        ('gap', '5e-3', 0.005),
        ('gap', '12 mm', 0.012),
        ('force_amplitudes', [7], [7.0]),
        ('multisine_lines', 37.0, 37),
        ('sweep_mode', False, 'off'),
    ],
)
def test_accepted_values_are_stored(rig, name, given, stored):
    assert rig.parameters.set(**{name: given}) == ''
    assert rig.parameters.get(name) == stored


@pytest.mark.parametrize(
    ('name', 'given', 'words'),
    [
        ('gap', math.nan, ['nan']),
        ('force_phases', [math.nan], ['force_phases[0]', 'nan']),
        ('state_rate', 100.0, ['fixed', 'start']),
        ('stifness', 1.0, ['did you mean stiffness?']),
        ('bag_directory', '', ['bag_directory']),
    ],
)
def test_rejected_values_are_explained_and_change_nothing(rig, name, given, words):
    names = rig.parameters.names()
    before = rig.parameters.get(*names)
    rig.reset()
    count = len(rig.snapshots)
    for reason in (
        rig.parameters.set(**{name: given}),
        rig.parameters.set_atomically(**{name: given}),
    ):
        for word in words:
            assert word in reason
    assert rig.parameters.get(*names) == before
    rig.await_states(3)
    # A machine that is late publishes one, too.
    assert all('"reason": "slip"' in message.data for message in rig.snapshots[count:])


def test_a_parameter_cannot_be_undeclared(rig):
    nothing = Parameter(name='gap', value=ParameterValue())
    assert 'gap' in rig.parameters.set(gap=nothing)
    assert rig.parameters.get('gap') == 0.01


def test_a_request_is_answered_when_it_is_in_effect(monkeypatch):
    """What the rig does not carry out is withdrawn, and changes no parameter."""
    rclpy.init(args=['sim_node', '--ros-args', '-r', '__ns:=/answers'])
    monkeypatch.setattr(engine, 'ANSWER_TIMEOUT_S', 0.1)
    node = SimNode((), SingleThreadedExecutor())
    try:
        # Its engine does not run yet.
        result = node.set_parameters_atomically([RosParameter('gap', value=2.0)])
        assert not result.successful
        assert 'has not answered within 0.1 s: the request is withdrawn' in result.reason
        assert node.get_parameter('gap').value == 37.0
        assert node.engine.parameters.rig.gap == 37.0
        monkeypatch.setattr(engine, 'ANSWER_TIMEOUT_S', DEADLINE_S)
        node.start()
        for gap in (3.0, 4.0, 5.0):
            assert node.set_parameters_atomically([RosParameter('gap', value=gap)]).successful
            assert node.engine._rig.parameters.gap == gap
            assert node.get_parameter('gap').value == gap
        # What the rig refuses is no value of the node either.
        monkeypatch.setattr(node.engine._rig, 'change', lambda *_: 1.0 / 0.0)
        result = node.set_parameters_atomically([RosParameter('gap', value=6.0)])
        assert (result.successful, 'division by zero' in result.reason) == (False, True)
        assert node.get_parameter('gap').value == node.engine.parameters.rig.gap == 5.0
    finally:
        node.finish()
        node.destroy_node()
        rclpy.try_shutdown()


def test_a_request_is_judged_as_a_whole(rig):
    """With the force arrays that it resizes; see `test_rig_parameters`."""
    before = rig.parameters.get('stiffness', 'gap')
    reason = rig.parameters.set_atomically(stiffness=2000.0, gap=0.02, restitution_1=1.5)
    assert 'restitution_1' in reason
    assert rig.parameters.get('stiffness', 'gap') == before
    arrays = ('force_amplitudes', 'force_frequencies', 'force_phases')
    assert rig.parameters.set(force_amplitudes='[10, 0.5, 2]') == ''
    assert rig.parameters.get(*arrays) == [[10.0, 0.5, 2.0], [31.6, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_bad_parameters_at_start_end_the_node(launch):
    cases = {
        'write stiffness': {'stifness': 3},
        'between the stops': {'initial_damper_offset': 30},
        'not [1, 0.5]': {'force_amplitudes': '[1, 0.5]'},
        'cannot record to': {'record': True, 'bag_directory': '/dev/null/runs'},
    }
    processes = {words: launch(**parameters) for words, parameters in cases.items()}
    for words, process in processes.items():
        assert process.wait() == 1
        assert words in process.output
        assert 'Traceback' not in process.output
        (line,) = [line for line in process.output.splitlines() if 'cannot start' in line]
        assert words in line


def test_the_last_value_counts_whatever_its_type(launch, tmp_path):
    """In rcl there is one value of each type, and rclpy takes a whole number before a float."""
    first, second = tmp_path / 'first.yaml', tmp_path / 'second.yaml'
    first.write_text('/**: {ros__parameters: {gap: 1, friction: 0.5, force_amplitudes: [2]}}')
    second.write_text('/**/sim_node: {ros__parameters: {friction: 1}}')
    words = ('--ros-args', '--params-file', str(first), '--params-file', str(second))
    words += ('-p', 'gap:=2.5', '-p', 'other:gap:=7', '-p', 'force_amplitudes:=[0.5]')
    given, idle, applied = values_given(
        ['sim_node', *words, '--', '-p', 'gap:=8'], '/rig/sim_node'
    )
    assert given == {'gap': 2.5, 'friction': 1, 'force_amplitudes': [0.5]}
    assert not idle
    assert applied == [f'{first} (/**)', f'{second} (/**/sim_node)', 'the command line']
    assert values_given(['--ros-args', '-p', 'gap:=['], '/a') == ({}, [], [])
    process = launch(parameters_file=first, gap='0.o12')
    assert process.wait() == 1
    assert "cannot start: gap is '0.o12': 'o12' is no unit of it" in process.output


#: Files, the names of whose entries are not that of the node.
FOR_OTHERS = {
    'two.yaml': (
        '/rig1/sim_node: {ros__parameters: {gap: 1.0}}\n'
        '/rig2: {sim_node: {ros__parameters: {gap: 2.0}}}'
    ),
    'empty.yaml': '',
}


def test_a_file_without_parameters_for_the_node(launch, tmp_path):
    """The node once started the default rig without a word."""
    paths = {name: tmp_path / name for name in FOR_OTHERS}
    for name, path in paths.items():
        path.write_text(FOR_OTHERS[name])
    ended = {name: launch(parameters_file=path) for name, path in paths.items()}
    for name, process in ended.items():
        assert process.wait() == 1
        (line,) = [text for text in process.output.splitlines() if 'cannot start' in text]
        assert str(paths[name]) in line
        assert 'start the file with "/**:"' in line
    assert 'no parameters for /sim_node among /rig1/sim_node, /rig2/sim_node: give one of' in (
        ended['two.yaml'].output
    )
    assert 'holds no parameters' in ended['empty.yaml'].output
    camera = tmp_path / 'camera.yaml'
    camera.write_text('camera: {ros__parameters: {gap: 1.0}}')
    files = [camera, paths['two.yaml']]
    process = launch('__ns:=/rig2', parameters_file=files)
    until(lambda: 'runs in real time' in process.output, lambda: process.output)
    assert 'gap 2 m' in process.output
    assert 'no parameters for /rig2/sim_node among camera' in process.output
    assert process.stop() == 0


def test_commands_take_a_parameters_file_with_all_that_the_node_has(rig, tmp_path):
    """As `ros2 param dump` writes it; the commands read it without ROS, by a list of names."""
    names = rig.parameters.names()
    values = dict(zip(names, rig.parameters.get(*names), strict=True))
    assert {'real_time_priority', 'predict_motion'} <= values.keys()
    lines = [f'    {name}: {json.dumps(_plain(value))}' for name, value in values.items()]
    path = tmp_path / 'dumped.yaml'
    path.write_text('\n'.join(['/sim_node:', '  ros__parameters:', *lines, '']))
    loaded, initial, other = load_parameters(path)
    named = {**loaded.as_dict(), **initial.as_dict(), **other}
    assert named.keys() == values.keys()
    assert named['stiffness'] == values['stiffness']
    assert main([str(path), '--duration', '0.1', '--quiet']) == 0


def _plain(value):
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value


#: A file with units, a thousand parameters of other nodes, and an entry of another name.
MANY = f"""\
/**:
  ros__parameters:
    gap: 12mm
    angle: 10 deg
    "\\e[31mred": 1
{''.join(f'    p{number}: 1{chr(10)}' for number in range(1000))}
/other/sim_node: {{ros__parameters: {{gap: 0.5}}}}
"""


def test_a_start_says_what_applies(launch, namespace, tmp_path):
    path = tmp_path / 'many.yaml'
    path.write_text(MANY)
    process = launch(f'__ns:={namespace}', parameters_file=path, force_frequencies='5 Hz')
    until(lambda: 'recording  off' in process.output, lambda: process.output)
    text = process.output
    assert f'are given, by {path} (/**), the command line\n' in text
    assert '5.00 Hz (31.42 rad/s)' in text
    assert 'gap 0.012 m; inclined by 10°' in text
    assert text.count('is not one of this node; it is ignored') == 8
    assert '993 more parameters are ignored as well' in text
    assert '\x1b[31m' not in text
    assert process.stop() == 0


def test_values_in_rejections_are_short(rig):
    reason = rig.parameters.set(gap='x' * 100_000)
    assert 'gap' in reason
    assert len(reason) < 300
    reason = rig.parameters.set(**{'y' * 100_000: 1.0})
    assert len(reason) < 300
    reason = rig.parameters.set(gap_control='\x1b[2J')
    assert '\x1b' not in reason
