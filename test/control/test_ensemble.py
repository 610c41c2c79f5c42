"""An ensemble against its rigs, run one by one."""

import math

import numpy as np
import pytest

from impact_damper_ros.control import LawError, Outcome, Rig, run_ensemble
from impact_damper_ros.rig import (
    GapControlParameters,
    InitialConditions,
    Mode,
    RigParameters,
)

numba = pytest.importorskip('numba')

RNG = np.random.default_rng(5)
COUNT = 40
NINE = {
    'force_amplitudes': (1.0,) + (0.05,) * 8,
    'force_frequencies': tuple(0.6 + 0.1 * k for k in range(9)),
    'force_phases': tuple(0.3 * k for k in range(9)),
}


@pytest.mark.parametrize(
    ('rig', 'values', 'initial'),
    [
        ({'gravity': 0.0}, {'gap': np.linspace(10.0, 60.0, COUNT)}, {}),
        (
            {'gravity': 1.0, 'restitution_1': 0.4},
            {
                'angle': RNG.uniform(0.0, math.pi / 2, COUNT),
                'friction': RNG.uniform(0.0, 0.4, COUNT),
                'damper_mass': RNG.uniform(0.01, 0.4, COUNT),
                'stiffness': RNG.uniform(0.8, 1.2, COUNT),
                'gap': RNG.uniform(1.0, 20.0, COUNT),
            },
            {'initial_damper_offset': 0.3, 'initial_primary_position': 1.0},
        ),
        (
            {'one_sided': True, 'angle': math.pi / 2, 'gravity': 1.0, 'gap': 2.0, **NINE},
            {'restitution_1': np.linspace(0.2, 0.8, 5)},
            {'initial_damper_offset': 1.0, 'initial_damper_velocity': 1.0},
        ),
    ],
    ids=['gaps', 'all kinds', 'nine harmonics'],
)
def test_each_rig_runs_as_it_does_alone(rig, values, initial):
    parameters, start = RigParameters(**rig), InitialConditions(**initial)
    end, when = 120.0, [0.0, 33.3, 120.0]
    found = run_ensemble(parameters, values, end, when, initial=start, threads=2)
    assert (found.outcomes == Outcome.COMPLETE).all()
    assert (found.times == end).all()
    for k in range(len(found.outcomes)):
        one = parameters.replace(**{name: float(column[k]) for name, column in values.items()})
        alone = Rig(one, start).run(end, when)
        assert found.samples[k].tolist() == alone.samples.tolist()
        assert found.event_counts[k] == alone.event_count
        assert found.time_in_mode[k].tolist() == alone.time_in_mode.tolist()
    assert found.event_counts.sum() > 10 * len(found.outcomes)
    assert found.time_in_mode.shape == (len(found.outcomes), len(Mode))


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


@pytest.mark.parametrize(
    ('control', 'values', 'law'),
    [
        ({'gap_control': 'amplitude', 'gap_control_stops': 'symmetric'}, {}, None),
        (
            {'gap_control': 'timed', 'actuator_speed': 16.0, 'gap_control_rate': 5.0},
            {'gap_control_park': RNG.uniform(1.1, 2.0, COUNT), 'actuator_mass': np.ones(COUNT)},
            None,
        ),
        (
            {'gap_control': 'amplitude', 'gap_control_noise_position': 0.02},
            {'gap_control_seed': np.arange(COUNT), 'actuator_speed': RNG.integers(0, 9, COUNT)},
            None,
        ),
        # So many commands wait that there is no room at first.
        (
            {'gap_control': 'timed'},
            {'actuator_delay': np.where(np.arange(COUNT) % 2, 40.0, 0.0)},
            None,
        ),
        ({'gap_control': 'predictive', 'gap_control_stops': 'symmetric'}, {}, None),
        ({'gap_control': 'timed', 'gap_control_rate': 3.0}, {}, held),
    ],
    ids=['symmetric', 'timed', 'noise', 'delay', 'predictive', 'own law'],
)
def test_each_rig_under_control_runs_as_it_does_alone(control, values, law):
    parameters, start = RigParameters(gravity=1.0, angle=0.4), InitialConditions()
    given = GapControlParameters(**control)
    values = {'gap': RNG.uniform(5.0, 40.0, COUNT), **values}
    end, when = 90.0, [0.0, 50.0, 90.0]
    found = run_ensemble(parameters, values, end, when, control=given, law=law, threads=2)
    assert (found.outcomes == Outcome.COMPLETE).all()
    for k in range(0, COUNT, 9):
        here = {name: float(column[k]) for name, column in values.items()}
        rig = Rig(
            parameters.replace(gap=here.pop('gap')), start, control=given.replace(**here), law=law
        )
        alone = rig.run(end, when)
        assert found.samples[k].tolist() == alone.samples.tolist()
        assert found.event_counts[k] == alone.event_count
        assert found.time_in_mode[k].tolist() == alone.time_in_mode.tolist()
        assert tuple(found.actuator_energies[k]) == rig.energies
    assert found.event_counts.min() > 10
    assert found.actuator_energies.any() == ('actuator_speed' in {*control, *values})


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
