"""Published rigs: closed forms against exact motions."""

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from running import DEADLINE_S

pytest.importorskip('matplotlib')

EXAMPLES = Path(__file__).parents[2] / 'examples'
sys.path.append(str(EXAMPLES / 'published'))

import bouncing_ball  # noqa: E402
import chain_sector  # noqa: E402
import ice  # noqa: E402
import invariant_manifold  # noqa: E402
import measured_bounces  # noqa: E402
import rebounds  # noqa: E402
import sliding_block  # noqa: E402
import vertical_ring_down  # noqa: E402


def test_ball_on_a_table():
    rows, once, twice = bouncing_ball.results()
    computed = [value for _, _, value in rows]
    assert computed[:2] == pytest.approx([3.42088, 10.49432], abs=1e-5)
    for (_, closed, value), within in zip(rows, (1e-8, 1e-8, 1.0, 1.1e-4, 1.1e-4), strict=True):
        assert math.isnan(closed) or value == pytest.approx(closed, rel=within)
    # The second doubling has no closed form: its orbit has a multiplier of -1
    assert computed[2] == pytest.approx(11.97358, abs=1e-4)
    assert once.orbits[0].stops == (1,)
    assert (twice.orbits[0].stops, twice.orbits[0].cycles) == ((1, 1), 2)


def test_the_base_comes_to_the_closed_form_as_the_table_gets_stiffer():
    """The table exceeds its base by 1/(1 - r^2), r = Omega over the natural frequency."""
    kind = bouncing_ball.SpecialKind.FOLD
    for ratio in (10.0, 30.0):
        branch = bouncing_ball.once_per_cycle(lambda a, r=ratio: bouncing_ball.on_base(a, r))
        r = 1.0 / ratio
        gain = math.hypot(1.0, r) / math.hypot(1.0 - r**2, r)
        fold = bouncing_ball.special(branch, kind)
        assert fold * gain == pytest.approx(bouncing_ball.FOLD, rel=1e-7)


@pytest.mark.parametrize('restitution', invariant_manifold.RESTITUTIONS)
def test_fold_of_the_invariant_manifold(restitution):
    height, closed = invariant_manifold.fold_of(restitution)
    apart = {}
    for mu in (1e-4, invariant_manifold.MASS_RATIO):
        rig = invariant_manifold.sink(restitution, mu, 0.4 * mu)
        where, found = invariant_manifold.exact_fold(rig)
        assert where == pytest.approx(height, rel=1e-3)
        apart[mu] = found / closed - 1.0
    assert 0.0 < apart[5e-4] < 6e-4
    # What is neglected is of the first order in mu
    assert apart[5e-4] == pytest.approx(5.0 * apart[1e-4], rel=0.01)


def test_block_on_a_table():
    limits = [sliding_block.SLIPS, sliding_block.NEVER_STICKS]
    assert limits == pytest.approx([1.0, 1.8620959])
    for name, closed, computed in sliding_block.results():
        assert computed == pytest.approx(closed, rel=1.1e-4 if 'base' in name else 1e-5), name


@pytest.mark.parametrize(('ball', 'first'), [('ping-pong ball', 0.6015), ('golf ball', 0.5721)])
def test_rebounds(ball, first):
    found = rebounds.rebounds(rebounds.BALLS[ball])
    assert len(found.intervals) > 100
    assert found.intervals[0] == pytest.approx(first, abs=1e-4)
    assert found.apart < 1e-7
    assert found.rest == pytest.approx(found.closed_rest, abs=1e-6)


def bounces(count, law, speed=2.5, deviation=0.0, seed=0):
    """Return times of the bounces of a ball whose restitution is a law of its speed."""
    times = [0.1]
    for _ in range(count - 1):
        times.append(times[-1] + 2.0 * speed / 9.80665)
        speed *= law(speed)
    return np.array(times) + np.random.default_rng(seed).normal(0.0, deviation, count)


def falling(v):
    """Return R (1 + v/v_c)^-p of a ping-pong ball."""
    return 0.94 * (1.0 + v / 6.0) ** -0.25


def test_measured_restitution_of_a_ping_pong_ball_falls_with_its_speed():
    """Without noise exactly; with 0.1 ms the intervals hold. A constant R is distinguished."""
    true = measured_bounces.fit_rebounds(bounces(12, falling))
    assert true.slowness.value == pytest.approx(1.0 / 6.0, abs=1e-8)
    assert true.restitution.value == pytest.approx(0.94, abs=1e-8)
    held = 0
    for seed in range(40):
        found = measured_bounces.fit_rebounds(bounces(12, falling, 2.5, 1e-4, seed))
        low, high = found.slowness.interval
        held += low < 1.0 / 6.0 < high
        assert low > 0.0
    # 38 of 40 are expected
    assert held >= 33
    constant = measured_bounces.fit_rebounds(bounces(12, lambda _: 0.85, 2.5, 1e-4, 1))
    assert constant.slowness.interval[0] < 0.0 < constant.slowness.interval[1]
    times = bounces(10, lambda _: 0.7)
    for wrong, reason in (
        (np.delete(times, 4), 'is missing'),
        (times[:4], '4 bounces were measured'),
        (times[::-1], 'do not rise'),
    ):
        with pytest.raises(ValueError, match=reason):
            measured_bounces.fit_rebounds(wrong)


def test_ice_is_as_elastic_as_it_was_measured():
    for exponent, v_c in ((0.25, 1.09e-4), (0.234, 9.0e-5)):
        rig, apart = ice.fitted(exponent)
        assert rig.restitution_1 == pytest.approx(1.0, abs=1e-6)
        assert rig.restitution_speed == pytest.approx(v_c, rel=5e-3)
        assert apart < 0.062
    assert ice.measured(np.array([0.01])) == pytest.approx(0.32)


def test_ring_down_of_a_vertical_rig():
    for restitution in (0.05, 0.2):
        found = vertical_ring_down.released(restitution)
        curve = found.curve(14)
        loss, at = curve['median'], curve['acceleration']
        assert 0.26 < loss.max() < 0.36
        assert loss.max() < found.bound
        assert 1.5 < at[loss.argmax()] < 6.0
        assert vertical_ring_down.maxima(loss) == 1
        # m rests below 1 g: the dashpot of a mass M + m
        together = found.parameters.zeta / math.sqrt(1.0 + found.parameters.mass_ratio)
        alone = -math.expm1(-2.0 * math.tau * together)
        assert loss[at < 0.9] == pytest.approx(alone, rel=1e-4)


def test_sector_of_a_chain():
    apart = [exact / balance - 1.0 for _, balance, exact, _ in chain_sector.compared()]
    assert min(apart) > 0.0
    assert max(apart) < 0.025
    assert apart == sorted(apart, reverse=True)
    heights = chain_sector.HEIGHTS
    assert [len(chain_sector.stable_at(height)) for height in heights[:2]] == [1, 1]
    assert all(exact < 0.11 * alone for *_, exact, alone in chain_sector.compared())


def test_a_script_runs_by_itself(tmp_path):
    script = EXAMPLES / 'published' / 'invariant_manifold.py'
    done = subprocess.run(
        [sys.executable, script, '--out', 'new'],
        cwd=tmp_path, check=True, timeout=DEADLINE_S, capture_output=True, text=True,
    )  # fmt: skip
    assert '| 0.8 | 0.070559 |' in done.stdout
    assert (tmp_path / 'new' / 'invariant_manifold.png').stat().st_size > 20_000
