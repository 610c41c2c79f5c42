"""The figures and claims of the paper in quick form, and what they rest on."""

import csv
import subprocess
import sys
from pathlib import Path

import pytest
from running import DEADLINE_S

pytest.importorskip('matplotlib')

EXAMPLES = Path(__file__).parents[2] / 'examples'
sys.path.append(str(EXAMPLES / 'paper'))

import claims  # noqa: E402

IN_PART, OTHER = 'reproduced in part', 'reproduced with a different number'
#: Verdicts on the claims, in order.
VERDICTS = (
    'reproduced', 'reproduced', IN_PART, IN_PART, IN_PART, 'reproduced',
    IN_PART, 'reproduced', IN_PART, IN_PART, 'reproduced', 'reproduced',
    'not reproduced', IN_PART, 'reproduced', 'reproduced', 'reproduced',
    IN_PART, 'reproduced', IN_PART, OTHER, 'reproduced', 'reproduced', 'reproduced', IN_PART,
)  # fmt: skip


def rows_of(path):
    with path.open(encoding='utf-8', newline='') as file:
        return list(csv.DictReader(file))


def test_the_stored_verdicts():
    """Those of docs/results/paper, which `claims.py` takes too long for here to compute all."""
    rows = rows_of(EXAMPLES.parent / 'docs' / 'results' / 'paper' / 'claims.csv')
    assert tuple({row['no.']: row['verdict'] for row in rows}.values()) == VERDICTS


@pytest.fixture
def drawn(monkeypatch, tmp_path):
    """Run a script in quick form, and return its series."""

    def run(module):
        monkeypatch.setattr(sys, 'argv', ['example', '--quick', '--out', str(tmp_path)])
        found = module.series_of_figure(True)
        monkeypatch.setattr(module, 'series_of_figure', lambda _: found)
        module.main()
        name = module.__name__
        assert (tmp_path / f'{name}.png').stat().st_size > 20_000
        kinds = {row['kind'] for row in rows_of(tmp_path / f'{name}.csv')}
        assert {'stable', 'unstable', 'settled run'} <= kinds
        return found

    return run


def judged(found):
    """Return the verdicts of some claims, and all their numbers."""
    rows = list(found)
    return [row.verdict for row in rows], {k: v for row in rows for k, v in row.numbers.items()}


def test_figure_6(drawn):
    found = drawn(claims.figure_6)
    verdicts, numbers = judged(claims.air_claims(found))
    assert tuple(verdicts) == VERDICTS[17:20]
    assert claims.control_claim(found).verdict == VERDICTS[24]
    assert numbers['r = 1, stable up to p/mγg'] == pytest.approx(4.3534, abs=1e-4)
    assert numbers['r = 1.02, least with the best gap'] == pytest.approx(0.38637, abs=1e-5)


def test_the_vertical_rig():
    verdicts, numbers = judged(claims.vertical_claims())
    assert tuple(verdicts) == VERDICTS[20:23]
    assert (numbers['from'], numbers['to']) == pytest.approx((0.45362, 1.12673), abs=1e-5)
    # The limit of a light ball, from the literature
    assert numbers['heavy table, from'] == pytest.approx(0.448799, abs=1e-6)
    assert numbers['heavy table, to'] == pytest.approx(1.114744, abs=1e-6)


def test_friction_and_gravity_act_by_two_coefficients():
    claim = claims.coefficient_claim()
    assert claim.verdict == VERDICTS[23]
    assert sum(claim.numbers.values()) > 17


def test_a_script_runs_by_itself(tmp_path):
    script = EXAMPLES / 'paper' / 'figure_5.py'
    subprocess.run(
        [sys.executable, script, '--quick', '--out', 'new'],
        cwd=tmp_path,
        check=True,
        timeout=DEADLINE_S,
    )
    gaps = [float(row['gap [m]']) for row in rows_of(tmp_path / 'new' / 'figure_5.csv')]
    assert gaps == pytest.approx([58.128, 58.077, 57.994, 59.243], abs=1e-3)
