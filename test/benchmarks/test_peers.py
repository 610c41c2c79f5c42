"""
The contenders of benchmarks/peers.py: that each simulates the rig it is measured with.

Those of heyoka and MuJoCo, which the tests do not install, are compared with the same oracle each
time that `peers.py` runs.
"""

import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from impact_damper_ros import RigParameters

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
peer_rigs = import_module('peer_rigs')
cases = import_module('golden_cases').CASES

#: Impacts compared.
FIRST = 8
LEVEL, SLOPE, FRICTION = range(3)


@cache
def exact(case):
    """Return times and stops of the first impacts by the oracle."""
    from oracle.hybrid_oracle import simulate

    events = simulate(cases[case].changes, 300.0, max_events=3 * FIRST)
    impacts = [event for event in events if event.kind == 'impact'][:FIRST]
    assert len(impacts) == FIRST
    return [float(event.time) for event in impacts], [event.stop for event in impacts]


@pytest.mark.parametrize('number', [LEVEL, SLOPE, FRICTION])
@pytest.mark.parametrize(
    ('make', 'error'),
    [
        (lambda rig: peer_rigs.RungeKuttaRig(rig, 2000), 1e-9),
        (lambda rig: peer_rigs.SolveIvpRig(rig), 1e-8),
    ],
    ids=['RK4', 'solve_ivp'],
)
def test_a_peer_finds_the_first_impacts(make, error, number):
    pytest.importorskip('numba')
    times, stops = exact(number)
    found = make(RigParameters(**cases[number].changes)).run(times[-1] * 1.02)
    assert list(found[1])[:FIRST] == stops
    assert list(found[0])[:FIRST] == pytest.approx(times, rel=error)
