"""Runs under gap control replayed from their logs: acts, noise and live switching included."""

import math
import random

import pytest
from bag import ros2_bags, samples
from bag.recorded_rig import LIVELY, NOTES, RecordedRig
from replay.test_replay import places, replayed

from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.control import GapControlParameters, Order, Rig
from impact_damper_ros.replay.findings import ReplayVerdict

# Of a rig of 5 Hz that moves centimetres
CONTROL = GapControlParameters(
    gap_control='timed',
    gap_min=0.002,
    gap_max=0.5,
    gap_control_rate=200.0,
    gap_control_noise_position=1e-5,
    gap_control_noise_velocity=1e-3,
    actuator_speed=0.5,
    actuator_delay=0.004,
)


def random_switch(rng):
    """Return a request that switches the control, or changes something under it."""
    return rng.choice(
        [
            ('change', {'gap_control': 'off'}),
            ('change', {'gap_control': 'timed'}),
            ('change', {'gap_control': 'amplitude', 'gap': rng.uniform(0.005, 0.03)}),
            ('change', {'gap_control': 'timed', 'gap_control_stops': 'symmetric'}),
            ('change', {'actuator_delay': rng.choice([0.0, 0.03]), 'gap_control_seed': 5}),
            ('change', {'actuator_speed': rng.choice([0.0, 0.1, 2.0])}),
            ('change', {'gap': rng.uniform(0.005, 0.03)}),
            ('change', {'friction': rng.choice([0.0, 0.2])}),
            ('reset', None),
            ('resume', rng.randrange(10**9)),
        ]
    )


def switched_run(seed, ticks=500):
    rng = random.Random(seed)
    rig = RecordedRig(control=CONTROL, offset=rng.choice([0, samples.START])).start()
    while rig.tick < ticks:
        batch = [random_switch(rng) for _ in range(rng.choice([1, 1, 2, 3]))]
        rig.run(rng.randrange(5, 80), *batch)
    return rig


@pytest.fixture(scope='module')
def messages():
    rig = RecordedRig(control=CONTROL).start().run(300)
    return rig.run(200, ('change', {'gap_control': 'amplitude'})).messages


def save(directory, messages, notes=NOTES):
    return samples.record(directory, messages, samples.CONTROLLED, custom=notes)


@pytest.mark.parametrize('seed', range(8))
def test_random_switching_comes_out_bit_for_bit(tmp_path, seed):
    rig = switched_run(seed)
    findings = replayed(rig.save(tmp_path / 'bag'))
    assert findings.differences == []
    assert findings.faults == []
    assert findings.verdict is ReplayVerdict.IDENTICAL
    count = len(places(rig.messages, '/gap_control'))
    assert findings.control == findings.recorded_control == count > 0


def ordered_run(seed):
    """Return the run of a controller outside the rig, which is also switched off at times."""
    rng = random.Random(seed)
    on = ('change', {'gap_control': 'external'})
    external = CONTROL.replace(gap_control='external', actuator_speed=rng.choice([0.0, 0.5]))
    rig = RecordedRig(control=external, rate=rng.choice([100.0, 333.3])).start()

    def order():
        half, force = rng.uniform(0.002, 0.02), rng.choice([math.nan, rng.gauss(0.0, 3.0)])
        return Order(half, rng.choice([-half, math.nan]), rng.choice([math.nan, 0.2]), 0.3, force)

    for _ in range(5):
        rig.run(rng.randrange(20, 80), on, order=order)
        rig.run(3, ('change', {'gap': rng.uniform(0.005, 0.03)}), order=order)
        rig.run(rng.randrange(5, 20), random_switch(rng))
    return rig


@pytest.mark.parametrize('seed', range(4))
def test_orders_come_out_bit_for_bit(tmp_path, seed):
    rig = ordered_run(seed)
    for name, messages in (('own', rig.messages), ('ros2', ros2_bags.joined(rig.messages, 0))):
        findings = replayed(save(tmp_path / name, messages, NOTES if name == 'own' else {}))
        assert (findings.differences, findings.faults) == ([], [])
        assert findings.verdict is ReplayVerdict.IDENTICAL
        assert findings.control == len(places(rig.messages, '/gap_control')) > 300


def test_an_altered_order_is_found(tmp_path):
    messages = ordered_run(1).messages
    at = next(
        i
        for i, (topic, content, _) in enumerate(messages)
        if topic == '/gap_control' and b'order' in content
    )
    del messages[at]
    assert replayed(save(tmp_path / 'bag', messages)).difference_count > 0


def test_what_ros2_bag_record_makes_of_it(tmp_path, messages):
    findings = replayed(save(tmp_path / 'bag', ros2_bags.joined(messages, 0), {}))
    assert findings.difference_count == 0
    assert findings.control == len(places(messages, '/gap_control'))


def test_a_bag_may_end_anywhere(tmp_path):
    rig = RecordedRig(control=CONTROL).start().run(200)
    messages = rig.run(40, ('change', {'gap_control': 'amplitude'})).messages
    assert {topic for topic, *_ in messages[-40:]} >= {'/joint_states', '/impacts', '/gap_control'}
    for end in range(len(messages) - 40, len(messages), 3):
        findings = replayed(save(tmp_path / f'bag_{end}', messages[:end]))
        assert findings.difference_count == 0, end


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
    twin = Rig(rig.rig.parameters, control=CONTROL)
    twin.advance(rig.time_ns / 1e9)
    assert twin.control.active
