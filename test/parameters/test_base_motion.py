"""Lines of a base: their three quantities, upward zeros, and what is refused."""

import math

import numpy as np
import pytest
from rigs import UNFORCED

from impact_damper_ros import ParameterError
from impact_damper_ros.parameters.base_motion import BaseMotion, angles_after, wait_for_change


def base_of(**more):
    return UNFORCED.replace(**more)


def test_the_three_quantities_are_one_motion():
    rate, size, phase = 40.0, 2e-3, 0.7
    rigs = [
        base_of(
            base_amplitudes=amplitude,
            base_frequencies=rate,
            base_phases=angle,
            base_quantity=quantity,
        )
        for quantity, amplitude, angle in (
            ('displacement', size, phase),
            ('velocity', size * rate, phase + 0.5 * math.pi),
            ('acceleration', -size * rate**2, phase),
        )
    ]
    force = [rigs[0].stiffness * size, rigs[0].damping * size * rate]
    turned = phase + math.atan2(force[1], force[0])
    for rig in rigs:
        amplitude, frequency, angle = rig.first_harmonic
        assert (amplitude, frequency) == (pytest.approx(math.hypot(*force)), rate)
        assert math.cos(angle - turned) == pytest.approx(1.0)
        assert math.sin(angle - turned) == pytest.approx(0.0, abs=1e-12)
        assert rig.periodic_force
        assert rig.response_amplitude == pytest.approx(rigs[0].response_amplitude)


def test_upward_zeros_of_many_lines():
    base = BaseMotion(
        tuple(np.linspace(1.0, 0.2, 9)), tuple(np.linspace(1.0, 7.3, 9)), tuple(range(9))
    )
    angles = [0.0] * 9
    # Through the force that stands for them
    _, _, phases = base.force(1974.0, 12.6)
    columns = np.array(base.columns(1974.0, 12.6))
    assert (columns * [np.sin(phases), np.cos(phases)]).sum() == pytest.approx(base.at(angles)[0])
    for _ in range(20):
        wait = base.upward_zero(angles)
        place, speed = base.at(angles, wait)
        assert abs(place) < 1e-13
        assert speed > 0.0
        assert min(base.at(angles, share * wait)[0] for share in (0.999, 0.9999)) < 0.0
        angles = [a + w * wait for a, w in zip(angles, base.frequencies, strict=True)]
        assert base.upward_zero(angles) == 0.0
        angles = [a + w * 1e-3 for a, w in zip(angles, base.frequencies, strict=True)]
    still = BaseMotion((0.0,), (1.0,), (0.0,))
    assert wait_for_change(still, [0.3], base) == 0.0
    place, _ = base.at(angles_after(still, [0.3], base))
    assert abs(place) < 1e-13


#: Amplitudes, frequencies and phases of one line, or lines far apart, and when b first rises by 0.
FAR_APART = {
    'one line': ([1.0], [2.0], [0.3], (math.tau - 0.3) / 2.0),
    'one line upside down': ([-1.0], [2.0], [0.3], (math.pi - 0.3) / 2.0),
    'a ripple': ([1.0, 1e-9], [1.0, 1e6], [math.pi / 2, 0.0], 1.5 * math.pi),
    'many ripples': (
        [0.05] + [1e-9] * 200,
        [0.3] + [1e4 + k for k in range(200)],
        [math.pi / 2] + [0.0] * 200,
        1.5 * math.pi / 0.3,
    ),
    'a slow line that is larger': ([1.0, 0.5], [1e-6, 1e3], [math.pi / 2, 0.0], None),
    'a slow line that is smaller': ([0.1, 1.0], [1e-6, 1e3], [0.3, 1.0], None),
    'a place that is passed': ([0.9, 1.0], [0.0, 2.0], [math.pi / 2, 0.0], None),
    'a place that is never passed': ([1.1, 1.0], [0.0, 2.0], [math.pi / 2, 0.0], math.inf),
}


@pytest.mark.parametrize(('amplitudes', 'frequencies', 'phases', 'zero'), FAR_APART.values())
def test_an_upward_zero_of_lines_far_apart(amplitudes, frequencies, phases, zero):
    base = BaseMotion(tuple(amplitudes), tuple(frequencies), tuple(phases))
    wait = base.upward_zero([0.0] * len(amplitudes))
    if zero is not None:
        assert wait == pytest.approx(zero, rel=1e-5)
    if zero != math.inf:
        place, speed = base.at([0.0] * len(amplitudes), wait)
        assert abs(place) < 1e-8
        assert speed > 0.0


@pytest.mark.parametrize(
    ('values', 'name', 'remedy'),
    [
        ({'base_amplitudes': [1.0, 2.0]}, 'base_frequencies', 'give all three base arrays'),
        *(
            (
                {'base_amplitudes': 1.0, 'base_frequencies': low, 'base_quantity': quantity},
                'base_frequencies',
                'or base_quantity displacement',
            )
            for low, quantity in (
                (0.0, 'velocity'),
                (1e-320, 'velocity'),
                (0.0, 'acceleration'),
                (1e-300, 'acceleration'),
            )
        ),
        (
            {'base_amplitudes': 1e9, 'base_quantity': 'displacement'},
            'base_amplitudes',
            'pulls M by 1.974e\\+12 N',
        ),
        ({'base_quantity': 'sideways'}, 'base_quantity', 'displacement, velocity, acceleration'),
        ({'base_amplitudes': math.nan}, 'base_amplitudes', 'give a number'),
    ],
)
def test_refusals(values, name, remedy):
    with pytest.raises(ParameterError, match=remedy) as error:
        base_of(**values)
    assert error.value.name == name


@pytest.mark.parametrize(
    ('amplitudes', 'value', 'quantity'),
    [
        ('0.2 g', 0.2 * 9.80665, 'acceleration'),
        ('2mm', 0.002, 'displacement'),
        (['30 mm/s'], 0.03, 'velocity'),
        ('0.3', 0.3, 'acceleration'),
    ],
)
def test_the_unit_of_amplitudes_is_their_quantity(amplitudes, value, quantity):
    rig = base_of(base_amplitudes=amplitudes, base_frequencies=31.4)
    assert rig.base_amplitudes == pytest.approx((value,))
    assert rig.base_quantity == quantity
    again = base_of(base_frequencies=31.4).replace(base_amplitudes=amplitudes)
    assert again == rig
    with pytest.raises(ParameterError, match='give all lines of the base as one quantity'):
        base_of(base_amplitudes=['1 mm', '2 g'])
    with pytest.raises(ParameterError, match="'kg' is no unit of it: write m, cm"):
        base_of(base_amplitudes='1 kg')
