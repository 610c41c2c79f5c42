"""The contenders of benchmarks/peers.py: that each simulates the rig it is measured with."""

import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

from impact_damper_ros import Rig, RigParameters

sys.path.append(str(Path(__file__).parents[2] / 'benchmarks'))
peer_rigs = import_module('peer_rigs')
heyoka_rigs = import_module('heyoka_rigs')
cases = import_module('golden_cases').CASES

#: Impacts compared.
FIRST = 8
LEVEL, SLOPE, FRICTION = range(3)
ALL = (LEVEL, SLOPE, FRICTION)


@cache
def exact(case):
    """Return times and stops of the first impacts by the oracle."""
    from oracle.hybrid_oracle import simulate

    events = simulate(cases[case].changes, 300.0, max_events=3 * FIRST)
    impacts = [event for event in events if event.kind == 'impact'][:FIRST]
    assert len(impacts) == FIRST
    return [float(event.time) for event in impacts], [event.stop for event in impacts]


@pytest.mark.parametrize(
    ('module', 'make', 'error', 'number'),
    [
        pytest.param(module, make, error, number, id=f'{name}-{number}')
        for name, module, make, error, numbers in (
            ('heyoka', 'heyoka', lambda p: heyoka_rigs.HeyokaRig(p), 1e-12, ALL),
            (
                'fast_math',
                'heyoka',
                lambda p: heyoka_rigs.HeyokaRig(p, fast_math=True),
                1e-12,
                (FRICTION,),
            ),
            (
                'batch',
                'heyoka',
                lambda p: heyoka_rigs.HeyokaBatchRig(p, [p.gap] * 2),
                1e-12,
                (LEVEL, SLOPE),
            ),
            ('RK4', 'numba', lambda p: peer_rigs.RungeKuttaRig(p, 2000), 1e-9, ALL),
            ('solve_ivp', 'scipy', lambda p: peer_rigs.SolveIvpRig(p), 1e-8, ALL),
            # At resonance its soft contacts lead to another order after some impacts
            ('MuJoCo', 'mujoco', lambda p: peer_rigs.MujocoRig(p, 2000), 0.02, (SLOPE,)),
        )
        for number in numbers
    ],
)
def test_a_peer_finds_the_first_impacts(module, make, error, number):
    pytest.importorskip(module)
    times, stops = exact(number)
    found = make(RigParameters(**cases[number].changes)).run(times[-1] * 1.02)
    assert list(found[1])[:FIRST] == stops
    assert list(found[0])[:FIRST] == pytest.approx(times, rel=error)


def test_a_batch_resets_each_lane_by_itself():
    """Rigs with gaps so different that their impacts never coincide."""
    pytest.importorskip('heyoka')
    rig = RigParameters(**cases[SLOPE].changes)
    gaps = [37.0, 30.0, 20.0, 11.0]
    batch = heyoka_rigs.HeyokaBatchRig(rig, gaps)
    for _ in range(2):
        for gap, (times, stops) in zip(gaps, batch.run_all(60.0), strict=True):
            impacts = Rig(rig.replace(gap=gap)).run(60.0).impacts()
            assert stops == impacts['stop'].tolist()
            assert times == pytest.approx(impacts['time'].tolist(), rel=1e-9)
            assert len(times) > 5
    with pytest.raises(ValueError, match='no friction'):
        heyoka_rigs.HeyokaBatchRig(RigParameters(**cases[FRICTION].changes), gaps)
