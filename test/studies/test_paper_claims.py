"""Key numbers of the paper's claims, each from the solver and from elsewhere."""

import numpy as np
import pytest

from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig import Simulator
from impact_damper_ros.studies.paper.claims import (
    heavy_table_range,
    stable_width,
    symmetric_displacements,
    vertical_range,
)
from impact_damper_ros.studies.paper.curves import (
    Curve,
    CurvePoint,
    SeriesPlan,
    Status,
    disturbed,
    enumerated_curves,
    followed_curves,
    settle,
)
from impact_damper_ros.studies.paper.rigs import BASIC, OPERATIONS, scaled_rig
from impact_damper_ros.studies.paper.series import figure_of, plans_of

ABOVE = BASIC.replace(force_frequencies=(1.02,))


def test_vertical_range():
    low, high = vertical_range(tolerance=1e-7)
    assert low == pytest.approx(0.4536, abs=1e-4)
    assert high == pytest.approx(1.1267, abs=1e-4)


def test_heavy_table_range_is_the_limit_of_the_solver():
    low, high = heavy_table_range(0.75)
    assert low == pytest.approx(0.448799, abs=1e-6)
    assert high == pytest.approx(1.114744, abs=1e-6)


@pytest.mark.parametrize('rate', [1.0, 1.02, 1.05])
def test_symmetric_motion_in_closed_form(rate):
    rig = BASIC.replace(force_frequencies=(rate,), gap=41.0)
    found = [orbit.x[0] for orbit in find_orbits(rig, (1, 2), simulate=False).orbits]
    closed = symmetric_displacements(rig)
    assert closed
    for x in closed:
        assert min(abs(x - other) for other in found) < 1e-11 * abs(x)


def test_stability_ends_of_figure_2():
    values = tuple(float(v) for v in range(22, 60, 2))
    plan = SeriesPlan('test', OPERATIONS[2].rig(ABOVE, 2.0), 'gap', values)
    stable = [p.value for c in enumerated_curves(plan) for p in c.points if p.status == 0]
    assert min(stable) == pytest.approx(24.2957, abs=1e-3)
    assert max(stable) == pytest.approx(56.1015, abs=1e-3)


def test_three_impacts_with_friction_are_followed():
    values = tuple(float(v) for v in np.arange(13.0, 22.0, 0.5))
    rig = OPERATIONS[2].rig(ABOVE, 1.0)
    plan = SeriesPlan('test', rig, 'gap', values, (16.0,), (3,))
    motion = settle(Simulator(plan.at(16.0)), 16.0)
    assert motion.stops == (1, 1, 2)
    assert motion.orbit is not None
    assert motion.difference < 1e-6
    assert motion.ratio == pytest.approx(motion.orbit.amplitude_ratio, rel=1e-6)
    (curve,) = followed_curves(plan, [motion], 3)
    stable = [point.value for point in curve.points if point.status is Status.STABLE]
    assert min(stable) < 14.0
    assert max(stable) == pytest.approx(20.368, abs=2e-3)
    assert max(point.value for point in curve.points) >= 21.5


def test_disturbed_motion_returns():
    orbit = find_orbits(ABOVE, (1, 2), simulate=False).orbits[0]
    settled = settle(disturbed(orbit))
    assert settled.cycles == 1
    assert settled.ratio == pytest.approx(orbit.amplitude_ratio, rel=1e-6)


def test_scaled_rig_keeps_what_figure_4_keeps():
    rig = scaled_rig(BASIC, 3.0)
    assert rig.omega == pytest.approx(3.0)
    assert rig.zeta == pytest.approx(BASIC.zeta)
    assert rig.frequency_ratio == pytest.approx(1.0)
    assert rig.response_amplitude == pytest.approx(BASIC.response_amplitude)


def test_stable_width_counts_overlaps_once():
    def curve(low, high):
        points = [CurvePoint(v, 0.1, (1.0, 1.0), Status.STABLE, 0.5) for v in (low, high)]
        return Curve((1, 2), points)

    assert stable_width([curve(1.0, 3.0), curve(2.0, 5.0), curve(7.0, 8.0)]) == pytest.approx(5.0)


def test_every_figure_has_its_series():
    assert figure_of('2a') == figure_of('2') == '2'
    assert plans_of('5') == []
    for figure in '2346':
        full, quick = plans_of(figure), plans_of(figure, quick=True)
        assert [s.name for s in full] == [s.name for s in quick]
        assert all(set(s.marks) <= set(s.values) for s in quick)
        assert all(list(s.values) == sorted(s.values) for s in full)
        assert sum(len(s.values) for s in quick) < sum(len(s.values) for s in full)
    with pytest.raises(ValueError, match='7'):
        figure_of('7')


def test_reversal_between_alternating_impacts_is_followed():
    values = tuple(float(v) for v in np.arange(19.0, 23.0, 0.5))
    plan = SeriesPlan('test', OPERATIONS[2].rig(ABOVE, 2.0), 'gap', values, (20.0,), (2,))
    motion = settle(Simulator(plan.at(20.0)), 20.0)
    assert motion.stops == (1, 2)
    assert motion.orbit is not None
    assert motion.orbit.events
    assert followed_curves(plan, [motion], 3) == []
    (curve,) = followed_curves(plan, [motion], 2)
    assert 20.0 in [point.value for point in curve.points if point.status is Status.STABLE]
    enumerated = [p for c in enumerated_curves(plan) for p in c.points if p.value == 20.0]
    assert all(p.status != Status.STABLE for p in enumerated)
