"""Rows of messages are what the rig did, seen from the fixed place that messages count from."""

import math

import numpy as np
import pytest
from rigs import BENCH

from impact_damper_ros import Order, Rig
from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.control.act import Action, ControlAct
from impact_damper_ros.motion.event import SAMPLE_TYPE
from impact_damper_ros.replay.rows import (
    orders_of,
    published_acts,
    published_impacts,
    published_states,
    recorded_impacts,
    recorded_samples,
)

#: With static deflection, and a base that moves
RIG = BENCH.replace(angle=0.4, base_amplitudes=0.7, base_frequencies=29.0)
OFFSET_NS = 5 * 10**9


@pytest.fixture(scope='module')
def run():
    run = Rig(RIG).run(20.0, np.linspace(0.0, 20.0, 400))
    assert len(run.impacts()) > 50
    return run


def test_samples_are_those_of_their_messages(run):
    numbers = published_states(run.samples, RIG)
    deflection = 2.0 * 9.81 * math.sin(0.4) / 1974.0
    assert RIG.gravity * RIG.primary_mass == 2.0 * 9.81
    found = {name: run.samples[name] for name in SAMPLE_TYPE.names}
    assert numbers[:, 0] == pytest.approx(found['x'] + deflection, abs=1e-15)
    assert numbers[:, 6] == pytest.approx(found['x'] + deflection - found['base'], abs=1e-15)
    messages = np.zeros(len(numbers), message_row(14))
    messages['numbers'] = numbers
    again = recorded_samples(messages, RIG, found['time'])
    for name, column in found.items():
        assert again[name] == pytest.approx(column, abs=1e-15), name


def test_impacts_are_those_of_their_messages(run):
    messages = published_impacts(run.events, RIG, OFFSET_NS)
    impacts = run.impacts()
    assert (messages['stamp_ns'] - OFFSET_NS) / 1e9 == pytest.approx(impacts['time'], abs=1e-9)
    again = recorded_impacts(messages, RIG, impacts['time'])
    for name in ('kind', 'stop'):
        assert again[name].tolist() == impacts[name].tolist()
    names = [name for name in again.dtype.names if name.partition('_')[2].startswith(('v', 'd'))]
    assert len(names) == 4
    for name in ('time', 'x', 'y', 'impulse', *names):
        assert again[name] == pytest.approx(impacts[name], rel=1e-12, abs=1e-14), name
        assert np.ptp(again[name]) > 0.0


def test_orders_are_those_of_their_acts():
    """Among acts of other kinds, with the force beside the stops and their speeds."""
    numbers = (0.011, -0.012, 0.1, 0.3, 0.4, 0.5, 0.6, 0.7, 2.5)
    acts = [ControlAct(1.25, Action.ORDER, *numbers), ControlAct(2.0, Action.CROSSING, *numbers)]
    found = orders_of(published_acts(acts, OFFSET_NS), OFFSET_NS)
    assert [(one.time, one.order) for one in found] == [
        (1.25, Order(0.011, -0.012, 0.3, 0.4, 2.5))
    ]
