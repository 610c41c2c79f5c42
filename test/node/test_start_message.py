"""What the node says as it starts, and of a second one of the same name."""

from node.rig_client import LIVELY, until


def test_start_message_names_what_runs(launch, namespace):
    process = launch(f'__ns:={namespace}', **LIVELY, gap_control='timed', publish_clock=True)
    until(lambda: 'or rig_page' in process.output, lambda: process.output)
    said = process.output
    assert f'{namespace}/sim_node runs in real time\n' in said
    assert (
        'natural frequency 5.03 Hz (31.62 rad/s), ζ 0.949 %; force 10 N at 5.03 Hz (31.6 rad/s) = '
        '0.999 of it; gap 0.01 m; level\n'
    ) in said
    assert 'control    timed\n' in said
    states = f'{namespace}/joint_states at 200 Hz'
    others = [f'{namespace}/{name}' for name in ('impacts', 'gap_control', 'snapshot')]
    assert f'topics     {", ".join([states, *others])}, /diagnostics, /clock\n' in said
    services = [f'{namespace}/sim_node/{n}' for n in ('reset', 'pause', 'step', 'step_to_impact')]
    assert f'services   {", ".join(services)}\n' in said
    assert 'Hz were meant' not in said
    assert process.stop() == 0


def test_start_message_of_a_recording_and_of_a_frequency_in_hertz(launch, namespace, tmp_path):
    values = {**LIVELY, 'force_frequencies': '[5.0]', 'record': True, 'real_time_factor': 0.5}
    values |= {'gap_control': 'external', 'measurement_rate': 50.0}
    process = launch(f'__ns:={namespace}', **values)
    until(lambda: 'note  ' in process.output, lambda: process.output)
    (bag,) = (tmp_path / 'process_0' / 'runs').iterdir()
    assert f'recording  to runs/{bag.name}\n' in process.output
    assert 'runs at 0.5 times real time' in process.output
    assert 'control    external: by the topics stop_commands and force_command\n' in process.output
    assert f'{namespace}/measurements at 50 Hz, {namespace}/impacts' in process.output
    assert 'force 10 N at 0.796 Hz (5 rad/s) = 0.158 of it' in process.output
    assert 'if Hz were meant, give 31.4159' in process.output
    assert process.stop() == 0


def test_nodes_whose_messages_are_mixed_warn(launch, namespace):
    first, second = (
        launch(f'__ns:={namespace}', real_time_factor=factor) for factor in (2.0, 3.0)
    )
    words = (
        f'there are 2 nodes with the name {namespace}/sim_node',
        'another node publishes /clock, too',
    )
    for process in (first, second):
        until(lambda process=process: all(word in process.output for word in words))
    for process in (first, second):
        assert process.stop() == 0
        assert [process.output.count(word) for word in words] == [1, 1]
