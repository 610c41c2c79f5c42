"""A comparison as `compare_run` makes them, of a simulated rig; for tests of what shows it."""

from dataclasses import replace
from functools import cache

from compare.recorded import compared
from rigs import FRICTION

from impact_damper_ros.compare.result import (
    Beginning,
    LogVerdict,
    MotionKind,
    RunComparison,
    StretchCurves,
    Verdict,
)
from impact_damper_ros.replay.findings import Difference
from impact_damper_ros.theory.gap_curve import GapCurve


@cache
def settled():
    """Return the golden motion at 45 degrees with friction 0.5, and the curve over its gap."""
    found = compared(FRICTION, 400)
    curve = GapCurve(FRICTION)
    curve.follow(found.predicted)
    return found, curve.message()


def example(*, gap_curve=True):
    """
    Return a run of three stretches: settled, one that differs, and one without prediction.

    The others have the same curves as the first.
    """
    first, curve = settled()
    curves = first.curves
    first = replace(first, curves=replace(curves, gap_curve=curve if gap_curve else None))
    number = 605 * 10**9
    where = '/joint_states', 'position of stop_1', 'm'
    wrong = Difference(605.0, number, *where, 37.5, 37.0, 'the start of the bag')
    differing = replace(
        first,
        number=2,
        begins=Beginning.CHANGE,
        cause='damping = 0.02 N s/m (was 0.01 N s/m)',
        verdict=Verdict.DIFFERS,
        sentence='differs: the gap is 37.5 m, logged is 37 m',
        log=LogVerdict.DIFFERS,
        differences=(wrong,),
        start=first.end,
        end=2.0 * first.end,
    )
    chaotic = replace(
        first,
        number=3,
        begins=Beginning.RESET,
        cause='reset',
        kind=MotionKind.CHAOTIC,
        evidence='0-1 test 0.98, Lyapunov exponent 0.21 per cycle',
        verdict=Verdict.NO_PREDICTION,
        sentence='no periodic motion to compare with',
        start=2.0 * first.end,
        end=3.0 * first.end,
        cycles=0,
        settled_at=None,
        predicted=None,
        predicted_impulse=(),
        decay=None,
        curves=StretchCurves(curves.envelope, curves.motion, curves.impacts, curves.phases),
    )
    return RunComparison(
        bag='runs/run_20260101_120000',
        node='/sim_node',
        version='0.1.0',
        complete=True,
        start=0.0,
        end=chaotic.end,
        samples=3 * first.samples,
        impacts=3 * first.impacts,
        stretches=(first, differing, chaotic),
    )
