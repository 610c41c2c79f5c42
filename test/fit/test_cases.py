"""Files of other programs: what comes of each is right, or the reason is."""

from pathlib import Path

import pytest

from impact_damper_ros.fit.measured_motion import ReadingOptions
from impact_damper_ros.fit.recorded_motion import read_motion
from impact_damper_ros.fit.rig_fit import fit_rig
from impact_damper_ros.fit.structure import fit_structure
from impact_damper_ros.parameters.parameters_file import load_parameters

CASES = Path(__file__).parent / 'cases'


def fitted(name, rig, impacts=None, **options):
    reading = ReadingOptions()
    if impacts is not None:
        reading = ReadingOptions(impacts=CASES / impacts, impact_deviation=5e-4)
    data = read_motion(CASES / f'{name}.zip', reading)
    return fit_rig(data, load_parameters(CASES / rig)[0], **options)


def test_a_rig_that_is_at_rest_before_the_first_impact():
    """With the flight before it K and the gap were five standard deviations off."""
    true = {'stiffness': 2031.0, 'damping': 1.45, 'restitution_1': 0.62, 'friction': 0.015}
    fit = fitted('60_first_203', 'rig.yaml', '60_first_203_hits.csv')
    assert fit.accepted, fit.reasons
    for name, value in {**true, 'gap': 0.0187}.items():
        estimate = fit.parameters[name]
        assert abs(estimate.value - value) < 3.0 * estimate.standard_deviation, name
    # Of m known to 0.5 % and the force to 1 %
    assert fit.parameters['gap'].standard_deviation < 2e-5


def test_inches_called_millimetres():
    fit = fitted('43_inch_m', '43_inch_r.yaml', '43_inch_h.csv')
    assert not fit.accepted
    assert '25.4 times too small' in fit.reasons[0]


def test_a_damper_that_moves_with_the_structure():
    fit = fitted('run_stuck', 'start.yaml')
    assert not fit.accepted
    assert '2.7 % lower than that of the file' in fit.reasons[0]
    assert 'm moves with M' in fit.reasons[0]


def test_an_acceleration_that_was_cut_out_of_a_motion():
    """Its offset is fitted without being asked for; a tenth of the flights is left out."""
    fit = fitted('run_cut', 'start.yaml', also=['force_delay'])
    assert fit.accepted, fit.reasons
    assert fit.parameters['gap'].value == pytest.approx(0.009, rel=2e-3)
    assert fit.parameters['bias'].value == pytest.approx(0.03, abs=1e-3)


@pytest.mark.parametrize(
    ('name', 'mass'), [('70_sweep', None), ('71_force_sweep', 2.0)], ids=['base', 'force']
)
def test_a_sweep_whose_force_or_base_is_noisy(name, mass):
    data = read_motion(CASES / f'{name}.zip', ReadingOptions())
    found = fit_structure(data)
    assert found.accepted, found.reasons
    pairs = [(found.frequency, 5.07178), (found.damping_ratio, 0.011375)]
    for estimate, true in [*pairs, *([] if mass is None else [(found.mass, mass)])]:
        assert abs(estimate.value - true) < 3.0 * estimate.standard_deviation
    assert found.input_noise > 0.0


def test_a_ring_down_with_the_damper_in_it():
    data = read_motion(CASES / 'ringdown_with_damper.zip', ReadingOptions())
    found = fit_structure(data)
    assert not found.accepted
    assert 'is the damper still in it?' in found.reasons[0]
