"""The motion at later instants, before the rig is there: the same bits as on the way."""

import random

import pytest

from impact_damper_ros.rig import RigParameters, Simulator
from rig.random_rigs import random_command, random_rig


@pytest.mark.parametrize('seed', range(60))
def test_previews_are_what_the_rig_does(seed):
    """Of all kinds of rigs, some of them swept or with moving stops; previewed or not."""
    parameters, initial = random_rig(f'preview {seed}')
    rng = random.Random(seed)
    if seed % 5 == 0:
        parameters = parameters.replace(
            sweep_mode='up_down', sweep_low=0.8, sweep_high=1.2, sweep_step=0.1, sweep_dwell=3.1
        )
    rig, alone = Simulator(parameters, initial), Simulator(parameters, initial)
    period, tick, seen = rng.choice([0.01, 0.1, 0.7]), 0, 0
    for _ in range(60):
        ahead = rig.preview([(tick + i) * period for i in range(rng.choice([1, 4, 20]))])
        seen += len(ahead)
        for sample in ahead:
            assert alone.advance(tick * period) == rig.advance(tick * period)
            assert sample == rig.sample() == alone.sample()
            tick += 1
        tick += 1
        assert alone.advance(tick * period) == rig.advance(tick * period)
        if seed % 3 == 0 and rng.random() < 0.2:
            place_1, place_2, speed = random_command(rng, rig)
            done = rig.move_stops(place_1, place_2, speed=speed)
            assert alone.move_stops(place_1, place_2, speed=speed) == done
    assert seen > 60
    assert rig.snapshot() == alone.snapshot()


def test_a_preview_ends_before_the_next_event():
    rig = Simulator(RigParameters(gravity=0.0))
    times = [43.0 + 0.1 * i for i in range(30)]
    rig.advance(43.0)
    (impact,) = Simulator.restore(rig.snapshot()).advance(44.0)
    assert [sample.time for sample in rig.preview(times)] == [t for t in times if t < impact.time]
    assert rig.preview([]) == []
    assert rig.time == 43.0
