"""Orders of a controller outside the rig: stops by the actuators, and a constant force on M."""

import math

import pytest

from impact_damper_ros import (
    Action,
    EventKind,
    GapControlParameters,
    Order,
    ParameterError,
    Rig,
    RigParameters,
)

FREE = RigParameters(gravity=0.0, gap=1000.0, force_amplitudes=(0.0,))
EXTERNAL = GapControlParameters(
    gap_control='external', actuator_delay=0.25, actuator_speed=4.0, actuator_mass=0.5
)


def displacement(rig, time, force):
    """Return X of M that starts at rest under a constant force."""
    K, zeta, omega = rig.stiffness, rig.zeta, rig.omega
    eta = math.sqrt(1.0 - zeta * zeta)
    phase = eta * omega * time
    decay = math.exp(-zeta * omega * time)
    return force / K * (1.0 - decay * (math.cos(phase) + zeta / eta * math.sin(phase)))


def test_a_force_on_m_shifts_its_equilibrium():
    rig = Rig(FREE, control=EXTERNAL)
    rig.advance(1.0)
    (step,) = rig.order(Order(force=3.0))
    assert (step.time, step.kind, step.impulse) == (1.0, EventKind.FORCE_STEP, 3.0)
    rig.advance(8.5)
    assert rig.sample().x == pytest.approx(displacement(FREE, 7.5, 3.0), rel=1e-13)
    # A hold after a hold is the sum of two steps
    rig.order(Order(force=-1.0))
    rig.advance(20.0)
    expected = displacement(FREE, 19.0, 3.0) + displacement(FREE, 11.5, -4.0)
    assert rig.sample().x == pytest.approx(expected, rel=1e-12)
    assert rig.force == -1.0
    (record,) = [r for r in rig.acts if r.action is Action.ORDER] or [None]
    assert record is None
    # It ends with the external control.
    rig.change(FREE, GapControlParameters())
    assert rig.force == 0.0


def test_a_force_moves_m_that_friction_held():
    parameters = FREE.replace(gravity=1.0, friction=0.5)
    rig = Rig(parameters, control=EXTERNAL)
    rig.advance(1.0)
    # It takes both masses along while a < friction g, here a = F/(M + m).
    limit = 0.5 * (parameters.primary_mass + parameters.damper_mass)
    assert [event.kind for event in rig.order(Order(force=0.99 * limit))] == [EventKind.FORCE_STEP]
    rig.order(Order(force=0.0))
    kinds = [event.kind for event in rig.order(Order(force=1.01 * limit))]
    assert kinds == [EventKind.FORCE_STEP, EventKind.RELEASE]
    rig.advance(1.0 + 1e-3)
    sample = rig.sample()
    # m lags behind at the acceleration that friction gives it, M has the rest of the force.
    m, M = parameters.damper_mass, parameters.primary_mass
    assert sample.damper_velocity == pytest.approx(0.5e-3, rel=1e-5)
    assert sample.primary_velocity == pytest.approx((1.01 * limit - 0.5 * m) / M * 1e-3, rel=1e-5)


def test_stops_go_by_the_actuators():
    rig = Rig(FREE, control=EXTERNAL)
    rig.advance(1.0)
    rig.order(Order(stop_1=300.0, speed_1=2.0))
    (record,) = rig.acts
    assert record[:4] == (1.0, Action.ORDER, 300.0, pytest.approx(math.nan, nan_ok=True))
    assert (record.velocity_1, record.force) == (2.0, pytest.approx(math.nan, nan_ok=True))
    rig.advance(2.25)
    # After the delay, at the speed asked for: a quarter of the energy of full speed
    assert rig.stops == (498.0, -500.0)
    assert rig.energies == (0.25 * 0.5 * 0.5 * 4.0**2, 0.0)
    # No faster than the actuators are
    rig.order(Order(stop_1=400.0, stop_2=-490.0, speed_1=100.0, speed_2=1.0))
    rig.advance(3.5)
    assert rig.stops == (497.5 - 4.0, -499.0)
    events = rig.advance(30.0)
    (arrival,) = [e for e in events if e.kind is EventKind.STOP_ARRIVED and e.stop == 2]
    assert arrival.time == pytest.approx(12.5)
    assert [r.action for r in rig.acts].count(Action.ARRIVED) == len(events)


@pytest.mark.parametrize(
    ('order', 'places'),
    [
        (Order(stop_1=490.0, speed_1=2.0), (496.0, -500.0)),
        (Order(stop_2=-490.0, speed_2=2.0), (500.0, -496.0)),
        (Order(stop_1=490.0, stop_2=-490.0, speed_2=2.0), (492.0, -496.0)),
        (Order(stop_1=490.0, stop_2=-490.0, speed_1=2.0), (496.0, -492.0)),
    ],
)
def test_each_stop_has_its_own_speed(order, places):
    rig = Rig(FREE, control=EXTERNAL.replace(actuator_delay=0.0))
    rig.order(order)
    rig.advance(2.0)
    assert rig.stops == pytest.approx(places)


@pytest.mark.parametrize('limit', [0.0, 5.0])
def test_a_speed_of_its_own_is_paid_for(limit):
    """Also where stops move at once without one: half the moving mass times its square."""
    control = EXTERNAL.replace(actuator_speed=limit, actuator_delay=0.0)
    rig = Rig(FREE, control=control)
    rig.order(Order(stop_1=400.0, speed_1=2.0))
    rig.advance(10.0)
    assert rig.energies == (0.5 * 0.5 * 2.0**2, 0.0)


@pytest.mark.parametrize(
    ('order', 'beyond', 'name'),
    [
        (Order(speed_1=1e-6), Order(speed_1=0.9e-6), 'speed_1'),
        (Order(speed_2=1e9), Order(speed_2=1.1e9), 'speed_2'),
        (Order(force=1e12), Order(force=1.1e12), 'force'),
        (Order(force=-1e12), Order(force=-1.1e12), 'force'),
        (Order(stop_1=1000.0), Order(stop_1=1000.1), 'stop_1'),
        (Order(stop_2=-1000.0), Order(stop_2=-1000.1), 'stop_2'),
        (Order(stop_1=2.0, stop_2=0.0), Order(stop_1=1.9, stop_2=0.0), 'stop_1'),
    ],
)
def test_the_ends_of_ranges_are_allowed(order, beyond, name):
    """Those of places are half of gap_max, and gap_min from stop to stop."""
    rig = Rig(FREE, control=EXTERNAL.replace(gap_min=2.0, gap_max=2000.0))
    rig.order(order)
    assert order.stops is name.startswith('stop')
    with pytest.raises(ParameterError, match=f'^{name}'):
        rig.order(beyond)
