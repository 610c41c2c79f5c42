"""The rig under control: commands, switching, snapshots, and the state of the controller."""

import itertools
import json

import pytest

from control.controlled_rigs import TRIAL, control
from impact_damper_ros import (
    Action,
    EventKind,
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
)
from impact_damper_ros.control.controller import begin_sampling, control_of, rest_stops
from impact_damper_ros.control.state import LAW_NUMBERS, PARTS, damper_of
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS


@pytest.mark.parametrize(('time', 'rate'), [(0.0, 32.0), (10.0, 32.0), (9.99, 0.5), (1e6, 7.0)])
def test_the_first_sample_comes_after_the_present_time(time, rate):
    begun = control_of(control('timed', gap_control_rate=rate), RigParameters())
    begin_sampling(begun, time)
    index = begun.controller.sample_index
    assert (index - 1) / rate <= time < index / rate


def test_rigs_restored_from_one_snapshot_do_not_share_it():
    """Neither with one another nor with the snapshot, which can be read again."""
    law = control('timed', actuator_delay=0.1, actuator_speed=30.0)
    rig = Rig(TRIAL, InitialConditions(initial_primary_position=1.0), control=law)
    rig.advance(20.0)
    snapshot = rig.snapshot()
    kept = json.dumps(snapshot)
    first = Rig.restore(snapshot)
    expected = first.advance(60.0)
    assert {EventKind.CROSSING, EventKind.STOP_ARRIVED} <= {event.kind for event in expected}
    assert json.dumps(snapshot) == kept
    assert Rig.restore(snapshot).advance(60.0) == expected


def test_snapshot_of_a_plain_simulator_means_off():
    plain = Rig(TRIAL)
    plain.advance(50.0)
    rig = Rig.restore(plain.snapshot())
    assert rig.control == GapControlParameters()
    assert rig.advance(80.0) == plain.advance(80.0)


def test_off_sends_the_stops_back_by_the_actuators():
    rig = Rig(TRIAL, control=control('timed', actuator_speed=2.0, actuator_delay=0.5))
    rig.advance(200.0)
    before = rig.stops
    assert before != (10.0, -10.0)
    rig.change(rig.parameters, control('off', actuator_speed=2.0, actuator_delay=0.5))
    rig.advance(200.4999)
    assert rig.amplitude > 0.0
    assert (10.0, -10.0) not in {(r.target_1, r.target_2) for r in rig.acts}
    rig.advance(200.5)
    assert rig.acts[-1].action is Action.COMMAND
    assert rig.acts[-1][2:4] == (10.0, -10.0)
    rig.advance(400.0)
    assert rig.stops == (10.0, -10.0)
    # Nothing is left to do or known: from now on it is the plain simulator.
    state = rig.snapshot()['gap_control']['state']
    fresh = Rig(TRIAL).snapshot()['gap_control']['state']
    assert state == {**fresh, 'actuators': state['actuators']}
    plain = Rig.restore({k: v for k, v in rig.snapshot().items() if k != 'gap_control'})
    assert rig.advance(450.0) == plain.advance(450.0)


def test_another_gap_under_control():
    rig = Rig(TRIAL, control=control('timed', actuator_delay=0.3))
    rig.advance(100.0)
    rig.change(rig.parameters.replace(gap=36.0))
    assert rig.stops == (18.0, -18.0)
    assert rig.snapshot()['gap_control']['state']['actuators']['waiting'] == []
    rig.advance(120.0)
    assert rig.stops != (18.0, -18.0)
    # Other parameters leave the stops alone.
    stops = rig.stops
    rig.change(rig.parameters.replace(friction=0.01))
    assert rig.stops == stops
    rig.change(rig.parameters, control('off'))
    rig.advance(rig.time + 1.0)
    assert rig.stops == (18.0, -18.0)


def test_the_gap_below_the_threshold():
    quiet = TRIAL.replace(force_amplitudes=[0.002])
    rig = Rig(quiet, control=control('timed', gap_control_threshold=1.0))
    rig.advance(200.0)
    assert rig.stops == (10.0, -10.0)
    rig.change(TRIAL)
    rig.advance(300.0)
    assert rig.amplitude > 1.0
    assert rig.stops != (10.0, -10.0)
    rig.change(quiet)
    rig.advance(900.0)
    assert rig.amplitude < 1.0
    assert rig.stops == (10.0, -10.0)


def test_one_sided_rigs_move_their_only_stop():
    parameters = RigParameters(
        one_sided=True, gap=4.0, gravity=0.3, angle=1.0, damper_mass=0.1, force_amplitudes=[0.2]
    )
    for mode in ('amplitude', 'timed'):
        rig = Rig(parameters, control=control(mode, actuator_speed=16.0))
        events = rig.advance(300.0)
        assert {e.stop for e in events if e.kind is EventKind.IMPACT} == {1}
        assert rig.stops[0] != 2.0
        # The other one spends nothing, and is shown where it would stand.
        assert rig.energies[0] > rig.energies[1] == 0.0
        assert {(r.target_2, r.velocity_2) for r in rig.acts} == {(-2.0, 0.0)}


def test_the_only_stop_returns_to_the_gap():
    """Below the threshold, and where the control is switched off."""
    parameters = RigParameters(
        one_sided=True, gap=4.0, gravity=0.3, angle=1.0, damper_mass=0.1, force_amplitudes=[0.2]
    )
    begun = control_of(control('timed'), parameters)
    begun.actuators.commanded_1 = 5.0
    rest_stops(begun, 1.0)
    assert (begun.actuators.commanded_1, begun.controller.returning) == (2.0, True)
    rig = Rig(parameters, control=control('timed', actuator_speed=0.5))
    rig.advance(100.0)
    assert rig.stops[0] != 2.0
    rig.change(parameters, control('off', actuator_speed=0.5))
    assert rig.snapshot()['gap_control']['state']['returning']
    rig.advance(150.0)
    assert rig.stops[0] == 2.0


def test_a_law_of_ones_own_may_send_the_only_stop_anywhere():
    rig = Rig(TRIAL.replace(one_sided=True), law=lambda _seen, _memory: (-5.0, 5.0))
    rig.advance(60.0)
    assert rig.stops[0] < -4.0


def test_a_law_switched_on_in_steady_motion_does_not_close_the_gap_first():
    """The estimate begins with the first half cycle: it grew from 0, and the gap with it."""
    steady = TRIAL.replace(gap=200.0)
    start = InitialConditions(initial_primary_position=-TRIAL.response_amplitude)
    rig = Rig(steady, start)
    rig.advance(10.0)
    rig.change(steady, control('amplitude', gap_control_stops='symmetric'))
    rig.advance(18.0)
    first = next(record for record in rig.acts if record.action is Action.COMMAND)
    assert first.amplitude == pytest.approx(50.0, rel=0.01)
    best = damper_of(TRIAL).optimal_gap(50.0, 1e3)
    assert first.target_1 - first.target_2 == pytest.approx(0.8 * best, rel=0.01)


def test_the_detector_triggers_at_every_passage_and_only_there():
    rig = Rig(TRIAL, control=control('timed'))
    events = rig.advance(300.0)
    crossings = [e for e in events if e.kind is EventKind.CROSSING]
    triggers = [r for r in rig.acts if r.action is Action.CROSSING]
    assert [r.time for r in triggers] == sorted({r.time for r in triggers})
    # Some may be told twice, where the stop moved at that instant.
    assert {r.time for r in triggers} <= {e.time for e in crossings}
    spacing = [b.time - a.time for a, b in itertools.pairwise(triggers[10:])]
    assert min(spacing) > 2.0
    assert max(abs(e.x) for e in crossings) < 1e-10


def start():
    return control_of(GapControlParameters(), RigParameters(gap=4.0))


def test_the_controller_has_every_law_that_the_parameter_names():
    assert tuple(LAW_NUMBERS) == GAP_CONTROL_SPECS['gap_control'].choices
    assert LAW_NUMBERS['off'] == 0
    assert set(PARTS) <= set(start().states())
