"""Units as people write them, against factors by hand."""

import pytest

from impact_damper_ros.measured.sheet import heading
from impact_damper_ros.measured.units import si_unit_of

G = 9.80665


@pytest.mark.parametrize(
    ('text', 'si', 'factor'),
    [
        ('in/s^2', 'm/s^2', 0.0254),
        ('in/sec²', 'm/s^2', 0.0254),
        ('m·s⁻²', 'm/s^2', 1.0),
        ('m s^-2', 'm/s^2', 1.0),
        ('ms-2', 'm/s^2', 1.0),
        ('m/s**2', 'm/s^2', 1.0),
        ('MG', 'm/s^2', 1e-3 * G),
        ('Gal', 'm/s^2', 0.01),
        ('μm/s', 'm/s', 1e-6),
        ('MM', 'm', 1e-3),
        ('nm', 'm', 1e-9),
        ('MSEC', 's', 1e-3),
        ('KN', 'N', 1e3),
        ('MN', 'N', 1e6),
        ('KHz', 'Hz', 1e3),
        ('1/min', None, None),
        ('(m/s2)2/Hz', '(m/s^2)^2/Hz', 1.0),
        ('(g)^2/Hz', '(m/s^2)^2/Hz', G**2),
        ('m²/s³', '(m/s^2)^2/Hz', 1.0),
        ('mg^2/Hz', '(m/s^2)^2/Hz', 1e-6 * G**2),
        ('', '', 1.0),
        # Neither a nanometre nor a thousand g
        ('Nm', None, None),
        ('kg', None, None),
        ('+0100', None, None),
        ('°C', None, None),
        ('((', None, None),
    ],
)
def test_a_unit(text, si, factor):
    found = si_unit_of(text)
    assert found == (None if si is None else (si, pytest.approx(factor)))


@pytest.mark.parametrize(
    ('title', 'name', 'unit'),
    [
        ('x [mm]', 'x', 'mm'),
        ('Time (s) Run #1', 'Time Run #1', 's'),
        ('Latest: Time (s)', 'Time', 's'),
        ('Acceleration (x) (m/s²)', 'Acceleration (x)', 'm/s²'),
        ('level ((m/s2)2/Hz)', 'level', '(m/s2)2/Hz'),
        ('seconds_elapsed', 'elapsed', 'seconds'),
        ('millis', 'time', 'millis'),
        ('t / s', 't', 's'),
        ('t/s', 't', 's'),
        ('x_mm', 'x', 'mm'),
        ('x, mm', 'x', 'mm'),
        ('t in s', 't', 's'),
        ('linear acceleration x', 'linear acceleration x', None),
        ('timestamp (+0100)', 'timestamp', '+0100'),
        ('(' * 10**6, '(' * 200, None),
    ],
)
def test_a_header(title, name, unit):
    found = heading(title)
    assert (found.name, found.unit) == (name, unit)
