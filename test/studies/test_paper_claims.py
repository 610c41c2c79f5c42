"""Key numbers of the paper's claims, each from the solver and from elsewhere."""

from dataclasses import replace

import numpy as np
import pytest

from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig import InitialConditions
from impact_damper_ros.studies.paper.claim import Judgement, stable_width
from impact_damper_ros.studies.paper.curves import (
    Curve,
    CurvePoint,
    SeriesPlan,
    SettledMotion,
    Status,
    carried_starts,
    disturbed,
    enumerated_curves,
    followed_curves,
    frictionless_motions,
    settle,
)
from impact_damper_ros.studies.paper.figure_claims import (
    inclination_effects,
    range_claims,
    stability_edge,
)
from impact_damper_ros.studies.paper.rigs import BASIC, OPERATIONS, scaled_rig
from impact_damper_ros.studies.paper.series import Series, figure_of, plans_of
from impact_damper_ros.studies.paper.theory_claims import (
    heavy_table_range,
    simulation_claim,
    symmetric_displacements,
    vertical_range,
)

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
    motion = settle(Rig(plan.at(16.0)), 16.0)
    assert motion.stops == (1, 1, 2)
    assert motion.orbit is not None
    assert motion.difference < 1e-6
    assert motion.ratio == pytest.approx(motion.orbit.amplitude_ratio, rel=1e-6)
    (curve,) = followed_curves(plan, [(16.0, motion.orbit)], 3)
    stable = [point.value for point in curve.points if point.status is Status.STABLE]
    assert min(stable) < 14.0
    assert max(stable) == pytest.approx(20.368, abs=2e-3)
    assert max(point.value for point in curve.points) >= 21.5


def _motions(curves, value):
    """Return Xmax/A and stability of the motions at a value, in order."""
    points = (point for curve in curves for point in curve.points if point.value == value)
    return sorted((point.ratio, point.status) for point in points)


def test_curves_do_not_depend_on_where_they_start():
    """Three impacts with friction: from other rigs, other gaps, and a disturbed simulation."""
    values = (15.0, 15.5, 16.0, 16.5, 17.0)
    plan = SeriesPlan('test', OPERATIONS[2].rig(ABOVE, 1.0), 'gap', values, (), (3,))
    horizontal, inclined, _ = OPERATIONS
    others = [
        (horizontal.rig(ABOVE, 1.0), 17.0),
        (inclined.rig(ABOVE, 1.0), 16.0),
        (inclined.rig(ABOVE, 2.0), 15.0),
    ]
    ways = [
        carried_starts(plan, frictionless_motions(replace(plan, rig=rig), [gap]))
        for rig, gap in others
    ]
    settled = settle(Rig(plan.at(16.0), InitialConditions(initial_primary_position=1e-9)))
    ways.append([(16.0, settled.orbit)])
    found = []
    for starts in ways:
        (curve,) = (
            c for c in followed_curves(plan, starts, 3) if c.stops in {(1, 1, 2), (1, 2, 1)}
        )
        found.append([_motions([curve], value) for value in values])
    assert all(status is Status.STABLE for ((_, status),) in found[0])
    for other in found[1:]:
        assert np.array(other) == pytest.approx(np.array(found[0]), rel=1e-9)


def test_stability_between_two_unstable_values_is_found():
    """Three impacts below and one above are stable from 12.81 to 12.92 m only."""
    rig = OPERATIONS[0].rig(ABOVE, 1.0)
    plan = SeriesPlan('test', rig, 'gap', (12.5, 12.75, 13.0), (), (4,))
    found = find_orbits(plan.at(12.75), (1, 1, 1, 2), simulate=False).orbits
    starts = [(12.75, orbit) for orbit in found if orbit.viable]
    (curve,) = followed_curves(plan, starts, 4)
    assert all(p.status is Status.UNSTABLE for p in curve.points if p.value in plan.values)
    stable = [point.value for point in curve.points if point.status is Status.STABLE]
    assert min(stable) == pytest.approx(12.809, abs=2e-3)
    assert max(stable) == pytest.approx(12.919, abs=2e-3)


def test_disturbed_motion_returns():
    orbit = find_orbits(ABOVE, (1, 2), simulate=False).orbits[0]
    settled = settle(disturbed(orbit))
    assert settled.cycles == 1
    assert settled.ratio == pytest.approx(orbit.amplitude_ratio, rel=1e-6)


@pytest.mark.parametrize(('name', 'share'), [('6 r=1', 3.5), ('6 r=1', 4.25), ('6 r=1.02', 2.5)])
def test_disturbed_motion_under_air_returns(name, share):
    (plan,) = (plan for plan in plans_of('6') if plan.name == name)
    found = find_orbits(plan.at(share), (1, 2), simulate=False).orbits
    (orbit,) = (orbit for orbit in found if orbit.stable and orbit.viable)
    settled = settle(disturbed(orbit))
    assert settled.stops == (1, 2)
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


def _stable_over(widths):
    """Return the series of Figure 2 with stable motions of some sequences over so many metres."""
    return {
        plan.name: Series(
            plan,
            tuple(
                Curve(
                    tuple(map(int, word)),
                    [CurvePoint(v, 0.1, (1.0,), Status.STABLE, 0.5) for v in (0.0, width)],
                )
                for word, width in widths(plan.name).items()
            ),
            (),
        )
        for plan in plans_of('2')
    }


def test_largest_reduction_is_judged_by_every_measure():
    def two_lose_most(name):
        return {'12': 30.0 if name == '2 horizontal' else 10.0, '112': 6.0, '1122': 2.0}

    def one_sequence_vanishes(name):
        kept = {'12': 35.0, '112': 5.5, '1122': 2.0}
        return kept | ({'122': 5.5} if name == '2 horizontal' else {'12': 33.0})

    def two_lose_least(name):
        return {'12': 35.0} | ({'112': 5.0} if name == '2 horizontal' else {'12': 34.9})

    verdicts = [
        next(c for c in range_claims(_stable_over(widths)) if 'largest reduction' in c.claim)
        for widths in (two_lose_most, one_sequence_vanishes, two_lose_least)
    ]
    assert [verdict.judgement for verdict in verdicts] == [
        Judgement.REPRODUCED,
        Judgement.IN_PART,
        Judgement.NOT_REPRODUCED,
    ]
    assert verdicts[1].remark.startswith('it holds in metres, by the number of impacts')
    assert '122 5.50 m (100%)' in verdicts[1].computed


def test_simulation_must_be_on_the_curves():
    """A settled motion that the theory does not have makes the agreement partial."""
    (plan,) = (plan for plan in plans_of('3') if plan.name == '3a horizontal unequal')
    gaps = (45.0, 50.0)
    plan = replace(plan, values=gaps, marks=gaps)
    curves = tuple(enumerated_curves(plan))
    marks = [settle(Rig(plan.at(gap)), gap) for gap in gaps]
    assert all(mark.stops for mark in marks)
    agree = simulation_claim({'one': Series(plan, curves, tuple(marks))})
    assert agree.judgement is Judgement.REPRODUCED
    other = SettledMotion(50.0, (1, 2), 1, 0.3, (1.2, 0.8), None)
    differ = simulation_claim({'one': Series(plan, curves, (*marks, other))})
    assert differ.judgement is Judgement.IN_PART
    assert '1 of one cycle and as many impacts are not' in differ.computed


def test_edge_of_stability_over_the_natural_frequency():
    (plan,) = (plan for plan in plans_of('4') if plan.name == '4 ζ=0.005')
    edge = stability_edge(plan, 0.816)
    assert edge == pytest.approx(0.8153545, abs=5e-7)
    for value, stable in ((edge + 2e-5, True), (edge - 2e-5, False), (0.815, False)):
        (orbit,) = (
            o for o in find_orbits(plan.at(value), (1, 2), simulate=False).orbits if o.viable
        )
        assert orbit.stable is stable


def test_inclination_has_other_effects_at_other_gaps():
    narrow, wide = (
        inclination_effects(BASIC.replace(gap=gap), (5.0, 10.0)) for gap in (30.0, 55.0)
    )
    assert max(narrow[10.0]) == pytest.approx(0.145, abs=1e-3)
    assert min(narrow[5.0]) == pytest.approx(0.005, abs=1e-3)
    assert [round(value, 3) for value in wide[5.0]] == [0.024, 0.026]


def test_every_figure_has_its_series():
    assert figure_of('2a') == figure_of('2') == '2'
    assert plans_of('5') == []
    for figure in '2346':
        full, quick = plans_of(figure), plans_of(figure, quick=True)
        assert [s.name for s in full] == [s.name for s in quick]
        assert all(set(s.marks) <= set(s.values) for s in (*quick, *full))
        assert all(list(s.values) == sorted(s.values) for s in full)
        # The values that its claims name, in a quick look, too
        judged = {0.0, 0.5, 1.0, 2.0} if figure == '6' else set()
        assert all(judged <= set(s.values) for s in (*quick, *full))
        assert sum(len(s.values) for s in quick) < sum(len(s.values) for s in full)
    with pytest.raises(ValueError, match='7'):
        figure_of('7')


def test_reversal_between_alternating_impacts_is_followed():
    values = tuple(float(v) for v in np.arange(19.0, 23.0, 0.5))
    plan = SeriesPlan('test', OPERATIONS[2].rig(ABOVE, 2.0), 'gap', values, (20.0,), (2,))
    motion = settle(Rig(plan.at(20.0)), 20.0)
    assert motion.stops == (1, 2)
    assert motion.orbit is not None
    assert motion.orbit.events
    assert followed_curves(plan, [(20.0, motion.orbit)], 3) == []
    (curve,) = followed_curves(plan, [(20.0, motion.orbit)], 2)
    assert 20.0 in [point.value for point in curve.points if point.status is Status.STABLE]
    enumerated = [p for c in enumerated_curves(plan) for p in c.points if p.value == 20.0]
    assert all(p.status != Status.STABLE for p in enumerated)
