"""The tables of parameters: ranges, kinds of values, and what holds between values."""

import dataclasses
import json
import math

import numpy as np
import pytest

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    ParameterError,
    RigParameters,
)
from impact_damper_ros.parameters.rig_parameters import (
    ALL_SPECS,
    GAP_CONTROL_SPECS,
    INITIAL_SPECS,
    PARAMETER_SPECS,
    SETTING_SPECS,
    NodeSettings,
)

TABLES = {
    RigParameters: PARAMETER_SPECS,
    InitialConditions: INITIAL_SPECS,
    GapControlParameters: GAP_CONTROL_SPECS,
    NodeSettings: SETTING_SPECS,
}
NUMBERS = [
    pytest.param(table, spec, id=name)
    for table, specs in TABLES.items()
    for name, spec in specs.items()
    if spec.low is not None
]
#: What the ends of some ranges need to be admissible.
SUPPORT = {
    'damping': {'stiffness': 1e15, 'primary_mass': 1e9},
    'stiffness': {'damping': 0.0},
    'primary_mass': {'damping': 0.0},
    'gap_min': {'gap_max': 1e9},
    'gap_max': {'gap_min': 1e-9},
}


@pytest.mark.parametrize(('table', 'spec'), NUMBERS)
def test_range(table, spec):
    """Both ends are in, the next floats are out, and the message says what to give."""
    whole = spec.kind == 'integer'

    def built(number):
        value = [number] if spec.kind == 'double_array' else number
        return getattr(table(**{**SUPPORT.get(spec.name, {}), spec.name: value}), spec.name)

    for end, side in ((spec.low, -math.inf), (spec.high, math.inf)):
        if {'gap_min': spec.high, 'gap_max': spec.low}.get(spec.name) != end:
            assert built(end) == ((end,) if spec.kind == 'double_array' else end)
        beyond = end + math.copysign(1, side) if whole else math.nextafter(end, side)
        for value in (beyond, math.nan, side, int(math.copysign(1, side)) * 10**400):
            with pytest.raises(ParameterError) as caught:
                built(value)
            assert caught.value.name == spec.name
    for value in ('one', None, True, 1j, [[1.0]], {}, b'1', object()):
        with pytest.raises(ParameterError, match=f'{spec.name}.* is .*: give ') as caught:
            built(value)
        assert caught.value.name == spec.name
    value = 2.0 * spec.high + 1.0
    with pytest.raises(ParameterError) as caught:
        built(value)
    span = f'{int(spec.low)} to {int(spec.high)}' if whole else f'{spec.low:g} to {spec.high:g}'
    for words in (spec.name, repr(value), span, spec.unit):
        assert words in str(caught.value)


@pytest.mark.parametrize(('table', 'spec'), [p for p in NUMBERS if p.values[1].low <= 0.0])
def test_no_parameter_is_minus_zero(table, spec):
    """It would differ from 0 in a log; typed, set or read, in a list too."""
    value = getattr(table(**{spec.name: -0.0}), spec.name)
    typed = spec.read('-0.0')
    for number in (value, typed):
        entries = number if isinstance(number, tuple) else (number,)
        assert [str(entry) for entry in entries] in (['0.0'], ['0'])


def test_tables():
    """Names are unique; each parameter has a description, and a default within its range."""
    assert len(ALL_SPECS) == sum(map(len, TABLES.values()))
    for table, specs in TABLES.items():
        assert list(table().as_dict()) == list(specs)
    for name, spec in ALL_SPECS.items():
        assert spec.description.endswith('.')
        assert spec.label == (f'{name} [{spec.unit}]' if spec.unit else name)
        if spec.choices:
            assert spec.default in spec.choices
            assert spec.span == ', '.join(spec.choices)
        if spec.low is not None:
            for number in spec.default if spec.kind == 'double_array' else (spec.default,):
                assert spec.low <= number <= spec.high


def test_defaults_are_the_papers_basic_rig():
    values = RigParameters().as_dict()
    paper = {
        'primary_mass': 1.0,
        'stiffness': 1.0,
        'damping': 0.01,
        'damper_mass': 0.042,
        'gap': 37.0,
        'restitution_1': 0.75,
        'restitution_2': 0.75,
        'angle': 0.0,
        'friction': 0.0,
        'gravity': 9.81,
        'air_force': 0.0,
        'one_sided': False,
        'force_amplitudes': (1.0,),
        'force_frequencies': (1.0,),
        'force_phases': (0.0,),
        'multisine_level': 0.0,
        'sweep_mode': 'off',
    }
    assert {name: values[name] for name in paper} == paper
    assert InitialConditions().as_dict() == dict.fromkeys(INITIAL_SPECS, 0.0)
    assert not GapControlParameters().active


#: Table, name, a value of another kind that is taken, and what it is taken for.
TAKEN = [
    *((RigParameters, 'gap', kind(37), 37.0) for kind in (int, np.float32, np.int64, np.array)),
    *((RigParameters, 'multisine_lines', kind(37), 37) for kind in (float, np.int32, np.float64)),
    *((RigParameters, 'force_phases', kind(2), (2.0,)) for kind in (int, np.float32, np.array)),
    (RigParameters, 'force_phases', [0], (0.0,)),
    (RigParameters, 'force_phases', np.array([0.5]), (0.5,)),
    # What YAML makes of an unquoted off
    (RigParameters, 'sweep_mode', False, 'off'),
    (GapControlParameters, 'gap_min', 1, 1.0),
    (GapControlParameters, 'gap_control_seed', 3.0, 3),
    (RigParameters, 'damping', 1.9998, 1.9998),
]


@pytest.mark.parametrize(('table', 'name', 'value', 'want'), TAKEN)
def test_taken(table, name, value, want):
    got = getattr(table(**{name: value}), name)
    assert got == want
    assert type(got) is type(want)
    assert not isinstance(got, tuple) or {type(entry) for entry in got} == {float}


def test_replace():
    """All at once or not at all; the tables are frozen."""
    rig = RigParameters()
    # Each of the two alone is not admissible.
    assert rig.replace(stiffness=0.01, damping=0.001).damping == 0.001
    for table in TABLES:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(table(), next(iter(TABLES[table])), 2.0)
        assert table(**json.loads(json.dumps(table().as_dict()))) == table()
        assert hash(table()) == hash(table())


@pytest.mark.parametrize('seed', range(20))
def test_derived_values(seed):
    rng = np.random.default_rng(seed)
    M, K, m, F, W = 10.0 ** rng.uniform(-3, 3, 5)
    zeta = rng.uniform(0, 0.999)
    rig = RigParameters(
        primary_mass=M,
        stiffness=K,
        damping=2 * zeta * math.sqrt(K * M),
        damper_mass=m,
        angle=rng.uniform(-1.57, 1.57),
        force_amplitudes=[-F],
        force_frequencies=[W],
    )
    r = W / math.sqrt(K / M)
    gain = 1 / complex(1 - r * r, 2 * zeta * r)
    assert rig.omega == pytest.approx(math.sqrt(K / M), rel=1e-14)
    assert rig.zeta == pytest.approx(zeta, rel=1e-14)
    assert rig.eta == pytest.approx(math.sqrt(1 - rig.zeta**2), rel=1e-12)
    assert rig.mass_ratio == pytest.approx(m / M, rel=1e-15)
    assert rig.frequency_ratio == pytest.approx(r, rel=1e-14)
    assert rig.response_amplitude == pytest.approx(F / K * abs(gain), rel=1e-10)
    assert rig.static_deflection == pytest.approx(M * 9.81 * math.sin(rig.angle) / K, rel=1e-14)


def test_resonance_without_damping():
    rig = RigParameters(damping=0.0)
    assert rig.response_amplitude == math.inf
    assert rig.replace(force_amplitudes=[0.0]).response_amplitude == 0.0
    assert RigParameters().response_amplitude == pytest.approx(100.0, rel=1e-14)


def test_initial_conditions_within_the_gap():
    rig = RigParameters(gap=2.0)
    for offset in (-1.0, 0.0, 1.0):
        InitialConditions(initial_damper_offset=offset).check_within(rig)
    InitialConditions(initial_damper_offset=-50.0).check_within(rig.replace(one_sided=True))


@pytest.mark.parametrize(
    ('changes', 'periodic'),
    [
        ({}, True),
        ({'force_amplitudes': [0.0]}, False),
        ({'force_frequencies': [0.0]}, False),
        ({'multisine_level': 0.1}, False),
        ({'sweep_mode': 'up'}, False),
        ({'force_amplitudes': [1, 0], 'force_frequencies': [1, 2], 'force_phases': [0, 0]}, True),
        ({'force_amplitudes': [1, 1], 'force_frequencies': [1, 2], 'force_phases': [0, 0]}, False),
    ],
)
def test_periodic_force(changes, periodic):
    assert RigParameters(**changes).periodic_force == periodic
