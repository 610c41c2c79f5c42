"""What a bench test shows, against rigs that are run step by step."""

import math

import numpy as np
import pytest
from rigs import TABLE

from impact_damper_ros import Rig, load_parameters, settle
from impact_damper_ros.design.bench_test import (
    bench_test,
    flight_laws,
    knowledge,
    swept,
    switched_on,
    varied,
)


@pytest.fixture(scope='module')
def rig():
    return TABLE.replace(gap=0.0215)


@pytest.mark.parametrize('values', [{}, {'friction': 0.05}, {'friction': 0.02, 'angle': 0.1}])
def test_the_laws_of_flights_give_restitution_friction_and_gap(rig, values):
    """Linear least squares over exact flights returns what the rig has."""
    there = rig.replace(**values)
    rows, constants, _ = flight_laws(there, Rig(there).run(6.0).events)
    unknowns = 3 if there.friction else (0, 2)
    laws = rows.reshape(-1, 3)
    laws = laws if unknowns == 3 else laws[:, unknowns]
    found = np.linalg.lstsq(laws, -constants.ravel(), rcond=None)[0]
    alpha, gap = found[0], found[-1]
    mu = there.mass_ratio
    assert (1.0 + mu) / (mu * alpha) - 1.0 == pytest.approx(0.6, rel=1e-6)
    assert gap == pytest.approx(there.gap, rel=1e-6)
    if there.friction:
        grip = there.friction * there.gravity * math.cos(there.angle)
        assert found[1] == pytest.approx(grip, rel=1e-5)


def test_the_settled_motion_does_not_tell_and_the_start_does(rig):
    """Two impacts per cycle are one flight again and again: two laws for three unknowns."""
    alone = knowledge(rig, settled=True)
    assert alone.repeats
    assert alone.flights > 150
    assert alone.deviations == (math.inf,) * 3
    start = knowledge(rig)
    assert max(start.deviations) < 0.01
    irregular = knowledge(rig.replace(gap=1.1 * rig.gap))
    assert not irregular.repeats
    assert irregular.deviations[0] < start.deviations[0]


def test_switched_on(rig):
    run = switched_on(rig)
    first = next(event for event in Rig(rig).advance(5.0) if event.stop)
    assert run.first_impact == first.time
    # Two impacts in each cycle of 0.1 s
    assert run.impact_rate == pytest.approx(20.0)
    motion = settle(Rig(rig))
    assert run.settled.x_max == motion.x_max
    times = np.linspace(run.settling_time, run.settling_time + 1.0, 641)
    x = np.abs(Rig(rig).run(float(times[-1]), times).samples['x']).max()
    assert x == pytest.approx(motion.x_max, rel=0.06)
    half = switched_on(rig.replace(base_amplitudes=0.5 * rig.base_amplitudes[0]))
    assert (half.first_impact, half.impact_speed, half.impact_rate) == (math.inf, 0.0, 0.0)


def test_a_sweep_is_that_of_settled_rigs_where_there_is_one_motion():
    bench, _, _ = load_parameters('bench_rig')
    found = swept(bench)
    assert found.frequencies[[0, -1]] == pytest.approx(np.array([0.8, 1.2]) * 31.416)
    for k in np.flatnonzero(~found.differs)[::4]:
        there = bench.with_first_frequency(float(found.frequencies[k]))
        settled = settle(Rig(there))
        if settled.period is not None and settled.x_max > 0.9 * found.up[k]:
            assert found.up[k] == pytest.approx(settled.x_max, rel=0.02)
    # Below resonance m is heard on the way down only, until it comes to rest
    quiet = found.impacts_up == 0.0
    assert (quiet & (found.impacts_down > 1.9)).any()
    assert (found.down > 1.2 * found.up)[quiet].any()
    without = swept(bench.replace(gap=1.0))
    assert without.up[2:] == pytest.approx(without.bare[2:], rel=0.03)
    assert not without.impacts_up.any()


def test_what_is_varied(rig):
    found = varied(rig, 'restitution', (0.5, 0.7))
    for value, x in zip(found.values, found.x_max, strict=True):
        settled = settle(Rig(rig.replace(restitution_1=value, restitution_2=value)))
        assert x == pytest.approx(settled.x_max, rel=1e-3)
    levels = varied(rig, 'level', (0.5, 1.0))
    assert levels.ratios[0] == pytest.approx(1.0, abs=1e-3)
    assert levels.ratios[1] == pytest.approx(
        settle(Rig(rig)).x_max / rig.response_amplitude, rel=1e-3
    )


@pytest.mark.parametrize(
    'values',
    [
        {'force_amplitudes': 0.0, 'multisine_level': 1.0},
        {'force_phases': (0, 0), 'force_amplitudes': (1, 1), 'force_frequencies': (31, 32)},
        {'sweep_mode': 'up'},
    ],
)
def test_a_rig_that_no_sine_shakes_is_refused(values):
    bench, _, _ = load_parameters('bench_rig')
    with pytest.raises(ValueError, match='not shaken by one lasting sine'):
        bench_test(bench.replace(**values), {}, (1.0,))
