"""The oracle against another integrator, closed forms, and itself."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
import scipy

from oracle.dense_check import FALSE, MISSED, NONE, OK, REVERSAL, STOP_1, STOP_2, check
from oracle.first_root import Watched, first_event
from oracle.flight_cases import FlightCases, exact_motion, precise, round_off
from oracle.flight_generators import near_grazing_flights, random_flights
from oracle.hybrid_oracle import DEFAULTS, run, simulate
from oracle.precise_motion import Motion, Relative, mp
from oracle.reference import kept, load_reference

SLOPE: dict[str, Any] = {'angle': math.pi / 4, 'gravity': 1.0, 'force_frequencies': (1.02,)}


def derivative(params: dict[str, Any], slide: int, held: bool) -> Any:
    """Return the right-hand side for scipy: state (x, v, y, u)."""
    p = {**DEFAULTS, **params}
    M, m, C, K, g = (
        p[k] for k in ('primary_mass', 'damper_mass', 'damping', 'stiffness', 'gravity')
    )
    incline = g * math.sin(p['angle'])
    grip = p['friction'] * g * math.cos(p['angle'])

    def rhs(t: float, s: np.ndarray) -> list[float]:
        x, v, _, u = s
        force = sum(
            f * math.sin(w * t + q)
            for f, w, q in zip(
                p['force_amplitudes'], p['force_frequencies'], p['force_phases'], strict=True
            )
        )
        spring = force - C * v - K * x
        if held:
            return [v, (spring + m * incline) / (M + m), 0.0, 0.0]
        a = (spring + slide * m * grip) / M
        return [v, a, u, incline - slide * grip - a]

    return rhs


@pytest.mark.parametrize(
    'params',
    [
        {'gap': 12.0, 'restitution_2': 0.5, 'force_frequencies': (0.9,)},
        {
            'gap': 6.0,
            'friction': 0.05,
            'damping': 0.05,
            'force_amplitudes': (1.0, 0.7),
            'force_frequencies': (0.8, 1.7),
            'force_phases': (0.4, -0.9),
        },
        {**SLOPE, 'friction': 0.5, 'gap': 11.0},
    ],
)
def test_flights_agree_with_dop853(params: dict[str, Any]) -> None:
    """Each flight is integrated by scipy to its end, and hits there what the oracle says."""
    motion = run(params, 60.0, max_events=14)
    events = motion.events
    assert len(events) == 14
    ends = [e.time for e in events]
    for (start, piece, _), end in zip(motion.pieces, ends, strict=False):
        x, v, z, w = (float(c) for c in motion.state(start))
        held = isinstance(piece, Motion)
        middle = motion.state((start + end) / 2)
        slide = 1 if middle[3] > middle[1] else -1
        solution = scipy.integrate.solve_ivp(
            derivative(params, slide, held),
            (float(start), float(end)),
            [x, v, z - x, w - v],
            method='DOP853',
            rtol=1e-12,
            atol=1e-12,
            dense_output=True,
        )
        for part in (0.3, 0.6, 1 - 1e-9):
            time = start + (end - start) * mp.mpf(part)
            x, v, z, w = (float(c) for c in motion.state(time))
            assert solution.sol(float(time)) == pytest.approx([x, v, z - x, w - v], abs=1e-8)


def test_chatter_ends_where_a_bouncing_ball_does() -> None:
    """On a base that does not move, the times form a geometric series."""
    M = 1e40
    params = {
        'primary_mass': M,
        'stiffness': M,
        'damping': 0.0,
        'damper_mass': 1.0,
        'one_sided': True,
        'angle': math.pi / 2,
        'gravity': 2.0,
        'gap': 4.0,
        'restitution_1': 0.5,
        'force_amplitudes': (0.0,),
    }
    events = simulate(params, 10.0)
    assert events[-1].kind == 'rest'
    fall = mp.sqrt(mp.mpf(2))
    # Falls 2 in sqrt(2); each flight is half as long as the one before, from twice the fall.
    assert abs(events[-1].time - 3 * fall) < mp.mpf(10) ** -29
    assert all(e.stop == 1 for e in events)


def precise_first_event(c: FlightCases, i: int) -> tuple[int, Any]:
    """Return the first event of one flight by the multiprecision search."""
    v, y, u, h, gz = (mp.mpf(float(a[i])) for a in (c.v0, c.y0, c.w0, c.half_gap, c.gz))
    motion = Relative(exact_motion(c, i), y, u + v, gz)
    functions = [Watched('1', motion, -1, 0, h, 1 if y == h else 0)]
    if not c.one_sided[i]:
        functions.append(Watched('2', motion, 1, 0, h, 1 if y == -h else 0))
    if c.watch_reversal[i]:
        functions.append(Watched('3', motion, int(np.sign(c.w0[i])), 1, mp.mpf(0), 0))
    found = first_event(functions, mp.mpf(0.26) / float(c.fastest[i]), mp.mpf(float(c.horizon[i])))
    return (int(found[0]), found[1]) if found else (NONE, mp.mpf(float(c.horizon[i])))


@pytest.mark.parametrize('generator', [random_flights, near_grazing_flights])
def test_dense_check_takes_what_the_precise_search_finds_and_nothing_else(generator: Any) -> None:
    cases = generator(400, np.random.default_rng(11))
    cases = cases.take(np.flatnonzero((cases.w0 != 0) & (cases.horizon * cases.fastest < 60))[:40])
    found = [precise_first_event(cases, i) for i in range(len(cases))]
    kind, tau = np.array([k for k, _ in found]), np.array([float(t) for _, t in found])
    right = check(cases, kind, tau)
    assert (right.status == OK).all()
    event = kind != NONE
    assert {STOP_1, STOP_2, REVERSAL} <= set(kind[event].tolist())
    clear = event & (np.abs(right.margin) > 1e4)
    assert clear.sum() > 15
    # Nothing is claimed where there is an event; too early or late by a little; the wrong kind.
    blind = check(cases, np.zeros_like(kind), cases.horizon)
    gone = blind.status == MISSED
    assert not gone[~event].any()
    assert gone[clear].all()
    assert (blind.missed_at[gone] >= tau[gone] * (1 - 1e-9)).all()
    for factor, allowed in ((1 - 1e-6, {FALSE}), (1 + 1e-6, {FALSE, MISSED}), (0.5, {FALSE})):
        assert set(check(cases, kind, tau * factor).status[clear].tolist()) <= allowed
    other = check(cases, np.where(kind == STOP_1, STOP_2, STOP_1), tau)
    assert (other.status[clear] != OK).all()


def test_check_formula_agrees_with_multiprecision() -> None:
    cases = random_flights(60, np.random.default_rng(5))
    t = cases.horizon * np.random.default_rng(6).random(60)
    s, u, _ = precise(cases, np.arange(60), t)
    units = round_off(cases, np.arange(60), t, 'local')
    for i in range(60):
        v, w, gz = (mp.mpf(float(a[i])) for a in (cases.v0, cases.w0, cases.gz))
        y = Relative(exact_motion(cases, i), mp.mpf(0), w + v, gz).derivatives(mp.mpf(float(t[i])))
        for found, exact, unit in ((s[i], y[0], units[0][i]), (u[i], y[1], units[1][i])):
            high = float(exact)
            gap = float(found - np.longdouble(high)) - float(exact - mp.mpf(high))
            assert abs(gap) < 0.1 * float(unit)


def test_reference_file_is_what_the_oracle_says() -> None:
    runs = load_reference()
    assert len(runs) >= 25
    assert len({r.name for r in runs}) == len(runs)
    kinds = {e.kind for r in runs for e in r.events}
    assert kinds == {'impact', 'rest', 'stick', 'release', 'reversal'}
    for r in runs[:: len(runs) // 6]:
        if r.floor:
            continue
        events = simulate(r.params, r.duration, r.initial, max_events=12)
        for a, b in zip(events, r.events, strict=False):
            assert (a.kind, a.stop) == (b.kind, b.stop)
            assert mp.nstr(a.time, 30, strip_zeros=False) == b.digits[0]
            assert mp.nstr(a.x, 30, strip_zeros=False) == b.digits[1]


def test_slow_impacts_and_their_reversals_are_left_out() -> None:
    kinds = ['impact', 'reversal', 'impact', 'reversal', 'rest', 'release', 'reversal']
    speeds = [1.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0]
    assert kept(kinds, speeds, 0.1) == [True, True, False, False, True, True, True]
    assert all(kept(kinds, speeds, 0.0))
