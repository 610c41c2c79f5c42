"""A comparison as `compare_run` makes them, of a simulated rig; for tests of what shows it."""

import numpy as np
from rigs import FRICTION

from impact_damper_ros.compare.result import (
    Beginning,
    Convergence,
    Decay,
    EnergyBalance,
    Finding,
    ImpactStates,
    MeasuredMotion,
    MotionCurve,
    MotionKind,
    PredictedCurve,
    RunComparison,
    Spectrum,
    StretchComparison,
    StretchCurves,
    Verdict,
)
from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.replay.rows import events_as_rows
from impact_damper_ros.rig import EventKind
from impact_damper_ros.theory import GapCurve


def _motion(parameters, start, end):
    rig, rows, events = Rig(parameters), [], []
    for t in np.arange(0.0, end, 0.05):
        for e in rig.advance(float(t)):
            events.append(e)
            for speed, relative in ((e[5], e[7] - e[5]), (e[6], e[8] - e[6])):
                rows.append((e.time, e.x, speed, e.y, relative))
        s = rig.sample()
        rows.append((t, s.x, s[2], s.z - s.x, s[4] - s[2]))
    rows = np.array([row for row in rows if row[0] >= start])
    half = np.full(len(rows), parameters.gap / 2.0)
    hits = [e for e in events if e.kind is EventKind.IMPACT]
    return MotionCurve(*rows.T, half, -half), hits


def _predicted(orbit):
    rig = Rig(orbit.parameters)
    rig.advance(400 * orbit.cycle)
    rows = []
    for p in np.arange(400.0, 401.0, 0.004) + orbit.phases[0]:
        for e in rig.advance(float(p * orbit.cycle)):
            for speed, relative in ((e[5], e[7] - e[5]), (e[6], e[8] - e[6])):
                rows.append((e.time / orbit.cycle - 400.0, e.x, speed, e.y, relative))
        s = rig.sample()
        rows.append((p - 400.0, s.x, s[2], s.z - s.x, s[4] - s[2]))
    return PredictedCurve(*np.array(rows).T, 0.0, orbit.cycle, orbit.cycles)


def example(*, bag='runs/run_20260101_120000', gap_curve=True):
    """
    Return a run of three stretches: settled, one that differs, and one without prediction.

    The first is the golden motion at 45 degrees with friction 0.5; the others have the same
    curves.
    """
    orbit = find_orbits(FRICTION, (1, 2)).orbits[0]
    end, cycle = 600.0, orbit.cycle
    motion, hits = _motion(FRICTION, end - 6 * cycle, end)
    impacts = events_as_rows(hits)
    impulse = tuple(e.impulse for e in hits[-2:])
    last = ImpactStates(
        orbit.stops,
        orbit.phases,
        orbit.x,
        orbit.primary_velocity_before,
        orbit.primary_velocity_after,
        orbit.damper_velocity_before,
        orbit.damper_velocity_after,
        impulse,
    )
    ratio = orbit.amplitude_ratio
    measured = MeasuredMotion(
        300.0, end, orbit.x_max, 0.7 * orbit.x_max, ratio, 97, 2.0, impulse[0], impulse[0], last
    )
    periods = np.arange(90)
    decay = Decay(0.9411, abs(orbit.multipliers[0]), 70, 2e-9, 1e-9)
    distance = np.maximum(0.9411**periods, 1e-9)
    frequency = np.linspace(0.0, 1.0, 400)
    line = np.exp(-((np.minimum(frequency % 0.1624, -frequency % 0.1624) / 0.004) ** 2))
    envelope_time = np.arange(0.0, end, 1.0)
    swing = orbit.x_max * (1.0 + 0.5 * np.exp(-envelope_time / 60.0))
    curve = None
    if gap_curve:
        followed = GapCurve(FRICTION)
        followed.follow(orbit)
        curve = followed.message(done=True)
    curves = StretchCurves(
        np.array([envelope_time, -swing, swing]),
        motion,
        impacts,
        impacts['time'] / cycle % 1.0,
        _predicted(orbit),
        Convergence(periods * cycle, distance, 10, decay),
        Spectrum(frequency, orbit.x_max * line * np.exp(-3.0 * frequency), 0.1624, 0.0025, 'Hann'),
        curve,
    )
    common = {
        'start': 0.0,
        'end': end,
        'samples': 12001,
        'impacts': len(hits),
        'parameters': FRICTION,
        'cycles': 1,
        'settled_at': 300.0,
        'measured': measured,
        'predicted': orbit,
        'predicted_impulse': impulse,
        'solver': 'impact equations, 1 motion',
        'energy': EnergyBalance(
            300.0, end, 48, 812.0, 0.0, 310.0, 201.0, 300.99, 0.01, 1e-4, 1e-3
        ),
        'decay': decay,
        'curves': curves,
        'measures': {'period_mismatch': 2e-9},
    }
    settled = StretchComparison(
        number=1,
        begins=Beginning.START,
        cause='start of the bag',
        kind=MotionKind.PERIODIC,
        evidence='repeats after 1 cycle to 2e-9',
        verdict=Verdict.AGREES,
        sentence='agrees with the predicted motion to 2e-9 of its size',
        **common,
    )
    wrong = Finding(
        'gap', 'm', 605.0, 37.5, 37.0, 1e-9, 'the impacts are 37.5 m apart in Y, not 37 m'
    )
    differing = StretchComparison(
        number=2,
        begins=Beginning.CHANGE,
        cause='damping = 0.02 N s/m (was 0.01 N s/m)',
        kind=MotionKind.PERIODIC,
        evidence='repeats after 1 cycle to 2e-9',
        verdict=Verdict.DIFFERS,
        sentence='differs: the gap is 37.5 m, logged is 37 m',
        findings=(wrong,),
        **{**common, 'start': 600.0, 'end': 1200.0},
    )
    chaotic = StretchComparison(
        number=3,
        begins=Beginning.RESET,
        cause='reset',
        kind=MotionKind.CHAOTIC,
        evidence='0-1 test 0.98, Lyapunov exponent 0.21 per cycle',
        verdict=Verdict.NO_PREDICTION,
        sentence='no periodic motion to compare with',
        **{
            **common,
            'start': 1200.0,
            'end': 1800.0,
            'cycles': 0,
            'settled_at': None,
            'predicted': None,
            'predicted_impulse': (),
            'decay': None,
            'curves': StretchCurves(curves.envelope, motion, impacts, curves.phases),
        },
    )
    return RunComparison(
        bag=bag,
        node='/sim_node',
        version='0.1.0',
        complete=True,
        stamps='rig time',
        start=0.0,
        end=1800.0,
        samples=36001,
        impacts=3 * len(hits),
        stretches=(settled, differing, chaotic),
    )
