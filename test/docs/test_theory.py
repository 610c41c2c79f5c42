"""What the pages of the theory state: the paper's equations as corrected, and some others."""

import importlib.util
import math
import random
import re
from pathlib import Path

import numpy as np
import pytest
from rigs import FRICTION, HORIZONTAL

import impact_damper_ros
from impact_damper_ros import (
    EventKind,
    InitialConditions,
    Rig,
    RigParameters,
    find_orbits,
    follow,
    settle,
)
from impact_damper_ros.design.damper_design import best_design
from impact_damper_ros.design.mass_damper import den_hartog, mass_damper_response
from impact_damper_ros.motion.flight import support_need
from impact_damper_ros.orbits.flights import machine_of, moving_at

ROOT = Path(impact_damper_ros.__file__).parents[1]
PAGES = sorted((ROOT / 'docs' / 'theory').glob('*.md'))
HEAVIER = FRICTION.replace(
    primary_mass=2.0, stiffness=2.0, damping=0.02, damper_mass=0.084, force_amplitudes=(2.0,)
)


@pytest.fixture(scope='module')
def motion():
    """Return the motion with two impacts of a rig, stop sequence 1, 2 if not given."""
    known = {}

    def found(rig, stops=(1, 2)):
        if (rig, stops) not in known:
            known[rig, stops] = find_orbits(rig, stops, simulate=False).orbits[0]
        return known[rig, stops]

    return found


class Paper:
    """
    The paper's equations for a motion that is known, as corrected but for one erratum.

    Errata have the numbers of docs/theory/errata.md. Indices count from 0.
    """

    def __init__(self, orbit, erratum=0):
        rig = orbit.parameters
        self.orbit, self.rig, self.erratum, self.N = orbit, rig, erratum, orbit.impacts
        self.W, self.w, self.z, self.h = (
            rig.force_frequencies[0],
            rig.omega,
            rig.zeta,
            rig.eta,
        )
        self.r, self.mu, self.A = self.W / rig.omega, rig.mass_ratio, rig.response_amplitude
        self.psi = math.atan2(2 * rig.zeta * self.r, 1 - self.r**2)
        if erratum == 4:
            self.psi = math.atan(2 * rig.zeta * self.r / (1 - self.r**2))
        self.t, self.X = np.array(orbit.instants), np.array(orbit.x)
        self.tau = self.W * self.t[0] - self.psi
        self.Xa, self.Xb = orbit.primary_velocity_after, orbit.primary_velocity_before
        self.Za = orbit.damper_velocity_after
        self.Y = np.array([rig.gap / 2 if stop == 1 else -rig.gap / 2 for stop in orbit.stops])
        both = {1: rig.restitution_1, 2: rig.restitution_2}
        self.R = [both[stop] for stop in orbit.stops]
        way = np.sign(np.roll(self.Y, -1) - self.Y)
        grip = rig.friction * rig.gravity * math.cos(rig.angle)
        self.g = rig.gravity * math.sin(rig.angle) - way * grip
        self.F = way * self.mu * grip * (1.0 if erratum == 5 else rig.primary_mass)
        self.deflection = self.F / rig.stiffness

    def angle(self, i):
        """Return alpha_i, i = 0 at the first impact."""
        turns, j = divmod(i, self.N)
        return self.W * (self.t[j] - self.t[0] + turns * self.orbit.period)

    def flight(self, i):
        """Return C_1i to C_4i, and the duration of the flight."""
        T = (self.angle(i + 1) - self.angle(i)) / self.W
        E, f = math.exp(-self.z * self.w * T), self.h * self.w * T
        C1, C2 = E * math.sin(f), E * math.cos(f)
        return (
            C1,
            C2,
            self.w * (self.h * C2 - self.z * C1),
            -self.w * (self.z * C2 + self.h * C1),
            T,
        )

    def start(self, i):
        """Return a_i and b_i."""
        phase = self.angle(i) + (-self.psi if self.erratum == 2 else self.tau)
        b = self.X[i] - self.A * math.sin(phase) - self.deflection[i]
        a = self.Xa[i] / self.w - self.A * self.r * math.cos(phase) + self.z * b
        return a / self.h, b

    def ways(self, i):
        """Return the ways of m before and after impact i, as (12) to (15) have them."""
        last, here, after = (k % self.N for k in (i - 1, i, i + 1))
        (*_, T), (*_, T_last) = self.flight(here), self.flight(last)
        before = self.Y[here] - self.Y[last] + self.g[last] * T_last**2 / 2
        then = self.Y[after] - self.Y[here] - self.g[here] * T**2 / 2
        return before, then, T_last, T

    def velocities(self, i):
        """Return the residuals of (12) and (13)."""
        last, after = (i - 1) % self.N, (i + 1) % self.N
        before, then, T_last, T = self.ways(i)
        mean_b = (self.X[i] - self.X[last] + before) / T_last
        mean_a = (self.X[after] - self.X[i] + then) / T
        late = mean_a
        if self.erratum == 1:
            late = (self.X[after] - self.X[i] + self.Y[after] - self.Y[i]) / T_last
            late -= self.g[i] * T / 2
        R, mu = self.R[i], self.mu
        return (
            ((1 + mu) * R * mean_b + (1 - mu * R) * late) / (1 + R) - self.Xa[i],
            ((R - mu) * mean_b + (1 + mu) * mean_a) / (1 + R) - self.Xb[i],
        )

    def ends(self, i):
        """Return the residuals of (3) and (4)."""
        C1, C2, C3, C4, _ = self.flight(i)
        a, b = self.start(i)
        phase, after = self.angle(i + 1) + self.tau, (i + 1) % self.N
        return (
            C1 * a + C2 * b + self.A * math.sin(phase) + self.deflection[i] - self.X[after],
            C3 * a + C4 * b + self.A * self.W * math.cos(phase) - self.Xb[after],
        )

    def coefficients(self, i):
        """Return W_1i to W_6i and V_1i to V_7i, the first at index 1."""
        C1, C2, C3, C4, T = self.flight(i)
        h, w, z, r, mu, W = self.h, self.w, self.z, self.r, self.mu, self.W
        after = (i + 1) % self.N
        before, then, T_last, _ = self.ways(i)
        _, later, _, T_next = self.ways(after)
        R, R_next = self.R[i], self.R[after]
        G1, G2 = (1 + mu) * R / ((1 + R) * T_last), (1 - mu * R) / ((1 + R) * T)
        G3, G4 = (R_next - mu) / ((1 + R_next) * T), (1 + mu) / ((1 + R_next) * T_next)
        c, s = math.cos(self.angle(i)), math.sin(self.angle(i))
        c_1, s_1 = math.cos(self.angle(i + 1)), math.sin(self.angle(i + 1))
        first = before
        if self.erratum == 6:
            first += self.Y[after] - self.Y[i]
        drop = self.deflection[i]
        return (
            (
                0.0,
                C1 / (h * w) * (G2 - G1 - z * w) - C2,
                1 - C1 * G2 / (h * w),
                C1 * G1 / (h * w),
                C1 * (r * c + z * s) / h + C2 * s - s_1,
                C1 * (-r * s + z * c) / h + C2 * c - c_1,
                C1 / (h * w) * (G1 * first + G2 * then) - drop * (C1 * z / h + C2 - 1),
            ),
            (
                0.0,
                -G3 - C4 - C3 / (h * w) * (G1 - G2 + z * w),
                G3 - G4 - C3 * G2 / (h * w),
                G4,
                C3 * G1 / (h * w),
                C3 * (r * c + z * s) / h + C4 * s - W * c_1,
                C3 * (-r * s + z * c) / h + C4 * c + W * (c_1 if self.erratum == 7 else s_1),
                -G3 * (then + self.g[i] * T**2)
                - G4 * later
                + C3 / (h * w) * (G1 * before + G2 * then)
                - drop * (C4 + z * C3 / h),
            ),
        )

    def governing(self, i):
        """Return the residuals of (14) and (15)."""
        W, V = self.coefficients(i)
        X = [self.X[k % self.N] for k in (i - 1, i, i + 1, i + 2)]
        c, s = self.A * math.cos(self.tau), self.A * math.sin(self.tau)
        return (
            W[1] * X[1] + W[2] * X[2] + W[3] * X[0] + W[4] * c + W[5] * s - W[6],
            V[1] * X[1] + V[2] * X[2] + V[3] * X[3] + V[4] * X[0] + V[5] * c + V[6] * s - V[7],
        )

    def section_map(self, i):
        """Return P_i."""
        C1, C2, C3, C4, T = self.flight(i)
        h, w, z, mu, W, A = self.h, self.w, self.z, self.mu, self.W, self.A
        R = self.R[(i + 1) % self.N]
        a, b = self.start(i)
        here, there = self.angle(i) + self.tau, self.angle(i + 1) + self.tau
        Q2, Q3 = (self.g[i] * T + self.Za[i]) / W, self.g[i] / W
        k1, k2 = (1 - mu * R) / (1 + mu), mu * (1 + R) / (1 + mu)
        k3, k4 = (1 + R) / (1 + mu), (mu - R) / (1 + mu)
        S1, S2, S3, S4 = (z * C1 + h * C2) / h, C1 / (h * w), -w * C1 / h, C3 / (h * w)
        S6 = (a * C3 + b * C4) / W
        S5 = Q2 - A * math.cos(there) - S6
        S7, S8, S9, S10 = S1 / S5, S2 / S5, -1 / S5, -T / S5
        by_phase = -A * S1 * math.cos(here) + A * W * S2 * math.sin(here) - S6
        S11 = (by_phase + Q2) / S5
        S12 = A * math.cos(there) + S6
        u = self.Xa[i] - A * W * math.cos(here)
        S13 = (-w * b * C3 + (h * C4 - z * C3) * u) / (h * W)
        S14 = S13 - A * W * math.sin(there)
        turned = -A * S3 * math.cos(here) + A * W * S4 * math.sin(here) - S13 + S11 * S14
        slid = Q2 if self.erratum == 12 else Q3
        return np.array(
            [
                [
                    S1 + S12 * (S7 + (S8 if self.erratum == 11 else S9)),
                    S2 + S12 * S8,
                    S10 * S12,
                    by_phase + S11 * S12,
                ],
                [
                    k1 * (S3 + S7 * S14 + S9 * S14) + k2 * Q3 * (S7 + S9),
                    k1 * (S4 + S8 * S14) + k2 * Q3 * S8,
                    k1 * S10 * S14 + k2 * (1 + Q3 * S10),
                    k1 * turned + k2 * Q3 * (S11 - 1),
                ],
                [
                    k3 * (S3 + S7 * S14 + S9 * S14) + k4 * Q3 * (S7 + S9),
                    k3 * (S4 + S8 * S14) + k4 * Q3 * S8,
                    k3 * S10 * S14 + k4 * (1 + Q3 * S10),
                    k3 * turned + k4 * slid * (S11 - 1),
                ],
                [S7 + S9, S8, S10, S11],
            ]
        )

    def multipliers(self, order):
        """Return the moduli of the eigenvalues of the product of P_i, the first on the right."""
        product = np.eye(4)
        for i in order:
            product = self.section_map(i) @ product
        return np.sort(np.abs(np.linalg.eigvals(product)))


def residuals(paper, name):
    """Return the largest residual of each of a pair of equations."""
    return np.abs([getattr(paper, name)(i) for i in range(paper.N)]).max(axis=0)


@pytest.mark.parametrize(
    ('rig', 'stops'),
    [
        (FRICTION, (1, 2)),
        (HEAVIER, (1, 2)),
        (FRICTION.replace(restitution_2=0.7), (1, 2)),
        (HORIZONTAL.replace(force_frequencies=(1.02,), gap=18.0), (1, 1, 2)),
    ],
    ids=['friction', 'heavier', 'unequal', 'three impacts'],
)
def test_the_papers_equations_hold_as_corrected(motion, rig, stops):
    orbit = motion(rig, stops)
    paper = Paper(orbit)
    for name in ('velocities', 'ends', 'governing'):
        assert residuals(paper, name).max() < 1e-12
    expected = np.sort(np.abs(orbit.multipliers))
    assert paper.multipliers(range(paper.N)) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ('erratum', 'rig', 'name', 'expected'),
    [
        (1, FRICTION, 'velocities', (0.38, 0.0)),
        (2, FRICTION, 'ends', (29, 18)),
        (4, FRICTION, 'governing', (0.29, 3.2)),
        (5, HEAVIER, 'ends', (0.015, 0.00098)),
        (6, FRICTION, 'governing', (0.69, 0.0)),
        (7, FRICTION, 'governing', (0.0, 23)),
    ],
)
def test_an_error_that_is_printed_leaves_this_residual(motion, erratum, rig, name, expected):
    found = residuals(Paper(motion(rig), erratum), name)
    assert found == pytest.approx(expected, rel=0.02, abs=1e-12)


def test_errors_in_the_matrix_of_stability(motion):
    two = motion(FRICTION)
    moduli = Paper(two).multipliers([0, 1])
    assert moduli == pytest.approx([0.57960, 0.57960, 0.94107, 0.94107], abs=1e-5)
    assert Paper(two, 11).multipliers([0, 1])[-1] == pytest.approx(1.13, abs=0.005)
    assert Paper(two, 12).multipliers([0, 1])[[0, -1]] == pytest.approx([0.426, 0.948], abs=1e-3)
    assert Paper(two).multipliers([0, 1, 0])[-1] == pytest.approx(0.958, abs=5e-4)
    three = Paper(motion(HORIZONTAL.replace(force_frequencies=(1.02,), gap=18.0), (1, 1, 2)))
    assert three.multipliers([0, 1, 2])[-1] == pytest.approx(0.962, abs=1e-3)
    assert three.multipliers([2, 1, 0])[-1] == pytest.approx(1.133, abs=1e-3)


def test_equation_16_and_where_it_is_empty(motion):
    """The paper's elimination of both displacements leaves A cos tau and A sin tau."""

    def left(orbit):
        paper = Paper(orbit)
        (W1, V1), (W2, V2) = paper.coefficients(0), paper.coefficients(1)
        rows = [
            [W1[1], W1[2] + W1[3], W1[4], W1[5], W1[6]],
            [W2[2] + W2[3], W2[1], W2[4], W2[5], W2[6]],
            [V1[1] + V1[3], V1[2] + V1[4], V1[5], V1[6], V1[7]],
            [V2[2] + V2[4], V2[1] + V2[3], V2[5], V2[6], V2[7]],
        ]
        places, forced = np.array(rows)[:, :2], np.array(rows)[:, 2:]

        def without_x(column):
            """Return a pair of rows without one displacement, times what removes the other."""
            a, b = places[:2], places[2:]
            w = a[1, column] * forced[0] - a[0, column] * forced[1]
            v = b[1, column] * forced[2] - b[0, column] * forced[3]
            other = 1 - column
            w_x = a[1, column] * a[0, other] - a[0, column] * a[1, other]
            v_x = b[1, column] * b[0, other] - b[0, column] * b[1, other]
            return v_x * w - w_x * v

        L, K = without_x(0), without_x(1)
        M3 = L[0] * K[1] - L[1] * K[0]
        M2 = L[2] * K[1] - L[1] * K[2]
        M1 = L[0] * K[2] - L[2] * K[0]
        return M1, M2, M3, paper

    M1, M2, M3, paper = left(motion(FRICTION))
    cosine, sine = paper.A * math.cos(paper.tau), paper.A * math.sin(paper.tau)
    found = M2 / M3, M1 / M3
    assert found == pytest.approx((cosine, sine), rel=1e-9)
    empty = left(motion(HORIZONTAL))[:3]
    assert max(map(abs, empty)) < 1e-12 * max(abs(M1), abs(M2), abs(M3))


def test_relative_acceleration_is_that_of_the_need():
    """Y'' = -(1 + mu)(n + lambda f), whichever way m slides."""
    rng = random.Random(28)
    for _ in range(200):
        rig = RigParameters(
            primary_mass=rng.uniform(0.5, 3.0),
            stiffness=rng.uniform(0.5, 9.0),
            damping=rng.uniform(0.0, 0.5),
            damper_mass=rng.uniform(0.05, 2.0),
            angle=rng.uniform(-1.5, 1.5),
            friction=rng.uniform(0.1, 1.0),
            gravity=rng.uniform(0.1, 9.0),
            air_force=rng.uniform(0.0, 1.0),
            force_frequencies=(rng.uniform(0.5, 2.0),),
        )
        machine = machine_of(rig)
        way = rng.choice([-1.0, 1.0])
        x, velocity, instant = (rng.uniform(-3.0, 3.0) for _ in range(3))
        moving = moving_at(machine, instant, x, velocity, -10.0, way, 0, rng.choice([0, 1, 2]))
        need = support_need(moving, velocity)
        expected = -(1.0 + rig.mass_ratio) * (need + way * machine.constants.grip)
        assert moving.run.relative_acceleration == pytest.approx(expected, rel=1e-12, abs=1e-13)


def test_determinant_with_a_reversal():
    """A reversal contracts by (|n| - f)/(|n| + f)."""
    rig = FRICTION.replace(gap=18.0)
    settled = settle(Rig(rig))
    orbit = settled.orbit
    period = settled.events[settled.events['time'] > settled.end - orbit.period]
    slope, grip = (
        rig.gravity * math.sin(rig.angle),
        rig.friction * rig.gravity * math.cos(rig.angle),
    )
    reversals = period[period['kind'] == EventKind.REVERSAL]
    assert len(reversals) == len(orbit.events) > 0
    expected = math.exp(-2.0 * rig.zeta * rig.omega * orbit.period) * 0.75 ** (2 * orbit.impacts)
    for event in reversals:
        force = math.sin(rig.force_frequencies[0] * event['time']) + rig.damper_mass * slope
        force -= rig.damping * event['primary_velocity_before'] + rig.stiffness * event['x']
        need = abs(force / (rig.primary_mass + rig.damper_mass) - slope)
        expected *= (need - grip) / (need + grip)
    assert np.prod(orbit.multipliers) == pytest.approx(expected, rel=1e-8)


def best_gap_of(zeta, mu, R):
    """Return the damping ratio that impacts add, X_m over X_0, and the best gap over X_0."""
    gain = (1.0 + R) / (1.0 - R)
    added = 2.0 / math.pi * mu / (1.0 + mu) * gain
    left = zeta / (zeta + added)
    return added, left, math.pi * left * gain / (1.0 + mu)


def test_the_best_gap_is_that_of_the_exact_motion():
    rig = RigParameters(gravity=0.0)
    added, left, gap = best_gap_of(rig.zeta, rig.mass_ratio, rig.restitution_1)
    x_0 = rig.response_amplitude
    assert (round(added, 3), round(left * x_0, 2), round(gap * x_0, 1)) == (0.180, 2.71, 57.2)
    best = follow(find_orbits(rig, (1, 2)).orbits[0], 'gap', 37.0, 62.0).best('x_max')
    assert best.value == pytest.approx(gap * x_0, rel=0.02)
    assert best.orbit.x_max == pytest.approx(left * x_0, rel=0.002)


def settled(mu, share, start=None, zeta=0.02, R=0.6):
    """Return the settled |X| over X_0 with a gap given in shares of the best one."""
    rig = RigParameters(damping=2.0 * zeta, damper_mass=mu, restitution_1=R, restitution_2=R)
    x_0 = 1.0 / (2.0 * zeta)
    gap = share * best_gap_of(zeta, mu, R)[2] * x_0
    return settle(Rig(rig.replace(gap=gap, gravity=0.0), start)).x_max / x_0


def test_the_least_mass_from_rest():
    zeta, share, loss = 0.02, 0.9, 0.4 / 1.6
    least = zeta * (share * math.pi**2 / 4.0 - math.pi / 2.0 * loss)
    least /= 1.0 + zeta * math.pi / 2.0 * loss
    assert round(least, 4) == 0.0363
    assert settled(0.99 * least, share) == pytest.approx(1.0, abs=1e-6)
    assert settled(1.02 * least, share) < 0.23


def test_a_damper_too_light_for_its_best_gap():
    _, left, gap = best_gap_of(0.02, 0.02, 0.6)
    thrown = InitialConditions(initial_damper_velocity=4.0 * left * 25.0)
    assert settled(0.02, 0.9) == pytest.approx(1.0, abs=1e-6)
    assert settled(0.02, 1.98 / gap) == pytest.approx(0.57, abs=0.01)
    assert settled(0.02, 1.0, thrown) == pytest.approx(0.29, abs=0.01)


@pytest.mark.parametrize(('mu', 'better'), [(0.013, False), (0.03, True)])
def test_an_impact_damper_beside_a_mass_damper(mu, better):
    rig = RigParameters(
        damping=2e-4, damper_mass=mu, restitution_1=0.6, restitution_2=0.6, gravity=0.0
    )
    height = mass_damper_response(rig, den_hartog(rig), np.linspace(0.8, 1.2, 4001)).max()
    assert height == pytest.approx(math.sqrt(1.0 + 2.0 / mu), rel=0.02)
    assert bool(best_design(rig).orbit.x_max < height) is better


def test_figures_are_those_of_the_pages(tmp_path):
    pytest.importorskip('matplotlib')
    script = ROOT / 'docs' / 'theory' / 'figures.py'
    spec = importlib.util.spec_from_file_location('figures', script)
    figures = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(figures)
    figures.HERE = tmp_path
    figures.draw_all()
    text = '\n'.join(page.read_text(encoding='utf-8') for page in PAGES)
    shown = set(re.findall(r'\]\((\w+\.png)\)', text))
    drawn = {path.name for path in tmp_path.iterdir()}
    assert shown == drawn == {path.name for path in script.parent.glob('*.png')}
