"""Measured and predicted motion on /diagnostics, over DDS."""

import json
import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rigs import VERTICAL
from running import alive, until

from impact_damper_ros import RigParameters, find_orbits
from impact_damper_ros.node.motion_report import SETTLED_DRIFT, TOLERANCE, X_MAX_TOLERANCE
from node.rig_client import LIVELY, RigParametersClient
from node.test_scheduling import children

INCLINED = {
    'predict_motion': True,
    'angle': math.pi / 4,
    'friction': 0.5,
    'gravity': 1.0,
    'force_frequencies': '[1.02]',
    # A period takes 6 ms.
    'real_time_factor': 1000.0,
    'state_rate': 5.0,
}
RIG = RigParameters(angle=math.pi / 4, friction=0.5, gravity=1.0, force_frequencies=1.02)


class Reports:
    """What one node says of its motion."""

    def __init__(self, client, namespace):
        self._prefix = f'{namespace.removeprefix("/")}/sim_node: '
        self._arrays = client.listen(DiagnosticArray, '/diagnostics')
        self._seen = 0
        #: Of the predicted motion, when it was last waited for
        self.level = None

    def motion(self, condition):
        """
        Wait until the measured and the predicted motion are as they should be; return them.

        No report is passed over, however late this process looks, and each is looked at once.
        """
        return until(
            lambda: self._next(condition), lambda: str([a.status[-2:] for a in self._arrays[-9:]])
        )

    def _next(self, condition):
        while self._seen < len(self._arrays):
            array = self._arrays[self._seen]
            self._seen += 1
            ours = {s.name.removeprefix(self._prefix): s for s in array.status}
            tasks = [ours[t] for t in ('measured motion', 'predicted motion') if t in ours]
            values = [{v.key: v.value for v in task.values} for task in tasks]
            if tasks and condition(*values):
                self.level = tasks[-1].level
                return values
        return None


@pytest.fixture
def node(client, launch, namespace):
    """Start a node with the golden inclined rig, and return it with its reports."""

    def start(**parameters):
        reports = Reports(client, namespace)
        process = launch(f'__ns:={namespace}', **{**INCLINED, **parameters})
        return process, reports, RigParametersClient(client, f'{namespace}/sim_node')

    return start


def agreeing(orbit):
    """Return a condition: the predicted motion is this one, and the measured one agrees."""

    def condition(_, predicted):
        return predicted['Agreement'] == 'agrees' and json.loads(
            predicted['Largest X [m]']
        ) == pytest.approx(orbit.x_max, rel=1e-6)

    return condition


def check(measured, predicted, orbit):
    """Compare the reported motions with a motion of the theory."""
    # How near a measured motion is, that counts as settled, depends on how slowly it settles.
    near = float(predicted['Tolerance'])
    assert near <= TOLERANCE + SETTLED_DRIFT / (1.0 - abs(orbit.multipliers[0]))
    keys = (
        ('Phases [cycles of the force]', orbit.phases, 1e-8, near),
        ('X at the impacts [m]', orbit.x, 1e-6, near * orbit.x_max),
    )
    for key, value, predicted_error, measured_error in keys:
        assert json.loads(predicted[key]) == pytest.approx(value, abs=predicted_error)
        assert json.loads(measured[key]) == pytest.approx(value, abs=measured_error)
    for values in (measured, predicted):
        assert values['Stop sequence'] == '[1, 2]'
        assert values['Impacts per period'] == '2'
        assert values['Period [cycles of the force]'] == '1'
        assert float(values['Largest X / A']) == pytest.approx(
            orbit.x_max_ratio, rel=X_MAX_TOLERANCE - TOLERANCE + near
        )
    assert measured['State'] == 'periodic'
    assert measured['Settled'] == 'True'
    assert predicted['State'] == 'found'
    assert (predicted['Stable'], predicted['Viable']) == ('True', 'True')
    assert float(predicted['Largest multiplier modulus']) == pytest.approx(
        abs(orbit.multipliers[0]), abs=1e-6
    )


def test_measured_and_predicted_motion_agree_before_and_after_a_change(node):
    process, reports, parameters = node(record=True)
    orbit = find_orbits(RIG, (1, 2)).orbits[0]
    assert orbit.x_max_ratio == pytest.approx(0.2113439, abs=5e-8)
    check(*reports.motion(agreeing(orbit)), orbit)
    for gap in (33.0, 30):
        assert parameters.set(gap=gap) == ''
        orbit = find_orbits(RIG.replace(gap=gap), (1, 2)).orbits[0]
        check(*reports.motion(agreeing(orbit)), orbit)
    assert reports.level == DiagnosticStatus.OK
    # A second harmonic repeats after three cycles of the first, and begins as it is added.
    both = {'force_amplitudes': [1.0, 0.1], 'force_phases': [0.0, 0.0]}
    assert parameters.set_atomically(force_frequencies=[1.02, 1.7], **both) == ''
    period = 'Period [cycles of the force]'
    reports.motion(lambda _, p: (p['Agreement'], p[period]) == ('agrees', '3'))
    # Without a common period there is no periodic motion, and that is no fault.
    assert parameters.set(force_frequencies=[1.02, 1.7171]) == ''
    _, predicted = reports.motion(lambda _, p: p['State'] == 'none')
    assert 'needs a whole number' in predicted['Reason']
    assert reports.level == DiagnosticStatus.OK
    assert process.stop() == 0, process.output


def test_a_gap_that_m_never_crosses_is_reported(client, launch, namespace):
    """Of 5 m for a rig that moves by centimetres: metres for millimetres."""
    values = {**LIVELY, 'gap': 5.0, 'real_time_factor': 4.0}
    process = launch(f'__ns:={namespace}', **values)
    reports = client.listen(DiagnosticArray, '/diagnostics')

    def status():
        name = f'{namespace[1:]}/sim_node: measured motion'
        found = [s for r in list(reports) for s in r.status if s.name == name]
        return next((s for s in found if s.message.startswith('m has not hit a stop for ')), None)

    found = until(status)
    assert found.level == DiagnosticStatus.WARN
    (reason,) = [v.value for v in found.values if v.key == 'Reason']
    assert reason.startswith('the gap, 5 m, is wider than M moves from end to end')
    assert process.stop() == 0, process.output


def test_one_impact_in_three_cycles_is_recognised(node):
    rig = VERTICAL.replace(force_amplitudes=1.48507)
    orbit = find_orbits(rig, (1,), 3).orbits[0]
    _, reports, _ = node(
        damper_mass=rig.damper_mass,
        damping=rig.damping,
        angle=rig.angle,
        friction=0.0,
        one_sided=True,
        force_amplitudes='[1.48507]',
        force_frequencies='[10.0]',
        force_phases=f'[{math.tau * orbit.phases[0]}]',
        initial_primary_position=orbit.x[0],
        initial_primary_velocity=orbit.primary_velocity_after[0],
        initial_damper_offset=0.5 * rig.gap,
        initial_damper_velocity=orbit.damper_velocity_after[0],
        real_time_factor=100.0,
    )
    measured, predicted = reports.motion(lambda _, p: p['Agreement'] == 'agrees')
    for values in (measured, predicted):
        assert values['Stop sequence'] == '[1]'
        assert values['Period [cycles of the force]'] == '3'
    assert measured['State'] == 'periodic'


def test_predictions_on_request_and_nothing_left_of_a_killed_node(node):
    process, reports, parameters = node(predict_motion=False)
    measured, predicted = reports.motion(lambda m, _: m['State'] == 'periodic')
    assert (predicted['State'], predicted['Process']) == ('off', '')
    assert measured['Stop sequence'] == '[1, 2]'
    assert parameters.set(predict_motion=True) == ''
    reports.motion(lambda _, p: p['State'] == 'found')
    assert parameters.set(gap=30.0) == ''
    reports.motion(agreeing(find_orbits(RIG.replace(gap=30.0), (1, 2)).orbits[0]))
    # Whoever starts a node and kills it should not find anything left.
    started = children(process.pid)
    assert started
    process.kill()
    until(lambda: not any(map(alive, started)))
