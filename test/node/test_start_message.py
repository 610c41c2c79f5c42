"""What the node says as it starts, and of another one that publishes the clock."""

from impact_damper_ros.node.parameters import parameters_from_overrides
from impact_damper_ros.node.sim_node import start_message
from node.rig_client import LIVELY, until


def start_text(recording='', **values):
    """Return what a node says in a namespace."""
    parameters = parameters_from_overrides({**LIVELY, **values}, (), print)
    return start_message(parameters, '/lab/sim_node', recording)


def test_start_message_names_what_runs():
    text = start_text()
    assert '/lab/sim_node runs in real time\n' in text
    assert (
        'natural frequency 5.03 Hz (31.62 rad/s), ζ 0.949 %; force 10 N at 5.03 Hz (31.6 rad/s) = '
        '0.999 of it; gap 0.01 m; level\n'
    ) in text
    assert text.endswith('recording  off')


def test_start_message_of_a_recording_and_of_a_frequency_in_hertz():
    text = start_text('runs/rig_1', force_frequencies='[5.0]', real_time_factor=0.5)
    assert 'recording  to runs/rig_1\n' in text
    assert 'runs at 0.5 times real time' in text
    assert 'force 10 N at 0.796 Hz (5 rad/s) = 0.158 of it' in text
    assert 'if Hz were meant, give 31.4159' in text


def test_two_rigs_that_publish_the_clock_warn(launch, namespace):
    both = [
        launch(f'__ns:={namespace}_{factor:.0f}', real_time_factor=factor) for factor in (2.0, 3.0)
    ]
    words = 'another node publishes /clock, too'
    for process in both:
        until(lambda process=process: words in process.output)
    for process in both:
        assert process.stop() == 0
        assert process.output.count(words) == 1
