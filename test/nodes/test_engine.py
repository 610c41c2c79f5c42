"""The engine on its own: what it hands out, in which order and with which stamps."""

import json
import threading
import time
from itertools import pairwise

import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros.nodes.engine import LOG_BACKLOG, Engine
from impact_damper_ros.nodes.motion_ahead import ticks_ahead
from impact_damper_ros.nodes.outlets import Outlet, Outlets
from impact_damper_ros.rig import EventKind, InitialConditions, RigParameters, Simulator
from nodes.rig_client import DEADLINE_S, stamp_ns, until

TYPES = {
    'states': JointState,
    'impacts': JointState,
    'gap_control': JointState,
    'snapshot': String,
    'clock': Clock,
}
LIVELY = RigParameters(gap=1.0, gravity=0.0)


class Bench:
    """An engine whose messages are kept, and which is always stopped."""

    def __init__(
        self, parameters=LIVELY, initial=None, *, factor=0.0, rate=100.0, clock=True, priority=0
    ):
        self.sent = []
        self.failed = threading.Event()
        self.alive = True
        outlets = Outlets(
            *(Outlet(name, self._publisher(name)) for name in TYPES), 'events', 'diagnostics'
        )
        self.engine = Engine(
            parameters,
            initial or InitialConditions(),
            outlets,
            state_rate=rate,
            real_time_factor=factor,
            publish_clock=clock,
            alive=lambda: self.alive,
            on_failure=self.failed.set,
            real_time_priority=priority,
        )

    def _publisher(self, name):
        return lambda data: self.sent.append((name, data))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.engine.stop()

    def messages(self, name):
        return [deserialize_message(d, TYPES[name]) for n, d in list(self.sent) if n == name]

    def run_to(self, seconds):
        self.engine.start()
        until(lambda: self.engine.stamp_ns() >= seconds * 1e9 or self.failed.is_set())
        self.engine.stop()


class KeptLog:
    """A recording in memory."""

    def __init__(self):
        self.messages = []
        self.backlog = 0

    def write(self, topic, data, stamp):
        self.messages.append((topic, bytes(data), stamp))


def event_bytes(node='/rig'):
    return serialize_message(ParameterEvent(node=node))


def test_states_and_impacts_are_those_of_the_simulator():
    with Bench() as bench:
        bench.run_to(60.0)
    states = bench.messages('states')
    rig = Simulator(LIVELY)
    impacts = []
    for tick, message in enumerate(states):
        t_ns = tick * 10_000_000
        assert stamp_ns(message.header.stamp) == t_ns
        impacts += [e for e in rig.advance(t_ns / 1e9) if e.kind is EventKind.IMPACT]
        sample = rig.sample()
        assert list(message.position) == [sample.x, sample.z, sample.stop_1, sample.stop_2]
        assert message.velocity[0] == sample.primary_velocity
        assert message.velocity[1] == sample.damper_velocity
    assert len(impacts) > 20
    for event, message in zip(impacts, bench.messages('impacts'), strict=True):
        assert stamp_ns(message.header.stamp) == round(event.time * 1e9)
        assert message.header.frame_id == f'stop_{event.stop}'
        assert list(message.position) == [event.x, event.x + event.y]
        assert list(message.velocity) == [
            event.primary_velocity_after,
            event.damper_velocity_after,
        ]
        # The effort is the impulse that each received: its mass times its change of velocity.
        change = event.damper_velocity_after - event.damper_velocity_before
        assert message.effort[1] == pytest.approx(LIVELY.damper_mass * change, rel=1e-9)
        assert message.effort[0] == -message.effort[1]


def test_impacts_come_in_their_tick_and_before_its_states():
    with Bench() as bench:
        bench.run_to(20.0)
    last_ns = 0
    impacts = 0
    for name, data in bench.sent:
        if name == 'states':
            last_ns = stamp_ns(deserialize_message(data, JointState).header.stamp)
        elif name == 'impacts':
            instant = stamp_ns(deserialize_message(data, JointState).header.stamp)
            assert last_ns <= instant <= last_ns + 10_000_000
            impacts += 1
    assert impacts > 3


def test_clock_precedes_the_states_it_belongs_to():
    with Bench() as bench:
        bench.run_to(1.0)
    order = [name for name, _ in bench.sent if name in ('clock', 'states')]
    assert order == ['clock', 'states'] * (len(order) // 2)
    clocks = [stamp_ns(m.clock) for m in bench.messages('clock')]
    assert clocks == [stamp_ns(m.header.stamp) for m in bench.messages('states')]


def test_a_burst_of_chatter_goes_out_whole():
    """Vertical, at rest on a spring: m bounces down to rest within one long tick."""
    drop = RigParameters(
        angle=1.5708, gap=1.0, one_sided=True, restitution_1=0.95, force_amplitudes=0.0
    )
    with Bench(drop, rate=1.0) as bench:
        bench.run_to(30.0)
    count = len(bench.messages('states'))
    rig = Simulator(drop)
    events = rig.advance(float(count - 1))
    impacts = [e for e in events if e.kind is EventKind.IMPACT]
    assert len(impacts) > 100
    published = [stamp_ns(m.header.stamp) for m in bench.messages('impacts')]
    assert published == [round(e.time * 1e9) for e in impacts]
    assert bench.engine.failure is None


def test_a_change_takes_effect_at_the_instant_recorded():
    log = KeptLog()
    with Bench(factor=20.0) as bench:
        bench.engine.record_to(log, event_bytes('/dump'))
        bench.engine.start()
        until(lambda: bench.engine.stamp_ns() > 2e9)
        changed = LIVELY.replace(gap=0.5, angle=0.3)
        ticket = bench.engine.change(changed, event_bytes('/change'))
        assert ticket.wait(DEADLINE_S)
        until(lambda: bench.engine.stamp_ns() > ticket.time_ns + 2e9)
    topics = [topic for topic, _, _ in log.messages]
    assert topics[:2] == ['snapshot', 'events']
    stamps = [stamp for _, _, stamp in log.messages]
    assert stamps == sorted(stamps)
    dump, change = [
        deserialize_message(data, ParameterEvent)
        for topic, data, _ in log.messages
        if topic == 'events'
    ]
    assert (dump.node, stamp_ns(dump.stamp)) == ('/dump', 0)
    assert (change.node, stamp_ns(change.stamp)) == ('/change', ticket.time_ns)
    assert ticket.time_ns % 10_000_000 == 0
    # From the bag alone: the first snapshot, the change at its instant, every sample after.
    first = json.loads(deserialize_message(log.messages[0][1], String).data)
    assert first['reason'] == 'record'
    rig = Simulator.restore(first['state'])
    for topic, data, stamp in log.messages:
        if topic != 'states':
            continue
        rig.advance(stamp / 1e9)
        if stamp == ticket.time_ns:
            rig.change(changed)
        sample = rig.sample()
        position = list(deserialize_message(data, JointState).position)
        assert position == [sample.x, sample.z, sample.stop_1, sample.stop_2]
    reasons = [json.loads(m.data)['reason'] for m in bench.messages('snapshot')]
    assert reasons == ['record', 'start', 'change']


@pytest.mark.parametrize(
    ('period_ns', 'factor', 'ticks'),
    [
        (1_000_000, 1.0, 20),
        (5_000_000, 1.0, 4),
        (20_000_000, 1.0, 1),
        (1_000_000_000, 1.0, 1),
        (10_000_000, 20.0, 20),
        (1_000_000, 0.001, 1),
        (1_000_000, 0.0, 20),
    ],
)
def test_ticks_are_made_ahead_where_they_come_thick_and_fast(period_ns, factor, ticks):
    assert ticks_ahead(period_ns, factor) == ticks


def test_what_is_recorded_is_what_is_published():
    log = KeptLog()
    with Bench() as bench:
        bench.engine.record_to(log, event_bytes())
        bench.run_to(10.0)
    published = [(n, d) for n, d in bench.sent if n != 'clock']
    assert [(t, d) for t, d, _ in log.messages if t != 'events'] == published


def test_nothing_is_recorded_after_recording_has_stopped():
    log = KeptLog()
    with Bench(factor=1.0) as bench:
        bench.engine.start()
        bench.engine.record_to(log, event_bytes())
        until(lambda: len(log.messages) > 10)
        ticket = bench.engine.stop_recording()
        assert ticket.wait(DEADLINE_S)
        assert ticket.result is log
        # Up to and including the joint states of the tick at which it stopped.
        topic, _, stamp = log.messages[-1]
        assert (topic, stamp) == ('states', bench.engine._stamps.offset_ns + ticket.time_ns)
        assert len({s for t, _, s in log.messages if t == 'states'}) == sum(
            t == 'states' for t, _, _ in log.messages
        )
        count = len(log.messages)
        tick = bench.engine.stamp_ns()
        until(lambda: bench.engine.stamp_ns() > tick + 50_000_000)
        assert len(log.messages) == count


def test_a_free_running_rig_waits_for_its_recording():
    log = KeptLog()
    log.backlog = LOG_BACKLOG + 1
    with Bench() as bench:
        bench.engine.record_to(log, event_bytes())
        bench.engine.start()
        until(lambda: log.messages)
        reached = bench.engine.stamp_ns()
        time.sleep(0.1)
        assert bench.engine.stamp_ns() - reached <= 20_000_000
        log.backlog = 0
        until(lambda: bench.engine.stamp_ns() > reached + 1e9)


def test_reset_puts_the_rig_back_and_time_goes_on():
    with Bench(factor=50.0) as bench:
        bench.engine.start()
        until(lambda: bench.engine.stamp_ns() > 1e9)
        initial = InitialConditions(initial_primary_position=2.0, initial_damper_offset=-0.25)
        ticket = bench.engine.reset(initial)
        assert ticket.wait(DEADLINE_S)
        assert ticket.error is None
        until(lambda: bench.engine.stamp_ns() > ticket.time_ns + 1e9)
    states = bench.messages('states')
    (index,) = [i for i, m in enumerate(states) if stamp_ns(m.header.stamp) == ticket.time_ns]
    assert list(states[index].position) == [2.0, 1.75, 2.5, 1.5]
    steps = {stamp_ns(b.header.stamp) - stamp_ns(a.header.stamp) for a, b in pairwise(states)}
    assert steps == {10_000_000}
    assert json.loads(bench.messages('snapshot')[-1].data)['reason'] == 'reset'


def test_a_reset_to_outside_the_gap_is_refused_and_harmless():
    with Bench(factor=1.0) as bench:
        bench.engine.start()
        ticket = bench.engine.reset(InitialConditions(initial_damper_offset=5.0))
        assert ticket.wait(DEADLINE_S)
        assert 'between the stops' in str(ticket.error)
        reached = bench.engine.stamp_ns()
        until(lambda: bench.engine.stamp_ns() > reached)
        assert bench.engine.failure is None


@pytest.mark.parametrize('clock', [True, False])
def test_a_pause_stops_rig_time_and_moves_wall_stamps_on(clock):
    with Bench(factor=1.0, clock=clock) as bench:
        bench.engine.start()
        until(lambda: len(bench.messages('states')) > 3)
        ticket = bench.engine.pause(True)
        assert ticket.wait(DEADLINE_S)
        assert ticket.result is True
        held, stamp = bench.engine.status().time_ns, bench.engine.stamp_ns()
        # A request is served before the states of its tick go out.
        until(lambda: stamp_ns(bench.messages('states')[-1].header.stamp) == stamp)
        count = len(bench.messages('states'))
        ticks = len(bench.messages('clock'))
        again = bench.engine.pause(True)
        assert again.wait(DEADLINE_S)
        assert again.result is False
        time.sleep(0.3)
        # /clock goes on, and a change is possible, at the instant at which the rig is held.
        until(lambda: len(bench.messages('clock')) > ticks or not clock)
        change = bench.engine.change(LIVELY.replace(gap=2.0), event_bytes())
        assert change.wait(DEADLINE_S)
        assert change.time_ns == held == bench.engine.status().time_ns
        assert len(bench.messages('states')) == count
        assert bench.engine.pause(False).wait(DEADLINE_S)
        until(lambda: len(bench.messages('states')) > count + 3)
    stamps = [stamp_ns(m.header.stamp) for m in bench.messages('states')]
    steps = [b - a for a, b in pairwise(stamps)]
    long = [step for step in steps if step != 10_000_000]
    if clock:
        assert not long
    else:
        assert len(long) == 1
        assert long[0] >= 300_000_000
    assert stamps[count - 1] == stamp
    last = json.loads(bench.messages('snapshot')[-1].data)
    assert (last['reason'], last['time_ns']) == ('resume', held)
    assert last['stamp_offset_ns'] + held + 10_000_000 == stamps[count]


def test_a_request_between_two_far_ticks_is_answered_at_once():
    with Bench(factor=0.001, rate=1.0) as bench:
        bench.engine.start()
        # The next one is a quarter of an hour away.
        ticket = bench.engine.change(LIVELY.replace(gap=2.0), event_bytes())
        assert ticket.wait(DEADLINE_S)
        assert ticket.time_ns == 0
        bench.engine.stop(DEADLINE_S)
        assert not bench.engine._thread.is_alive()


def test_a_failure_is_reported_and_requests_are_turned_away(monkeypatch):
    with Bench() as bench:

        def fail(_time):
            raise ArithmeticError('no root')

        monkeypatch.setattr(bench.engine._simulator, 'advance', fail)
        bench.engine.start()
        assert bench.failed.wait(DEADLINE_S)
        assert isinstance(bench.engine.failure, ArithmeticError)
        ticket = bench.engine.pause(True)
        assert ticket.wait(DEADLINE_S)
        assert 'shutting down' in str(ticket.error)


def test_the_log_is_whole_when_ros_shuts_down_in_the_midst_of_a_tick():
    log = KeptLog()
    with Bench() as bench:

        def publish(data):
            bench.sent.append(('states', data))
            if len(bench.messages('states')) == 50:
                bench.alive = False
            if not bench.alive:
                raise RuntimeError('context is invalid')

        outlet = Outlet('states', publish)
        bench.engine._outlets = bench.engine._outlets._replace(joint_states=outlet)
        bench.engine.record_to(log, event_bytes())
        bench.engine.start()
        bench.engine._thread.join(DEADLINE_S)
        assert bench.engine.failure is None
        assert not bench.failed.is_set()
        assert sum(topic == 'states' for topic, _, _ in log.messages) == 50
