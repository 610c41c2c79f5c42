"""An ensemble against its rigs, run one by one."""

import math

import numpy as np
import pytest

from impact_damper_ros.control import Outcome, Rig, run_ensemble
from impact_damper_ros.rig import InitialConditions, Mode, ParameterError, RigParameters

pytest.importorskip('numba')

RNG = np.random.default_rng(5)
COUNT = 70
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


def test_a_rig_with_too_many_events_stops_alone():
    values = {'gap': [1.0, 1000.0]}
    found = run_ensemble(RigParameters(gravity=0.0), values, 200.0, [200.0], most_events=10)
    assert found.outcomes.tolist() == [Outcome.TOO_MANY_EVENTS, Outcome.COMPLETE]
    assert found.event_counts[0] == 10
    assert found.times[0] < found.times[1] == 200.0
    assert np.isnan(found.samples['x'][0, 0])


@pytest.mark.parametrize(
    ('rig', 'values', 'error', 'message'),
    [
        ({}, {'gap': [1.0, -2.0]}, ParameterError, 'gap is -2.0'),
        ({}, {'gap': [1.0, math.nan]}, ParameterError, 'gap is nan'),
        ({}, {'damping': [0.1, 1.9], 'stiffness': [1.0, 0.5]}, ParameterError, 'underdamped'),
        ({}, {'force_amplitudes': [1.0, 2.0]}, ParameterError, 'does not vary in an ensemble'),
        ({}, {'gap': [1.0, 2.0], 'angle': [0.1]}, ValueError, 'lists of one length'),
        ({}, {'gap': 1.0}, ValueError, 'lists of one length'),
        ({}, {}, ValueError, 'at least one parameter'),
        ({'sweep_mode': 'up'}, {'gap': [1.0]}, ParameterError, 'no stepped sine'),
    ],
)
def test_what_no_ensemble_can_be_is_refused(rig, values, error, message):
    with pytest.raises(error, match=message):
        run_ensemble(RigParameters(**rig), values, 10.0)


def test_m_must_start_within_every_gap():
    start = InitialConditions(initial_damper_offset=2.0)
    with pytest.raises(ParameterError, match='initial_damper_offset'):
        run_ensemble(RigParameters(), {'gap': [9.0, 3.0, 8.0]}, 10.0, initial=start)
