"""A controller outside the node: commands over DDS, refusals, watchdog; recorded and replayed."""

import importlib
import itertools
import json
import math
import sys
import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Wrench, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros import GapControlParameters, Order, Rig, RigParameters
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.node.commands import (
    CommandInbox,
    CommandTopic,
    read_force_command,
    read_stop_command,
)
from impact_damper_ros.node.external_control import ExternalControl
from impact_damper_ros.parameters.rig_parameters import NodeSettings
from node.rig_client import LIVELY, RigClient, RigParametersClient, SimProcess, stamp_ns

SPACE = '/plant'
RIG = RigParameters(**{name: json.loads(str(value)) for name, value in LIVELY.items()})
ACTUATORS = {'gap_min': 0.002, 'gap_max': 0.5, 'actuator_speed': 0.5, 'actuator_delay': 0.004}


class Plant:
    """A rig that is controlled from outside, and the client that does so."""

    def __init__(self, client, process, runs):
        self.client, self.process, self.runs = client, process, runs
        self.parameters = RigParametersClient(client, f'{SPACE}/sim_node')
        self.acts = client.listen(JointState, f'{SPACE}/gap_control')
        self.states = client.listen(JointState, f'{SPACE}/joint_states')
        self.reports = client.listen(DiagnosticArray, '/diagnostics')
        make = client.node.create_publisher
        self.stops = make(JointState, f'{SPACE}/stop_commands', QoSProfile(depth=10))
        self.force = make(WrenchStamped, f'{SPACE}/force_command', QoSProfile(depth=10))
        until(lambda: self.states or not process.running(), 'no joint states come')
        assert process.running(), process.output
        for publisher in (self.stops, self.force):
            until(lambda p=publisher: p.get_subscription_count() == 1)

    def send_stops(self, *places, **more):
        self.stops.publish(stops(*places, **more))

    def send_force(self, x):
        self.force.publish(force(x))

    def orders(self, since=0):
        """Return stamp, positions, speeds and force of the orders that were carried out."""
        return [
            (stamp_ns(m.header.stamp), *m.position[:2], *m.velocity[:2], m.effort[2])
            for m in self.acts[since:]
            if m.header.frame_id == 'order'
        ]

    def report(self, task='controller'):
        """Return message and values of the last report on the controller, or something else."""
        for report in reversed(list(self.reports)):
            for status in report.status:
                if status.name == f'{SPACE[1:]}/sim_node: {task}':
                    return status.message, {v.key: v.value for v in status.values}
        return '', {}

    def obeyed(self, send, *order):
        """Send a command until an order of these numbers is carried out."""
        before = len(self.acts)

        def done():
            send()
            time.sleep(0.01)
            return any(same(found, order) for _, *found in self.orders(before))

        until(done, lambda: self.orders(before))

    def refused(self, send, words):
        """Send a command until it is reported that one was refused, with a reason."""
        before = int(self.report()[1].get('Commands refused', 0))

        def done():
            send()
            time.sleep(0.01)
            return int(self.report()[1]['Commands refused']) > before

        until(done, self.report)
        assert words in self.report()[1]['Last refusal']


@pytest.fixture(scope='module')
def plant(tmp_path_factory):
    directory = tmp_path_factory.mktemp('plant')
    process = SimProcess(
        directory,
        (f'__ns:={SPACE}',),
        gap_control='external',
        command_timeout=0.0,
        bag_directory=directory / 'runs',
        **ACTUATORS,
        **LIVELY,
    )
    try:
        with RigClient() as client:
            plant = Plant(client, process, directory / 'runs')
            until(lambda: plant.report()[1])
            yield plant
        assert process.stop() == 0, process.output
        assert 'a callback failed' not in process.output, process.output
    finally:
        process.kill()


def same(a, b):
    return all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


def test_commands_are_carried_out_and_replayed_bit_for_bit(plant, capsys):
    assert plant.parameters.set(record=True) == ''
    nan = math.nan
    plant.obeyed(lambda: plant.send_stops(0.008, -0.006), 0.008, -0.006, nan, nan, nan)
    # One stop alone, at a speed
    send = {'names': ['stop_2'], 'velocity': [-0.2]}
    plant.obeyed(lambda: plant.send_stops(-0.009, **send), nan, -0.009, nan, 0.2, nan)
    plant.obeyed(lambda: plant.send_force(2.5), nan, nan, nan, nan, 2.5)
    # Many of both
    for k in range(60):
        plant.send_stops(0.008 + 0.001 * math.sin(k), -0.008)
        plant.send_force(math.cos(k))
        time.sleep(0.003)
    assert plant.parameters.set(gap_control='off') == ''
    assert plant.parameters.set(gap_control='external') == ''
    plant.obeyed(lambda: plant.send_force(-1.0), nan, nan, nan, nan, -1.0)
    moved = {m.header.frame_id for m in plant.acts}
    assert {'order', 'command', 'arrived'} <= moved
    assert plant.parameters.set(record=False) == ''
    (bag,) = plant.runs.iterdir()
    assert replay_run([str(bag)]) == 0, capsys.readouterr()


def stops(*places, names=('stop_1', 'stop_2'), velocity=(), stamp_s=0):
    message = JointState(name=names, position=places, velocity=velocity)
    message.header.stamp.sec = stamp_s
    return message


def force(x, y=0.0):
    message = WrenchStamped()
    message.wrench.force.x, message.wrench.force.y = x, y
    return message


@pytest.mark.parametrize(
    ('message', 'words', 'settings'),
    [
        (stops(math.nan, -0.01), 'stop_1 is nan', {}),
        (stops(0.3, -0.01), 'stop_1 is 0.3 m', {}),
        (stops(-0.01, 0.01), 'stop_1 must be above stop_2', {}),
        (stops(0.01, names=['elbow']), "'elbow'", {}),
        (stops(0.01, 0.01, names=['stop_1'] * 2), "names 'stop_1' twice", {}),
        (stops(0.01), '2 joints, 1 position', {}),
        (stops(0.01, -0.01, velocity=[math.nan, 0.1]), 'velocity of stop_1', {}),
        (force(math.nan), 'force.x is nan', {}),
        (force(1.0, 2.0), 'only force.x', {}),
        (stops(0.01, -0.01, stamp_s=90), 'late', {'command_timeout': 9.0}),
        (stops(0.01, -0.01, stamp_s=900), 'after that of the rig', {}),
        (stops(0.01, -0.01), 'set gap_control to external', {'gap_control': 'off'}),
        (stops(0.01, -0.01), '2 publishers', {'publishers': 2}),
    ],
)
def test_what_cannot_be_carried_out_is_refused_with_its_reason(message, words, settings):
    control = {'gap_control': settings.pop('gap_control', 'external'), **ACTUATORS}
    waiting, count = [serialize_message(message)], settings.pop('publishers', 1)
    read = read_force_command if isinstance(message, WrenchStamped) else read_stop_command
    take = iter([*waiting, None]).__next__
    inbox = CommandInbox([CommandTopic('key', 'topic', take, lambda: count, read)])
    rig = Rig(RIG, control=GapControlParameters(**control))
    controller = ExternalControl(rig, inbox, NodeSettings(**settings))
    assert list(controller.obey(10**9, 100 * 10**9)) == []
    assert (inbox.refused, inbox.reason[:7], words in inbox.reason) == (1, 'topic: ', True), inbox


def test_in_lock_step_each_measurement_has_one_command():
    """A measurement sent twice is answered twice; the second answer has no effect."""
    rig = Rig(RIG, control=GapControlParameters(gap_control='external', **ACTUATORS))
    waiting = []
    topics = [
        CommandTopic(
            key,
            key,
            lambda key=key: waiting.pop(0)[1] if waiting and waiting[0][0] == key else None,
            lambda: 1,
            read,
        )
        for key, read in (
            ('stop_commands', read_stop_command),
            ('force_command', read_force_command),
        )
    ]
    inbox = CommandInbox(topics)
    settings = NodeSettings(measurement_rate=1.0, lock_step='stop_commands')
    controller = ExternalControl(rig, inbox, settings)

    def obeyed(second, *messages):
        for message in messages:
            key = 'force_command' if isinstance(message, WrenchStamped) else 'stop_commands'
            waiting.append((key, serialize_message(message)))
        time_ns = round(second * 1e9)
        rig.advance(time_ns / 1e9)
        assert len(list(controller.measurements(time_ns, 0))) == (second == round(second))
        return len(list(controller.obey(time_ns, time_ns)))

    answers = [stops(0.01, -0.01, stamp_s=second) for second in range(4)]
    assert obeyed(0, answers[3]) == 0
    assert 'takes only that of the last measurement, 0.000' in inbox.reason
    assert obeyed(0.25, answers[0], answers[0]) == 1
    assert obeyed(0.5, answers[0]) == 0
    assert obeyed(1, answers[0]) == 0
    assert (obeyed(1.25), controller.waits, inbox.refused) == (0, True, 1)
    assert controller.status(0).awaited == 'stop_commands'
    assert obeyed(1.5, answers[1], stops(0.02, -0.02, stamp_s=9)) == 1
    assert (controller.waits, controller.status(0).awaited, inbox.refused) == (False, '', 2)
    assert obeyed(1.75, force(1.0)) == 0
    assert 'waits for stop_commands only: start with lock_step:=both' in inbox.reason
    # A rig that goes on without waiting takes any command; then it waits again.
    assert obeyed(2) == 0
    controller.give_up()
    assert obeyed(2.5, stops(0.02, -0.02), answers[2]) == 2
    assert obeyed(2.75, answers[2]) == 0
    assert (obeyed(3, answers[3]), controller.waits, inbox.refused) == (1, False, 3)
    # Also a command that comes too late ends that: its controller is waited for again.
    assert obeyed(4) == 0
    controller.give_up()
    for second in range(5, 20):
        obeyed(second)
        assert not controller.waits
    assert obeyed(20, stops(0.01, -0.01, stamp_s=4)) == 0
    assert 'late: its stamp is 16.000 s before' in inbox.reason
    assert (obeyed(21), controller.waits) == (0, True)
    # The last measurement, not the one that was answered last
    assert obeyed(21.5, stops(0.01, -0.01, stamp_s=20)) == 0
    assert inbox.reason.endswith('only that of the last measurement, 21.000000000 s')


def test_refusals_are_reported_and_a_second_controller_is_one(plant):
    other = plant.client.node.create_publisher(JointState, f'{SPACE}/stop_commands', 10)
    until(lambda: other.get_subscription_count() == 1)
    plant.refused(lambda: plant.send_stops(0.01, -0.01), '2 publishers')
    plant.client.node.destroy_publisher(other)
    plant.obeyed(lambda: plant.send_stops(0.01, -0.01), 0.01, -0.01, *[math.nan] * 3)


def test_a_best_effort_controller_is_obeyed_and_reported(plant):
    loose = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    plant.client.node.destroy_publisher(plant.stops)
    plant.stops = plant.client.node.create_publisher(JointState, f'{SPACE}/stop_commands', loose)
    plant.obeyed(lambda: plant.send_stops(0.011, -0.012), 0.011, -0.012, *[math.nan] * 3)
    words = f'/test_client publishes {SPACE}/stop_commands best effort: commands may get lost'
    until(lambda: plant.report('network')[0] == words, lambda: plant.report('network'))
    assert words in plant.process.output
    plant.client.node.destroy_publisher(plant.stops)
    # A reliable one again
    plant.stops = plant.client.node.create_publisher(JointState, f'{SPACE}/stop_commands', 10)
    plant.obeyed(lambda: plant.send_stops(0.013, -0.012), 0.013, -0.012, *[math.nan] * 3)


def test_partners_that_do_not_match_are_reported(plant):
    """A message of another type, and a subscription that asks for more than is offered."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

    def report():
        return plant.report('network')[0]

    with RigClient() as other:
        other.node.create_publisher(Wrench, f'{SPACE}/force_command', 10)
        other.node.create_subscription(JointState, f'{SPACE}/impacts', print, latched)
        until(
            lambda: (
                'publishes /plant/force_command as geometry_msgs/msg/Wrench,' in report()
                and '/test_client does not receive /plant/impacts' in report()
            ),
            report,
        )
    assert plant.process.output.count('does not receive /plant/impacts') == 1
    until(lambda: report() == 'no other node interferes', report)


def test_the_watchdog_parks_the_stops(plant):
    nan, half = math.nan, 0.5 * float(LIVELY['gap'])
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    snapshots = plant.client.listen(String, f'{SPACE}/snapshot', latched)
    assert plant.parameters.set_atomically(command_timeout=0.2, force_limit=3.0) == ''
    plant.obeyed(lambda: plant.send_force(-1e3), nan, nan, nan, nan, -3.0)
    begun = len(plant.acts)
    plant.obeyed(lambda: plant.send_stops(0.02, -0.02), 0.02, -0.02, nan, nan, nan)
    until(lambda: 'the stops are parked' in plant.report()[0], plant.report)
    moves = [order for order in plant.orders(begun) if order[1] == order[1]]
    places = [order[1] for order in moves]
    assert set(places) == {0.02, half}
    at = places.index(half, places.index(0.02))

    def waited_ns():
        """Return the time between the two in that of the rig, whose stamps may slip."""
        held = [json.loads(m.data) for m in list(snapshots)]
        offsets = [(h['stamp_offset_ns'] + h['time_ns'], h['stamp_offset_ns']) for h in held]
        begin, end = (
            stamp - max((since, offset) for since, offset in offsets if since <= stamp)[1]
            for stamp, *_ in moves[at - 1 : at + 1]
        )
        return end - begin

    # At the first tick after the time is over; a snapshot may come later than an act
    until(lambda: 0.2e9 < waited_ns() <= 0.2e9 + 1e9 / 200, waited_ns)
    assert 0.0 in [order[-1] for order in plant.orders()]
    assert int(plant.report()[1]['Forces limited']) > 0
    assert plant.parameters.set_atomically(command_timeout=0.0, force_limit=0.0) == ''
    plant.obeyed(lambda: plant.send_stops(0.02, -0.02), 0.02, -0.02, nan, nan, nan)
    until(lambda: plant.report()[1]['Stops parked'] == 'False')


@pytest.fixture(scope='module')
def stepped(tmp_path_factory):
    """Start a rig in lock-step, whose controller is the test."""
    directory = tmp_path_factory.mktemp('stepped')
    process = SimProcess(
        directory,
        ('__ns:=/stepped',),
        gap_control='external',
        gap_control_noise_position=1e-4,
        measurement_rate=50.0,
        lock_step='stop_commands',
        lock_step_timeout=1000.0,
        real_time_factor=0.0,
        **ACTUATORS,
        **LIVELY,
    )
    try:
        with RigClient() as client:
            yield client, process
        assert process.stop() == 0, process.output
    finally:
        process.kill()


def test_measurements_in_lock_step_are_those_of_the_sensors(stepped):
    client, process = stepped
    seen = client.listen(JointState, '/stepped/measurements')
    out = client.node.create_publisher(JointState, '/stepped/stop_commands', 10)
    twin = Rig(
        RIG,
        control=GapControlParameters(
            gap_control='external', gap_control_noise_position=1e-4, **ACTUATORS
        ),
    )
    for k in range(40):
        until(lambda k=k: seen and stamp_ns(seen[-1].header.stamp) == 20_000_000 * k)
        twin.advance(20_000_000 * k / 1e9)
        sample, rates = twin.measure(k)
        message = seen[-1]
        assert list(message.name) == ['primary', 'damper', 'stop_1', 'stop_2']
        assert list(message.position) == [sample.x, sample.y, sample.stop_1, sample.stop_2]
        assert list(message.velocity) == [sample.x_rate, sample.y_rate, *rates]
        half = 0.006 + 0.0001 * k
        command = JointState(name=['stop_1', 'stop_2'], position=[half, -half])
        # Another stamp is refused, and nothing is waited for any longer by it.
        command.header.stamp.sec = 1000
        out.publish(command)
        command.header.stamp = message.header.stamp
        out.publish(command)
        twin.order(Order(half, -half))
    # Without an answer it goes on, after a while.
    parameters = RigParametersClient(client, '/stepped/sim_node')
    assert parameters.set(lock_step_timeout=0.01) == ''
    until(lambda: len(seen) > 60 and 'goes on without' in process.output, lambda: process.output)


def test_a_slow_controller_that_joins_late_gets_in(client, launch, namespace):
    """The rig runs as fast as it can, so that the first answers come seconds of its time late."""
    process = launch(
        f'__ns:={namespace}',
        gap_control='external',
        measurement_rate=50.0,
        lock_step='stop_commands',
        lock_step_timeout=0.3,
        real_time_factor=0.0,
        **ACTUATORS,
        **LIVELY,
    )
    until(lambda: 'goes on without' in process.output, lambda: process.output)
    newest = QoSProfile(depth=1)
    seen = client.listen(JointState, f'{namespace}/measurements', newest)
    acts = client.listen(JointState, f'{namespace}/gap_control')
    out = client.node.create_publisher(JointState, f'{namespace}/stop_commands', 10)
    until(lambda: out.get_subscription_count() and seen and stamp_ns(seen[-1].header.stamp) > 2e10)

    def answered():
        command = stops(0.01, -0.01)
        command.header.stamp = seen[-1].header.stamp
        time.sleep(0.05)
        out.publish(command)
        return len(in_step(acts)) > 10

    until(answered, lambda: process.output)
    assert process.stop() == 0, process.output


def in_step(acts):
    """Return the orders that follow each other at the distance of measurements."""
    stamps = [stamp_ns(m.header.stamp) for m in list(acts) if m.header.frame_id == 'order']
    return [b for a, b in itertools.pairwise(stamps) if b - a == 20_000_000]


LAW = """
def gap_of_the_amplitude(seen, memory):
    memory[0] += 1.0
    half = min(max({factor} * seen.amplitude, seen.gap_min), 0.5 * seen.gap_max)
    return half, -half
"""


def test_a_law_of_ones_own_is_replayed_with_it(tmp_path, monkeypatch, capsys):
    directory = tmp_path / 'node'
    directory.mkdir()
    (directory / 'plant_law.py').write_text(LAW.format(factor=4.0))
    process = SimProcess(
        directory,
        ('__ns:=/lawful',),
        gap_control='timed',
        control_law='plant_law:gap_of_the_amplitude',
        record=True,
        **ACTUATORS,
        **LIVELY,
    )
    with RigClient() as client:
        acts = client.listen(JointState, '/lawful/gap_control')
        until(lambda: len(acts) > 100 or not process.running(), lambda: process.output)
        set_law = RigParametersClient(client, '/lawful/sim_node').set
        assert 'fixed while the node runs' in set_law(control_law='other:law')
    assert process.stop() == 0, process.output
    (bag,) = (directory / 'runs').iterdir()
    assert replay_run([str(bag)]) != 0
    assert 'plant_law:gap_of_the_amplitude' in capsys.readouterr().err
    monkeypatch.chdir(directory)
    law = ['--law', 'plant_law:gap_of_the_amplitude']
    assert replay_run([str(bag), *law]) == 0, capsys.readouterr()
    # Another law of the same name
    (directory / 'plant_law.py').write_text(LAW.format(factor=3.0) + '\n')
    sys.modules.pop('plant_law')
    importlib.invalidate_caches()
    assert replay_run([str(bag), *law]) == 1
    assert 'law.digest' in capsys.readouterr().out
