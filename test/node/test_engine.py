"""The engine on its own: what it hands out, in which order and with which stamps."""

import itertools
import json
import time
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from running import DEADLINE_S, until
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
)
from impact_damper_ros.bag import RunWriter
from impact_damper_ros.bag.rig_topics import PAUSED_FRAME, recorded_topics
from impact_damper_ros.node import engine
from impact_damper_ros.node.commands import CommandInbox, CommandTopic, read_stop_command
from impact_damper_ros.node.engine import LOG_BACKLOG, Engine
from impact_damper_ros.node.pacing import CATCH_UP_NS
from impact_damper_ros.node.parameters import NodeParameters
from impact_damper_ros.node.publishing import TopicPublisher
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import (
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
)
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.rig_client import stamp_ns

TYPES = {
    'states': JointState,
    'impacts': JointState,
    'gap_control': JointState,
    'measurements': JointState,
    'snapshot': String,
    'clock': Clock,
}
LIVELY = RigParameters(gap=1.0, gravity=0.0)


def change_event(before, after):
    """Return the parameter event of a change."""
    was, now = before.as_dict(), after.as_dict()
    changed = [
        Parameter(n, value=list(v) if isinstance(v, tuple) else v).to_parameter_msg()
        for n, v in now.items()
        if v != was[n]
    ]
    return serialize_message(ParameterEvent(node='/rig', changed_parameters=changed))


class Bench:
    """An engine whose messages are kept, and which is always stopped."""

    def __init__(
        self,
        parameters=LIVELY,
        initial=None,
        *,
        factor=0.0,
        rate=100.0,
        clock=True,
        control=None,
        inbox=None,
        measurement_rate=0.0,
    ):
        self.sent = []
        self.troubles = []
        self.alive = True
        publishers = {
            {'states': 'joint_states', 'events': 'parameter_events'}.get(name, name): (
                TopicPublisher(name, self._publisher(name))
            )
            for name in (*TYPES, 'events')
        }
        settings = NodeParameters(
            rig=parameters,
            initial=initial or InitialConditions(),
            state_rate=rate,
            real_time_factor=factor,
            publish_clock=clock,
            control=control or GapControlParameters(),
            measurement_rate=measurement_rate,
        )
        # Stamps count from 0 only where a test wants them to, at any pace.
        with patch.object(NodeParameters, 'simulated_time', clock):
            self.engine = Engine(
                settings,
                publishers,
                inbox=inbox,
                alive=lambda: self.alive,
                on_trouble=lambda _, text: self.troubles.append(text),
            )

    def ask(self, name, *arguments, **named):
        return self.engine.ask(getattr(self.engine, name), *arguments, **named)

    def change(self, event=None, **values):
        """Ask for a change: `rig`, `initial`, or settings of the node."""
        before = self.engine.parameters
        after = replace(before, **values)
        return self.ask('change', after, event or change_event(before, after))

    def reset(self, initial=None):
        """Change the conditions of a reset, and ask for one."""
        done(self.change(initial=initial or InitialConditions()))
        return self.ask('reset')

    def _publisher(self, name):
        return lambda data: self.sent.append((name, data))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.engine.stop()

    def started(self):
        self.engine.start()
        return self

    def messages(self, name):
        return [deserialize_message(d, TYPES[name]) for n, d in list(self.sent) if n == name]

    def samples(self):
        return [m for m in self.messages('states') if m.header.frame_id != PAUSED_FRAME]

    def paused(self):
        return [m for m in self.messages('states') if m.header.frame_id == PAUSED_FRAME]

    def snapshots(self):
        return [json.loads(m.data) for m in self.messages('snapshot')]

    def run_to(self, seconds):
        self.engine.start()
        until(lambda: self.engine.stamp_ns() >= seconds * 1e9 or self.engine.failure)
        self.engine.stop()


class Answer(NamedTuple):
    time_ns: int
    result: object
    error: object


def done(request):
    """Wait until a request is carried out or rejected; return its time, result and error."""
    if (error := request.exception(DEADLINE_S)) is not None:
        return Answer(0, None, error)
    return Answer(*request.result(), None)


class KeptLog:
    """A recording in memory."""

    def __init__(self):
        self.messages = []
        self.backlog = 0

    def write(self, topic, data, stamp):
        self.messages.append((topic, bytes(data), stamp))

    def split_due(self, _stamp):
        return False


def event_bytes(node='/rig'):
    return serialize_message(ParameterEvent(node=node))


@pytest.fixture(scope='module')
def ran():
    """Return a rig that has run without pacing for a minute of rig time, and its recording."""
    log = KeptLog()
    with Bench() as bench:
        bench.ask('record_to', log, event_bytes())
        bench.run_to(60.0)
    return bench, log


def test_states_and_impacts_are_those_of_the_rig(ran):
    bench, _ = ran
    rig = Rig(LIVELY)
    impacts = []
    for tick, message in enumerate(bench.messages('states')):
        t_ns = tick * 10_000_000
        assert stamp_ns(message.header.stamp) == t_ns
        impacts += [e for e in rig.advance(t_ns / 1e9) if e.kind is EventKind.IMPACT]
        sample = rig.sample()
        v = sample.primary_velocity
        stops = sample.stop_1, sample.stop_2
        assert list(message.position) == [sample.x, sample.z, *stops, 0.0, 0.0, sample.x]
        assert list(message.velocity) == [v, sample.damper_velocity, v, v, 0.0, 0.0, v]
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


def test_messages_come_in_order_and_are_recorded_as_they_are_published(ran):
    """Impacts in their tick and before its states, the clock just before them."""
    bench, log = ran
    last_ns = 0
    for name, data in bench.sent:
        if name == 'states':
            last_ns = stamp_ns(deserialize_message(data, JointState).header.stamp)
        elif name == 'impacts':
            instant = stamp_ns(deserialize_message(data, JointState).header.stamp)
            assert last_ns <= instant <= last_ns + 10_000_000
    order = [name for name, _ in bench.sent if name in ('clock', 'states')]
    assert order == ['clock', 'states'] * (len(order) // 2)
    clocks = [stamp_ns(m.clock) for m in bench.messages('clock')]
    assert clocks == [stamp_ns(m.header.stamp) for m in bench.messages('states')]
    published = [(n, d) for n, d in bench.sent if n != 'clock']
    assert [(t, d) for t, d, _ in log.messages if t != 'events'] == published


def test_a_burst_of_chatter_goes_out_whole():
    """Vertical, at rest on a spring: m bounces down to rest within one long tick."""
    drop = RigParameters(
        angle=1.5708, gap=1.0, one_sided=True, restitution_1=0.95, force_amplitudes=0.0
    )
    with Bench(drop, rate=1.0) as bench:
        bench.run_to(30.0)
    count = len(bench.messages('states'))
    rig = Rig(drop)
    events = rig.advance(float(count - 1))
    impacts = [e for e in events if e.kind is EventKind.IMPACT]
    assert len(impacts) > 100
    published = [stamp_ns(m.header.stamp) for m in bench.messages('impacts')]
    assert published == [round(e.time * 1e9) for e in impacts]
    assert bench.engine.failure is None


def test_a_change_takes_effect_at_the_instant_recorded():
    log = KeptLog()
    with Bench(factor=20.0) as bench:
        bench.ask('record_to', log, event_bytes('/dump'))
        bench.engine.start()
        until(lambda: bench.engine.stamp_ns() > 2e9)
        changed = LIVELY.replace(gap=0.5, angle=0.3)
        ticket = done(bench.change(event_bytes('/change'), rig=changed))
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
    reasons = [json.loads(m.data)['reason'] for m in bench.messages('snapshot')]
    assert reasons == ['record', 'start', 'change']


def test_nothing_is_recorded_after_recording_has_stopped():
    log = KeptLog()
    with Bench(factor=1.0).started() as bench:
        bench.ask('record_to', log, event_bytes())
        until(lambda: len(log.messages) > 10)
        ticket = done(bench.ask('stop_recording'))
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
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        until(lambda: log.messages)
        reached = bench.engine.stamp_ns()
        time.sleep(0.1)
        assert bench.engine.stamp_ns() - reached <= 20_000_000
        log.backlog = 0
        until(lambda: bench.engine.stamp_ns() > reached + 1e9)


def test_reset_puts_the_rig_back_and_time_goes_on():
    with Bench(factor=50.0).started() as bench:
        until(lambda: bench.engine.stamp_ns() > 1e9)
        initial = InitialConditions(initial_primary_position=2.0, initial_damper_offset=-0.25)
        ticket = done(bench.reset(initial))
        assert ticket.error is None
        until(lambda: bench.engine.stamp_ns() > ticket.time_ns + 1e9)
        # One to outside the gap is refused, and harmless.
        refused = done(bench.reset(InitialConditions(initial_damper_offset=5.0)))
        assert 'between the stops' in str(refused.error)
        reached = bench.engine.stamp_ns()
        until(lambda: bench.engine.stamp_ns() > reached)
        assert bench.engine.failure is None
    states = bench.messages('states')
    (index,) = [i for i, m in enumerate(states) if stamp_ns(m.header.stamp) == ticket.time_ns]
    assert list(states[index].position) == [2.0, 1.75, 2.5, 1.5, 0.0, 0.0, 2.0]
    steps = {stamp_ns(b.header.stamp) - stamp_ns(a.header.stamp) for a, b in pairwise(states)}
    assert steps == {10_000_000}
    (reset,) = [s for s in bench.snapshots() if s['reason'] == 'reset']
    assert reset['time_ns'] == ticket.time_ns


@pytest.mark.parametrize('clock', [True, False])
def test_a_pause_stops_rig_time_and_moves_wall_stamps_on(clock):
    log = KeptLog()
    with Bench(factor=1.0, clock=clock) as bench:
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        until(lambda: len(bench.samples()) > 3)
        ticket = done(bench.ask('pause', True))
        assert ticket.result is True
        held, stamp = bench.engine.status().time_ns, bench.engine.stamp_ns()
        # A request is served before the states of its tick go out.
        until(lambda: stamp_ns(bench.samples()[-1].header.stamp) == stamp)
        count = len(bench.samples())
        ticks = len(bench.messages('clock'))
        again = done(bench.ask('pause', True))
        assert again.result is False
        time.sleep(0.3)
        # /clock and joint states go on, and a change is possible, where the rig is held.
        until(lambda: len(bench.messages('clock')) > ticks or not clock)
        until(lambda: len(bench.paused()) > 1)
        change = done(bench.change(rig=LIVELY.replace(gap=2.0)))
        assert change.time_ns == held == bench.engine.status().time_ns
        assert len(bench.samples()) == count
        done(bench.ask('pause', False))
        until(lambda: len(bench.samples()) > count + 3)
    stamps = [stamp_ns(m.header.stamp) for m in bench.samples()]
    steps = [b - a for a, b in pairwise(stamps)]
    long = [step for step in steps if step != 10_000_000]
    if clock:
        assert not long
    else:
        # On a machine that stands still the rig may slip as well.
        slips = sum(s['reason'] == 'slip' for s in bench.snapshots())
        assert len(long) == 1 + slips
        assert stamps[count] - stamp >= 300_000_000
    assert stamps[count - 1] == stamp
    (last,) = [s for s in bench.snapshots() if s['reason'] == 'resume']
    assert last['time_ns'] == held
    assert last['stamp_offset_ns'] >= stamp - held
    # That of the next tick, which may slip
    (*_, offset_ns) = [
        s['stamp_offset_ns'] for s in bench.snapshots() if s['time_ns'] <= held + 10_000_000
    ]
    assert offset_ns + held + 10_000_000 == stamps[count]
    repeated = bench.paused()
    positions = {tuple(m.position) for m in repeated[:2]}
    assert positions == {tuple(bench.samples()[count - 1].position)}
    times = [stamp_ns(m.header.stamp) for m in repeated]
    if clock:
        assert set(times) == {stamp}
    else:
        assert all(a < b for a, b in pairwise([stamp, *times, stamps[count]]))
    # What only repeats is in no recording.
    recorded = [deserialize_message(d, JointState) for t, d, _ in log.messages if t == 'states']
    assert {m.header.frame_id for m in recorded} == {''}


def stepped(bench, *, to_impact=False):
    """Make a step; return the rig time that it ends at, ns."""
    ticket = done(bench.ask('step', to_impact=to_impact))
    assert ticket.error is None
    return ticket.result.result(DEADLINE_S).time_ns


#: The topics of a `Bench`.
TOPICS = {
    'joint_states': 'states',
    **{name: name for name in ('impacts', 'gap_control', 'snapshot')},
    'parameter_events': 'events',
    'diagnostics': 'diagnostics',
}


def as_others_record(bench, place):
    """Record all that is published as `ros2 bag record` does, with the time of arrival."""
    log = RunWriter(place, recorded_topics(TOPICS))
    for number, (name, data) in enumerate(bench.sent):
        if name != 'clock':
            log.write(name, data, 10**18 + 1_000_003 * number)
    log.close()
    assert log.error is None


@pytest.mark.parametrize('clock', [True, False])
def test_single_steps_of_a_paused_rig(clock, tmp_path):
    """A step is one sample, or ends after the next impact; nothing of the motion depends on it."""
    with Bench(factor=1.0, clock=clock).started() as bench:
        until(lambda: len(bench.samples()) > 3)
        done(bench.ask('pause', True))
        held = bench.engine.status().time_ns
        for count in range(1, 6):
            assert stepped(bench) == held + count * 10_000_000
            status = bench.engine.status()
            assert status.paused
            assert status.time_ns == held + count * 10_000_000
        count, impacts = len(bench.samples()), bench.engine.status().impacts
        end = stepped(bench, to_impact=True)
        assert len(bench.messages('impacts')) > impacts
        assert bench.engine.status().paused
        until(lambda: len(bench.paused()) > 1)
        # The one sample after the impact is the last one.
        stamps = [stamp_ns(m.header.stamp) for m in bench.samples()[-2:]]
        hit = stamp_ns(bench.messages('impacts')[impacts].header.stamp)
        assert stamps[0] < hit <= stamps[1] == bench.engine.stamp_ns()
        assert len(bench.samples()) == count + (end - held) // 10_000_000 - 5
        done(bench.ask('pause', False))
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 30)
    samples = bench.samples()
    rig = Rig(LIVELY)
    for tick, message in enumerate(samples):
        rig.advance(tick * 10_000_000 / 1e9)
        sample = rig.sample()
        assert list(message.position[:2]) == [sample.x, sample.z]
    stamps = [stamp_ns(m.header.stamp) for m in samples]
    assert stamps == sorted(set(stamps))
    as_others_record(bench, tmp_path / 'bag')
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    assert sum(len(part.samples) for part in replay) == len(samples)


def test_steps_that_are_refused_or_ended():
    still = RigParameters(gap=1e6, force_amplitudes=(0.0,), gravity=0.0)
    with Bench(still, factor=1.0).started() as bench:
        refused = done(bench.ask('step'))
        assert 'pause it first' in str(refused.error)
        for hold in (True, False):
            done(bench.ask('pause', True))
            step = done(bench.ask('step', to_impact=True))
            # m never comes to a stop; the rig runs on as long as it is let.
            reached = bench.engine.stamp_ns()
            until(lambda reached=reached: bench.engine.stamp_ns() > reached + 100_000_000)
            again = done(bench.ask('step'))
            assert 'under way' in str(again.error)
            end = done(bench.ask('pause', hold))
            assert end.result is True
            assert 'ended' in str(step.result.exception(DEADLINE_S))
            assert bench.engine.status().paused is hold
        done(bench.ask('pause', True))
        step = done(bench.ask('step', to_impact=True))
    assert 'shutting down' in str(step.result.exception(DEADLINE_S))


@pytest.mark.parametrize('clock', [True, False])
def test_the_pace_changes_while_the_rig_runs(clock):
    """So slow that the next sample would come after 10 s, and as fast as possible again."""
    with Bench(factor=0.0, clock=clock) as bench:
        bench.engine.start()
        until(lambda: len(bench.samples()) > 3)
        done(bench.change(real_time_factor=1e-3))
        held = bench.engine.status().time_ns
        for _ in range(20):
            done(bench.change())
        assert bench.engine.status().time_ns - held < 10_000_000
        done(bench.change(real_time_factor=0.0))
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 50)
    samples = bench.samples()
    # The motion is the same as at any pace, and stamps never go back.
    rig = Rig(LIVELY)
    for k, sample in enumerate(samples):
        rig.advance(k / 100.0)
        assert sample.position[0] == rig.sample().x + LIVELY.static_deflection
    stamps = [stamp_ns(m.header.stamp) for m in samples]
    steps = {b - a for a, b in pairwise(stamps)}
    assert min(steps) == 10_000_000
    assert clock is False or steps == {10_000_000}


def test_several_pauses_do_not_add_up_to_a_delay():
    """Each pause falls somewhere between two ticks; stamps are not late by that part of it."""
    with Bench(factor=1.0, rate=2.0, clock=False).started() as bench:
        for _ in range(8):
            done(bench.ask('pause', True))
            time.sleep(0.05)
            asked_ns = time.time_ns()
            done(bench.ask('pause', False))
            (*_, last) = bench.snapshots()
            resumed_ns = last['stamp_offset_ns'] + last['time_ns']
            assert asked_ns - 10**6 < resumed_ns < time.time_ns() + 10**6


@pytest.mark.parametrize('clock', [True, False])
def test_a_slip_moves_wall_stamps_on(clock):
    """The engine's thread stands still for twice the time that is made up for."""
    with Bench(factor=1.0, clock=clock) as bench:
        bench.engine.start()
        until(lambda: len(bench.samples()) > 3)
        before_ns = bench.engine._stamps.offset_ns
        done(bench.engine.ask(lambda: time.sleep(2.0 * CATCH_UP_NS * 1e-9)))
        until(lambda: bench.engine.status().pacing.slips)
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 3)
        after_ns = bench.engine._stamps.offset_ns

        def late_ns():
            return time.time_ns() - stamp_ns(bench.samples()[-1].header.stamp)

        # Stamps are those of the wall again, but for moments of a busy machine
        until(lambda: clock or late_ns() < CATCH_UP_NS)
    stamps = [stamp_ns(m.header.stamp) for m in bench.samples()]
    slipped = [s for s in bench.snapshots() if s['reason'] == 'slip']
    if clock:
        assert {b - a for a, b in pairwise(stamps)} == {10_000_000}
        assert (slipped, bench.troubles, after_ns) == ([], [], before_ns)
        return
    assert len(slipped) >= 1
    assert 'they are moved on' in bench.troubles[0]
    first = next(s for s in slipped if s['stamp_offset_ns'] > before_ns)
    assert first['stamp_offset_ns'] - before_ns >= CATCH_UP_NS
    at = stamps.index(first['stamp_offset_ns'] + first['time_ns'])
    assert stamps[at] - stamps[at - 1] > CATCH_UP_NS
    assert stamps[at - 1] == before_ns + first['time_ns'] - 10_000_000


SLOW = {
    'force': ({'force_frequencies': 1e6, 'friction': 0.1}, ()),
    'gap': (
        {'gap': 1e-9, 'gravity': 1e4, 'angle': 0.785, 'restitution_1': 1.0, 'restitution_2': 1.0},
        (),
    ),
    'lines': (
        {
            'multisine_level': 1.0,
            'multisine_low': 12000.0,
            'multisine_high': 12566.0,
            'multisine_lines': 512,
        },
        (),
    ),
    'runaway': (
        {'gap': 1e-9, 'restitution_1': 1.0, 'restitution_2': 1.0},
        {'initial_damper_velocity': 1e9},
    ),
}


def recording(directory):
    """Return the recording of an engine whose topics are those of a `Bench`."""
    names = {name: name for name in ('impacts', 'gap_control', 'snapshot')}
    notes = {'node': '/rig', 'joint_states': 'states', **names}
    return RunWriter(directory, recorded_topics(TOPICS), custom=notes)


@pytest.mark.parametrize('name', SLOW)
def test_a_rig_that_takes_ever_so_long_answers_and_ends(name, tmp_path):
    values, initial = SLOW[name]
    initial = InitialConditions(**dict(initial))
    slow, calm = LIVELY.replace(**values), LIVELY.replace(gap=0.5)
    log = recording(tmp_path / 'bag')

    def stuck():
        """Return whether the rig is held, has slipped, or has not ticked for a while."""
        status = bench.engine.status()
        ticks.append(status.pacing.ticks)
        still = len(ticks) > 50 and ticks[-1] == ticks[-50]
        return status.held or still or status.pacing.slips > slips

    with Bench(slow, initial, factor=1.0, rate=1000.0) as bench:
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        ticks, slips = [], 0
        until(stuck)
        # In one go, the answer would take from half a minute to for ever.
        done(bench.change(rig=calm))
        reset = done(bench.reset())
        until(lambda: bench.engine.status().time_ns > reset.time_ns + 50_000_000)
        assert bench.engine.status().held == ''
        done(bench.change(rig=slow))
        done(bench.reset(initial))
        ticks, slips = [], bench.engine.status().pacing.slips
        until(stuck)
        bench.engine.stop(DEADLINE_S)
        assert not bench.engine._thread.is_alive()
    assert bench.engine.failure is None
    log.close()
    assert log.error is None
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    count = sum(len(part.samples) for part in replay)
    assert (count > 40, replay.findings.resets) == (True, 2)


def test_a_rig_that_cannot_go_on_is_held_until_it_is_changed():
    values, initial = SLOW['runaway']
    rig = LIVELY.replace(**values)
    with Bench(rig, InitialConditions(**initial), factor=1.0, clock=False) as bench:
        bench.engine.start()
        until(lambda: bench.engine.status().held)
        status = bench.engine.status()
        assert 'the gap wider' in status.held
        assert 'it waits for a change or a reset' in bench.troubles[0]
        until(lambda: len(bench.paused()) > 1)
        assert bench.engine.failure is None
        # A pause on top, and a change that leaves the rig as it is, do not set it going.
        done(bench.ask('pause', True))
        done(bench.ask('pause', False))
        done(bench.change())
        assert bench.engine.status().held
        # Nor is there a step to be made.
        done(bench.ask('pause', True))
        step = done(bench.ask('step'))
        assert 'the gap wider' in str(step.error)
        done(bench.ask('pause', False))
        # A reset to the same end
        count = len(bench.troubles)
        done(bench.reset(InitialConditions(**initial)))
        until(lambda: len(bench.troubles) > count)
        held = bench.engine.status().time_ns
        done(bench.reset())
        until(lambda: bench.engine.status().time_ns > held + 100_000_000)
        assert bench.engine.status().held == ''
    stamps = [stamp_ns(m.header.stamp) for m in bench.messages('states')]
    assert stamps == sorted(stamps)
    assert [s['reason'] for s in bench.snapshots()].count('reset') == 2


def test_a_step_of_a_rig_that_cannot_go_on_ends_in_a_pause():
    values, initial = SLOW['runaway']
    with Bench(factor=1.0).started() as bench:
        done(bench.ask('pause', True))
        done(bench.change(rig=LIVELY.replace(**values)))
        done(bench.reset(InitialConditions(**initial)))
        step = done(bench.ask('step'))
        assert 'the gap wider' in str(step.result.exception(DEADLINE_S))
        # What sets a held rig going again leaves a paused one where it is.
        done(bench.change(rig=LIVELY))
        status = bench.engine.status()
        assert (status.held, status.paused) == ('', True)


def test_between_two_far_ticks_impacts_are_sent_and_requests_answered():
    """The next tick is a minute away."""
    fast = InitialConditions(initial_damper_velocity=100.0)
    with Bench(initial=fast, factor=1.0 / 60.0, rate=1.0).started() as bench:
        until(lambda: bench.messages('impacts'))
        ticket = done(bench.change(rig=LIVELY.replace(gap=2.0)))
        assert len(bench.samples()) == 1
        (impact, *_) = bench.messages('impacts')
        assert stamp_ns(impact.header.stamp) < ticket.time_ns < 1e9
        (change,) = until(lambda: [s for s in bench.snapshots() if s['reason'] == 'change'])
        assert change['time_ns'] == ticket.time_ns
        bench.engine.stop(DEADLINE_S)
        assert not bench.engine._thread.is_alive()


def test_changes_between_two_far_ticks_are_replayed(tmp_path):
    """They take effect when they are made, and the samples stay on their grid."""
    log = recording(tmp_path / 'bag')
    with Bench(factor=1.0, rate=2.0) as bench:
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        until(lambda: bench.engine.status().time_ns > 0)
        calm = LIVELY.replace(gap=0.5)
        change = done(bench.change(rig=calm))
        done(bench.ask('pause', True))
        until(lambda: len(bench.paused()) > 1)
        done(bench.ask('pause', False))
        reset = done(bench.reset(InitialConditions(initial_primary_position=2.0)))
        until(lambda: len(bench.samples()) > 4)
        done(bench.ask('stop_recording'))
    assert (change.time_ns % 500_000_000, reset.time_ns % 500_000_000) != (0, 0)
    log.close()
    assert log.error is None
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    assert sum(len(part.samples) for part in replay) >= 5


@pytest.mark.parametrize('last', ['change', 'pace', 'reset', 'slip'])
def test_what_comes_with_the_end_of_a_recording_is_in_it(last, tmp_path):
    """As `set_rig gap=0.021 record=false` asks for it; or in a tick that is late."""
    log = recording(tmp_path / 'bag')
    with Bench(factor=1.0, clock=False) as bench:
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        until(lambda: len(bench.samples()) > 3)

        def at_once():
            """Ask for both at one tick."""
            if last == 'slip':
                time.sleep(2.0 * CATCH_UP_NS * 1e-9)
            elif last == 'reset':
                bench.ask('reset')
            else:
                value = {'rig': LIVELY.replace(gap=0.5)} if last == 'change' else {}
                bench.change(**value, real_time_factor=1.0 if value else 2.0)
            bench.ask('stop_recording')

        done(bench.engine.ask(at_once))
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 3)
    log.close()
    assert log.error is None
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    assert sum(len(part.samples) for part in replay) > 3
    assert replay.findings.resets == (last == 'reset')
    assert replay.findings.changes == (last == 'change')


def test_an_order_between_the_start_of_a_recording_and_a_slip_is_replayed(tmp_path):
    """No sample comes between the two."""
    log, waiting = recording(tmp_path / 'bag'), []
    topic = CommandTopic(
        'stop_commands',
        'stop_commands',
        lambda: waiting.pop() if waiting else None,
        lambda: 1,
        read_stop_command,
    )
    external = GapControlParameters(gap_control='external')
    inbox = CommandInbox([topic])
    with Bench(factor=1.0, rate=2.0, clock=False, control=external, inbox=inbox) as bench:
        bench.engine.start()
        until(lambda: bench.engine.status().time_ns > 0)
        done(bench.ask('record_to', log, event_bytes()))
        waiting.append(serialize_message(JointState(name=['stop_1'], position=[0.3])))
        until(lambda: bench.messages('gap_control'))
        done(bench.engine.ask(lambda: time.sleep(0.5 + 2.0 * CATCH_UP_NS * 1e-9)))
        until(lambda: [s for s in bench.snapshots() if s['reason'] == 'slip'])
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 1)
        done(bench.ask('stop_recording'))
    log.close()
    assert log.error is None
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    samples = np.concatenate([part.samples for part in replay])
    # Until the watchdog parks it
    assert 0.3 in np.round(samples['stop_1'] - samples['x'], 9)


def test_paused_states_that_were_missed_are_not_made_up_for(monkeypatch):
    """The process stands still for a minute while the rig is paused."""
    clock = [time.monotonic_ns()]
    naps = []

    def sleep(seconds):
        naps.append(len(bench.paused()))
        clock[0] += 60 * 10**9 if len(naps) == 1 else round(seconds * 1e9)
        if len(naps) > 50:
            bench.engine._stopping.set()

    with Bench(factor=1.0) as bench:
        monkeypatch.setattr(engine.time, 'monotonic_ns', lambda: clock[0])
        monkeypatch.setattr(engine.time, 'sleep', sleep)
        bench.ask('pause', True)
        bench.engine.start()
        bench.engine._thread.join(DEADLINE_S)
    # Fifty naps of 20 ms are a second: ten joint states, and one just after that minute.
    assert 9 <= naps[-1] <= 12


TINY = (0.0, -0.0, 5e-324, -5e-324, 1e-300)


def test_the_least_numbers_leave_the_rig_ticking_or_held():
    """Of every parameter, one at a time; none ends the engine, or keeps it from answering."""
    specs = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
    names = [name for name, spec in specs.items() if spec.kind == 'double']
    law = GapControlParameters(gap_control='timed')
    count = 0
    with Bench(factor=0.0, rate=50.0, control=law).started() as bench:
        home = bench.engine.parameters
        for name, value in itertools.product(names, TINY):
            try:
                after = home.changed({name: value})
            except ParameterError:
                continue
            requests = bench.ask('change', after, event_bytes()), bench.ask('reset')
            assert [done(request).error for request in requests] == [None, None], (name, value)
            ticks = bench.engine.status().pacing.ticks
            until(
                lambda ticks=ticks: (
                    (status := bench.engine.status()).held or status.pacing.ticks > ticks + 5
                ),
                f'{name} {value}',
            )
            assert done(bench.ask('change', home, event_bytes())).error is None
            count += 1
    assert bench.engine.failure is None
    assert count > 80


def test_a_sensor_that_fails_holds_the_rig(monkeypatch):
    settings = {'control': GapControlParameters(gap_control='external'), 'measurement_rate': 50.0}
    with Bench(factor=1.0, **settings) as bench:

        def fail(_index):
            raise OverflowError('cannot convert float infinity to integer')

        measure = bench.engine._rig.measure
        monkeypatch.setattr(bench.engine._rig, 'measure', fail)
        bench.engine.start()
        until(lambda: bench.engine.status().held)
        assert bench.engine.status().held.startswith('OverflowError: cannot convert')
        monkeypatch.setattr(bench.engine._rig, 'measure', measure)
        done(bench.change(rig=LIVELY.replace(gap=0.5)))
        count = len(bench.samples())
        until(lambda: len(bench.samples()) > count + 3)
        assert bench.engine.failure is None


def test_a_failure_is_reported_and_requests_are_turned_away(monkeypatch):
    with Bench() as bench:

        def fail(*_):
            raise RuntimeError('no root')

        monkeypatch.setattr(bench.engine._rig, 'advance', fail)
        bench.engine.start()
        until(lambda: bench.engine.failure)
        assert isinstance(bench.engine.failure, RuntimeError)
        ticket = done(bench.ask('pause', True))
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

        bench.engine._publishers['joint_states'] = TopicPublisher('states', publish)
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        bench.engine._thread.join(DEADLINE_S)
        assert bench.engine.failure is None
        assert sum(topic == 'states' for topic, _, _ in log.messages) == 50
