"""Parameters of the gap control: ranges, and what must hold between them."""

import json

import pytest

from impact_damper_ros.rig import GapControlParameters, ParameterError


def test_off_by_default():
    assert GapControlParameters().gap_control == 'off'
    assert not GapControlParameters().active


def test_values_go_through_json():
    control = GapControlParameters(gap_control='timed', gap_min=0.01, gap_control_seed=7)
    assert GapControlParameters(**json.loads(json.dumps(control.as_dict()))) == control


def test_whole_numbers_are_taken_for_numbers():
    control = GapControlParameters(gap_min=1, gap_max=2, gap_control_seed=3.0)
    assert (control.gap_min, control.gap_max, control.gap_control_seed) == (1.0, 2.0, 3)
    assert type(control.gap_min) is float
    assert type(control.gap_control_seed) is int


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'gap_min': 0.5, 'gap_max': 0.5}, ('gap_min', 'gap_max', 'below')),
        ({'gap_min': 2.0, 'gap_max': 1.0}, ('2.0', '1.0', 'both at once')),
        ({'gap_control': 'on'}, ('off', 'amplitude', 'timed')),
        ({'gap_control_stops': 'both'}, ('symmetric', 'independent')),
        ({'gap_control_smoothing': 0.0}, ('0.0', '0.001', '1')),
        ({'gap_control_rate': 0.0}, ('Hz', '0.001')),
        ({'actuator_speed': 1e-9}, ('1e-09', '0 (at once)', '1e-06')),
        ({'actuator_delay': -0.1}, ('-0.1', '0 to')),
        ({'gap_control_seed': 1.5}, ('1.5', 'whole number')),
        ({'gap_max': float('nan')}, ('nan',)),
    ],
)
def test_errors_name_value_range_and_remedy(values, words):
    with pytest.raises(ParameterError) as error:
        GapControlParameters(**values)
    assert error.value.name in values
    for word in words:
        assert word in str(error.value)


def test_replace_is_atomic_and_knows_its_names():
    control = GapControlParameters(gap_min=0.1, gap_max=1.0)
    moved = control.replace(gap_min=2.0, gap_max=3.0)
    assert (moved.gap_min, moved.gap_max) == (2.0, 3.0)
    with pytest.raises(ParameterError, match='gap_min is 2'):
        control.replace(gap_min=2.0)
    with pytest.raises(ParameterError, match='gap_maximum is not a parameter'):
        control.replace(gap_maximum=2.0)
    assert (control.gap_min, control.gap_max) == (0.1, 1.0)
