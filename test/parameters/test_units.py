"""What a person types, read in the units of the table."""

import math

import pytest

from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.units import UNITS, USUAL, si_value


@pytest.mark.parametrize(
    ('name', 'text', 'unit', 'value'),
    [
        ('gap', '24.5 mm', '', 0.0245),
        ('gap', '24.5', 'mm', 0.0245),
        ('gap', '2,5', 'mm', 0.0025),
        ('gap', '0,025', '', 0.025),
        ('gap', '3e-2m', 'mm', 0.03),
        ('initial_primary_position', '−2 cm', '', -0.02),
        ('angle', '37 deg', '', math.radians(37.0)),
        ('angle', '-3', '°', math.radians(-3.0)),
        ('force_frequencies', '0.5 Hz', '', (math.pi,)),
        ('force_frequencies', '60 rpm', '', (math.tau,)),
        ('force_amplitudes', '1, 0.5 kN', '', (1000.0, 500.0)),
        ('force_amplitudes', '1, 0.5 kN', 'N', (1.0, 500.0)),
        ('force_amplitudes', '[2,5;]', 'N', (2.5,)),
        ('force_amplitudes', '[2,5]', '', (2.0, 5.0)),
        ('force_amplitudes', '2,5; 3', '', (2.5, 3.0)),
        ('friction', '5 %', '', 0.05),
        ('max_bag_size', '3 MB', '', 3_000_000),
        ('multisine_lines', '12', '', 12),
    ],
)
def test_read(name, text, unit, value):
    assert ALL_SPECS[name].read(text, unit) == pytest.approx(value, rel=1e-14)


def test_every_unit_of_a_parameter_is_there():
    assert {spec.unit for spec in ALL_SPECS.values()} <= UNITS.keys()
    for unit, factors in UNITS.items():
        assert factors[unit] == 1.0
    assert USUAL.keys() <= UNITS.keys()


def test_usual_ranges_hold_the_defaults():
    """But the limit of the gap control that is as good as none, and a step of a frequency."""
    beyond = set()
    for name, spec in ALL_SPECS.items():
        if spec.usual is not None:
            low, high = spec.usual
            assert spec.low <= low < high <= spec.high
            entries = spec.default if isinstance(spec.default, tuple) else (spec.default,)
            beyond |= {name for entry in entries if not low <= entry <= high}
    assert beyond == {'gap_max', 'sweep_step'}


@pytest.mark.parametrize(
    ('text', 'unit', 'value'),
    [('500ms', 's', 0.5), ('2 min', 's', 120.0), ('1kHz', 'Hz', 1000.0), ('1e3', 's', 1000.0)],
)
def test_a_number_with_its_own_unit(text, unit, value):
    assert si_value(text, unit) == value


@pytest.mark.parametrize('text', ['5 kg', 'ms', '', '1,000'])
def test_what_is_no_number_of_a_unit(text):
    with pytest.raises(ValueError, match='could not convert'):
        si_value(text, 's')
