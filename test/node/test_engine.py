"""The engine on its own: what it hands out, in which order and with which stamps."""

import itertools
import time
from itertools import pairwise

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.serialization import deserialize_message, serialize_message
from running import DEADLINE_S, until
from sensor_msgs.msg import JointState

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
)
from impact_damper_ros.bag import RunWriter
from impact_damper_ros.bag.rig_topics import recorded_topics
from impact_damper_ros.node.commands import CommandInbox, CommandTopic, read_stop_command
from impact_damper_ros.node.engine import LOG_BACKLOG
from impact_damper_ros.node.pacing import CATCH_UP_NS
from impact_damper_ros.node.publishing import TopicPublisher
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS, PARAMETER_SPECS
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.bench import LIVELY, NAMES, Bench, MadeTime, done, event_bytes
from node.rig_client import stamp_ns

TICK = 10_000_000
#: Longer than what is made up for, s.
STALL = 2.0 * CATCH_UP_NS * 1e-9


class KeptLog:
    """A recording in memory."""

    def __init__(self):
        self.messages = []
        self.backlog = 0

    def write(self, topic, data, stamp):
        self.messages.append((topic, bytes(data), stamp))

    def split_due(self, _stamp):
        return False

    def of(self, topic):
        """Return the messages of a topic."""
        return [data for name, data, _ in self.messages if name == topic]


@pytest.fixture(scope='module')
def ran():
    """Return a rig that has run without pacing, and its recording."""
    log = KeptLog()
    with Bench() as bench:
        bench.ask('record_to', log, event_bytes())
        bench.run_to(40.0)
    return bench, log


def test_states_and_impacts_are_those_of_the_rig(ran):
    bench, _ = ran
    rig = Rig(LIVELY)
    impacts = []
    for tick, message in enumerate(bench.messages('joint_states')):
        assert stamp_ns(message.header.stamp) == tick * TICK
        events = rig.advance(tick * TICK / 1e9)
        impacts += [e for e in events if e.kind is EventKind.IMPACT]
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
        after = [event.primary_velocity_after, event.damper_velocity_after]
        assert list(message.velocity) == after
        # The effort is the impulse that each received: its mass times its change of velocity.
        change = event.damper_velocity_after - event.damper_velocity_before
        assert message.effort[1] == pytest.approx(LIVELY.damper_mass * change, rel=1e-9)
        assert message.effort[0] == -message.effort[1]


def test_messages_come_in_order_and_are_recorded_as_they_are_published(ran):
    """Impacts in their tick and before its states, the clock just before them."""
    bench, log = ran
    last_ns = 0
    for name, data in bench.sent:
        if name in ('joint_states', 'impacts'):
            instant = stamp_ns(deserialize_message(data, JointState).header.stamp)
            assert last_ns <= instant <= last_ns + TICK
            last_ns = instant if name == 'joint_states' else last_ns
    order = [name for name, _ in bench.sent if name in ('clock', 'joint_states')]
    assert order == ['clock', 'joint_states'] * (len(order) // 2)
    assert [stamp_ns(m.clock) for m in bench.messages('clock')] == bench.stamps()
    published = [(n, d) for n, d in bench.sent if n != 'clock']
    assert [(t, d) for t, d, _ in log.messages if t != 'parameter_events'] == published


def test_a_burst_of_chatter_goes_out_whole():
    """Vertical, at rest on a spring: m bounces down to rest within one long tick."""
    drop = RigParameters(
        angle=1.5708, gap=1.0, one_sided=True, restitution_1=0.95, force_amplitudes=0.0
    )
    with Bench(drop, rate=1.0) as bench:
        bench.run_to(30.0)
    events = Rig(drop).advance(float(len(bench.samples()) - 1))
    impacts = [round(e.time * 1e9) for e in events if e.kind is EventKind.IMPACT]
    assert len(impacts) > 100
    assert [stamp_ns(m.header.stamp) for m in bench.messages('impacts')] == impacts
    assert bench.engine.failure is None


def test_a_change_takes_effect_at_the_instant_recorded():
    log = KeptLog()
    with Bench(factor=20.0) as bench:
        bench.ask('record_to', log, event_bytes('/dump'))
        bench.started().pass_by(2.0)
        changed = done(bench.change(event_bytes('/change'), rig=LIVELY.replace(gap=0.5)))
        bench.pass_by(changed.time_ns / 1e9 + 2.0)
    assert [topic for topic, *_ in log.messages[:2]] == ['snapshot', 'parameter_events']
    stamps = [stamp for *_, stamp in log.messages]
    assert stamps == sorted(stamps)
    events = [deserialize_message(data, ParameterEvent) for data in log.of('parameter_events')]
    assert [(event.node, stamp_ns(event.stamp)) for event in events] == [
        ('/dump', 0),
        ('/change', changed.time_ns),
    ]
    assert changed.time_ns % TICK == 0
    assert [s['reason'] for s in bench.snapshots()] == ['record', 'start', 'change']


def test_nothing_is_recorded_after_recording_has_stopped():
    log = KeptLog()
    with Bench(factor=1.0).started() as bench:
        bench.ask('record_to', log, event_bytes())
        until(lambda: len(log.messages) > 10)
        stopped = done(bench.ask('stop_recording'))
        assert stopped.result is log
        # Up to and including the joint states of the tick at which it stopped, once
        topic, _, stamp = log.messages[-1]
        offset_ns = bench.engine._stamps.offset_ns
        assert (topic, stamp) == ('joint_states', offset_ns + stopped.time_ns)
        stamps = [s for t, _, s in log.messages if t == 'joint_states']
        assert len(stamps) == len(set(stamps))
        count = len(log.messages)
        bench.await_samples(5)
        assert len(log.messages) == count


def test_a_free_running_rig_waits_for_its_recording():
    log = KeptLog()
    log.backlog = LOG_BACKLOG + 1
    with Bench() as bench:
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        until(lambda: log.messages)
        reached = bench.engine.stamp_ns()
        for _ in range(5):
            done(bench.engine.ask(lambda: None))
        assert bench.engine.stamp_ns() - reached <= 2 * TICK
        log.backlog = 0
        bench.pass_by(reached / 1e9 + 1.0)


def test_reset_puts_the_rig_back_and_time_goes_on():
    with Bench(factor=50.0).started() as bench:
        bench.pass_by(1.0)
        initial = InitialConditions(initial_primary_position=2.0, initial_damper_offset=-0.25)
        reset = bench.reset(initial)
        assert reset.error is None
        bench.pass_by(reset.time_ns / 1e9 + 1.0)
        # One to outside the gap is refused, and harmless.
        refused = bench.reset(InitialConditions(initial_damper_offset=5.0))
        assert 'between the stops' in str(refused.error)
        bench.await_samples(1)
        assert bench.engine.failure is None
    stamps = bench.stamps()
    state = bench.samples()[stamps.index(reset.time_ns)]
    assert list(state.position) == [2.0, 1.75, 2.5, 1.5, 0.0, 0.0, 2.0]
    assert {b - a for a, b in pairwise(stamps)} == {TICK}
    assert [s['time_ns'] for s in bench.snapshots('reset')] == [reset.time_ns]


@pytest.mark.parametrize('clock', [True, False])
def test_a_pause_stops_rig_time_and_moves_wall_stamps_on(clock):
    log = KeptLog()
    with Bench(factor=1.0, clock=clock) as bench:
        bench.ask('record_to', log, event_bytes())
        bench.started().await_samples(3)
        assert bench.pause().result is True
        held, stamp = bench.status.time_ns, bench.engine.stamp_ns()
        # A request is served before the states of its tick go out.
        until(lambda: bench.stamps()[-1] == stamp)
        count = len(bench.samples())
        ticks = len(bench.messages('clock'))
        assert bench.pause().result is False
        bench.wall.spend(0.3)
        # /clock and joint states go on, and a change is possible, where the rig is held.
        until(lambda: len(bench.messages('clock')) > ticks or not clock)
        until(lambda: len(bench.paused()) > 1)
        change = done(bench.change(rig=LIVELY.replace(gap=2.0)))
        assert change.time_ns == held == bench.status.time_ns
        assert len(bench.samples()) == count
        bench.pause(False)
        bench.await_samples(3)
    stamps = bench.stamps()
    jumps = [b - a for a, b in pairwise(stamps) if b - a != TICK]
    # On a machine that stands still the rig may slip as well.
    assert len(jumps) == (0 if clock else 1 + len(bench.snapshots('slip')))
    assert clock or stamps[count] - stamp >= 300_000_000
    assert stamps[count - 1] == stamp
    (resumed,) = bench.snapshots('resume')
    assert resumed['time_ns'] == held
    assert resumed['stamp_offset_ns'] >= stamp - held
    # That of the next tick, which may slip
    offsets = [s['stamp_offset_ns'] for s in bench.snapshots() if s['time_ns'] <= held + TICK]
    assert offsets[-1] + held + TICK == stamps[count]
    repeated = bench.paused()
    assert {tuple(m.position) for m in repeated[:2]} == {
        tuple(bench.samples()[count - 1].position)
    }
    times = [stamp_ns(m.header.stamp) for m in repeated]
    if clock:
        assert set(times) == {stamp}
    else:
        assert stamp <= times[0]
        assert all(a < b for a, b in pairwise([*times, stamps[count]]))
    # What only repeats is in no recording.
    recorded = [deserialize_message(data, JointState) for data in log.of('joint_states')]
    assert {m.header.frame_id for m in recorded} == {''}


def stepped(bench, *, to_impact=False):
    """Make a step; return the rig time that it ends at, ns."""
    return done(bench.ask('step', to_impact=to_impact)).result.result(DEADLINE_S).time_ns


def as_others_record(bench, place):
    """Record all that is published as `ros2 bag record` does, with the time of arrival."""
    log = RunWriter(place, recorded_topics(NAMES))
    for number, (name, data) in enumerate(bench.sent):
        if name != 'clock':
            log.write(name, data, 10**18 + 1_000_003 * number)
    log.close()
    assert log.error is None


@pytest.mark.parametrize('clock', [True, False])
def test_single_steps_of_a_paused_rig(clock, tmp_path):
    """A step is one sample, or ends after the next impact; nothing of the motion depends on it."""
    with Bench(factor=1.0, clock=clock).started() as bench:
        bench.await_samples(3)
        bench.pause()
        held = bench.status.time_ns
        for count in range(1, 6):
            assert stepped(bench) == held + count * TICK
            assert (bench.status.paused, bench.status.time_ns) == (True, held + count * TICK)
        count, impacts = len(bench.samples()), bench.status.impacts
        end = stepped(bench, to_impact=True)
        assert bench.status.paused
        until(lambda: len(bench.paused()) > 1)
        # The one sample after the impact is the last one.
        stamps = bench.stamps()
        hit = stamp_ns(bench.messages('impacts')[impacts].header.stamp)
        assert stamps[-2] < hit <= stamps[-1] == bench.engine.stamp_ns()
        assert len(stamps) == count + (end - held) // TICK - 5
        bench.pause(False)
        bench.await_samples(30)
    rig = Rig(LIVELY)
    for tick, message in enumerate(bench.samples()):
        rig.advance(tick * TICK / 1e9)
        assert list(message.position[:2]) == [rig.sample().x, rig.sample().z]
    assert bench.stamps() == sorted(set(bench.stamps()))
    # That it is replayed is seen by `every_bag_is_replayed`.
    as_others_record(bench, tmp_path / 'bag')


def test_steps_that_are_refused_or_ended():
    still = RigParameters(gap=1e6, force_amplitudes=(0.0,), gravity=0.0)
    with Bench(still, factor=1.0).started() as bench:
        assert 'pause it first' in str(done(bench.ask('step')).error)
        for hold in (True, False):
            bench.pause()
            step = done(bench.ask('step', to_impact=True))
            # m never comes to a stop; the rig runs on as long as it is let.
            bench.await_samples(10)
            assert 'under way' in str(done(bench.ask('step')).error)
            assert bench.pause(hold).result is True
            assert 'ended' in str(step.result.exception(DEADLINE_S))
            assert bench.status.paused is hold
        bench.pause()
        step = done(bench.ask('step', to_impact=True))
    assert 'shutting down' in str(step.result.exception(DEADLINE_S))


@pytest.mark.parametrize('clock', [True, False])
def test_the_pace_changes_while_the_rig_runs(clock):
    """So slow that the next sample would come after 10 s, and as fast as possible again."""
    with Bench(factor=1.0, clock=clock).started() as bench:
        bench.await_samples(3)
        done(bench.change(real_time_factor=1e-3))
        held = bench.status.time_ns
        # A change does not wait for it.
        times = [done(bench.change()).time_ns for _ in range(20)]
        assert held <= times[0]
        assert any(time_ns % TICK for time_ns in times)
        done(bench.change(real_time_factor=0.0))
        bench.await_samples(50)
    # The motion is the same as at any pace, and stamps never go back.
    rig = Rig(LIVELY)
    for k, sample in enumerate(bench.samples()):
        rig.advance(k / 100.0)
        assert sample.position[0] == rig.sample().x + LIVELY.static_deflection
    steps = {b - a for a, b in pairwise(bench.stamps())}
    assert min(steps) == TICK
    assert clock is False or steps == {TICK}


def test_stamps_of_a_step_are_not_ahead_of_the_clock_however_late_its_thread_is():
    """Another program runs where a step begins, for nearly as long as is made up for."""

    class Busy(MadeTime):
        busy_s = 0.0

        def time_ns(self):
            self.spend(self.busy_s)
            self.busy_s = 0.0
            return super().time_ns()

    wall = Busy()
    with Bench(factor=1.0, clock=False, wall=wall).started() as bench:
        bench.await_samples(1)
        bench.pause()
        count = len(bench.paused())
        # In the engine's thread, so that no joint states of the pause come between the two
        bench.engine.ask(setattr, wall, 'busy_s', 0.24)
        stepped(bench, to_impact=True)
        until(lambda: len(bench.paused()) >= count + 4)
    stamps = [stamp_ns(m.header.stamp) for m in bench.paused()]
    assert stamps == sorted(set(stamps))


def test_several_pauses_do_not_add_up_to_a_delay():
    """Each pause falls somewhere between two ticks; stamps are not late by that part of it."""
    with Bench(factor=1.0, rate=2.0, clock=False).started() as bench:
        for resumed in range(8):
            bench.pause()
            asked_ns = bench.wall.time_ns()
            bench.pause(False)
            # The snapshot follows the answer.
            until(lambda count=resumed: len(bench.snapshots('resume')) > count)
            last = bench.snapshots('resume')[-1]
            resumed_ns = last['stamp_offset_ns'] + last['time_ns']
            assert asked_ns <= resumed_ns <= bench.wall.time_ns()


@pytest.mark.parametrize('clock', [True, False])
def test_a_slip_moves_wall_stamps_on(clock):
    """The engine's thread stands still for twice the time that is made up for."""
    with Bench(factor=1.0, clock=clock).started() as bench:
        bench.await_samples(3)
        before_ns = bench.engine._stamps.offset_ns
        done(bench.engine.ask(bench.wall.spend, STALL))
        until(lambda: bench.status.pacing.slips)
        bench.await_samples(3)
        after_ns = bench.engine._stamps.offset_ns
        # Those of the wall again; while the rig is paused made time goes on by itself
        now_ns = bench.wall.time_ns()
        bench.pause()
        assert clock or bench.stamps()[-1] > now_ns - CATCH_UP_NS
    stamps, slipped = bench.stamps(), bench.snapshots('slip')
    if clock:
        assert {b - a for a, b in pairwise(stamps)} == {TICK}
        assert (slipped, bench.troubles, after_ns) == ([], [], before_ns)
        return
    assert 'they are moved on' in bench.troubles[0]
    first = next(s for s in slipped if s['stamp_offset_ns'] > before_ns)
    assert first['stamp_offset_ns'] - before_ns >= CATCH_UP_NS
    at = stamps.index(first['stamp_offset_ns'] + first['time_ns'])
    assert stamps[at] - stamps[at - 1] > CATCH_UP_NS
    assert stamps[at - 1] == before_ns + first['time_ns'] - TICK


RUNAWAY = {'gap': 1e-9, 'restitution_1': 1.0, 'restitution_2': 1.0}
FAST = InitialConditions(initial_damper_velocity=1e9)
BAND = {'multisine_level': 1.0, 'multisine_low': 12000.0, 'multisine_high': 12566.0}
SLOW = {
    'force': {'force_frequencies': 1e6, 'friction': 0.1},
    'gap': {**RUNAWAY, 'gravity': 1e4, 'angle': 0.785},
    'lines': {**BAND, 'multisine_lines': 512},
    'runaway': RUNAWAY,
}


@pytest.mark.parametrize('name', SLOW)
def test_a_rig_that_takes_ever_so_long_answers_and_ends(name, tmp_path):
    slow, initial = LIVELY.replace(**SLOW[name]), FAST if name == 'runaway' else None

    def await_stuck(slips):
        """Wait until the rig is held, has slipped, or has not ticked for a while."""
        ticks = []

        def stuck():
            status = bench.status
            ticks.append(status.pacing.ticks)
            still = len(ticks) > 50 and ticks[-1] == ticks[-50]
            return status.held or still or status.pacing.slips > slips

        until(stuck)

    with Bench(slow, initial, factor=1.0, rate=1000.0, wall=time) as bench:
        bench.record(tmp_path / 'bag')
        bench.engine.start()
        await_stuck(0)
        # In one go, the answer would take from half a minute to for ever.
        done(bench.change(rig=LIVELY.replace(gap=0.5)))
        bench.pass_by(bench.reset().time_ns / 1e9 + 0.05)
        assert bench.status.held == ''
        done(bench.change(rig=slow))
        bench.reset(initial)
        await_stuck(bench.status.pacing.slips)
        assert bench.recorded() > 40
    assert len(bench.snapshots('reset')) == 2


def test_a_rig_that_cannot_go_on_is_held_until_it_is_changed():
    runaway = LIVELY.replace(**RUNAWAY)
    with Bench(runaway, FAST, factor=1.0, clock=False).started() as bench:
        until(lambda: bench.status.held)
        assert 'the gap wider' in bench.status.held
        assert 'it waits for a change or a reset' in bench.troubles[0]
        until(lambda: len(bench.paused()) > 1)
        assert bench.engine.failure is None
        # A pause on top, and a change that leaves the rig as it is, do not set it going.
        bench.pause()
        bench.pause(False)
        done(bench.change())
        assert bench.status.held
        # Nor is there a step to be made.
        bench.pause()
        assert 'the gap wider' in str(done(bench.ask('step')).error)
        bench.pause(False)
        # A reset to the same end
        count = len(bench.troubles)
        bench.reset(FAST)
        until(lambda: len(bench.troubles) > count)
        held = bench.status.time_ns
        bench.reset()
        until(lambda: bench.status.time_ns > held + 10 * TICK)
        assert bench.status.held == ''
        # A step that cannot be made ends in a pause.
        bench.pause()
        bench.reset(FAST)
        step = done(bench.ask('step'))
        assert 'the gap wider' in str(step.result.exception(DEADLINE_S))
        # What sets a held rig going again leaves a paused one where it is.
        done(bench.change(rig=LIVELY))
        assert (bench.status.held, bench.status.paused) == ('', True)
    stamps = [stamp_ns(m.header.stamp) for m in bench.messages('joint_states')]
    assert stamps == sorted(stamps)
    assert len(bench.snapshots('reset')) == 3


def test_between_two_far_ticks_impacts_are_sent_and_requests_answered():
    """The next tick is a minute away."""
    fast = InitialConditions(initial_damper_velocity=100.0)
    with Bench(initial=fast, factor=1.0 / 60.0, rate=1.0).started() as bench:
        until(lambda: bench.messages('impacts'))
        change = done(bench.change(rig=LIVELY.replace(gap=2.0)))
        assert len(bench.samples()) == 1
        (impact, *_) = bench.messages('impacts')
        assert stamp_ns(impact.header.stamp) < change.time_ns < 1e9
        (snapshot,) = until(lambda: bench.snapshots('change'))
        assert snapshot['time_ns'] == change.time_ns
        bench.engine.stop(DEADLINE_S)
        assert not bench.engine._thread.is_alive()


def test_changes_between_two_far_ticks_are_replayed(tmp_path):
    """They take effect when they are made, and the samples stay on their grid."""
    with Bench(factor=1.0, rate=2.0) as bench:
        bench.record(tmp_path / 'bag')
        bench.engine.start()
        until(lambda: bench.status.time_ns > 0)
        change = done(bench.change(rig=LIVELY.replace(gap=0.5)))
        bench.pause()
        until(lambda: len(bench.paused()) > 1)
        bench.pause(False)
        reset = bench.reset(InitialConditions(initial_primary_position=2.0))
        bench.await_samples(4)
        done(bench.ask('stop_recording'))
        assert bench.recorded() > 5
    assert (change.time_ns % 500_000_000, reset.time_ns % 500_000_000) != (0, 0)


@pytest.mark.parametrize('last', ['change', 'pace', 'reset', 'slip'])
def test_what_comes_with_the_end_of_a_recording_is_in_it(last, tmp_path):
    """As `set_rig gap=0.021 record=false` asks for it; or in a tick that is late."""
    with Bench(factor=1.0, clock=False) as bench:
        bench.record(tmp_path / 'bag')
        bench.started().await_samples(3)

        def at_once():
            """Ask for both at one tick."""
            if last == 'slip':
                bench.wall.spend(STALL)
            elif last == 'reset':
                bench.ask('reset')
            else:
                value = {'rig': LIVELY.replace(gap=0.5)} if last == 'change' else {}
                bench.change(**value, real_time_factor=1.0 if value else 2.0)
            bench.ask('stop_recording')

        done(bench.engine.ask(at_once))
        bench.await_samples(3)
        bench.recorded()
    replay = Replay(RecordedRun(tmp_path / 'bag'))
    assert sum(len(part.samples) for part in replay) > 3
    assert replay.findings.resets == (last == 'reset')
    assert replay.findings.changes == (last == 'change')


def test_an_order_between_the_start_of_a_recording_and_a_slip_is_replayed(tmp_path):
    """No sample comes between the two."""
    waiting, name = [], 'stop_commands'

    def take():
        return [waiting.pop()] if waiting else []

    inbox = CommandInbox([CommandTopic(name, name, take, lambda: 1, read_stop_command)])
    external = GapControlParameters(gap_control='external')
    # A sample takes 25 of its naps.
    wall = MadeTime(nap=0.02)
    made = {'factor': 1.0, 'rate': 2.0, 'clock': False, 'wall': wall}
    with Bench(**made, control=external, inbox=inbox) as bench:
        bench.engine.start()
        until(lambda: bench.status.time_ns > 0)
        bench.record(tmp_path / 'bag')
        until(lambda: bench.snapshots('record'))
        waiting.append(serialize_message(JointState(name=['stop_1'], position=[0.3])))
        until(lambda: bench.messages('gap_control'))
        done(bench.engine.ask(wall.spend, 0.5 + STALL))
        until(lambda: bench.snapshots('slip'))
        bench.await_samples(2)
        done(bench.ask('stop_recording'))
        bench.recorded()
    samples = np.concatenate([part.samples for part in Replay(RecordedRun(tmp_path / 'bag'))])
    # Until the watchdog parks it
    assert 0.3 in np.round(samples['stop_1'] - samples['x'], 9)


def test_paused_states_that_were_missed_are_not_made_up_for():
    """The process stands still for a minute while the rig is paused."""
    naps = []

    class Minute(MadeTime):
        def sleep(self, seconds):
            naps.append(len(bench.paused()))
            self.spend(60.0 if len(naps) == 1 else seconds)
            if len(naps) > 50:
                bench.engine._stopping.set()

    with Bench(factor=1.0, wall=Minute()) as bench:
        bench.ask('pause', True)
        bench.engine.start()
        bench.engine._thread.join(DEADLINE_S)
    # Fifty naps of 20 ms are a second: ten joint states, and one just after that minute.
    assert 9 <= naps[-1] <= 12


def test_the_least_numbers_leave_the_rig_ticking_or_held():
    """Of every parameter, one at a time; none ends the engine, or keeps it from answering."""
    specs = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS}
    names = [name for name, spec in specs.items() if spec.kind == 'double']
    count = 0
    law = GapControlParameters(gap_control='timed')
    with Bench(rate=50.0, control=law).started() as bench:
        home = bench.engine.parameters
        for name, value in itertools.product(names, (0.0, -0.0, 5e-324, -5e-324, 1e-300)):
            try:
                after = home.with_changes({name: value})
            except ParameterError:
                continue
            requests = bench.ask('change', after, event_bytes()), bench.ask('reset')
            assert [done(request).error for request in requests] == [None, None], (name, value)
            ticks = bench.status.pacing.ticks

            def ticks_or_held(ticks=ticks):
                status = bench.status
                return status.held or status.pacing.ticks > ticks + 5

            until(ticks_or_held, f'{name} {value}')
            assert done(bench.ask('change', home, event_bytes())).error is None
            count += 1
    assert bench.engine.failure is None
    assert count > 80


def test_a_sensor_that_fails_holds_the_rig(monkeypatch):
    external = GapControlParameters(gap_control='external')
    with Bench(factor=1.0, control=external, measurement_rate=50.0) as bench:

        def fail(_index):
            raise OverflowError('cannot convert float infinity to integer')

        with monkeypatch.context() as patch:
            patch.setattr(bench.engine._rig, 'measure', fail)
            bench.engine.start()
            until(lambda: bench.status.held)
            assert bench.status.held.startswith('OverflowError: cannot convert')
        done(bench.change(rig=LIVELY.replace(gap=0.5)))
        bench.await_samples(3)
        assert bench.engine.failure is None


def test_a_failure_is_reported_and_requests_are_turned_away(monkeypatch):
    with Bench() as bench:

        def fail(*_):
            raise RuntimeError('no root')

        monkeypatch.setattr(bench.engine._rig, 'advance', fail)
        bench.engine.start()
        until(lambda: bench.engine.failure)
        assert isinstance(bench.engine.failure, RuntimeError)
        assert 'shutting down' in str(bench.pause().error)


def test_the_log_is_whole_when_ros_shuts_down_in_the_midst_of_a_tick():
    log = KeptLog()
    with Bench() as bench:

        def publish(data):
            bench.sent.append(('joint_states', data))
            if len(bench.samples()) == 50:
                bench.alive = False
            if not bench.alive:
                raise RuntimeError('context is invalid')

        bench.engine._publishers['joint_states'] = TopicPublisher('joint_states', publish)
        bench.ask('record_to', log, event_bytes())
        bench.engine.start()
        bench.engine._thread.join(DEADLINE_S)
        assert bench.engine.failure is None
        assert len(log.of('joint_states')) == 50
