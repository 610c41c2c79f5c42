"""Runs replayed from their logs, whole and faulty; written without ROS as the node would."""

import json
import math
import random
import struct
from collections import Counter
from itertools import islice, pairwise

import numpy as np
import pytest
from bag import ros2_bags, samples
from bag.alterations import altered_message, numbers_of
from bag.recorded_rig import (
    CONTROL,
    LIVELY,
    NOTES,
    RecordedRig,
    interrupted_run,
    ordered_run,
    params_file,
    random_excitation,
    random_run,
    requested_run,
)

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    Order,
    ParameterError,
    Rig,
)
from impact_damper_ros.bag import RecordingError, RunReader
from impact_damper_ros.bag.messages import decode, header_ns
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.compare.comparison import compare_bag
from impact_damper_ros.motion.event import events_of_table
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from impact_damper_ros.replay.what_if import WhatIf
from impact_damper_ros.rig.snapshot import ARITHMETIC


def replayed(bag, node=None):
    return Replay(RecordedRun(bag, node)).run()


def places(messages, topic):
    return [i for i, m in enumerate(messages) if m[0] == topic]


def flipped(message, value):
    """Flip the last bit of the double that a message holds."""
    topic, content, stamp = message
    old = struct.pack('<d', value)
    at = content.index(old)
    new = bytes([old[0] ^ 1]) + old[1:]
    return topic, content[:at] + new + content[at + 8 :], stamp


RATES = {200.0: 400, 20.0: 120, 333.0: 400, 1000.0: 400}
RUNS = {
    **{
        f'requests at {rate:g} Hz': lambda seed, rate=rate: random_run(
            seed, RATES[rate], rate=rate
        )
        for rate in RATES
    },
    'excitation': lambda seed: requested_run(seed, random_excitation),
    'control': lambda seed: requested_run(seed, control=CONTROL),
    'orders': ordered_run,
    'interruptions': interrupted_run,
}


@pytest.mark.parametrize('seed', range(2))
@pytest.mark.parametrize('name', RUNS)
def test_random_histories_come_out_bit_for_bit(tmp_path, name, seed, monkeypatch):
    """As the node records them, and as `ros2 bag record` does; this one replayed compiled."""
    rig = RUNS[name](seed)
    for how, messages in (('own', rig.messages), ('ros2', ros2_bags.joined(rig.messages, 0))):
        notes = NOTES if how == 'own' else {}
        bag = samples.record(tmp_path / how, messages, samples.CONTROLLED, custom=notes)
        least = 0 if how == 'ros2' else math.inf
        monkeypatch.setattr('impact_damper_ros.replay.run._COMPILED_FROM', least)
        findings = replayed(bag)
        assert (findings.differences, findings.faults, findings.remarks) == ([], [], [])
        assert findings.verdict is ReplayVerdict.IDENTICAL
        counts = Counter(topic for topic, *_ in messages)
        assert findings.samples == counts['/joint_states']
        assert findings.impacts == findings.recorded_impacts == counts['/impacts']
        assert findings.gap_control == findings.recorded_gap_control == counts['/gap_control']
        assert findings.snapshots == counts['/snapshot']
        assert findings.changes > 0
        assert not findings.gap_count
        assert (findings.gap_control > 0) is (name in ('control', 'orders', 'interruptions'))


def test_positions_are_those_in_the_laboratory(tmp_path):
    """They go on where the static equilibrium moves."""
    changes = (
        {'angle': 0.3},
        {'gravity': 3.0},
        {'stiffness': 1500.0, 'primary_mass': 4.0},
        {'angle': -0.2, 'gravity': 9.81},
    )
    rig = RecordedRig(rate=1000.0).start().run(500)
    for change in changes:
        rig.run(400, ('change', change))
    reached = []
    findings = Replay(RecordedRun(rig.save(tmp_path / 'bag'))).run(reached.append)
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences
    assert findings.impacts > 50
    assert findings.changes == len(changes)
    assert reached == sorted(reached)
    assert {0.5, 0.9, 1.3, 1.7, 2.1} <= {*reached}
    # A tick carries a stretch of a thousandth of a second with it.
    states = [
        decode('sensor_msgs/msg/JointState', rig.messages[place][1])
        for place in places(rig.messages, '/joint_states')
    ]
    for one, other in pairwise(states):
        for a, b, v, w in islice(
            zip(one.position, other.position, one.velocity, other.velocity, strict=True), 4
        ):
            assert abs((b - a) - 0.5e-3 * (v + w)) < 0.5e-3 * abs(w - v) + 1e-4
    # The angle is shown from the sample on at which it changes.
    angles = [state.position[4] for state in states]
    assert angles == [0.0] * 501 + [0.3] * 1200 + [-0.2] * 400


def test_a_reset_that_begins_with_an_impact(tmp_path):
    initial = {'initial_damper_offset': 0.005, 'initial_damper_velocity': 0.5}
    rig = RecordedRig().start().run(50).run(50, ('change', initial), ('reset', None))
    rig.run(50, ('reset', None), ('change', {'gap': 0.02}))
    # The impact is reported after the change, from which on X counts from another place.
    rig.run(50, ('reset', None), ('change', {'angle': 0.3}))
    bag = rig.save(tmp_path / 'bag')
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences
    assert findings.resets == 3
    assert findings.impacts == len(places(rig.messages, '/impacts'))
    other, _, events = what_if(bag, damper_mass=0.1)
    assert other.from_initial
    assert sum(kind is EventKind.IMPACT for _, kind, _ in events) == findings.impacts


def test_pauses_and_slips_are_counted(tmp_path):
    """A pause may last no time; a slip of the pace moves the stamps as a pause does."""
    rig = RecordedRig().start().run(30, ('change', {'friction': 0.1}))
    rig.run(30, ('resume', 10**9)).run(30, ('resume', 0))
    rig.offset += 5 * 10**6
    rig.done.append(['stamp_offset_ns', rig.offset])
    rig.announce('slip')
    findings = replayed(rig.run(30).save(tmp_path / 'bag'))
    assert findings.verdict is ReplayVerdict.IDENTICAL
    assert (findings.pauses, findings.slips, findings.changes) == (2, 1, 1)


@pytest.fixture
def messages():
    """Return a run of 2 s with a change after one."""
    return RecordedRig().start().run(200).run(200, ('change', {'gap': 0.009})).messages


def test_one_flipped_bit_is_found(tmp_path, messages):
    """The last one of a number, and the sign of a zero."""
    topic, content, stamp = messages[places(messages, '/joint_states')[0]]
    (zero, *others), velocities, _ = samples.numbers(content)
    assert zero == 0.0
    altered = samples.with_numbers(content, stamp, [-0.0, *others], velocities)
    messages[places(messages, '/joint_states')[0]] = (topic, altered, stamp)
    place = places(messages, '/joint_states')[150]
    positions = samples.numbers(messages[place][1])[0]
    messages[place] = flipped(messages[place], positions[1])
    findings = replayed(samples.record(tmp_path / 'bag', messages, custom=NOTES))
    assert findings.verdict is ReplayVerdict.DIFFERENT
    signed, found = findings.differences
    assert signed.quantity == 'position of primary'
    assert (found.topic, found.quantity) == ('/joint_states', 'position of damper')
    assert found.time == 0.75
    assert found.replayed == positions[1]
    assert found.after == 'the start of the bag'
    assert (findings.divergence.samples, findings.divergence.last) == (2, 0.75)


@pytest.fixture(scope='module')
def controlled():
    """Return a run of 2 s under control, which changes after one."""
    rig = RecordedRig(control=GapControlParameters(gap_control='timed', gap_min=0.002)).start()
    return rig.run(200).run(200, ('change', {'restitution_1': 0.7})).messages


@pytest.mark.parametrize(
    ('topic', 'number', 'place', 'quantity'),
    [
        ('/joint_states', 350, ('velocity', 0), 'velocity of primary'),
        ('/impacts', 7, ('stamp', 'nanosec'), 'stamp'),
        ('/impacts', 7, ('frame',), 'frame_id'),
        ('/impacts', 7, ('effort', 1), 'effort of damper'),
        ('/gap_control', 40, ('frame',), 'frame_id'),
        ('/gap_control', 40, ('position', 1), 'position of stop_2'),
        ('/gap_control', 40, ('effort', 2), 'effort of primary'),
        ('/gap_control', 40, ('velocity', 0), 'velocity of stop_1'),
        ('/snapshot', -1, ('state', 'parameters', 'stiffness'), 'parameters.stiffness'),
        ('/snapshot', -1, ('state', 'origin', 'clearance_1'), 'origin.clearance_1'),
        ('/snapshot', -1, ('state', 'origin', 'angles', 0), 'origin.angles'),
        ('/snapshot', -1, ('rate',), 'rate'),
        ('/snapshot', 0, ('number',), 'number'),
    ],
)
def test_an_altered_number_is_named(
    tmp_path, controlled, monkeypatch, topic, number, place, quantity
):
    """On the same machine, and noticed on another one."""
    at = places(controlled, topic)[number]
    stamp = controlled[at][2]
    (where,) = (p for p in numbers_of(controlled[at]) if p[-len(place) :] == place)
    messages = list(controlled)
    messages[at] = altered_message(controlled[at], where, 1e-3)
    bag = samples.record(tmp_path / 'bag', messages, samples.CONTROLLED, custom=NOTES)
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.DIFFERENT
    first = findings.first
    assert (first.topic, first.quantity) == (topic, quantity)
    if topic != '/snapshot':
        assert findings.by_topic == {topic: 1}
        assert first.time == pytest.approx((stamp - samples.START) / 1e9, abs=2e-3)
    monkeypatch.setattr('impact_damper_ros.replay.replay.mathematics', lambda: 1)
    findings = replayed(bag)
    assert findings.verdict is ReplayVerdict.DIFFERENT
    assert topic in findings.by_topic


def test_missing_samples_are_a_fault_unless_the_recorder_dropped_them(tmp_path, messages):
    for begin, end, missing in (
        (0, 20_000_001, '4 joint states are missing'),
        (600_000_001, 700_000_000, '19 joint states are missing, the first after 0.6 s'),
    ):
        kept = [m for m in messages if 'snap' in m[0] or not begin <= m[2] - samples.START < end]
        findings = replayed(samples.record(tmp_path / str(begin), kept, custom=NOTES))
        assert findings.verdict is ReplayVerdict.PARTIAL
        text = f'the bag is not complete: {missing}; the recorder notes 0 dropped messages'
        assert findings.faults == [text]
    notes = {**NOTES, 'dropped': '19'}
    findings = replayed(samples.record(tmp_path / 'dropped', kept, custom=notes))
    assert findings.verdict is ReplayVerdict.IDENTICAL
    assert '19 joint states are missing' in findings.remarks[0]
    assert 'it has dropped 19 messages' in findings.remarks[1]
    assert (findings.missing_samples, findings.gap_count) == (19, 1)
    assert findings.gaps[0].after == 0.6
    assert findings.missing_impacts > 0


def test_the_same_impact_twice_while_paused(tmp_path):
    """A reset, and a stop that comes up to m, repeated."""
    outwards = InitialConditions(initial_damper_offset=0.02, initial_damper_velocity=1.0)
    rig = RecordedRig(LIVELY.replace(gap=0.1), outwards).start().run(3)
    for _ in range(2):
        for request in (('reset', None), ('change', {'gap': 0.02}), ('change', {'gap': 0.1})):
            rig.serve(request)
    hits = [m for m in rig.messages if m[0] == '/impacts']
    assert len(hits) == 2
    assert hits[0] == hits[1]
    rig.run(100)
    arrived = ros2_bags.joined(rig.messages, 0)
    for name, messages, notes in (('bag', rig.messages, NOTES), ('ros2', arrived, {})):
        findings = replayed(samples.record(tmp_path / name, messages, custom=notes))
        assert findings.verdict is ReplayVerdict.IDENTICAL
        assert findings.impacts == len(places(messages, '/impacts')) > 2
    from impact_damper_ros.compare import compare_bag

    result = compare_bag(tmp_path / 'bag')
    assert (result.impacts, result.faults) == (findings.impacts, ())


def test_messages_twice_and_out_of_order(tmp_path, messages):
    """The stamps in the messages give the order, in bags of the node as in others."""
    a, b = places(messages, '/joint_states')[30:32]
    hit = places(messages, '/impacts')[3]
    change = places(messages, '/snapshot')[-1]
    exchanged = list(messages)
    exchanged[a], exchanged[b] = ((*messages[i][:2], messages[j][2]) for i, j in ((b, a), (a, b)))
    logged = messages[0][2]
    for name, changed, words in (
        ('state', messages[: a + 1] + messages[a:], '/joint_states that are there twice: 1'),
        ('hit', messages[: hit + 1] + messages[hit:], '/impacts that are there twice: 1'),
        (
            'change',
            messages[: change + 1] + messages[change:],
            '/snapshot that are there twice: 1',
        ),
        ('stamps', exchanged, ''),
        ('at once', [(*m[:2], logged) for m in messages], ''),
    ):
        findings = replayed(samples.record(tmp_path / name, changed, custom=NOTES))
        verdict = ReplayVerdict.PARTIAL if words else ReplayVerdict.IDENTICAL
        assert findings.verdict is verdict, findings
        assert findings.faults == ([f'messages of {words}'] if words else [])


@pytest.mark.parametrize('make', [ordered_run, interrupted_run])
def test_any_order_of_arrival_is_the_same_run(tmp_path, make):
    """Each topic on its own way, the latched snapshot after what it caused."""
    rig = make(7)
    rng = random.Random(5)
    late = {topic: rng.randrange(0, 3 * 10**8) for topic in sorted({m[0] for m in rig.messages})}
    arrived = sorted(
        (
            (t, content, stamp + late[t] + rng.randrange(10**8))
            for t, content, stamp in rig.messages
        ),
        key=lambda message: message[2],
    )
    findings = {
        name: replayed(samples.record(tmp_path / name, messages, samples.CONTROLLED))
        for name, messages in (('in order', rig.messages), ('arrived', arrived))
    }
    assert findings['arrived'] == findings['in order']
    assert findings['arrived'].verdict is ReplayVerdict.IDENTICAL


def test_a_bag_of_another_arithmetic_says_so(tmp_path, messages):
    topic, content, stamp = messages[0]
    now = f'"arithmetic": {ARITHMETIC}'.encode()
    assert content.count(now) == 1
    other = content.replace(now, f'"arithmetic": {ARITHMETIC + 1}'.encode())
    findings = replayed(
        samples.record(tmp_path / 'other', [(topic, other, stamp), *messages[1:]], custom=NOTES)
    )
    expected = f'recorded with arithmetic {ARITHMETIC + 1}, this version has {ARITHMETIC}'
    assert expected in findings.remarks[0]
    same = replayed(samples.record(tmp_path / 'same', messages, custom=NOTES))
    assert same.remarks == []


def test_bags_without_a_rig_are_refused(tmp_path, messages):
    def without(*topics):
        left = [m for m in messages if m[0] not in topics]
        return samples.record(tmp_path / str(len(topics)), left)

    with pytest.raises(
        RecordingError, match=r'no message of a snapshot.*record the topic snapshot too'
    ):
        replayed(without('/snapshot'))
    with pytest.raises(RecordingError, match='no complete message'):
        replayed(samples.record(tmp_path / 'empty', []))
    foreign = samples.record(tmp_path / 'foreign', samples.run(5))
    with pytest.raises(RecordingError, match='of format 3; this version reads format'):
        replayed(foreign)


def test_a_recorder_may_join_after_hours(tmp_path):
    """It has the latched snapshot, and then joint states of a rig that has run for 8 hours."""
    slow = LIVELY.replace(gap=100.0, stiffness=1e-3, damping=1e-3, force_amplitudes=0.0)
    rig = RecordedRig(slow, rate=0.01).start().run(300)
    late = [rig.messages[0], *rig.messages[-12:]]
    findings = replayed(samples.record(tmp_path / 'bag', late))
    assert (findings.verdict, findings.samples) == (ReplayVerdict.IDENTICAL, 12)


def test_a_wrong_stamp_does_not_run_the_rig_for_years(tmp_path, messages):
    arrived = ros2_bags.joined(messages, 0)
    place = places(arrived, '/joint_states')[100]
    topic, content, stamp = arrived[place]
    at = header_ns(content) + 2**25 * 10**9
    late = samples.with_numbers(content, at, *samples.numbers(content))
    arrived[place] = (topic, late, stamp)
    findings = replayed(samples.record(tmp_path / 'bag', arrived))
    assert findings.verdict is ReplayVerdict.PARTIAL
    assert findings.samples == 400
    assert any('impossible stamps: 1' in fault for fault in findings.faults)


@pytest.mark.parametrize('request_', [('reset', None), ('change', {'gap': 0.02})])
def test_what_cancels_the_order_of_its_stamp_may_come_after_it(tmp_path, request_):
    """In a paused rig, in simulated time: the snapshot is the same without the order."""
    rig = RecordedRig(control=CONTROL.replace(gap_control='external')).start()
    for place in (0.015, 0.008):
        rig.run(50, order=lambda place=place: Order(place, -place)).serve(request_)
        rig.serve(('resume', 0))
    findings = replayed(rig.run(50).save(tmp_path / 'bag'))
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences


def test_a_missing_order_is_found(tmp_path):
    messages = ordered_run(1).messages
    at = next(i for i, m in enumerate(messages) if m[0] == '/gap_control' and b'order' in m[1])
    del messages[at]
    bag = samples.record(tmp_path / 'bag', messages, samples.CONTROLLED, custom=NOTES)
    assert replayed(bag).difference_count > 0


def test_a_bag_may_end_anywhere(tmp_path):
    rig = RecordedRig(control=CONTROL).start().run(200)
    messages = rig.run(40, ('change', {'gap_control': 'amplitude'})).messages
    assert {topic for topic, *_ in messages[-40:]} >= {'/joint_states', '/impacts', '/gap_control'}
    for end in range(len(messages) - 40, len(messages), 3):
        name = tmp_path / f'bag_{end}'
        bag = samples.record(name, messages[:end], samples.CONTROLLED, custom=NOTES)
        assert replayed(bag).difference_count == 0, end


# What if


def what_if(bag, **held):
    """Return a what-if, its samples, and the times and kinds of its events."""
    history = RecordedRun(bag)
    other = WhatIf(history.start, held)
    found = [other.follow(part) for part in Replay(history)]
    samples, events = (np.concatenate([part[i] for part in found]) for i in (0, 1))
    return other, samples.tolist(), [(e.time, e.kind, e.x) for e in events_of_table(events)]


def test_what_if_is_the_direct_simulation(tmp_path):
    rig = RecordedRig().start().run(100).run(100, ('change', {'friction': 0.1}))
    rig.run(100, ('change', {'gap': 0.02}), ('reset', None))
    other, samples, events = what_if(rig.save(tmp_path / 'bag'), gap=0.006)
    assert other.from_initial
    direct, expected = Rig(LIVELY.replace(gap=0.006)), []
    for sample in samples:
        expected += direct.advance(sample[0])
        if sample[0] == 0.505:
            expected += direct.change(direct.parameters.replace(friction=0.1))
        if sample[0] == 1.005:
            direct.reset()
        assert sample == direct.sample()
    assert events == [(e.time, e.kind, e.x) for e in expected]
    assert sum(e.kind is EventKind.IMPACT for e in expected) > 30


def test_what_if_in_the_middle_of_a_run_is_a_change_at_its_start(tmp_path):
    rig = RecordedRig()
    rig.run(140)
    rig.record()
    start = json.loads(json.dumps(rig.rig.snapshot()))
    rig.run(100)
    direct = Rig.restore(start)
    offset = abs(direct.sample().z - direct.sample().x)
    # Too narrow for m where it is
    gap = offset
    assert gap > 1e-3
    expected = direct.change(direct.parameters.replace(gap=gap))
    other, samples, events = what_if(rig.save(tmp_path / 'bag'), gap=gap)
    assert not other.from_initial
    for sample in samples:
        expected += direct.advance(sample[0])
        assert sample == direct.sample()
    assert events == [(e.time, e.kind, e.x) for e in expected]


def test_what_if_a_reset_does_not_fit(tmp_path):
    initial = InitialConditions(initial_damper_offset=0.004)
    rig = RecordedRig(initial=initial).start().run(100).run(100, ('reset', None))
    other, samples, _ = what_if(rig.save(tmp_path / 'bag'), gap=0.006)
    # The gap closes on m at the start and at the reset, so that both go on alike.
    assert not other.from_initial
    assert samples[0][3] - samples[0][1] == 0.004
    assert samples[101][3] - samples[101][1] == 0.004
    assert samples[101][1:3] == (0.0, 0.0)


def test_inadmissible_what_ifs(tmp_path):
    bag = RecordedRig().start().run(5).save(tmp_path / 'bag')
    with pytest.raises(ParameterError, match='force_amplitudes has 1'):
        what_if(bag, force_frequencies=(1.0, 2.0))
    rig = RecordedRig()
    rig.run(140)
    rig.record()
    history = RecordedRun(rig.run(5).save(tmp_path / 'later'))
    with pytest.raises(ValueError, match='initial_primary_position cannot be set'):
        WhatIf(history.start, {}, {'initial_primary_position': 0.1})


@pytest.fixture(scope='module')
def ordered(tmp_path_factory):
    """Return a rig that a controller outside it has moved, and its bag."""
    external = CONTROL.replace(gap_control='external')
    rng = random.Random(3)
    rig = RecordedRig(control=external).start()
    for _ in range(2):
        rig.run(
            200, order=lambda: Order(rng.uniform(0.005, 0.02), -0.01, force=rng.gauss(0.0, 2.0))
        )
        rig.announce('record')
    return rig, rig.save(tmp_path_factory.mktemp('ordered') / 'bag')


def test_a_what_if_has_the_same_orders(ordered, capsys):
    _, path = ordered
    ratios = []
    # A seed that changes nothing, and a control that takes no orders
    for value in ('gap_control_seed=5', 'gap_control=off'):
        assert replay_run([str(path), '--set', value]) == 0
        text = capsys.readouterr().out
        ratios.append(float(text.partition('rms X [m]')[2].split()[2]))
    assert ratios[0] == 1.0
    assert ratios[1] != 1.0


def test_what_if_the_control_had_been_on(tmp_path, capsys):
    rig = RecordedRig(LIVELY.replace(gap=0.06)).start().run(2400)
    path = rig.save(tmp_path / 'bag')
    settings = [
        word for name, value in CONTROL.as_dict().items() for word in ('--set', f'{name}={value}')
    ]
    assert replay_run([str(path), *settings]) == 0
    text = capsys.readouterr().out
    assert "gap_control = 'timed' (recorded: 'off')" in text
    ratio = float(text.partition('rms X [m]')[2].split()[2])
    assert ratio < 0.9


# Recorded


def recorded_what_if(path, other, *settings):
    """Record a what-if by the command; return its result as JSON."""
    words = [word for setting in settings for word in ('--set', setting)]
    result = other.with_suffix('.json')
    files = ['--json', str(result), '--bag', str(other)]
    assert replay_run([str(path), *words, *files, '--quiet']) == 0
    return json.loads(result.read_text())['what_if']


def from_the_middle(_):
    rig = RecordedRig(control=CONTROL)
    rig.run(137)
    rig.record()
    for requests in (('change', {'friction': 0.1}), ('reset', None), ('resume', 10**9)):
        rig.run(90, requests)
    return rig


def with_a_reset_that_does_not_fit(_):
    initial = InitialConditions(initial_damper_offset=0.004)
    return RecordedRig(initial=initial).start().run(100).run(100, ('reset', None))


WHAT_IFS = {
    'requests': (lambda seed: random_run(seed, 400), ('gap=0.013', 'restitution_1=0.6')),
    'control': (lambda seed: requested_run(seed, control=CONTROL), ('damper_mass=0.2',)),
    'orders': (ordered_run, ('friction=0.05',)),
    'middle': (from_the_middle, ('gap=0.003',)),
    'reset': (with_a_reset_that_does_not_fit, ('gap=0.006',)),
    'controlled': (
        lambda seed: random_run(seed, 200),
        tuple(f'{name}={value}' for name, value in CONTROL.as_dict().items()),
    ),
}


@pytest.mark.parametrize('name', WHAT_IFS)
def test_a_what_if_is_a_recording(tmp_path, name):
    """It is replayed bit for bit, and compared; the numbers are those of the table."""
    make, settings = WHAT_IFS[name]
    rig = make(5)
    totals = recorded_what_if(rig.save(tmp_path / 'bag'), tmp_path / 'other', *settings)
    findings = replayed(tmp_path / 'other')
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings
    # It also has the sample of its start.
    first = json.loads(decode(samples.STRING, rig.messages[0][1]).data)['time_ns']
    assert findings.samples == len(places(rig.messages, '/joint_states')) + (first > 0)
    whole = compare_bag(tmp_path / 'other').overall
    for key, value in (
        ('x_max', whole.x_max),
        ('x_rms', whole.x_rms),
        ('impact_loss', whole.impact_loss),
    ):
        close = 5e-3 if first else 1e-9
        assert totals['what_if'][key] == pytest.approx(value, rel=close), key
    assert totals['what_if']['impacts'] == findings.impacts


def test_the_recorded_what_if_is_what_simulate_rig_records(tmp_path):
    """The same messages but for the identity of the run."""
    bag = RecordedRig(offset=0).start().run(400).save(tmp_path / 'bag')
    recorded_what_if(bag, tmp_path / 'other', 'gap=0.006')
    params = params_file(tmp_path / 'params.yaml', LIVELY)
    words = [str(params), '--duration', '2', '--set', 'gap=0.006', '--quiet', '--bag']
    assert simulate_rig([*words, str(tmp_path / 'direct')]) == 0
    topics = {'/joint_states', '/impacts'}
    one, other = (
        [record[2:] for record in RunReader(tmp_path / name).messages(topics)]
        for name in ('other', 'direct')
    )
    assert one == other


@pytest.mark.parametrize('level', [0.0, 6.0])
def test_a_stepped_sine_is_replayed_bit_for_bit(tmp_path, level):
    """Of the force, and of a base whose displacement changes at each step; with changes."""
    sweep = ['sweep_mode=up_down', 'sweep_low=25', 'sweep_high=40', 'sweep_step=3']
    if level:
        sweep += ['force_amplitudes=0', f'base_amplitudes={level}', 'base_frequencies=30']
    params = params_file(tmp_path / 'params.yaml', LIVELY)
    words = [str(params), '--duration', '4', '--quiet', '--bag', str(tmp_path / 'bag')]
    for setting in (*sweep, 'sweep_dwell=0.15'):
        words += ['--set', setting]
    for change in ('0.55:gap=0.012', '1.3:sweep_dwell=0.1', '2.9:sweep_mode=down'):
        words += ['--change', change]
    assert simulate_rig([*words, '--max-bag-duration', '1.7']) == 0
    findings = replayed(tmp_path / 'bag')
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences
    assert (findings.changes, findings.samples) == (3, 801)
    assert findings.impacts > 20


def test_both_sides_of_the_figure_have_the_orders(ordered):
    """Of a controller outside the rig; held is a value that changes nothing."""
    pytest.importorskip('matplotlib')
    from impact_damper_ros.report.run_pair import RunPair

    rig, path = ordered
    history = RecordedRun(path)
    other = WhatIf(history.start, {'gap_control_seed': 5})
    runs = RunPair(history.start, other, {'gap_control_seed': 5}, drawn=True)
    for part in Replay(history):
        runs.take(part, other.follow(part))
    runs.finish()
    last = rig.rig.sample()
    figure = runs.figure()
    for axes in figure.axes[1:3]:
        ends = {
            line.get_label(): (line.get_xdata()[-1], line.get_ydata()[-1])
            for line in axes.lines
            if not line.get_label().startswith('_')
        }
        drawn = next(value for label, value in ends.items() if label.startswith('X '))
        assert drawn == pytest.approx((last.time, last.x), rel=1e-9)
        assert ends['Z, loose mass'] == pytest.approx((last.time, last.z), rel=1e-9)


# Restarts


def restarted(offset):
    """Return what another recorder gets of two runs of a node, and both rigs."""
    first = RecordedRig(offset=0).start().run(300, ('change', {'gap': 0.012}))
    second = RecordedRig(LIVELY.replace(gap=0.02), offset=offset).start()
    second.run(100).run(100, ('change', {'friction': 0.1}))
    second.run_id = first.run_id[::-1]
    messages = [*first.messages, *second.messages]
    for i in places(messages, '/snapshot'):
        topic, content, stamp = messages[i]
        held = json.loads(decode(samples.STRING, content).data)
        held['run'] = (first if i < len(first.messages) else second).run_id
        text = samples.make(samples.STRING, json.dumps(held))
        messages[i] = topic, samples.serialise(samples.STRING, text), stamp
    arrived = [
        (*m[:2], 10**9 + k * 10**6)
        for k, m in enumerate(messages)
        # What is latched comes once to a recorder: the last one.
        if m[0] != '/snapshot' or b'record' not in m[1][:600]
    ]
    return arrived, first, second


@pytest.mark.parametrize('offset', [5 * 10**9, 0])
def test_a_restart_makes_another_run(tmp_path, capsys, offset):
    """Stamps go on, or begin at 0 again; each run is judged by itself."""
    messages, first, second = restarted(offset)
    bag = samples.record(tmp_path / 'bag', messages)
    result = tmp_path / 'result.json'
    assert replay_run([str(bag), '--json', str(result)]) == 0
    text = capsys.readouterr().out
    assert text.count('identical: the run is reproduced bit for bit') == 2
    assert 'node /sim_node, run 2 of 2' in text
    assert text.count('the node /sim_node was restarted') == 2
    runs = json.loads(result.read_text())['runs']
    counts = [len(places(rig.messages, '/joint_states')) for rig in (first, second)]
    assert [run['compared']['samples'] for run in runs] == counts
    assert [run['compared']['changes'] for run in runs] == [1, 1]
    assert [run['faults'] for run in runs] == [[], []]
    # One of them
    states = tmp_path / 'states.csv'
    assert replay_run([str(bag), '--states', str(states)]) == 2
    assert 'choose one with --run 1 to --run 2' in capsys.readouterr().err
    assert replay_run([str(bag), '--run', '2', '--states', str(states)]) == 0
    assert len(states.read_text().splitlines()) == 1 + counts[1]
    assert replay_run([str(bag), '--run', '3']) == 2
    assert 'holds 2 runs' in capsys.readouterr().err
    assert compare_run([str(bag), '--json', str(result), '--quiet']) == 0
    compared = json.loads(result.read_text())['runs']
    assert [run['samples'] for run in compared] == counts
    assert [run['run'] for run in compared] == [1, 2]


def test_stamps_may_go_back_with_the_system_clock(tmp_path):
    """As another recorder has it, of a rig that then counts from the clock that was set back."""
    rig = RecordedRig().start().run(200).run(200, ('resume', -(10**9) // 2))
    rig.run(100, ('change', {'gap': 0.02}))
    messages = [(*m[:2], 10**9 + k) for k, m in enumerate(rig.messages)]
    findings = replayed(samples.record(tmp_path / 'bag', messages))
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings.differences[:2]
    assert findings.samples == 501
    assert findings.impacts == len(places(rig.messages, '/impacts'))
