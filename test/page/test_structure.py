"""What is typed of a structure; the answer is in `test_server`."""

import math

import pytest

from impact_damper_ros.page.structure import (
    FieldError,
    command_of,
    design_of,
    note_on,
    structure_of,
)

TYPED = {
    'mass': '5',
    'frequency': '10',
    'damping': '2',
    'shaken': 'acceleration',
    'size': '0.2',
    'mass_ratio': '5',
    'restitution': '0.6',
}


def test_units_are_those_that_are_shown():
    rig = structure_of(TYPED)
    assert (rig.primary_mass, rig.damper_mass) == (5.0, 0.25)
    assert (rig.omega / math.tau, rig.zeta) == pytest.approx((10.0, 0.02))
    assert rig.base_amplitudes == (pytest.approx(0.2 * 9.80665),)
    assert rig.base_quantity == 'acceleration'
    assert rig.frequency_ratio == pytest.approx(1.0)
    assert rig.force_amplitudes == (0.0,)


@pytest.mark.parametrize(
    ('changes', 'name', 'value'),
    [
        ({'mass': '5000 g'}, 'primary_mass', 5.0),
        ({'mass': '5,5'}, 'primary_mass', 5.5),
        ({'frequency': '0.6 kHz'}, 'stiffness', 5.0 * (math.tau * 600.0) ** 2),
        ({'mass_ratio': '0.04 '}, 'damper_mass', 0.002),
        ({'mass_ratio': '4 %'}, 'damper_mass', 0.2),
        ({'shaken': 'force', 'size': '7'}, 'force_amplitudes', (7.0,)),
        ({'shaken': 'displacement', 'size': '0.5'}, 'base_amplitudes', (5e-4,)),
        ({'shaken': 'displacement', 'size': '500 um'}, 'base_amplitudes', (5e-4,)),
    ],
)
def test_what_is_typed_has_its_own_unit_or_that_of_the_field(changes, name, value):
    assert getattr(structure_of({**TYPED, **changes}), name) == pytest.approx(value)


def test_the_command_has_what_was_typed():
    typed = {**TYPED, 'mass': '5000 g', 'damping': '2,5'}
    structure = '--mass 5000g --frequency 10Hz --damping-ratio 2.5% --mass-ratio 5%'
    for size, shaken in (('0.2', '--base 0.2g'), ('0.2 m/s^2', '--base 0.2m/s^2')):
        command = command_of({**typed, 'size': size}, structure_of({**typed, 'size': size}))
        assert command == f'design_damper {structure} --restitution 0.6 {shaken}'
    pushed = {**typed, 'shaken': 'amplitude', 'size': '12'}
    force = structure_of(pushed).force_amplitudes[0]
    *_, option, given = command_of(pushed, structure_of(pushed)).split()
    assert option == '--force'
    assert float(given) == pytest.approx(force, rel=1e-3)


def test_an_amplitude_stands_for_the_force_that_makes_it():
    rig = structure_of({**TYPED, 'shaken': 'amplitude', 'size': '12'})
    assert rig.response_amplitude == pytest.approx(0.012)


@pytest.mark.parametrize(
    ('changes', 'field', 'problem'),
    [
        ({'mass': ''}, 'mass', 'primary_mass'),
        ({'mass': '5 Hz'}, 'mass', 'Hz'),
        ({'mass': '-1'}, 'mass', 'primary_mass'),
        ({'damping': '0'}, 'damping', 'It is 0'),
        ({'damping': '200'}, 'damping', 'damping_ratio'),
        ({'size': '0'}, 'size', 'It is 0'),
        ({'size': '2 kg'}, 'size', 'kg'),
        ({'restitution': '1.2'}, 'restitution', 'restitution_1'),
        ({'shaken': 'wind'}, 'shaken', 'none of acceleration'),
        ({'frequency': None}, 'frequency', 'natural_frequency'),
    ],
)
def test_refusals_name_the_field(changes, field, problem):
    with pytest.raises(FieldError, match=problem) as error:
        structure_of({**TYPED, **changes})
    assert error.value.field == field


def test_a_node_with_too_few_samples_for_its_traces_is_noted():
    rig = structure_of(TYPED)
    assert note_on(rig, 200.0) == ''
    assert 'state_rate:=200.0' in note_on(rig, 50.0)


def test_a_structure_without_a_damper():
    rig = structure_of({**TYPED, 'mass_ratio': '2000'})
    with pytest.raises(FieldError, match='No stable motion of two impacts'):
        design_of(rig)
