"""Motions known in advance: the design's values, closed forms and limits."""

import math
import subprocess
import sys

import numpy as np
import pytest
from rigs import FRICTION, HORIZONTAL, INCLINED, VERTICAL

from impact_damper_ros import SpecialKind, find_orbits, follow

PAIRS = ([0.94121] * 2 + [0.57951] * 2, [0.94107] * 2 + [0.57960] * 2)


@pytest.mark.parametrize(
    ('rig', 'phases', 'x', 'velocity', 'damper_velocity', 'digit', 'x_max', 'moduli'),
    [
        (HORIZONTAL, (0.733784, 0.233784), (9.9294, -9.9294), (-1.9340, 1.9340),
         (-18.0987, 18.0987), 0.51e-4, None, None),
        (INCLINED, (0.7513744, 0.2632173), (4.2199719, -4.0551342), (-1.3654370, 1.8294568),
         (-15.4743588, 13.9932174), 0.51e-7, 0.2032358, PAIRS[0]),
        (FRICTION, (0.7579950, 0.2697923), (4.1321400, -3.9291024), (-1.9067334, 2.3620421),
         (-15.9650212, 14.4522209), 0.51e-7, 0.2113439, PAIRS[1]),
    ],
    ids=['horizontal', 'inclined', 'inclined with friction'],
)  # fmt: skip
def test_golden_rows(rig, phases, x, velocity, damper_velocity, digit, x_max, moduli):
    found = find_orbits(rig, (1, 2))
    assert found.report.complete is (rig.friction == 0.0)
    (orbit,) = (orbit for orbit in found.orbits if orbit.viable)
    assert (orbit.stable, orbit.reason) == (True, '')
    assert orbit.residual < 1e-14
    assert orbit.phases == pytest.approx(phases, abs=max(0.02 * digit, 0.51e-7))
    assert orbit.x == pytest.approx(x, abs=digit)
    assert orbit.primary_velocity_after == pytest.approx(velocity, abs=digit)
    assert orbit.damper_velocity_after == pytest.approx(damper_velocity, abs=digit)
    if x_max is not None:
        assert orbit.x_max_ratio == pytest.approx(x_max, abs=0.51e-7)
        assert [abs(m) for m in orbit.multipliers] == pytest.approx(moduli, abs=0.51e-5)
        # Two complex pairs
        assert orbit.multipliers[::2] == tuple(m.conjugate() for m in orbit.multipliers[1::2])


def symmetric_displacements(rig):
    """
    Return X_1 of the motions with two equispaced impacts, after Masri and Caughey (1966).

    The second half of the period mirrors the first. m flies at a constant speed
    w = (2 X_1 + d) W/pi, each impact gives M the velocity 2 mu w, and what is not steady response
    satisfies (Phi + 1) xi = (0, 2 mu w) over half a period.
    """
    W, w, z = rig.force_frequencies[0], rig.omega, rig.zeta
    mu, R, d = rig.mass_ratio, rig.restitution_1, rig.gap
    h = math.pi / W
    E, wd = math.exp(-z * w * h), w * rig.eta
    c, s = math.cos(wd * h), math.sin(wd * h)
    phi_11, phi_12 = E * (c + z * w / wd * s), E * s / wd
    whole = 1.0 + 2.0 * E * c + E * E
    p_1, p_2 = -phi_12 / whole, (1.0 + phi_11) / whole
    # A sin tau = X - 2 mu w p_1 and A W cos tau = w q, with w = (2 X + d) W/pi
    q = ((R - 1.0 + 2.0 * mu * R) / (1.0 + R) - 2.0 * mu * p_2) / W
    k = 2.0 * mu * p_1
    slope, base = 2.0 * W / math.pi, d * W / math.pi
    sine = np.polynomial.Polynomial([-k * base, 1.0 - k * slope])
    cosine = np.polynomial.Polynomial([q * base, q * slope])
    roots = (sine**2 + cosine**2 - rig.response_amplitude**2).roots()
    return sorted(root.real for root in roots if abs(root.imag) < 1e-12)


@pytest.mark.parametrize('ratio', [0.6, 1.0, 1.02])
@pytest.mark.parametrize('gap', [5.0, 37.0])
@pytest.mark.parametrize('restitution', [0.3, 1.0])
def test_symmetric_motion_is_that_of_masri_and_caughey(ratio, gap, restitution):
    rig = HORIZONTAL.replace(
        gap=gap,
        restitution_1=restitution,
        restitution_2=restitution,
        force_frequencies=(ratio,),
        damping=0.03,
    )
    expected = symmetric_displacements(rig)
    orbits = [
        orbit
        for orbit in find_orbits(rig, (1, 2)).orbits
        if abs(orbit.durations[0] - 0.5 * orbit.period) < 1e-9 * orbit.period
    ]
    assert sorted(orbit.x[0] for orbit in orbits) == pytest.approx(expected, rel=1e-11)
    for orbit in orbits:
        assert orbit.x[1] == pytest.approx(-orbit.x[0], rel=1e-12)
        assert orbit.damper_velocity_after[0] == pytest.approx(
            -(2.0 * orbit.x[0] + gap) * ratio / math.pi, rel=1e-11
        )


def test_heavy_table_limit():
    """A massless ball on a vibrating table: the stable range is known in closed form."""
    ratio = 0.5
    first = math.pi * (1 - ratio) / (1 + ratio)
    second = math.hypot(first, 2 * (1 + ratio**2) / (1 + ratio) ** 2)
    rig = VERTICAL.replace(damper_mass=1e-9, restitution_1=ratio, force_amplitudes=1.0)
    loudness = 100.0 * rig.response_amplitude
    rig = rig.replace(force_amplitudes=0.5 * (first + second) / loudness)
    (orbit,) = (orbit for orbit in find_orbits(rig, (1,)).orbits if orbit.stable)
    branch = follow(orbit, 'force_amplitudes', 0.1, 3.0)
    edges = {special.kind: loudness * special.value for special in branch.special}
    assert edges[SpecialKind.FOLD] == pytest.approx(first, abs=1e-6)
    assert edges[SpecialKind.PERIOD_DOUBLING] == pytest.approx(second, abs=1e-6)


def test_mirrored_rig_has_mirrored_motion():
    """Turning the incline upside down exchanges the stops and shifts the force by half a cycle."""
    up = INCLINED.replace(restitution_1=0.6, restitution_2=0.8, air_force=0.01)
    down = up.replace(angle=-up.angle, restitution_1=0.8, restitution_2=0.6)
    first = find_orbits(up, (1, 2)).orbits
    second = find_orbits(down, (2, 1)).orbits
    assert len(first) == len(second)
    assert any(orbit.viable for orbit in first)
    for a, b in zip(first, second, strict=True):
        assert b.x == pytest.approx([-x for x in a.x], rel=1e-10)
        assert b.x_max == pytest.approx(a.x_max, rel=1e-12)
        shift = [(p - q) % 1.0 for p, q in zip(a.phases, b.phases, strict=True)]
        assert shift == pytest.approx([0.5, 0.5], abs=1e-11)


def test_force_phase_shifts_the_phases_only():
    plain = find_orbits(INCLINED, (1, 2)).orbits[0]
    shifted = find_orbits(INCLINED.replace(force_phases=(0.7,)), (1, 2)).orbits[0]
    assert shifted.x == pytest.approx(plain.x, rel=1e-11)
    for a, b in zip(plain.phases, shifted.phases, strict=True):
        assert (a - b) % 1.0 == pytest.approx(0.7 / math.tau, abs=1e-12)


def test_compiled_simulator_and_compiled_theory_in_one_process():
    """Functions of the code loaded first once took the place of those in the code loaded next."""
    pytest.importorskip('numba')
    program = (
        'from impact_damper_ros import Rig, find_orbits, load_parameters;'
        'rig = load_parameters("bench_rig")[0];'
        'Rig(rig, compiled=True).run(1.0);'
        'print(round(find_orbits(rig, (1, 2)).orbits[0].x_max, 9))'
    )
    words = [sys.executable, '-c', program]
    done = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, '0.003249641\n')
