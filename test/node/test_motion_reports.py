"""Measured and predicted motion: of a rig by itself, and over DDS in diagnostics and theory."""

import json
import math

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rigs import FRICTION, OFF_RESONANCE, VERTICAL
from std_msgs.msg import String

from impact_damper_ros import Rig, find_orbits, run_flights
from impact_damper_ros.node.motion_report import (
    SETTLED_DRIFT,
    TOLERANCE,
    X_MAX_TOLERANCE,
    recent_motion,
)
from impact_damper_ros.node.motion_trace import MotionTrace
from impact_damper_ros.orbits.recurrence import MotionKind
from node.rig_client import LATCHED

#: The golden inclined rig.
INCLINED = {
    'angle': math.pi / 4,
    'friction': 0.5,
    'gravity': 1.0,
    'force_frequencies': '[1.02]',
    # A period takes 6 ms.
    'real_time_factor': 1000.0,
    'state_rate': 1.0,
}
TASKS = 'measured motion', 'predicted motion'


WIDE = OFF_RESONANCE.replace(gap=1000.0)
SHAKEN = WIDE.replace(base_amplitudes=0.3, base_frequencies=1.02, base_quantity='displacement')
BROAD = FRICTION.replace(stiffness=4.0, multisine_level=0.5, multisine_low=0.5, multisine_high=2.0)
#: Rig, cycles of the force, samples in each; what its motion is, in how many last cycles it is
#: measured, and whether |X| is known.
RECENT = {
    'periodic': (FRICTION, 400, 40, MotionKind.PERIODIC, 1, True),
    'settling': (FRICTION, 80, 40, MotionKind.TRANSIENT, 1, True),
    'chaotic': (OFF_RESONANCE.replace(gap=50.0), 300, 40, MotionKind.UNDECIDED, 20, True),
    'not yet': (SHAKEN, 15, 40, MotionKind.UNDECIDED, 15, True),
    'no impacts': (WIDE, 60, 40, MotionKind.NO_IMPACTS, 20, True),
    'rarely sampled': (FRICTION, 400, 5, MotionKind.PERIODIC, 1, False),
    'random': (BROAD, 100, 40, MotionKind.NOT_PERIODICALLY_DRIVEN, 20, True),
}


@pytest.mark.parametrize('name', RECENT)
def test_recent_motion(name):
    parameters, cycles, samples, kind, last, sampled = RECENT[name]
    cycle = math.tau / (parameters.omega if name == 'random' else parameters.force_frequencies[0])
    rig = Rig(parameters)
    trace = MotionTrace.at(parameters, rig.snapshot())
    for k in range(1, cycles * samples + 1):
        trace = trace.after(rig.advance(k * cycle / samples))
        trace.sample(rig.sample())
    found = recent_motion(trace, samples / cycle)
    assert found.kind is kind
    part = run_flights(Rig(parameters), rig.time).cut(rig.time - last * cycle, rig.time)
    largest = part.integrals()[1]
    assert found.x_max == (pytest.approx(largest, rel=1e-3) if sampled else None)
    if name == 'random':
        return
    assert found.cycles == pytest.approx(cycles)
    assert found.impacts_per_cycle == pytest.approx(len(part.impacts) / last)
    assert found.too_wide == (parameters.gap if 2.0 * largest < parameters.gap else 0.0)
    assert (found.rhythm is not None) is (last == 1)
    if parameters.gap == 1000.0:
        assert found.without == pytest.approx(cycles)
    if parameters == SHAKEN:
        # Of whole cycles from the second one on
        end = int(trace.cycles(rig.time)) * cycle
        whole = run_flights(Rig(parameters), rig.time).cut(cycle, end).integrals()[0]
        assert found.transmissibility[:2] == pytest.approx(whole.transmissibility[:2], rel=5e-3)


def motions(rig, holds):
    """Wait for a report on both motions for whose values something holds, and return it."""
    return rig.await_report(*TASKS, holds=lambda *both: holds(*(r.values for r in both)))


def agreeing(orbit, ratio):
    """Return a condition: theory has this motion, and the measured one agrees with it."""

    def condition(_, predicted):
        known = ratio()
        return predicted['Agreement'] == 'agrees' and known == pytest.approx(orbit.x_max_ratio)

    return condition


def check(reports, orbit):
    """Compare the reported motions with a motion of the theory."""
    measured, predicted = (report.values for report in reports)
    assert reports[1].level == DiagnosticStatus.OK
    # How near a measured motion is, that counts as settled, depends on how slowly it settles.
    near = float(predicted['Tolerance'])
    largest = abs(orbit.multipliers[0])
    assert near <= TOLERANCE + SETTLED_DRIFT / (1.0 - largest)
    for key, value, error in (
        ('Phases [cycles of the force]', orbit.phases, near),
        ('X at the impacts [m]', orbit.x, near * orbit.x_max),
    ):
        assert json.loads(measured[key]) == pytest.approx(value, abs=error)
    within = X_MAX_TOLERANCE - TOLERANCE + near
    assert measured['Stop sequence'] == '[1, 2]'
    assert measured['Impacts per period'] == '2'
    assert measured['Period [cycles of the force]'] == '1'
    assert float(measured['Largest X / A']) == pytest.approx(orbit.x_max_ratio, rel=within)
    assert (measured['State'], measured['Settled']) == ('periodic', 'True')
    assert (predicted['State'], predicted['Agreement']) == ('found', 'agrees')


def test_measured_and_predicted_motion_agree_before_and_after_a_change(start):
    rig = start(**INCLINED, predict_motion=True, record=True)
    texts = rig.listen(String, 'theory', LATCHED)

    def document():
        """Return the ratio of the last document; that of the rig before does not stay."""
        orbit = json.loads(texts[-1].data)['orbit'] if texts else None
        return orbit and orbit['x_max_ratio']

    orbit = find_orbits(FRICTION, (1, 2)).orbits[0]
    assert orbit.x_max_ratio == pytest.approx(0.2113439, abs=5e-8)
    check(motions(rig, agreeing(orbit, document)), orbit)
    assert rig.parameters.set(gap=30) == ''
    orbit = find_orbits(FRICTION.replace(gap=30.0), (1, 2)).orbits[0]
    check(motions(rig, agreeing(orbit, document)), orbit)
    assert document() == pytest.approx(orbit.x_max_ratio, abs=1e-9)
    # A second harmonic repeats after three cycles of the first, and begins as it is added.
    both = {'force_amplitudes': [1.0, 0.1], 'force_phases': [0.0, 0.0]}
    rig.change(force_frequencies=[1.02, 1.7], **both)
    period = 'Period [cycles of the force]'
    motions(rig, lambda m, p: (p['Agreement'], m[period]) == ('agrees', '3'))
    # Without a common period there is no periodic motion, and that is no fault.
    rig.change(force_frequencies=[1.02, 1.7171])
    _, report = motions(rig, lambda _, p: p['State'] == 'none')
    assert 'needs a whole number' in report.values['Reason']
    assert report.level == DiagnosticStatus.OK
    rig.change(predict_motion=False)
    rig.until(lambda: 'predict_motion is false' in texts[-1].data)
    rig.stop()


def test_a_gap_that_m_never_crosses_is_reported(rig):
    """Of 5 m for a rig that moves by centimetres: metres for millimetres."""
    rig.change(gap=5.0, real_time_factor=4.0)
    rig.reset()
    words = 'm has not hit a stop for '
    found = rig.await_report('measured motion', holds=lambda r: r.message.startswith(words))
    assert found.level == DiagnosticStatus.WARN
    reason = 'the gap, 5 m, is wider than M moves from end to end'
    assert found.values['Reason'].startswith(reason)


def test_predictions_on_request(start):
    """Of one impact in three cycles."""
    ball = VERTICAL.replace(force_amplitudes=1.48507)
    orbit = find_orbits(ball, (1,), 3).orbits[0]
    rig = start(
        **INCLINED
        | {
            'damper_mass': ball.damper_mass,
            'damping': ball.damping,
            'angle': ball.angle,
            'friction': 0.0,
            'one_sided': True,
            'force_amplitudes': '[1.48507]',
            'force_frequencies': '[10.0]',
            'force_phases': f'[{math.tau * orbit.phases[0]}]',
            'initial_primary_position': orbit.x[0],
            'initial_primary_velocity': orbit.primary_velocity_after[0],
            'initial_damper_offset': 0.5 * ball.gap,
            'initial_damper_velocity': orbit.damper_velocity_after[0],
            'real_time_factor': 100.0,
        }
    )
    _, predicted = motions(rig, lambda m, _: m['State'] == 'periodic')
    assert predicted.values['State'] == 'off'
    rig.change(predict_motion=True)
    measured, _ = motions(rig, lambda _, p: p['Agreement'] == 'agrees')
    assert measured.values['Stop sequence'] == '[1]'
    assert measured.values['Period [cycles of the force]'] == '3'
