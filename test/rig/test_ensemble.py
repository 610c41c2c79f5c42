"""An ensemble against its rigs, run one by one."""

import math

import numpy as np
import pytest

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    LawError,
    Mode,
    Outcome,
    Rig,
    RigParameters,
    run_ensemble,
)
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS

numba = pytest.importorskip('numba')

RNG = np.random.default_rng(5)
COUNT = 40
NINE = {
    'force_amplitudes': (1.0,) + (0.05,) * 8,
    'force_frequencies': tuple(0.6 + 0.1 * k for k in range(9)),
    'force_phases': tuple(0.3 * k for k in range(9)),
}


@numba.njit
def held(seen, memory):
    """Hold the stops about m, by a count of the samples."""
    memory[0] += 1.0
    return 4.0 + 0.01 * memory[0] % 1.0, min(-4.0, seen.y)


@numba.njit
def astray(seen, memory):
    """Leave no gap once X is large."""
    memory[0] = seen.x
    return (4.0, -4.0) if seen.x < 2.0 else (-4.0, 4.0)


#: Parameters, the values of each rig, initial conditions, control and law
LEVEL = {'gravity': 0.0}
SLOPE = {'gravity': 1.0, 'angle': 0.4}
GAPS = {'gap': RNG.uniform(5.0, 40.0, COUNT)}
ENSEMBLES = {
    'gaps': (LEVEL, {'gap': np.linspace(10.0, 60.0, COUNT)}, {}, {}, None),
    'all kinds': (
        {'gravity': 1.0, 'restitution_1': 0.4},
        {
            'angle': RNG.uniform(0.0, math.pi / 2, COUNT),
            'friction': RNG.uniform(0.0, 0.4, COUNT),
            'damper_mass': RNG.uniform(0.01, 0.4, COUNT),
            'stiffness': RNG.uniform(0.8, 1.2, COUNT),
            'gap': RNG.uniform(1.0, 20.0, COUNT),
        },
        {'initial_damper_offset': 0.3, 'initial_primary_position': 1.0},
        {},
        None,
    ),
    'nine harmonics': (
        {'one_sided': True, 'angle': math.pi / 2, 'gravity': 1.0, 'gap': 2.0, **NINE},
        {'restitution_1': np.linspace(0.2, 0.8, COUNT)},
        {'initial_damper_offset': 1.0, 'initial_damper_velocity': 1.0},
        {},
        None,
    ),
    'symmetric': (SLOPE, GAPS, {}, {'gap_control_stops': 'symmetric'}, None),
    'timed': (
        SLOPE,
        {
            **GAPS,
            'gap_control_park': RNG.uniform(1.1, 2.0, COUNT),
            'actuator_mass': np.ones(COUNT),
        },
        {},
        {'gap_control': 'timed', 'actuator_speed': 16.0, 'gap_control_rate': 5.0},
        None,
    ),
    'noise': (
        SLOPE,
        {
            **GAPS,
            'gap_control_seed': np.arange(COUNT),
            'actuator_speed': RNG.integers(0, 9, COUNT),
        },
        {},
        {'gap_control_noise_position': 0.02},
        None,
    ),
    # So many commands wait that there is no room at first.
    'delay': (
        SLOPE,
        {**GAPS, 'actuator_delay': np.where(np.arange(COUNT) % 2, 40.0, 0.0)},
        {},
        {'gap_control': 'timed'},
        None,
    ),
    'own law': (SLOPE, GAPS, {}, {'gap_control': 'timed', 'gap_control_rate': 3.0}, held),
}


@pytest.mark.parametrize('name', ENSEMBLES)
def test_each_rig_runs_as_it_does_alone(name):
    rig, values, initial, control, law = ENSEMBLES[name]
    parameters, start = RigParameters(**rig), InitialConditions(**initial)
    given = GapControlParameters(**{'gap_control': 'amplitude', **control}) if control else None
    end, when = 90.0, [0.0, 33.3, 90.0]
    found = run_ensemble(
        parameters, values, end, when, initial=start, control=given, law=law, threads=2
    )
    assert (found.outcomes == Outcome.COMPLETE).all()
    assert (found.times == end).all()
    assert found.time_in_mode.shape == (COUNT, len(Mode))
    for k in range(0, COUNT, 5):
        here = {n: float(column[k]) for n, column in values.items()}
        of_rig = {n: value for n, value in here.items() if n in PARAMETER_SPECS}
        own = given and given.replace(**{n: here[n] for n in here.keys() - of_rig.keys()})
        alone = Rig(parameters.replace(**of_rig), start, control=own, law=law)
        result = alone.run(end, when)
        assert found.samples[k].tolist() == result.samples.tolist()
        assert found.event_counts[k] == result.event_count
        assert found.time_in_mode[k].tolist() == result.time_in_mode.tolist()
        if given:
            assert tuple(found.actuator_energies[k]) == alone.energies
    assert found.event_counts.sum() > 10 * COUNT
    if given:
        assert found.actuator_energies.any() == ('actuator_speed' in {*control, *values})


def test_what_is_kept_of_the_samples_is_in_the_order_of_the_rigs():
    count, rig = 150, RigParameters(gravity=0.0)
    values = {'gap': np.linspace(10.0, 60.0, count)}
    instants = np.linspace(0.0, 40.0, 9)
    whole = run_ensemble(rig, values, 40.0, instants).samples
    sizes = run_ensemble(
        *(rig, values, 40.0, instants),
        reduce=lambda samples: np.abs(samples['x']).max(axis=1),
        threads=3,
    ).samples
    assert whole.shape == (count, 9)
    assert sizes.tolist() == np.abs(whole['x']).max(axis=1).tolist()


def test_a_law_that_fails_names_its_rig():
    values = {'gap': [6.0, 8.0], 'damper_mass': [0.05, 0.04]}
    with pytest.raises(LawError, match=r'rig 0 of the ensemble: the law .*astray returned \(-4'):
        run_ensemble(RigParameters(gravity=0.0), values, 90.0, law=astray)


def test_a_rig_with_too_many_events_stops_alone():
    values = {'gap': [1.0, 1000.0]}
    found = run_ensemble(RigParameters(gravity=0.0), values, 200.0, [200.0], most_events=10)
    assert found.outcomes.tolist() == [Outcome.TOO_MANY_EVENTS, Outcome.COMPLETE]
    assert found.event_counts[0] == 10
    assert found.times[0] < found.times[1] == 200.0
    assert np.isnan(found.samples['x'][0, 0])


@pytest.mark.parametrize(
    ('values', 'words'),
    [
        ({'gap_control_seed': [0, 1.5, 3]}, 'gap_control_seed is 1.5: give a whole number'),
        ({'actuator_speed': [0.0, 1e-9, 1.0]}, 'actuator_speed is 1e-09 m/s: give 0'),
        ({'gap': [20.0, math.nan, 30.0]}, 'gap is nan m: give a number'),
    ],
)
def test_every_value_is_checked(values, words):
    """Not only the least and the largest one."""
    timed = GapControlParameters(gap_control='timed')
    with pytest.raises(ValueError, match=words):
        run_ensemble(RigParameters(gravity=0.0), values, 5.0, control=timed)
