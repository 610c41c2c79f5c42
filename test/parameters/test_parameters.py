"""The tables of parameters: ranges, kinds of values, and what holds between values."""

import dataclasses
import itertools
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
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GAP_CONTROL_SPECS
from impact_damper_ros.parameters.node_settings import SETTING_SPECS, NodeSettings
from impact_damper_ros.parameters.rig_parameters import INITIAL_SPECS, PARAMETER_SPECS

TABLES = {
    RigParameters: PARAMETER_SPECS,
    InitialConditions: INITIAL_SPECS,
    GapControlParameters: GAP_CONTROL_SPECS,
    NodeSettings: SETTING_SPECS,
}
#: What the ends of some ranges need to be admissible.
SUPPORT = {
    'damping': {'stiffness': 1e15, 'primary_mass': 1e9},
    'stiffness': {'damping': 0.0},
    'primary_mass': {'damping': 0.0},
    'gap_min': {'gap_max': 1e9},
    'gap_max': {'gap_min': 1e-9},
}
#: Ends that are not admissible beside any other value.
APART = {'gap_min': 1e9, 'gap_max': 1e-9}
NO_NUMBERS = ('one', '', None, True, 1j, [[1.0]], {}, b'1', object())
NO_TEXTS = ('sideways', '', None, 1, ['up'], b'up')


def wrong_values(spec):
    """Yield what a parameter cannot be, and a part of what is to be said of it."""
    if spec.kind == 'bool':
        yield from ((value, 'give true or false') for value in (1, 0, 'true', None, [True]))
    elif spec.choices:
        yield from ((value, f'give one of {spec.span}') for value in NO_TEXTS)
    elif spec.kind == 'string':
        yield from ((value, 'give a text') for value in (' ', None, b'up'))
    else:
        span = f'from {spec.span} {spec.unit}'.rstrip()
        for end, side in ((spec.low, -math.inf), (spec.high, math.inf)):
            sign = int(math.copysign(1, side))
            beyond = end + sign if spec.kind == 'integer' else math.nextafter(end, side)
            far = end + sign * (abs(end) + 1)
            yield from ((value, span) for value in (beyond, far, math.nan, side, sign * 10**400))
            # As a person types it
            yield repr(far), span
        yield from ((value, 'give ') for value in NO_NUMBERS)
        if spec.least:
            yield 0.5 * spec.least, f'give 0 ({spec.zero}) or a number from {spec.least:g} to'
        if spec.kind == 'integer':
            yield spec.low + 0.5, 'give a whole number from'


@pytest.mark.parametrize('table', TABLES, ids=lambda table: table.__name__)
def test_every_parameter_has_its_range_and_says_so(table):
    """Both ends are in; below, above, not a number and of another type are refused by name."""

    def built(spec, value):
        return getattr(table(**{**SUPPORT.get(spec.name, {}), spec.name: value}), spec.name)

    def refusal(spec, value):
        with pytest.raises(ParameterError) as caught:
            pytest.fail(f'{spec.name} is {built(spec, value)}')
        assert caught.value.name == spec.name
        return str(caught.value)

    for name, spec in TABLES[table].items():
        listed = spec.kind == 'double_array'
        for end in {spec.low, spec.high} - {None, APART.get(name)}:
            assert built(spec, [end] if listed else end) == ((end,) if listed else end)
        for value, words in wrong_values(spec):
            inside = listed and isinstance(value, float | int) and not isinstance(value, bool)
            said = refusal(spec, [value] if inside else value)
            assert said.startswith(tuple(f'{name}{x} ' for x in (' is', '[0] is', ' has'))), said
            assert words in said, (value, said)
            assert ' %' not in said or not spec.unit
        for entries, count in (([], 0), ([1.0] * 2000, 2000), (itertools.repeat(1.0), 'or more')):
            if listed:
                said = refusal(spec, entries)
                assert f'{count} entries: give 1 to 1024, one for each harmonic' in said


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


def test_the_most_harmonics():
    most = dict.fromkeys(('amplitudes', 'frequencies', 'phases'), [1.0] * 1024)
    rig = RigParameters(**{f'force_{name}': value for name, value in most.items()})
    assert rig.force_phases == (1.0,) * 1024


def test_replace():
    """All at once or not at all; the tables are frozen."""
    rig = RigParameters()
    # Each of the two alone is not admissible.
    assert rig.replace(stiffness=0.01, damping=0.001).damping == 0.001
    assert repr(rig.replace(gap=12.0)) == 'RigParameters(gap=12.0)'
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
    assert RigParameters().x_max_ratio(10.0) == pytest.approx(0.1)
    for none in (rig, rig.replace(force_amplitudes=0.0)):
        assert math.isnan(none.x_max_ratio(1.0))


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


@pytest.mark.parametrize(
    ('changes', 'rate'),
    [
        ({}, 1.0),
        ({'stiffness': 16.0}, 4.0),
        ({'force_frequencies': 9.0}, 9.0),
        ({'force_frequencies': 9.0, 'force_amplitudes': 0.0}, 1.0),
        ({'multisine_level': 1.0, 'multisine_high': 12.0}, 12.0),
    ],
)
def test_the_fastest_of_spring_and_force(changes, rate):
    assert RigParameters(**changes).fastest == pytest.approx(rate)
