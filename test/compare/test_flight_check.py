"""The closed form that checks a log is the motion of the simulator."""

import numpy as np
import pytest
from compare.recorded import recorded
from rigs import FRICTION, HORIZONTAL

from impact_damper_ros.compare.flight_check import check_intervals
from impact_damper_ros.compare.recorded_stretch import ForceClock, knots_of


@pytest.mark.parametrize(
    'rig',
    [
        HORIZONTAL,
        HORIZONTAL.replace(damping=0.0),
        FRICTION.replace(air_force=0.01),
        HORIZONTAL.replace(
            force_amplitudes=(1.0, 0.5), force_frequencies=(1.0, 7.3), force_phases=(0.2, 0.4)
        ),
        HORIZONTAL.replace(multisine_level=0.5, multisine_low=0.5, multisine_high=1.5),
    ],
    ids=['resonance', 'undamped', 'friction and air', 'two harmonics', 'multisine'],
)
def test_flights_are_those_of_the_simulator(rig):
    states, impacts, clock = recorded(rig, 60)
    if rig.multisine_level:
        clock = ForceClock(rig, 0.0, (0.0,) * len(rig.harmonics[0]))
    knots = knots_of(rig, states, impacts, 0)
    found = check_intervals(clock, knots)
    assert found.plain.mean() > 0.95
    assert found.sound[found.plain].all()
    # From one joint state to the next nothing is rounded.
    between = found.plain & (knots.stop[1:] == 0.0) & (knots.stop[:-1] == 0.0)
    assert np.abs(found.residuals[between]).max() < 2e-12
