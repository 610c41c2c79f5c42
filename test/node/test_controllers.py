"""A controller outside the node: commands over DDS, refusals, watchdog; recorded and replayed."""

import importlib
import itertools
import json
import math
import sys
import time
from copy import copy
from functools import partial

import pytest
from geometry_msgs.msg import Wrench, WrenchStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from running import until
from sensor_msgs.msg import JointState

from impact_damper_ros import GapControlParameters, Order, Rig, RigParameters
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.node.commands import (
    CommandInbox,
    CommandTopic,
    read_force_command,
    read_stop_command,
)
from impact_damper_ros.node.external_control import ExternalControl
from impact_damper_ros.parameters.node_settings import NodeSettings
from node.rig_client import LIVELY, LiveRig, RigClient, SimProcess, stamp_ns

RIG = RigParameters(**{name: json.loads(str(value)) for name, value in LIVELY.items()})
ACTUATORS = {'gap_min': 0.002, 'gap_max': 0.5, 'actuator_speed': 0.5, 'actuator_delay': 0.004}
NAN = math.nan


class Plant(LiveRig):
    """A rig that is controlled from outside, and the publishers of its controller."""

    def __init__(self, client, process):
        super().__init__(client, process, '/plant')
        self.await_states(len(self.acts) + 1)
        self.force = client.node.create_publisher(WrenchStamped, '/plant/force_command', 10)
        self.stops = self.stop_publisher(10)
        for publisher in (self.stops, self.force):
            until(lambda p=publisher: p.get_subscription_count() == 1)
        self.await_report('controller')

    def stop_publisher(self, qos):
        return self.client.node.create_publisher(JointState, '/plant/stop_commands', qos)

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

    def obeyed(self, send, *order):
        """Send a command until an order of these numbers is carried out."""
        before = len(self.acts)

        def done():
            send()
            time.sleep(0.01)
            return any(same(found, order) for _, *found in self.orders(before))

        self.until(done, lambda: self.orders(before))

    def moves_to(self, *places):
        """Send two stops somewhere until they go there."""
        self.obeyed(lambda: self.send_stops(*places), *places, NAN, NAN, NAN)

    def refused(self, send, words):
        """Send a command until it is reported that one was refused, with a reason."""
        before = int(self.report('controller').values['Commands refused'])

        def done():
            send()
            time.sleep(0.01)
            return int(self.report('controller').values['Commands refused']) > before

        self.until(done, lambda: self.report('controller'))
        assert words in self.report('controller').values['Last refusal']


def control(**more):
    """Return the parameters of a rig that waits for a controller."""
    return {'gap_control': 'external', **ACTUATORS, **LIVELY, **more}


@pytest.fixture(scope='module')
def plant(tmp_path_factory):
    process = SimProcess(
        tmp_path_factory.mktemp('plant'), ('__ns:=/plant',), **control(command_timeout=0.0)
    )
    try:
        with RigClient() as client:
            plant = Plant(client, process)
            yield plant
        plant.stop()
    finally:
        process.kill()


def same(a, b):
    return all(x == y or (x != x and y != y) for x, y in zip(a, b, strict=True))


def test_commands_are_carried_out_and_replayed_bit_for_bit(plant, tmp_path):
    plant.change(record=True, bag_directory=str(tmp_path))
    plant.moves_to(0.008, -0.006)
    # One stop alone, at a speed
    send = {'names': ['stop_2'], 'velocity': [-0.2]}
    plant.obeyed(lambda: plant.send_stops(-0.009, **send), NAN, -0.009, NAN, 0.2, NAN)
    plant.obeyed(lambda: plant.send_force(2.5), NAN, NAN, NAN, NAN, 2.5)
    # Many of both
    for k in range(60):
        plant.send_stops(0.008 + 0.001 * math.sin(k), -0.008)
        plant.send_force(math.cos(k))
        time.sleep(0.003)
    plant.change(gap_control='off')
    plant.change(gap_control='external')
    plant.obeyed(lambda: plant.send_force(-1.0), NAN, NAN, NAN, NAN, -1.0)
    assert {m.header.frame_id for m in plant.acts} >= {'order', 'command', 'arrived'}
    plant.change(record=False)
    # It is replayed by `every_bag_is_replayed`.
    assert len(list(tmp_path.glob('*/metadata.yaml'))) == 1


def stops(*places, names=('stop_1', 'stop_2'), velocity=(), stamp_s=0):
    message = JointState(name=names, position=places, velocity=velocity)
    message.header.stamp.sec = stamp_s
    return message


def force(x, y=0.0, stamp_s=0):
    message = WrenchStamped()
    message.header.stamp.sec = stamp_s
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
    law = {'gap_control': settings.pop('gap_control', 'external'), **ACTUATORS}
    count = settings.pop('publishers', 1)
    read = read_force_command if isinstance(message, WrenchStamped) else read_stop_command
    topic = CommandTopic('key', 'topic', lambda: [serialize_message(message)], lambda: count, read)
    inbox = CommandInbox([topic])
    rig = Rig(RIG, control=GapControlParameters(**law))
    controller = ExternalControl(rig, inbox, NodeSettings(**settings))
    assert list(controller.obey(10**9, 100 * 10**9)) == []
    assert (inbox.refused, inbox.reason[:7], words in inbox.reason) == (1, 'topic: ', True), inbox


def test_in_lock_step_each_measurement_has_one_command():
    """A measurement sent twice is answered twice; the second answer has no effect."""
    rig = Rig(RIG, control=GapControlParameters(gap_control='external', **ACTUATORS))
    waiting = []

    def taken(key):
        return [waiting.pop(0)[1] for one in list(waiting) if waiting[0][0] == key]

    topics = [
        CommandTopic(key, key, partial(taken, key), lambda: 1, read)
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
    # A controller whose own clock is a measurement behind answers the last one for ever.
    words = ' but 1 that answers the measurement before, of 0.000000000 s'
    assert copy(controller).give_up() == words
    assert controller.status(0).awaited == 'stop_commands'
    assert obeyed(1.5, answers[1], stops(0.02, -0.02, stamp_s=9)) == 1
    assert (controller.waits, controller.status(0).awaited, inbox.refused) == (False, '', 2)
    assert obeyed(1.75, force(1.0)) == 0
    words = 'waits for stop_commands only: start with lock_step:=force_command, or lock_step:=both'
    assert words in inbox.reason
    # A rig that goes on without waiting takes any command; then it waits again.
    assert obeyed(2, force(1.0, stamp_s=2)) == 0
    assert 'but 1 that was refused (force_command: lock-step waits' in controller.give_up()
    assert obeyed(2.5, stops(0.02, -0.02), answers[2]) == 2
    assert obeyed(2.75, answers[2]) == 0
    assert obeyed(3, answers[3], force(1.0, stamp_s=3)) == 1
    assert (controller.waits, inbox.refused) == (False, 5)
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
    other = plant.stop_publisher(10)
    until(lambda: other.get_subscription_count() == 1)
    plant.refused(
        lambda: plant.send_stops(0.01, -0.01), 'one that was killed counts for up to 20 s more'
    )
    words = (
        '/test_client and /test_client publish /plant/stop_commands: commands of both are '
        'refused; stop all but one'
    )
    report = plant.await_report('network', holds=lambda report: report.message == words)
    assert report.values['Publishers of stop_commands'] == '2'
    plant.client.node.destroy_publisher(other)
    plant.moves_to(0.01, -0.01)


def test_a_best_effort_controller_is_reported(plant):
    loose = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    plant.client.node.destroy_publisher(plant.stops)
    plant.stops = plant.stop_publisher(loose)
    words = '/test_client publishes /plant/stop_commands best effort, which is not received'
    report = plant.await_report('network', holds=lambda report: words in report.message)
    assert report.values['Publishers that do not match'] == '1'
    assert words in plant.process.output
    plant.client.node.destroy_publisher(plant.stops)
    # A reliable one again
    plant.stops = plant.stop_publisher(10)
    plant.moves_to(0.013, -0.012)


def test_partners_that_do_not_match_are_reported(plant):
    """A message of another type, and a subscription that asks for more than is offered."""
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    words = (
        'publishes /plant/force_command as geometry_msgs/msg/Wrench,',
        '/test_client does not receive /plant/impacts',
    )
    with RigClient() as other:
        other.node.create_publisher(Wrench, '/plant/force_command', 10)
        other.node.create_subscription(JointState, '/plant/impacts', print, latched)
        plant.await_report('network', holds=lambda r: all(part in r.message for part in words))
    assert plant.process.output.count(words[1]) == 1
    plant.await_report('network', holds=lambda r: r.message == 'no other node interferes')


def test_the_watchdog_parks_the_stops(plant):
    half = 0.5 * float(LIVELY['gap'])
    # From now on
    held = plant.snapshots
    held()
    plant.change(command_timeout=0.2, force_limit=3.0)
    plant.obeyed(lambda: plant.send_force(-1e3), NAN, NAN, NAN, NAN, -3.0)
    begun = len(plant.acts)
    plant.moves_to(0.02, -0.02)
    parked = plant.await_report(
        'controller', holds=lambda report: 'the stops are parked' in report.message
    )
    assert int(parked.values['Forces limited']) > 0
    moves = [order for order in plant.orders(begun) if order[1] == order[1]]
    places = [order[1] for order in moves]
    assert set(places) == {0.02, half}
    at = places.index(half, places.index(0.02))

    def waited_ns():
        """Return the time between the two in that of the rig, whose stamps may slip."""
        offsets = [(s['stamp_offset_ns'] + s['time_ns'], s['stamp_offset_ns']) for s in held()]
        begin, end = (
            stamp - max((since, offset) for since, offset in offsets if since <= stamp)[1]
            for stamp, *_ in moves[at - 1 : at + 1]
        )
        return end - begin

    # At the first tick after the time is over; a snapshot may come later than an act
    until(lambda: 0.2e9 < waited_ns() <= 0.2e9 + 1e9 / 200, waited_ns)
    assert 0.0 in [order[-1] for order in plant.orders()]
    plant.change(command_timeout=0.0, force_limit=0.0)
    plant.moves_to(0.02, -0.02)
    plant.await_report('controller', holds=lambda r: r.values['Stops parked'] == 'False')


def test_lock_step(start):
    """As fast as the rig can; its controller is the test."""
    noise = {'gap_control_noise_position': 1e-4}
    rig = start(
        **control(**noise, lock_step='stop_commands', lock_step_timeout=1000.0),
        measurement_rate=50.0,
        real_time_factor=0.0,
    )
    seen = rig.listen(JointState, 'measurements')
    out = rig.client.node.create_publisher(JointState, f'{rig.space}/stop_commands', 10)
    law = GapControlParameters(gap_control='external', **noise, **ACTUATORS)
    twin = Rig(RIG, control=law)
    for k in range(40):
        rig.until(lambda k=k: seen and stamp_ns(seen[-1].header.stamp) == 20_000_000 * k)
        twin.advance(20_000_000 * k / 1e9)
        sample, rates = twin.measure(k)
        message = seen[-1]
        assert list(message.name) == ['primary', 'damper', 'stop_1', 'stop_2']
        assert list(message.position) == [sample.x, sample.y, sample.stop_1, sample.stop_2]
        assert list(message.velocity) == [sample.x_rate, sample.y_rate, *rates]
        half = 0.006 + 0.0001 * k
        # Another stamp is refused, and nothing is waited for any longer by it.
        out.publish(stops(half, -half, stamp_s=1000))
        command = stops(half, -half)
        command.header.stamp = message.header.stamp
        out.publish(command)
        twin.order(Order(half, -half))
    # Without an answer it goes on, after a while; one with another stamp is refused.
    rig.until(lambda: stamp_ns(seen[-1].header.stamp) == 800_000_000)
    out.publish(stops(0.01, -0.01, stamp_s=777))
    rig.await_report('controller', holds=lambda r: ' 777.0' in r.values['Last refusal'])
    rig.change(lock_step_timeout=0.01)
    rig.until(lambda: len(seen) > 60 and 'continues without it' in rig.process.output)
    assert (
        f' s but 1 that was refused ({rig.space}/stop_commands: its stamp is 777.000000000 s, and '
        'lock-step takes only that of the last measurement, 0.800000000 s): the rig in'
    ) in rig.process.output
    # A slow controller gets in, whose first answers come seconds of the rig's time late.
    rig.change(lock_step_timeout=30.0)
    begun, acts = stamp_ns(seen[-1].header.stamp), rig.acts
    newest = rig.listen(JointState, 'measurements', QoSProfile(depth=1))
    rig.until(lambda: newest and stamp_ns(newest[-1].header.stamp) > begun + 2e10)

    def answered():
        command = stops(0.01, -0.01)
        command.header.stamp = newest[-1].header.stamp
        time.sleep(0.05)
        out.publish(command)
        orders = [stamp_ns(m.header.stamp) for m in list(acts) if m.header.frame_id == 'order']
        return sum(b - a == 20_000_000 for a, b in itertools.pairwise(orders)) > 10

    rig.until(answered)
    rig.stop()


LAW = """
def gap_of_the_amplitude(seen, memory):
    memory[0] += 1.0
    half = min(max({factor} * seen.amplitude, seen.gap_min), 0.5 * seen.gap_max)
    return half, -half
"""


def test_a_law_of_ones_own_is_replayed_with_it(start, tmp_path, monkeypatch, capsys):
    directory = tmp_path / 'process_0'
    directory.mkdir()
    (directory / 'plant_law.py').write_text(LAW.format(factor=4.0))
    law = 'plant_law:gap_of_the_amplitude'
    rig = start(**control(gap_control='timed'), control_law=law, record=True)
    rig.until(lambda: len(rig.acts) > 40)
    assert 'fixed while the node runs' in rig.parameters.set(control_law='other:law')
    rig.stop()
    bag = rig.bag()
    assert replay_run([str(bag)]) != 0
    assert law in capsys.readouterr().err
    monkeypatch.chdir(directory)
    assert replay_run([str(bag), '--law', law]) == 0, capsys.readouterr()
    # Another law of the same name
    (directory / 'plant_law.py').write_text(LAW.format(factor=3.0) + '\n')
    sys.modules.pop('plant_law')
    importlib.invalidate_caches()
    assert replay_run([str(bag), '--law', law]) == 1
    assert 'law.digest' in capsys.readouterr().out
