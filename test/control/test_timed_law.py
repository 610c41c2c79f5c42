"""Timed impacts: where they happen, and that both conditions hold at each of them."""

import math

import pytest

from control.controlled_rigs import TRIAL, control
from impact_damper_ros import Action, EventKind, Rig, RigParameters
from impact_damper_ros.control.controller import control_of, settings_of
from impact_damper_ros.control.sensors import ZeroPassage
from impact_damper_ros.control.state import Measurement, damper_of
from impact_damper_ros.control.timed_law import (
    close_stop,
    park_stops,
    stop_to_close,
    timed_law_sees,
)

RIGS = {
    'level': TRIAL,
    'broadband': TRIAL.replace(
        force_amplitudes=[0.35] * 16,
        force_frequencies=[0.5 + 1.5 * (k + 0.5) / 16 for k in range(16)],
        force_phases=[(k * k * 1.7) % 6.28 for k in range(16)],
    ),
    '15 degrees': RigParameters(angle=math.radians(15.0), friction=0.5, gravity=1.0),
    '45 degrees': RigParameters(angle=math.radians(45.0), friction=0.5, gravity=3.0),
}


def timed_impacts(rig, until):
    """Return the impacts on a stop that has been closed on m, with that of the touch."""
    events = rig.advance(until)
    touched = {(e.time, e.stop) for e in events if e.kind is EventKind.STOP_TOUCHED}
    return [e for e in events if e.kind is EventKind.IMPACT and (e.time, e.stop) in touched]


@pytest.mark.parametrize('stops', ['symmetric', 'independent'])
@pytest.mark.parametrize('name', RIGS)
def test_both_conditions_hold_at_every_timed_impact(name, stops):
    parameters = RIGS[name]
    rig = Rig(parameters, control=control('timed', gap_control_stops=stops))
    impacts = timed_impacts(rig, 400.0)
    triggers = [r.time for r in rig.acts if r.action is Action.CROSSING]
    assert len(impacts) > 0.3 * len(triggers)
    damper = damper_of(parameters)
    for event in impacts:
        x_rate = event.primary_velocity_before
        y_rate = event.damper_velocity_before - x_rate
        outwards = event.y if event.stop == 1 else -event.y
        # m moves outwards ...
        assert y_rate > 0.0 if event.stop == 1 else y_rate < 0.0
        if stops == 'symmetric':
            assert outwards > 0.5 * rig.control.gap_min
        # ... and M loses energy.
        assert x_rate * y_rate < 0.0
        assert damper.primary_jump * abs(y_rate) < 2.0 * abs(x_rate)
        assert abs(event.primary_velocity_after) < abs(x_rate)
        # At the passage of X through zero, the trigger's own instant
        assert event.time in triggers
        assert abs(event.x) < 1e-9
    # At most one for each passage
    assert len({event.time for event in impacts}) == len(impacts)


def test_delay_and_speed_are_made_up_for():
    """The command is given ahead, so that the stop still meets m where |X'| is largest."""
    for values in (
        {'actuator_delay': 0.5},
        {'actuator_speed': 10.0},
        {'actuator_delay': 0.3, 'actuator_speed': 20.0},
        # More than a quarter of a cycle, so that X still moves away when the command is given
        {'actuator_delay': 2.0},
        {'actuator_delay': 0.6, 'actuator_speed': 15.0, 'gap_control_stops': 'independent'},
    ):
        rig = Rig(TRIAL, control=control('timed', **values))
        rig.advance(600.0)
        impacts = timed_impacts(rig, 900.0)
        assert len(impacts) > 80
        for event in impacts:
            # X' at the impact, over its maximum: cosine of the phase by which it is missed
            phase = math.atan2(event.x, event.primary_velocity_before)
            assert abs(math.cos(phase)) > 0.985


def passage(**values):
    return ZeroPassage(**{'time': 1.0, 'x_rate': -2.0, 'y': 4.0, 'y_rate': 6.0, **values})


@pytest.mark.parametrize(
    ('values', 'symmetric', 'independent'),
    [
        ({}, 1, 1),
        ({'x_rate': 2.0, 'y': -4.0, 'y_rate': -6.0}, 2, 2),
        # It would give energy to M: M runs away from the blow, or is thrown back too fast.
        ({'x_rate': 2.0}, 0, 0),
        ({'y_rate': 30.0}, 0, 0),
        ({'y_rate': 29.0}, 1, 1),
        # It moves inwards; symmetric stops do not cross the middle.
        ({'y': -1.0}, 0, 1),
        ({'y': 0.04}, 0, 1),
        ({'y': -6.0}, 0, 0),
        # It will have hit the parked stop.
        ({'y': 8.0}, 0, 0),
        # A feeble blow is worth waiting for a better one, if m can be anywhere.
        ({'y_rate': 0.9}, 1, 0),
        ({'y_rate': 1.1}, 1, 1),
    ],
)
def test_which_stop_is_closed(values, symmetric, independent):
    for stops, expected in (('symmetric', symmetric), ('independent', independent)):
        law = control('timed', gap_control_stops=stops, gap_min=0.1)
        p = settings_of(law, TRIAL)
        assert stop_to_close(p, passage(**values), 8.0, 10.0) == expected


def test_the_energy_condition_is_that_of_the_impact():
    """M's kinetic energy falls just as long as c |Y'| < 2 |X'|; against the momentum balance."""
    damper = damper_of(TRIAL)
    limit = 2.0 * 2.0 / damper.primary_jump
    for y_rate, falls in ((0.999 * limit, True), (1.001 * limit, False)):
        x_rate, z_rate = -2.0, y_rate - 2.0
        mu, restitution = 0.1, 0.5
        after = ((1 - mu * restitution) * x_rate + mu * (1 + restitution) * z_rate) / (1 + mu)
        assert (abs(after) < 2.0) == falls
        p = settings_of(control('timed'), TRIAL)
        assert (stop_to_close(p, passage(y_rate=y_rate), 8.0, 10.0) == 1) == falls


@pytest.mark.parametrize(
    ('y', 'y_rate', 'parks'), [(4.0, 9.9, 3), (4.0, 10.1, 2), (-4.0, -10.1, 1)]
)
def test_no_stop_is_parked_where_m_is_or_will_be(y, y_rate, parks):
    """Within a twentieth of a half-cycle, here 0.1 s, on either side."""
    begun = control_of(control('timed'), TRIAL)
    begun.timed_law.parked, begun.estimates.half_cycle = 5.0, 2.0
    before = begun.actuators.commanded_1, begun.actuators.commanded_2
    park_stops(begun, Measurement(0.0, 0.0, 0.0, y, y_rate, *before), True, True)
    stops = begun.actuators.commanded_1, begun.actuators.commanded_2
    assert stops == (5.0 if parks & 1 else before[0], -5.0 if parks & 2 else before[1])


@pytest.mark.parametrize(('half_cycle', 'target'), [(2.0, 4.0 - 0.1 * 2.0 * 6.0), (50.0, -7.5)])
def test_a_stop_is_sent_a_little_beyond_m(half_cycle, target):
    """As far as m moves in a tenth of a half-cycle; the gap stays above the least."""
    begun = control_of(control('timed', gap_min=0.5), TRIAL)
    begun.timed_law.parked, begun.estimates.half_cycle = 8.0, half_cycle
    begun.estimates.amplitude = 50.0
    assert close_stop(begun, passage(), Measurement(1.0, 0.0, -2.0, 4.0, 6.0, 8.0, -8.0), math.inf)
    assert begun.actuators.commanded_1 == pytest.approx(target)
    assert begun.timed_law.until == 1.0


def test_the_stop_that_has_done_its_work_is_parked_and_no_other():
    begun = control_of(control('timed'), TRIAL)
    begun.timed_law.parked, begun.timed_law.closed, begun.timed_law.until = 5.0, 1, 1.0
    begun.estimates.half_cycle = 2.0
    before = begun.actuators.commanded_2
    timed_law_sees(begun, Measurement(1.6, 0.0, 0.0, 0.0, 1.0, 2.0, before), 1.8)
    assert (begun.actuators.commanded_1, begun.actuators.commanded_2) == (5.0, before)
    assert begun.timed_law.closed == 0
