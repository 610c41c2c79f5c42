"""A structure as people know it, wherever a rig is described."""

import math

import pytest

from impact_damper_ros import ParameterError, RigParameters, load_parameters
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.parameters.structure import STRUCTURE_SPECS

KNOWN = {'primary_mass': 5.0, 'natural_frequency': 10.0, 'damping_ratio': 0.02, 'mass_ratio': 0.05}


def test_what_the_names_mean():
    rig = RigParameters.of_structure(**KNOWN, gap=0.02)
    assert rig.omega == pytest.approx(20.0 * math.pi, rel=1e-15)
    assert rig.zeta == pytest.approx(0.02, rel=1e-15)
    assert rig.damper_mass == 0.25
    assert rig.stiffness == pytest.approx(5.0 * (20.0 * math.pi) ** 2)
    assert rig.gap == 0.02


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('damping_ratio', '2 %'),
        ('loss_factor', 0.04),
        ('loss_factor', '4%'),
        ('quality_factor', 25.0),
        ('logarithmic_decrement', 0.04 * math.pi / math.sqrt(1.0 - 0.0004)),
    ],
)
def test_measures_of_damping(name, value):
    others = {n: v for n, v in KNOWN.items() if n != 'damping_ratio'}
    assert RigParameters.of_structure(**others, **{name: value}).zeta == pytest.approx(0.02)


def test_a_part_of_them():
    rig = RigParameters(primary_mass=2.0, stiffness=1974.0, damping=1.26, damper_mass=0.1)
    assert rig.replace(mass_ratio='10 %').damper_mass == 0.2
    softer = rig.replace(natural_frequency='4 Hz')
    assert softer.omega == pytest.approx(8.0 * math.pi)
    assert (softer.damping, softer.primary_mass) == (1.26, 2.0)
    heavier = rig.replace(primary_mass=4.0, damping_ratio=0.01)
    assert heavier.stiffness == 1974.0
    assert heavier.zeta == pytest.approx(0.01)


def test_the_same_twice_is_no_contradiction():
    rig = RigParameters.of_structure(**KNOWN)
    again = RigParameters.of_structure(**KNOWN, stiffness=rig.stiffness, loss_factor=0.04)
    assert again == rig


@pytest.mark.parametrize(
    ('more', 'name', 'words'),
    [
        (
            {'stiffness': 1000.0},
            'stiffness',
            r'natural_frequency 10.0 means a stiffness of 19739.2088 N.m, and stiffness 1000.0 '
            r'one of 1000 N.m: give one',
        ),
        ({'quality_factor': 10.0}, 'quality_factor', 'damping_ratio 0.02 means a damping of'),
        ({'damper_mass': 1.0}, 'damper_mass', 'mass_ratio 0.05 means a damper_mass of 0.25 kg'),
        ({'damping_ratio': 1.5}, 'damping_ratio', 'damping_ratio is 1.5: give a number from 0 to'),
        ({'natural_frequency': 0.0}, 'natural_frequency', 'give a number from 1e-06'),
        ({'natural_frequency': '10 kg'}, 'natural_frequency', "'kg' is no unit of it"),
        ({'mass_ratio': math.nan}, 'mass_ratio', 'give a number'),
    ],
)
def test_refusals(more, name, words):
    with pytest.raises(ParameterError, match=words) as error:
        RigParameters.of_structure(**{**KNOWN, **more})
    assert error.value.name == name


def test_files_and_options(tmp_path, capsys):
    path = tmp_path / 'rig.yaml'
    path.write_text(
        '/**:\n  ros__parameters:\n    primary_mass: 5 kg\n    natural_frequency: 10 Hz\n'
        '    damping_ratio: 2 %\n    mass_ratio: 5%\n    gap: 20 mm\n'
    )
    rig, _, _ = load_parameters(path)
    assert rig == RigParameters.of_structure(**KNOWN, gap=0.02)
    options = ['--duration', '1', '--set', 'natural_frequency=5', '--set', 'mass_ratio=0.02']
    assert simulate_rig([str(path), *options]) == 0
    assert 'natural frequency 5.00 Hz' in capsys.readouterr().err
    path.write_text(path.read_text() + '    stiffness: 30\n')
    assert simulate_rig([str(path), '--duration', '1']) == 2
    assert 'rig.yaml: line 8: natural_frequency' in capsys.readouterr().err


def test_they_are_listed(capsys):
    assert simulate_rig(['--parameters']) == 0
    listed = capsys.readouterr().out
    assert all(f'`{name}`' in listed for name in STRUCTURE_SPECS)
