"""Integrals over flights by series, beside the closed form of the motion on a fine grid."""

import numpy as np
import pytest

from impact_damper_ros import InitialConditions, Rig, RigParameters, load_parameters
from impact_damper_ros.orbits.flight_arrays import run_flights
from impact_damper_ros.orbits.settled_motion import cycle_of

BENCH = load_parameters('bench_rig')[0]
SHAKEN = {'force_amplitudes': 0.0, 'base_amplitudes': 0.01, 'base_frequencies': 33.0}
RIGS = {
    'at resonance': RigParameters(),
    'undamped at resonance': RigParameters(damping=0.0, gravity=0.0),
    'friction and air': RigParameters(angle=0.5, friction=0.3, gravity=1.0, air_force=0.02),
    'base': BENCH.replace(gap=0.01, **SHAKEN),
    'harmonics': RigParameters(
        force_amplitudes=(1.0, 0.3, 0.2),
        force_frequencies=(1.0, 2.3, 6.0),
        force_phases=(0.0, 1.0, 2.0),
    ),
    'rest on a stop': RigParameters(
        angle=1.5708, one_sided=True, gravity=1.0, damper_mass=0.01, force_amplitudes=0.05
    ),
}


@pytest.mark.parametrize('rig', RIGS.values(), ids=RIGS)
def test_integrals_are_those_of_the_closed_form(rig):
    start = InitialConditions(initial_primary_position=0.001)
    flights = run_flights(Rig(rig, start, compiled=None), 40.0 * cycle_of(rig))
    found, largest = flights.integrals()
    nodes, weights = np.polynomial.legendre.leggauss(60)
    count = np.ceil(flights.spans / cycle_of(rig)).astype(int)
    index = np.repeat(np.arange(len(flights)), count)
    number = np.arange(len(index)) - np.repeat(np.cumsum(count) - count, count)
    span = (flights.spans / np.maximum(count, 1))[index]
    index, width = np.repeat(index, 60), np.repeat(span, 60)
    tau = np.repeat(number * span, 60) + width * np.tile(0.5 * (nodes + 1.0), len(span))
    x, velocity, acceleration, force = flights.motion(index, tau)
    base, speed, rate = flights.base(index, tau)
    weight = width * np.tile(0.5 * weights, len(span))
    slip = velocity - speed
    assert found.covered == pytest.approx(flights.spans.sum(), rel=1e-13)
    size = weight @ np.abs(x)
    assert found.total == pytest.approx(weight @ x, abs=1e-12 * size)
    assert found.squares == pytest.approx(weight @ (x * x), rel=1e-12)
    assert found.dashpot == pytest.approx(rig.damping * (weight @ (slip * slip)), rel=1e-11)
    assert largest == pytest.approx(np.abs(x).max(), rel=5e-3)
    assert largest >= np.abs(x).max() * (1.0 - 1e-14)
    if rig.base_motion.moves:
        sums = [base, base * base, x * base, acceleration**2, rate * rate]
        expected = [weight @ one for one in sums]
        scales = [weight @ np.abs(one) for one in sums]
        assert (np.abs(np.subtract(found[-5:], expected)) < 1e-11 * np.array(scales)).all()
    else:
        assert found.force == pytest.approx(
            weight @ (force * velocity), abs=1e-12 * (weight @ np.abs(force * velocity))
        )
