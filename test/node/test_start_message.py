"""What the node says as it starts, and of another one that publishes the clock."""

from impact_damper_ros.bag.rig_topics import RIG_TOPICS
from impact_damper_ros.node.parameters import parameters_from_overrides
from impact_damper_ros.node.publishing import TopicPublisher
from impact_damper_ros.node.sim_node import start_message
from node.rig_client import LIVELY, until


def said_by(recording='', **values):
    """Return what a node says in a namespace."""
    parameters = parameters_from_overrides({**LIVELY, **values}, (), print)
    names = [*RIG_TOPICS, *(['clock'] if parameters.simulated_time else [])]
    publishers = {
        name: TopicPublisher(f'{"" if name in ("diagnostics", "clock") else "/lab"}/{name}', print)
        for name in names
    }
    return start_message(parameters, publishers, '/lab/sim_node', recording)


def test_start_message_names_what_runs():
    said = said_by(gap_control='timed', publish_clock=True)
    assert '/lab/sim_node runs in real time\n' in said
    assert (
        'natural frequency 5.03 Hz (31.62 rad/s), ζ 0.949 %; force 10 N at 5.03 Hz (31.6 rad/s) = '
        '0.999 of it; gap 0.01 m; level\n'
    ) in said
    assert 'control    timed\n' in said
    states = '/lab/joint_states at 200 Hz'
    others = [f'/lab/{name}' for name in ('impacts', 'gap_control', 'snapshot')]
    assert f'topics     {", ".join([states, *others])}, /diagnostics, /clock\n' in said
    services = [f'/lab/sim_node/{n}' for n in ('reset', 'pause', 'step', 'step_to_impact')]
    assert f'services   {", ".join(services)}\n' in said
    assert 'or rig_page' in said
    assert 'Hz were meant' not in said


def test_start_message_of_a_recording_and_of_a_frequency_in_hertz():
    values = {'force_frequencies': '[5.0]', 'real_time_factor': 0.5}
    values |= {'gap_control': 'external', 'measurement_rate': 50.0}
    said = said_by('runs/rig_1', **values)
    assert 'recording  to runs/rig_1\n' in said
    assert 'runs at 0.5 times real time' in said
    assert 'control    external: by the topics stop_commands and force_command\n' in said
    assert '/lab/measurements at 50 Hz, /lab/impacts' in said
    assert 'force 10 N at 0.796 Hz (5 rad/s) = 0.158 of it' in said
    assert 'if Hz were meant, give 31.4159' in said


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
