"""The parameters of a running node, over the services that `ros2 param` uses."""

import json
import math

import rclpy
from rcl_interfaces.msg import Parameter, ParameterValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter as RosParameter
from running import DEADLINE_S, Running

from impact_damper_ros import load_parameters
from impact_damper_ros.cli.simulate_rig import main
from impact_damper_ros.node import engine_state
from impact_damper_ros.node.engine_state import wait_for
from impact_damper_ros.node.parameters import descriptor
from impact_damper_ros.node.sim_node import SimNode
from impact_damper_ros.parameters.all_parameters import ALL_SPECS


def test_every_parameter_is_declared_and_described(rig):
    """By the descriptors of `test_rig_parameters`."""
    assert set(ALL_SPECS) <= set(rig.parameters.names())
    assert rig.parameters.describe(*ALL_SPECS) == [descriptor(s) for s in ALL_SPECS.values()]


def test_accepted_values_are_stored(rig):
    for name, given, stored in (
        ('gap', '5e-3', 0.005),
        ('gap', '12 mm', 0.012),
        ('force_amplitudes', [7], [7.0]),
        ('multisine_lines', 37.0, 37),
        ('sweep_mode', False, 'off'),
    ):
        assert rig.parameters.set(**{name: given}) == ''
        assert rig.parameters.get(name) == stored


def test_rejected_values_are_explained_and_change_nothing(rig):
    """With short reasons, which do not act on the terminal."""
    names = rig.parameters.names()
    before = rig.parameters.get(*names)
    rig.reset()
    count = len(rig.snapshots())
    for name, given, words in (
        ('gap', math.nan, ['nan']),
        ('force_phases', [math.nan], ['force_phases[0]', 'nan']),
        ('state_rate', 100.0, ['fixed', 'start']),
        ('stifness', 1.0, ['did you mean stiffness?']),
        ('gap', [0.02], ['gap is [0.02]: give a number']),
        ('mass_ratio', 0.04, ['mass_ratio is for the start', '0.04 is a damper_mass of 0.04 kg']),
        ('damping_ratio', '3 %', ['is a damping of 1.8973666 N s/m']),
        ('natural_frequency', math.nan, ['natural_frequency is nan']),
        ('bag_directory', '', ['bag_directory']),
        ('gap', 'x' * 100_000, ['gap']),
        ('y' * 100_000, 1.0, ['y']),
        ('gap_control', '\x1b[2J', ['gap_control']),
        # A parameter cannot be undeclared.
        ('gap', Parameter(name='gap', value=ParameterValue()), ['gap']),
    ):
        for ask in (rig.parameters.set, rig.parameters.set_atomically):
            reason = ask(**{name: given})
            assert all(word in reason for word in words), reason
            assert len(reason) < 300
            assert '\x1b' not in reason
    # A request is judged as a whole.
    reason = rig.parameters.set_atomically(stiffness=2000.0, gap=0.02, restitution_1=1.5)
    assert 'restitution_1' in reason
    assert rig.parameters.get(*names) == before
    rig.await_states(3)
    # A machine that is late publishes one, too.
    assert all(snapshot['reason'] == 'slip' for snapshot in rig.snapshots()[count:])
    # With the force arrays that it resizes; see `test_rig_parameters`
    arrays = ('force_amplitudes', 'force_frequencies', 'force_phases')
    rig.change(force_amplitudes='[10, 0.5, 2]')
    assert rig.parameters.get(*arrays) == [[10.0, 0.5, 2.0], [31.6, 0.0, 0.0], [0.0, 0.0, 0.0]]


def test_a_request_is_answered_when_it_is_in_effect(monkeypatch):
    """What the rig does not carry out is withdrawn, and changes no parameter."""
    rclpy.init(args=['sim_node', '--ros-args', '-r', '__ns:=/answers'])
    monkeypatch.setattr(engine_state, 'ANSWER_TIMEOUT_S', 0.1)
    node = SimNode((), SingleThreadedExecutor())

    def asked(gap):
        """Ask for a gap; return the reason of a refusal, and see that all know the same gap."""
        result = node.set_parameters_atomically([RosParameter('gap', value=gap)])
        gaps = {node.get_parameter('gap').value, node.engine.parameters.rig.gap}
        gaps.add(node.engine._rig.parameters.gap)
        assert (len(gaps), gap in gaps) == (1, result.successful)
        return result.reason

    try:
        # Its engine does not run yet.
        assert 'has not answered within 0.1 s: the request is withdrawn' in asked(2.0)
        monkeypatch.setattr(engine_state, 'ANSWER_TIMEOUT_S', DEADLINE_S)
        node.start()
        assert [asked(gap) for gap in (3.0, 4.0, 5.0)] == ['', '', '']
        # If the rig cannot carry out a change, the parameter of the node keeps its value.
        change = node.engine._rig.change
        monkeypatch.setattr(node.engine._rig, 'change', lambda *rig: [change(*rig), 1.0 / 0.0])
        assert 'division by zero' in asked(6.0)
        # One that it cannot carry out only after it was accepted holds it, up to a reset.
        monkeypatch.setattr(node.engine._rig, 'check_change', lambda *_: None)
        result = node.set_parameters_atomically([RosParameter('gap', value=7.0)])
        assert (result.successful, node.engine._rig.parameters.gap) == (True, 5.0)
        assert 'division by zero' in node.engine.status().held
        monkeypatch.setattr(node.engine._rig, 'change', change)
        wait_for(node.engine.ask(node.engine.reset))
        assert (node.engine._rig.parameters.gap, node.engine.status().held) == (7.0, '')
    finally:
        node.finish()
        node.destroy_node()
        rclpy.try_shutdown()


#: Files by their names; the second has entries for other nodes, the last one no row that rises.
FILES = {
    'good.yaml': '/**: {ros__parameters: {gap: 1, friction: 0.5}}',
    'two.yaml': '/rig1/sim_node: {ros__parameters: {gap: 1.0}}\n'
    '/rig2: {sim_node: {ros__parameters: {gap: 2.0}}}',
    'empty.yaml': '',
    'flat.yaml': 'gap: 0.02\n',
    'no_block.yaml': '/**:\n    gap: 0.02\n',
    'tab.yaml': '/**:\n\tros__parameters:\n\t\tgap: 0.02\n',
    'record.csv': 't [s],force [N]\n0,1\n0.1,2\n0.1,3\n0.3,1\n',
}
#: Arguments with which the node does not start, and what it says.
REFUSED = {
    '-p stifness:=3': 'write stiffness',
    '-p initial_damper_offset:=30': 'between the stops',
    '-p force_amplitudes:=[1,0.5]': 'not [1, 0.5]',
    '-p record:=true -p bag_directory:=/dev/null/runs': 'cannot record to',
    '--params-file good.yaml -p gap:=0.o12': "gap is '0.o12': 'o12' is no unit of it",
    '--params-file two.yaml': 'two.yaml: no parameters for /sim_node among /rig1/sim_node, '
    '/rig2/sim_node: give one of',
    '--params-file empty.yaml': 'holds no parameters',
    '--params-file flat.yaml': 'flat.yaml: gap stands in no block of parameters: start the file',
    '--params-file no_block.yaml': 'no_block.yaml: /** has no ros__parameters: below it, write',
    '--params-file tab.yaml': 'tab.yaml: line 2: is not YAML: found character',
    '-p gap=0.02': "-p 'gap=0.02': write -p gap:=0.02",
    '-p gap:=': "-p 'gap:=': write -p NAME:=VALUE, as in -p gap:=12mm",
    '-p damping:=1.0 gap:=0.01': "unknown argument 'gap:=0.01'; parameters and their files follow "
    '--ros-args, each behind -p or --params-file',
    '-r __ns:=left': "-r '__ns:=left': write -r __ns:=/left",
    '-p force_record:=record.csv': ("line 4, column 't [s]': 0.1 after 0.1: the column must rise"),
    '-p lock_step:=both -p gap_control:=external': 'give a rate such as measurement_rate:=200.0',
    '-p base_record:=none.csv': 'none.csv: cannot be read (No such file or directory)',
}
#: One process for all, since it takes long to import ROS.
STARTS = """
import json, sys
from impact_damper_ros.node.sim_node import main
for words in json.loads(sys.argv[1]):
    code = main(['sim_node', '--ros-args', *words.split()])
    print('exit code', code, file=sys.stderr)
sys.exit(code)
"""


def test_bad_parameters_at_start_end_the_node(tmp_path):
    for name, text in FILES.items():
        (tmp_path / name).write_text(text)
    with Running(tmp_path, '-c', STARTS, json.dumps(list(REFUSED))) as process:
        assert process.wait() == 1
        text = process.output
    assert text.count('exit code 1\n') == len(REFUSED)
    assert 'Traceback' not in text
    reasons = [line for line in text.splitlines() if 'sim_node: cannot start: ' in line]
    for line, (words, reason) in zip(reasons, REFUSED.items(), strict=True):
        assert reason in line, words
        without = ('two.yaml', 'empty.yaml', 'flat.yaml')
        assert ('start the file with "/**:"' in line) == words.endswith(without)


def test_a_dump_of_a_rig_loads_into_any_running_rig(rig):
    """As `ros2 param load` sends what `ros2 param dump` has written: all, by the alphabet."""
    present = {n: plain(v) for n, v in shown(rig).items()}
    other = {
        **present,
        'base_amplitudes': [0.1, 0.2],
        'base_frequencies': [30.0, 45.0],
        'base_phases': [0.0, 1.0],
        'gap_min': 2e3,
        'gap_max': 3e3,
        'gap': 40.0,
        'initial_damper_offset': 15.0,
        'stiffness': 10.0,
        'damping': 0.01,
    }
    for values in (other, present):
        assert rig.parameters.set(**{name: values[name] for name in sorted(values)}) == [
            '' for _ in values
        ]
        assert {n: plain(v) for n, v in shown(rig).items()} == values
    # What cannot be loaded does not keep the rest out.
    reasons = rig.parameters.set(gap=0.02, state_rate=100.0, stifness=1.0, damping=0.7)
    assert [bool(reason) for reason in reasons] == [False, True, True, False]
    assert rig.parameters.get('gap', 'damping') == [0.02, 0.7]


def shown(rig):
    """Return the values of all parameters by name."""
    names = rig.parameters.names()
    return dict(zip(names, rig.parameters.get(*names), strict=True))


def test_commands_take_a_parameters_file_with_all_that_the_node_has(rig, tmp_path):
    """As `ros2 param dump` writes it; the commands read it without ROS, by a list of names."""
    values = shown(rig)
    assert {'real_time_priority', 'predict_motion'} <= values.keys()
    path = tmp_path / 'dumped.yaml'
    path.write_text(
        json.dumps({'/sim_node': {'ros__parameters': {n: plain(v) for n, v in values.items()}}})
    )
    loaded, initial, other = load_parameters(path)
    found = {**loaded.as_dict(), **initial.as_dict(), **other}
    assert found.keys() == values.keys()
    assert found['stiffness'] == values['stiffness']
    assert main([str(path), '--duration', '0.1', '--quiet']) == 0


def plain(value):
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value
