"""What the engine notes of the motion, and what is made of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from impact_damper_ros import (
    MotionKind,
    Period,
    Rhythm,
    Rig,
    RigParameters,
    find_orbits,
    load_parameters,
    transmissibility,
)
from impact_damper_ros.node.motion_report import (
    MotionMonitor,
    RecentMotion,
    compare,
    measured_report,
    predicted_report,
    recent_motion,
)
from impact_damper_ros.node.motion_trace import KEPT, MotionTrace
from impact_damper_ros.orbits.orbit import AT_IMPACTS
from impact_damper_ros.theory.prediction import Prediction
from impact_damper_ros.theory.theory_thread import TheoryThread

INCLINED = RigParameters(angle=math.pi / 4, friction=0.5, gravity=1.0, force_frequencies=1.02)
ORBIT = find_orbits(INCLINED, (1, 2)).orbits[0]
CYCLE = math.tau / 1.02
RATE = 10.0
TRANSMISSIBILITIES = (
    'Transmissibility, rms X / rms b',
    'Relative transmissibility, rms (X - b) / rms b',
)


def traced(rig, cycles, trace=None, rate=RATE):
    """Let a rig run for some cycles as the engine does."""
    trace = trace or MotionTrace.at(rig.parameters, rig.snapshot())
    began = rig.time
    for k in range(1, int(cycles * CYCLE * rate) + 1):
        events = rig.advance(began + k / rate)
        if events:
            trace = trace.after(events)
        trace.sample(rig.sample())
    return trace


def test_a_settled_rig_is_measured_as_the_theory_has_it():
    measured = recent_motion(traced(Rig(INCLINED), 250), RATE)
    assert (measured.kind, measured.settled) == (MotionKind.PERIODIC, True)
    assert measured.impacts_per_cycle == 2.0
    assert measured.cycles == pytest.approx(250, abs=0.1)
    rhythm = measured.rhythm
    assert (rhythm.stops, rhythm.cycles) == ((1, 2), 1)
    assert rhythm.phases == pytest.approx(ORBIT.phases, abs=1e-6)
    assert rhythm.x == pytest.approx(ORBIT.x, rel=1e-5)
    assert measured.x_max == pytest.approx(ORBIT.x_max, rel=1e-5)
    assert measured.x_max_ratio == pytest.approx(0.2113439, rel=1e-5)


#: INCLINED with the same force from a moving base.
ON_TABLE = INCLINED.replace(
    force_amplitudes=0.0,
    base_amplitudes=1.0 / math.hypot(1.0, 0.01 * 1.02),
    base_frequencies=1.02,
    base_quantity='displacement',
)


def test_transmissibility_of_the_last_cycles():
    """Whole cycles of 61.6 samples, so that a part of a sample is left out of each."""
    orbit = next(o for o in find_orbits(ON_TABLE, (1, 2)).orbits if o.viable and o.stable)
    expected = transmissibility(orbit)
    # Seven cycles after a change, which begin anew
    rig = Rig(ON_TABLE.replace(gap=30.0))
    traced(rig, 7.3)
    rig.change(ON_TABLE)
    measured = recent_motion(traced(rig, 250), RATE)
    assert measured.transmissibility[:2] == pytest.approx(expected[:2], rel=3e-3)
    values = measured_report(measured).values
    shown = [values[name] for name in TRANSMISSIBILITIES]
    assert list(map(float, shown)) == pytest.approx(measured.transmissibility[:2], rel=1e-4)
    theory = TheoryThread()
    agreement = compare(measured, Prediction((orbit,), complete=True))
    values = predicted_report(theory, agreement).values
    shown = [float(values[name]) for name in TRANSMISSIBILITIES]
    assert shown == pytest.approx(expected[:2], rel=1e-4)
    # Too few samples in a cycle, or a base at rest
    few = recent_motion(traced(Rig(ON_TABLE), 50, rate=0.5), 0.5)
    assert math.isnan(few.transmissibility.absolute)
    values = measured_report(recent_motion(traced(Rig(INCLINED), 50), RATE)).values
    assert {values[name] for name in TRANSMISSIBILITIES} == {''}


def test_phases_go_on_where_the_frequency_changes():
    rig = Rig(INCLINED.replace(force_frequencies=1.2, angle=0.3))
    traced(rig, 7.3)
    rig.change(INCLINED)
    measured = recent_motion(traced(rig, 250), RATE)
    assert measured.rhythm.phases == pytest.approx(ORBIT.phases, abs=1e-6)
    rig.reset()
    measured = recent_motion(traced(rig, 250), RATE)
    assert measured.rhythm.phases == pytest.approx(ORBIT.phases, abs=1e-6)


def test_at_each_step_of_a_sweep_the_measurement_begins_anew_with_the_phase_of_the_force():
    sweep = INCLINED.replace(
        sweep_mode='up', sweep_low=1.01, sweep_high=1.02, sweep_step=0.01, sweep_dwell=40.0
    )
    rig = Rig(sweep)
    trace = traced(rig, 3)
    assert trace.frequency == 1.01
    trace = traced(rig, 300, trace)
    assert (trace.frequency, trace.began) == (1.02, 40.0)
    measured = recent_motion(trace, RATE)
    assert measured.rhythm.phases == pytest.approx(ORBIT.phases, abs=1e-6)
    assert measured.x_max_ratio == pytest.approx(0.2113439, rel=1e-5)


def test_states_on_the_way():
    rig = Rig(INCLINED)
    trace = MotionTrace.at(INCLINED, rig.snapshot())
    assert recent_motion(trace, RATE).kind is MotionKind.UNDECIDED
    measured = recent_motion(traced(rig, 3, trace), RATE)
    assert (measured.kind, measured.rhythm) == (MotionKind.UNDECIDED, None)
    assert measured_report(measured).values['Reason'].endswith('3 cycles after the last change')
    measured = recent_motion(traced(rig, 90, trace), RATE)
    assert measured.kind is MotionKind.TRANSIENT
    assert measured.rhythm.stops == (1, 2)
    assert not measured.settled


def test_a_rig_that_hits_nothing_or_nothing_regular_or_has_no_cycles():
    wide = Rig(RigParameters(gravity=0.0, gap=600.0))
    measured = recent_motion(traced(wide, 30), RATE)
    assert (measured.kind, measured.impacts_per_cycle) == (MotionKind.NO_IMPACTS, 0.0)
    assert measured.x_max > 50.0
    assert measured.without == pytest.approx(30.0 / 1.02, abs=0.1)
    report = measured_report(measured)
    assert report.message == (
        'm has not hit a stop for 29 cycles of the force: the gap, 600 m, is wider than M moves '
        'from end to end: m is not hit from rest; give a narrower gap, or more force'
    )
    assert report.warning
    assert report.message.endswith(report.values['Reason'])
    chaotic = Rig(INCLINED.replace(gap=60.0))
    measured = recent_motion(traced(chaotic, 260), RATE)
    assert (measured.kind, measured.rhythm) == (MotionKind.UNDECIDED, None)
    assert 0.5 < measured.impacts_per_cycle < 4.0
    constant = Rig(RigParameters(force_frequencies=0.0))
    assert recent_motion(traced(constant, 3), RATE).kind is MotionKind.NOT_PERIODICALLY_DRIVEN
    broadband = Rig(INCLINED.replace(multisine_level=1.0))
    measured = recent_motion(traced(broadband, 30), RATE)
    assert (measured.kind, measured.rhythm) == (MotionKind.NOT_PERIODICALLY_DRIVEN, None)
    assert measured.x_max > 0.1


def test_chaos_is_never_settled_nor_settling():
    """The tilted bench rig, from the first cycle on."""
    tilted = load_parameters('bench_rig')[0].replace(angle=0.2)
    rig = Rig(tilted)
    trace = MotionTrace.at(tilted, rig.snapshot())
    rate = 8.0 * 31.416 / math.tau
    for k in range(1, 2401):
        trace = trace.after(rig.advance(k / rate))
        trace.sample(rig.sample())
        if k % 8 == 0:
            measured = recent_motion(trace, rate)
            assert measured.kind is MotionKind.UNDECIDED
            words = measured_report(measured)
            assert words.values['Reason']
            assert 'settl' not in words.message


def test_impacts_that_stop_are_no_rhythm():
    rig = Rig(INCLINED)
    trace = traced(rig, 200)
    assert recent_motion(trace, RATE).rhythm is not None
    still = rig.sample()
    for k in range(int(30 * CYCLE * RATE)):
        trace.sample(still._replace(time=still.time + k / RATE, primary_velocity=0.0))
    measured = recent_motion(trace, RATE)
    assert measured.kind is MotionKind.NO_IMPACTS
    assert 29.0 < measured.without < 32.0


def test_too_few_samples_tell_no_largest_displacement():
    measured = recent_motion(traced(Rig(INCLINED), 250, rate=0.7), 0.7)
    assert measured.rhythm.phases == pytest.approx(ORBIT.phases, abs=1e-6)
    assert (measured.x_max, measured.x_max_ratio) == (None, None)
    values = measured_report(measured).values
    assert (values['Largest X [m]'], values['Largest X / A']) == ('', '')


def test_the_trace_does_not_grow():
    trace = traced(Rig(INCLINED), 800)
    assert len(trace.impacts()) == KEPT
    assert len(trace._turns) == KEPT


def like(rhythm, x_max_ratio, multiplier):
    """Return a predicted motion with other impacts."""
    return replace(
        ORBIT,
        **{name: getattr(rhythm, name) for name in ('stops', 'cycles', 'phases', 'x')},
        x_max=x_max_ratio * ORBIT.parameters.response_amplitude,
        multipliers=(complex(multiplier),),
        **{name: len(rhythm.stops) * (0.0,) for name in AT_IMPACTS if name != 'x'},
    )


OTHER = like(Rhythm((1, 2), 1, (0.6, 0.1), (1.0, -1.0), 2.0), 0.1, 1.2)
ANSWER = Prediction((ORBIT, OTHER), ORBIT, 'run ahead', '', True)
MEASURED = RecentMotion(MotionKind.PERIODIC, 200.0, 2.0, ORBIT, x_max=ORBIT.x_max)


def shifted(phase=0.0, x=0.0, drift=0.0):
    """Return the measured motion, somewhat off, and counted from the other impact."""
    rhythm = Rhythm(
        (2, 1),
        1,
        tuple(p + phase for p in reversed(ORBIT.phases)),
        tuple(v + x * ORBIT.x_max for v in reversed(ORBIT.x)),
        ORBIT.x_max,
    )
    period = Period(1, 2, np.array([drift]), 1e-4, 0.0)
    return RecentMotion(MotionKind.PERIODIC, 200.0, 2.0, rhythm, period, x_max=ORBIT.x_max)


@pytest.mark.parametrize(
    ('measured', 'verdict'),
    [
        (shifted(), 'agrees'),
        (shifted(phase=9e-4), 'agrees'),
        (shifted(phase=2e-3), 'disagrees'),
        (shifted(x=2e-3), 'disagrees'),
        # Still so far to go at the rate of the largest multiplier, 0.94
        (shifted(phase=2e-3, drift=8e-5), 'agrees'),
    ],
)
def test_the_agreement_allows_for_what_is_left_of_the_transient(measured, verdict):
    agreement = compare(measured, ANSWER)
    assert agreement.verdict == verdict
    assert agreement.basis == 'measured'
    assert agreement.motion.stops == (2, 1)
    assert agreement.phase == pytest.approx(measured.rhythm.phases[0] - ORBIT.phases[1], abs=1e-12)


def test_the_motion_of_the_same_kind_that_is_nearest_is_chosen():
    rhythm = Rhythm((1, 2), 1, (0.601, 0.101), (1.0, -1.0), 2.0)
    agreement = compare(RecentMotion(MotionKind.PERIODIC, rhythm=rhythm), ANSWER)
    assert agreement.motion.multipliers == (1.2,)
    kind = Rhythm((1, 1, 2), 1, (0.1, 0.2, 0.3), (1.0, 1.0, 1.0), 2.0)
    agreement = compare(RecentMotion(MotionKind.PERIODIC, rhythm=kind), ANSWER)
    assert (agreement.verdict, agreement.motion) == ('disagrees', ORBIT)


def reported(measured=MEASURED, answer=ANSWER, **status):
    theory = TheoryThread()
    theory.prediction = answer
    for name, value in status.items():
        setattr(theory, name, value)
    return predicted_report(theory, compare(measured, answer or Prediction()))


UNDECIDED = RecentMotion(MotionKind.UNDECIDED)
CONTROLLED = Prediction(reason='gap_control is timed', complete=True, applies=False)
APERIODIC = Prediction(reason='two incommensurate harmonics', complete=True)
UNSTABLE = Prediction((OTHER,), OTHER, 'listed', 'it does not repeat', True)


@pytest.mark.parametrize(
    ('measured', 'answer', 'status', 'state', 'warning', 'words'),
    [
        (MEASURED, ANSWER, {}, 'found', False, 'stable; the measured motion agrees'),
        (shifted(phase=0.01), ANSWER, {}, 'found', True, 'the measured motion disagrees'),
        (RecentMotion(MotionKind.TRANSIENT), ANSWER, {}, 'found', False, '2 impacts in 1 cycle'),
        (MEASURED, None, {}, 'computing', False, 'computing'),
        (MEASURED, None, {'enabled': False}, 'off', False, 'predict_motion'),
        (MEASURED, Prediction(error='no memory'), {}, 'unavailable', True, 'no memory'),
        (UNDECIDED, UNSTABLE, {}, 'found', True, 'unstable; it does not repeat'),
        (UNDECIDED, APERIODIC, {}, 'none', False, 'two incommensurate harmonics'),
        (MEASURED, Prediction(complete=True), {}, 'none', True, 'theory finds no such motion'),
        (MEASURED, CONTROLLED, {}, 'none', False, 'gap_control is timed'),
    ],
)
def test_what_is_reported_and_when(measured, answer, status, state, warning, words):
    report = reported(measured, answer, **status)
    assert (report.values['State'], report.warning) == (state, warning)
    assert words in report.message


def test_the_keys_are_the_same_whatever_is_known():
    full = reported()
    for other in (reported(answer=None), reported(RecentMotion(MotionKind.TRANSIENT))):
        assert list(other.values) == list(full.values)
    full = measured_report(MEASURED)
    for kind in (MotionKind.TRANSIENT, MotionKind.NOT_PERIODICALLY_DRIVEN):
        assert list(measured_report(RecentMotion(kind)).values) == list(full.values)


def test_values_are_written_for_machines():
    rhythm = Rhythm((1, 2), 1, ORBIT.phases, ORBIT.x, ORBIT.x_max)
    values = measured_report(RecentMotion(MotionKind.PERIODIC, rhythm=rhythm)).values
    assert values['Stop sequence'] == '[1, 2]'
    assert values['Phases [cycles of the force]'] == '[0.757995034, 0.269792326]'
    assert (values['Impacts per period'], values['State']) == (2, 'periodic')


def test_a_measured_motion_that_theory_did_not_name_is_asked_for_once():
    theory = TheoryThread()
    trace = traced(Rig(INCLINED), 250)
    asked = []
    theory.ask_like = asked.append
    theory.prediction = Prediction((OTHER,), OTHER, 'listed', complete=True)
    monitor = MotionMonitor(lambda: trace, theory, RATE)
    for _ in range(3):
        measured, predicted = monitor.look()
        assert (measured.task, predicted.task) == ('measured motion', 'predicted motion')
    (motion,) = asked
    assert motion.rhythm.distance(ORBIT) < 1e-5
    theory.rigs_requested += 1
    monitor.look()
    assert len(asked) == 2
