"""Absurd rigs over DDS: the node answers, says what keeps it, and ends with a whole bag."""

import contextlib
import json
import re
import signal
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.bag import RecordingError, RunReader
from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.node.pacing import CATCH_UP_NS
from node.rig_client import LIVELY, RigParametersClient, stamp_ns

ENDLESS = {
    'gap': 1e-9,
    'gravity': 0.0,
    'restitution_1': 1.0,
    'restitution_2': 1.0,
    'initial_damper_velocity': 1e9,
}
#: Bounces of 0.1 pm on an elastic stop: 1e8 impacts per second.
HAMMERING = {
    'angle': 1.5708,
    'gravity': 1e4,
    'one_sided': True,
    'restitution_1': 1.0,
    'initial_damper_offset': 0.005 - 1.25e-13,
}
#: Rigs that are held: elastic stops 1 nm apart, weight or compressed air that presses m to one.
HELD = {
    'endless': ENDLESS,
    'endless, slower': {**ENDLESS, 'initial_damper_velocity': 1e6},
    'endless, under control': {**ENDLESS, 'gap_control': 'timed', 'gap_control_rate': 1000.0},
    'hammering': HAMMERING,
    'chatter': {**HAMMERING, 'restitution_1': 0.9999999},
    'air': {'air_force': 1e9, 'restitution_1': 1.0, 'restitution_2': 1.0},
}
CALM = {
    'angle': 0.0,
    'gap': 0.01,
    'gravity': 9.81,
    'air_force': 0.0,
    'one_sided': False,
    'restitution_1': 0.5,
    'restitution_2': 0.5,
    'gap_control': 'off',
    'initial_damper_offset': 0.0,
    'initial_damper_velocity': 0.0,
}
#: The node on a machine that stops it at random places, for longer than a slice of its search.
STALLS = """
import random, sys, time
rng, lost = random.Random(7), 0
monotonic_ns, thread_time_ns, time_ns = time.monotonic_ns, time.thread_time_ns, time.time_ns

def stalled(clock):
    global lost
    lost += rng.randrange(2 * 10**7, 4 * 10**7) if rng.random() < 0.02 else 0
    return clock() + lost

time.monotonic_ns = lambda: stalled(monotonic_ns)
time.thread_time_ns = lambda: stalled(thread_time_ns)
time.time_ns = lambda: time_ns() + lost
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


def bag_of(directory):
    (bag,) = (directory / 'runs').iterdir()
    reader = RunReader(bag)
    assert reader.complete
    assert reader.unusable == 0
    return bag


def statuses(reports, task):
    return [s for r in list(reports) for s in r.status if s.name.endswith(f'sim_node: {task}')]


@pytest.fixture
def recording(client, launch, namespace):
    """Start a node that records, and wait for it."""

    def start(code=None, **parameters):
        states = client.listen(JointState, f'{namespace}/joint_states')
        values = {'record': True, **LIVELY, **parameters}
        process = launch(f'__ns:={namespace}', code=code, **values)
        until(lambda: len(states) > 20, lambda: process.output)
        return process, states, RigParametersClient(client, f'{namespace}/sim_node')

    return start


def test_held_rigs_say_so_and_are_replayed_wherever_the_machine_stalls(
    client, recording, namespace, tmp_path, capsys
):
    """The state in which each is held, and made calmer, does not depend on the stalls."""
    reports = client.listen(DiagnosticArray, '/diagnostics')
    process, states, parameters = recording(code=STALLS)

    def hold(values):
        assert parameters.set_atomically(**values) == '', values
        assert client.call(Trigger, f'{namespace}/sim_node/reset').success
        until(lambda: states[-1].header.frame_id == PAUSED_FRAME, values)

    def go_on(values):
        assert parameters.set_atomically(**values) == '', values
        until(lambda: states[-1].header.frame_id != PAUSED_FRAME, values)

    for values in HELD.values():
        hold(values)
        go_on(CALM)
    hold(HAMMERING)
    # A change that is no remedy: it tries again.
    assert parameters.set(damper_mass=0.11) == ''
    reports.clear()
    held = until(lambda: [s for s in statuses(reports, 'rig') if s.message.startswith('held: ')])
    assert held[0].level == DiagnosticStatus.ERROR
    assert held[0].message.startswith('held: the rig had ')
    assert 'make the stops less elastic or the gap wider' in held[0].message
    assert held[0].message.endswith('it waits for a changed parameter or ~/reset')
    values = {value.key: value.value for value in held[0].values}
    assert values['Held'] == 'True'
    assert int(values['Events']) > 2500
    # Harmless initial conditions are a remedy.
    assert parameters.set(initial_damper_offset=0.0) == ''
    assert client.call(Trigger, f'{namespace}/sim_node/reset').success
    until(lambda: states[-1].header.frame_id != PAUSED_FRAME)
    reports.clear()
    rig = until(lambda: statuses(reports, 'rig'))
    assert rig[-1].level == DiagnosticStatus.OK
    assert process.stop() == 0, process.output
    assert 'Traceback' not in process.output
    bag = str(bag_of(tmp_path / 'process_0'))
    assert replay_run([bag]) == 0, capsys.readouterr().out
    said = capsys.readouterr().out
    assert f'{len(HELD) + 2} resets' in said, said


def late_ns(states, node):
    """Return by how much the last stamp is behind the system time, ns."""
    return node.get_clock().now().nanoseconds - stamp_ns(states[-1].header.stamp)


#: The node on a machine whose system clock is set by so many seconds as the file `set_by` says.
CLOCK = """
import sys, time
from pathlib import Path
time_ns, set_by = time.time_ns, Path('set_by')
time.time_ns = lambda: time_ns() + 10**9 * int(set_by.read_text() if set_by.exists() else 0)
time.time = lambda: time.time_ns() * 1e-9
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


@pytest.mark.parametrize(('step_s', 'paused'), [(3600, True), (-3600, False)])
def test_stamps_follow_a_step_of_the_system_clock(
    client, recording, namespace, tmp_path, step_s, paused
):
    """As after a slip; stamps of a bag only increase, so they go back once it has ended."""
    snapshots = client.listen(String, f'{namespace}/snapshot')
    process, states, parameters = recording(code=CLOCK)

    def pause(data):
        service = f'{namespace}/sim_node/pause'
        assert client.call(SetBool, service, SetBool.Request(data=data)).success

    def ahead_ns():
        return -late_ns(states, client.node)

    # That it was late a moment ago is no reason to be silent about the clock.
    process.send(signal.SIGSTOP)
    time.sleep(0.5)
    process.send(signal.SIGCONT)
    until(lambda: 'they are moved on' in process.output, lambda: process.output)
    if paused:
        pause(True)
        until(lambda: states[-1].header.frame_id == PAUSED_FRAME)
    new = tmp_path / 'new'
    new.write_text(f'{step_s}')
    new.rename(tmp_path / 'process_0' / 'set_by')
    if step_s < 0:
        count = len(states)
        until(lambda: len(states) > count + 100)
        assert abs(ahead_ns()) < 60 * 10**9
        assert parameters.set(record=False) == ''
    until(lambda: abs(ahead_ns() - step_s * 10**9) < CATCH_UP_NS)
    if paused:
        pause(False)
        until(lambda: states[-1].header.frame_id != PAUSED_FRAME)
    count = len(states)
    until(lambda: len(states) > count + 100)
    until(lambda: abs(ahead_ns() - step_s * 10**9) < CATCH_UP_NS)
    if not paused:
        # Less by what the rig was late meanwhile
        words = re.compile(r'were [123]\d{3}\.\d+ s ahead of .* moved back')
        until(lambda: words.search(process.output), lambda: process.output)
    # At the end of a pause, one snapshot may be for both.
    moved = [s for m in snapshots if (s := json.loads(m.data))['reason'] in ('slip', 'resume')]
    now_s = client.node.get_clock().now().nanoseconds * 1e-9
    offset_s, time_s = moved[-1]['stamp_offset_ns'] * 1e-9, moved[-1]['time_ns'] * 1e-9
    assert abs(offset_s + time_s - now_s - step_s) < 60.0
    assert process.stop() == 0, process.output
    bag_of(tmp_path / 'process_0')


def test_a_node_started_by_nohup_outlives_its_terminal(recording, tmp_path):
    process, states, _ = recording(
        code="""
import signal, sys
signal.signal(signal.SIGHUP, signal.SIG_IGN)
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""
    )
    process.send(signal.SIGHUP)
    count = len(states)
    until(lambda: len(states) > count + 20)
    assert process.stop() == 0, process.output
    bag_of(tmp_path / 'process_0')


def test_what_is_recorded_first_is_on_the_disk_at_once(recording, tmp_path):
    """Killed some messages after its start, the node leaves a bag with a beginning."""

    def reasons(number):
        """Return the reasons of the snapshots on the disk after a third of a second."""
        process, states, _ = recording()
        until(lambda: len(states) > 60)
        process.kill()
        (bag,) = (tmp_path / f'process_{number}' / 'runs').iterdir()
        with contextlib.suppress(RecordingError):
            reader = RunReader(bag)
            records = reader.records([reader.custom['snapshot']])
            snapshots = [deserialize_message(record.content, String).data for record in records]
            return [json.loads(text)['reason'] for text in snapshots][:2]

    # The thread that writes may have had no processor until then, but not each time
    assert ['record', 'start'] in map(reasons, range(8))


def test_others_are_answered_during_a_step(client, launch, namespace):
    """The next sample is seconds away."""
    process = launch(f'__ns:={namespace}', real_time_factor=0.01, state_rate=10.0)
    service = f'{namespace}/sim_node'
    parameters = RigParametersClient(client, service)

    def pause():
        assert client.call(SetBool, f'{service}/pause', SetBool.Request(data=True)).success

    def step_begun():
        """Return a step that is under way; a busy machine may be too late to notice one."""
        while True:
            pause()
            step = client.request(f'{service}/step', Trigger.Request())
            if client.call(Trigger, f'{service}/step').message == 'a step is under way':
                return step

    def asked_during_a_step():
        """Set a parameter, which takes less than a step may: two seconds, but not each time."""
        step = step_begun()
        assert parameters.set(gap=0.02) == ''
        return None if step.done() else step

    step = until(asked_during_a_step)
    answer = until(lambda: step.done() and step.result())
    assert answer.success
    assert answer.message.startswith('on the way to the next joint states, at rig time')
    # A pause ends the step, and the answer comes at once.
    step = step_begun()
    pause()
    answer = until(lambda: step.done() and step.result())
    assert 'the step was ended by a pause' in answer.message or 'on the way' in answer.message
    assert process.stop() == 0, process.output
