"""What the node says as it starts."""

from running import SOURCE

from impact_damper_ros.node.parameters import parameters_from_overrides
from impact_damper_ros.node.start_message import given_text, start_message
from impact_damper_ros.node.usage import USAGE
from node.rig_client import LIVELY


def start_text(recording='', **values):
    """Return what a node says in a namespace."""
    parameters = parameters_from_overrides({**LIVELY, **values}, (), print)
    return start_message(parameters, '/lab/sim_node', recording)


def test_start_message_names_what_runs():
    text = start_text()
    assert '/lab/sim_node runs in real time\n' in text
    assert (
        'natural frequency 5.03 Hz (31.62 rad/s), ζ 0.949 %; force 10 N at 5.03 Hz (31.6 rad/s), '
        '0.999 times the natural one; gap 0.01 m; horizontal\n'
    ) in text
    assert 'parameters all by default\n' in text
    assert text.endswith('recording  off')
    some = given_text(
        {'gap': 1.0, 'friction': 0.0, 'other': 2}, ['rig.yaml (/**)', 'the command line']
    )
    assert some.endswith(' are given, by rig.yaml (/**), the command line')
    assert some.startswith('2 of ')


def test_start_message_of_lock_step_without_a_controller():
    lock_step = {'lock_step': 'stop_commands', 'measurement_rate': 100.0}
    words = 'lock_step has no effect: gap_control is off, set it to external'
    assert words in start_text(**lock_step)
    assert words not in start_text(**lock_step, gap_control='external')


def test_start_message_of_a_recording_and_of_a_frequency_in_hertz():
    text = start_text('runs/rig_1', force_frequencies='[5.0]', real_time_factor=0.5)
    assert 'recording  to runs/rig_1\n' in text
    assert 'runs at 0.5 times real time' in text
    assert 'force 10 N at 0.796 Hz (5 rad/s), 0.158 times the natural one' in text
    assert 'if Hz were meant, give 31.4159' in text


def test_the_reference_of_the_commands_has_the_node():
    page = SOURCE / 'docs' / 'reference' / 'commands.md'
    assert f'```text\n{USAGE}\n```' in page.read_text(encoding='utf-8')
