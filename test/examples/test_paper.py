"""The figures and claims of the paper in quick form, and what they rest on."""

import csv
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('matplotlib')

EXAMPLES = Path(__file__).parents[2] / 'examples'
sys.path.append(str(EXAMPLES / 'paper'))

import bapat_rigs  # noqa: E402
import claims  # noqa: E402
import series  # noqa: E402

IN_PART, OTHER = 'reproduced in part', 'reproduced with a different number'
#: Verdicts on the claims, in order.
VERDICTS = (
    'reproduced', IN_PART, IN_PART, IN_PART, IN_PART, 'reproduced',
    IN_PART, 'reproduced', IN_PART, IN_PART, 'reproduced', 'reproduced',
    'not reproduced', IN_PART, 'reproduced', 'reproduced', 'reproduced',
    IN_PART, 'reproduced', IN_PART, OTHER, 'reproduced', 'reproduced',
)  # fmt: skip


def rows_of(path):
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def test_the_stored_verdicts():
    """Those of docs/paper, which `claims.py` takes too long for here to compute all."""
    rows = rows_of(EXAMPLES.parent / 'docs' / 'paper' / 'claims.csv')
    assert tuple({row['no.']: row['verdict'] for row in rows}.values()) == VERDICTS


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Run a script in quick form, and return its series."""

    def run(module):
        monkeypatch.setattr(sys, 'argv', ['example', '--quick', '--out', str(tmp_path)])
        module.main()
        name = module.__name__
        assert (tmp_path / f'{name}.png').stat().st_size > 20_000
        kinds = {row['kind'] for row in rows_of(tmp_path / f'{name}.csv')}
        assert {'stable', 'unstable', 'settled run'} <= kinds
        return module.series_of_figure(True)

    return run


def judged(found):
    """Return the verdicts of some claims, and all their numbers."""
    rows = list(found)
    return [row.verdict for row in rows], {k: v for row in rows for k, v in row.numbers.items()}


def test_figure_4(drawn):
    found = drawn(claims.figure_4)
    verdicts, numbers = judged(claims.natural_frequency_claims(found))
    assert tuple(verdicts) == VERDICTS[12:15]
    assert numbers['stable from ω [rad/s]'] == pytest.approx(0.8153545, abs=5e-6)
    assert numbers['friction alone, ω = 1'] == pytest.approx(1.156, abs=1e-3)
    agreement = claims.simulation_claim(found)
    assert agreement.holds['displacements agree to 1e-6']
    assert agreement.holds['runs settle into every stable motion']


def test_figure_6(drawn):
    verdicts, numbers = judged(claims.air_claims(drawn(claims.figure_6)))
    assert tuple(verdicts) == VERDICTS[17:20]
    assert numbers['r = 1, stable up to p/mγg'] == pytest.approx(4.3534, abs=1e-4)
    assert numbers['r = 1.02, least with the best gap'] == pytest.approx(0.38637, abs=1e-5)


def test_the_vertical_rig():
    verdicts, numbers = judged(claims.vertical_claims())
    assert tuple(verdicts) == VERDICTS[20:]
    assert (numbers['from'], numbers['to']) == pytest.approx((0.45362, 1.12673), abs=1e-5)
    # The limit of a light ball, from the literature
    assert numbers['heavy table, from'] == pytest.approx(0.448799, abs=1e-6)
    assert numbers['heavy table, to'] == pytest.approx(1.114744, abs=1e-6)


def test_a_script_runs_by_itself(tmp_path):
    script = EXAMPLES / 'paper' / 'figure_5.py'
    subprocess.run(
        [sys.executable, script, '--quick', '--out', 'new'], cwd=tmp_path, check=True, timeout=600
    )
    gaps = [float(row['gap [m]']) for row in rows_of(tmp_path / 'new' / 'figure_5.csv')]
    assert gaps == pytest.approx([58.128, 58.077, 57.994, 59.243], abs=1e-3)


def test_stable_ranges_end_at_special_points():
    """Two impacts at 45 degrees with friction 0.5, g = 2: as bisection has it, too."""
    rig = bapat_rigs.ABOVE.replace(gravity=2.0, **bapat_rigs.OPERATIONS['friction'])

    def at(gap):
        return rig.replace(gap=gap)

    branches = tuple(series.branches_along(at, 22.0, 60.0, (37.0,), name='gap'))
    one = series.Series(at, 22.0, 60.0, branches)
    (low, high) = one.stable_ranges((1, 2))[-1]
    assert (low, high) == pytest.approx((24.2957, 56.1015), abs=1e-3)
    for gap, stable in ((low - 1e-4, False), (low + 1e-4, True), (high + 1e-4, False)):
        assert math.isfinite(one.least(gap, (1, 2))) is stable
    assert one.stable_width() == pytest.approx(sum(b - a for a, b in one.stable_ranges()))
    assert not np.isfinite(claims.least_over(one, [22.0, 60.0])).any()
