"""Files of other programs: what comes of each is right, or the reason is."""

from pathlib import Path

import pytest

from impact_damper_ros.fit.measured_motion import ReadingOptions
from impact_damper_ros.fit.recorded_motion import read_motion
from impact_damper_ros.fit.rig_fit import fit_rig
from impact_damper_ros.fit.structure import fit_structure
from impact_damper_ros.parameters.parameters_file import load_parameters

CASES = Path(__file__).parent / 'cases'


TRUE = {
    'stiffness': 2031.0,
    'damping': 1.45,
    'restitution_1': 0.62,
    'friction': 0.015,
    'gap': 0.0187,
}
NAMED = {'restitution_1': 0.55, 'friction': 0.05, 'gap': 0.009, 'bias': 0.03}
#: File, rig, impact times, what is fitted besides, and the true values or words of the reason.
FITS = [
    ('40_rig', 'rig', '40_hits', (), TRUE),
    ('40_rig', 'rig', '40_hits', ('damper_mass',), {**TRUE, 'damper_mass': 0.12}),
    # m is 10 % too large in the file: the record says so, and it is fitted
    ('42_m+10_m', '42_m+10_r', '42_m+10_h', (), {'damper_mass': 0.15745 / 1.1}),
    ('43_inch_m', '43_inch_r', '43_inch_h', (), '25.4 times too small'),
    ('45_force_nan', 'rig', '40_hits', (), TRUE),
    ('46_clip_sentinel', 'rig', '40_hits', (), TRUE),
    ('46_sentinel_single', 'rig', '40_hits', (), TRUE),
    ('48_held', 'rig', '40_hits', (), TRUE),
    # At rest before the first impact: with the flight before it the gap was 4.9 deviations off
    ('60_first_203', 'rig', '60_first_203_hits', (), TRUE),
    ('run_named', 'start', None, (), NAMED),
    ('run_cut', 'start', None, ('force_delay',), NAMED),
    ('run_cut', 'start', None, (), 'the force comes at another time than described'),
    ('run_stuck', 'start', None, (), '2.7 % lower than that of the file, as that of M and m'),
]


@pytest.mark.parametrize(('name', 'rig', 'impacts', 'also', 'wanted'), FITS)
def test_a_rig_is_found_or_the_reason_is_named(name, rig, impacts, also, wanted):
    reading = ReadingOptions()
    if impacts:
        reading = ReadingOptions(impacts=CASES / f'{impacts}.csv', impact_deviation=5e-4)
    data = read_motion(CASES / f'{name}.zip', reading)
    fit = fit_rig(data, load_parameters(CASES / f'{rig}.yaml')[0], also=also)
    if isinstance(wanted, str):
        assert not fit.accepted
        assert wanted in fit.reasons[0]
        return
    assert fit.accepted, fit.reasons
    for parameter, value in wanted.items():
        estimate = fit.parameters[parameter]
        assert abs(estimate.value - value) < 3.0 * estimate.standard_deviation, parameter
    assert fit.parameters['gap'].standard_deviation < 4e-3 * fit.parameters['gap'].value


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
