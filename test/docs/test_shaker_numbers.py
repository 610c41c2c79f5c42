"""
The numbers of the page on base motion against an integration of the moving-base equations.

In coordinates that move with the table, u = X - b and w = Z - b, which the package does not use:
M u'' + C u' + K u = -M b'' between impacts, w'' = -b'', and b = -(a/W^2) sin(W t).
"""

import math
import re
from functools import cache

import numpy as np
import pytest
import scipy
from docs.tutorial import ROOT

from impact_damper_ros import find_orbits, load_parameters

PAGE = (ROOT / 'docs' / 'analysis' / 'base_motion.md').read_text(encoding='utf-8')
MASS, RATE, ZETA, MU, GAP, RESTITUTION = 5.0, 20.0 * math.pi, 0.02, 0.05, 0.018, 0.6
LEVEL = 0.2 * 9.80665


def integrated(hertz, state=(0.0,) * 4, start=0.0, settle=120, measure=20, per_cycle=400):
    """Return rms X/rms b and rms (X - b)/rms b of the last cycles, and the number of impacts."""
    drive = math.tau * hertz

    def base(time):
        return -LEVEL / drive**2 * np.sin(drive * time), -LEVEL / drive * np.cos(drive * time)

    def flow(time, y):
        shake = LEVEL * math.sin(drive * time)
        pull = -(RATE**2) * y[0] - 2.0 * ZETA * RATE * y[1]
        return [y[1], pull - shake, y[3], -shake]

    def stop(side):
        def distance(_, y):
            return side * (y[2] - y[0]) - 0.5 * GAP

        distance.terminal, distance.direction = True, 1.0
        return distance

    cycle = 1.0 / hertz
    time, end = start, start + (settle + measure) * cycle
    # The state is absolute where it is given, and at rest in the laboratory where it is not.
    place, speed = base(start)
    y = np.array(state) - [place, speed, place, speed]
    instants = end - cycle * np.arange(measure * per_cycle, 0, -1) / per_cycle
    samples, hits = [], 0
    while time < end:
        inside = instants[(instants >= time) & (instants < end)]
        run = scipy.integrate.solve_ivp(
            flow,
            (time, end),
            y,
            'DOP853',
            dense_output=True,
            events=[stop(1), stop(-1)],
            rtol=1e-9,
            atol=1e-13,
            max_step=0.05 * cycle,
        )
        if (inside := inside[inside < run.t[-1]]).size:
            samples.append(run.sol(inside)[0])
        time, y = run.t[-1], run.y[:, -1]
        if run.status == 1:
            mean = (y[1] + MU * y[3]) / (1.0 + MU)
            apart = RESTITUTION * (y[3] - y[1])
            y = [y[0], mean + MU * apart / (1.0 + MU), y[2], mean - apart / (1.0 + MU)]
            hits += time >= instants[0]
    relative, moved = np.concatenate(samples), base(instants)[0]
    assert len(relative) == len(moved)
    x = relative + moved
    return np.std(x) / np.std(moved), np.std(relative) / np.std(moved), hits / measure


@cache
def shown():
    """Return the table of the page: frequency to up, down and without the damper."""
    rows = re.findall(r'^ *([\d.]+) Hz +(\S+) +([\d.]+) +([\d.]+)$', PAGE, re.MULTILINE)
    return {float(hertz): numbers for hertz, *numbers in rows}


@pytest.fixture(scope='module')
def rig(tmp_path_factory):
    path = tmp_path_factory.mktemp('page') / 'table_rig.yaml'
    path.write_text(re.search(r'```yaml\n(.*?)```', PAGE, re.DOTALL)[1], encoding='utf-8')
    parameters, *_ = load_parameters(path)
    return parameters


@pytest.mark.parametrize(('hertz', 'column', 'impacts'), [(7.6, 0, 0), (10.0, 0, 2), (12.4, 1, 0)])
def test_from_rest(hertz, column, impacts):
    absolute, _, hits = integrated(hertz)
    assert float(shown()[hertz][column]) == pytest.approx(absolute, rel=0.01)
    assert hits == impacts


def test_relative_transmissibility_at_resonance():
    _, relative, _ = integrated(10.0)
    found = re.search(r'rms \(X - b\)/rms b ([\d.]+) \(', PAGE)
    assert float(found[1]) == pytest.approx(relative, rel=1e-3)


def test_downwards_with_impacts(rig):
    """The motion that a sweep downwards has at 7.6 Hz goes on."""
    below = rig.replace(base_frequencies='7.6 Hz')
    orbits = find_orbits(below, (1, 2)).orbits
    orbit = next(orbit for orbit in orbits if orbit.stable and orbit.viable)
    state = orbit.x[0], orbit.primary_velocity_after[0], orbit.x[0] + 0.5 * GAP
    # Phases count from the zero of b'' = a sin(W t)
    found = integrated(
        7.6, (*state, orbit.damper_velocity_after[0]), orbit.phases[0] / 7.6 + 1e-12, settle=20
    )
    assert float(shown()[7.6][1]) == pytest.approx(found[0], rel=0.01)
    assert found[2] == pytest.approx(2.0, abs=0.1)


def test_without_the_damper(rig):
    assert set(shown()) == {7.6, 10.0, 12.4}
    for hertz, (*_, alone) in shown().items():
        ratio = hertz / 10.0
        spring = complex(1.0, 2.0 * ZETA * ratio)
        assert float(alone) == pytest.approx(abs(spring / (spring - ratio**2)), rel=1e-3)
    assert (rig.zeta, rig.omega) == pytest.approx((ZETA, RATE))
