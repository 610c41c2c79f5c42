"""What a person types, read in the units of the table."""

import math

import pytest

from impact_damper_ros.rig import ALL_SPECS, ParameterError
from impact_damper_ros.rig.units import UNITS, USUAL


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


@pytest.mark.parametrize(
    ('name', 'text', 'unit', 'message'),
    [
        ('gap', 'abc', 'mm', "gap is 'abc': give a number from 1e-06 to 1e+12 mm"),
        ('gap', '', '', "gap is '': give a number from 1e-09 to 1e+09 m"),
        ('gap', '-5', 'mm', 'gap is -5.0 mm: give a number from 1e-06 to 1e+12 mm'),
        ('gap', '1e999', '', 'gap is inf m: give a number from 1e-09 to 1e+09 m'),
        ('gap', '1,000', 'mm', "gap is '1,000': write 1.000 or 1000"),
        (
            *('gap', '3 inch', 'mm'),
            "gap is '3 inch': 'inch' is no unit of it: write m, cm, mm, µm, um",
        ),
        ('friction', '5 m', '', "friction is '5 m': 'm' is no unit of it: write %"),
        (
            *('force_amplitudes', '2,5', 'N'),
            "force_amplitudes is '2,5': write 2.5 for one number, or 2; 5 for two",
        ),
        (
            'multisine_lines',
            '3.5',
            '',
            'multisine_lines is 3.5: give a whole number from 1 to 512',
        ),
        (
            *('max_bag_size', '3 kB', ''),
            'max_bag_size is 3.0 kB: give 0 (no limit) or a number from 100 to 1e+12 kB',
        ),
    ],
)
def test_what_cannot_be_read(name, text, unit, message):
    with pytest.raises(ParameterError) as caught:
        ALL_SPECS[name].read(text, unit)
    assert str(caught.value) == message


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
