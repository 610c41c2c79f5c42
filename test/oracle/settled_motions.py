"""
What rigs of any kind settle into, found by the theory, against the oracle.

    PYTHONPATH=.:test python -m oracle.settled_motions --rigs 200 [--seed 0]

A rig drawn at random runs until it repeats; the solver finds the periodic motion. The oracle,
which shares no code with either and has 110 digits, runs it for one period from just before an
impact. Its impacts must be those of the theory, the last one a period after the first; the
multipliers are those of its map from there to there, by differences.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, replace
from typing import Any, NamedTuple

import numpy as np
from motion.random_rigs import any_rig

from impact_damper_ros import PeriodicOrbit, Rig, settle
from oracle.hybrid_oracle import DEFAULTS, OracleEvent, run
from oracle.precise_motion import mp

#: Agreement asked for: of the instants, in cycles, and of the multipliers.
PHASES, MULTIPLIERS = 1e-9, 1e-6
#: Deviation whose growth is measured, relative.
_STEP = mp.mpf(10) ** -25
#: An impact of the theory and one of the oracle this close together are the same, in cycles.
_SAME = 1e-4


class Trial(NamedTuple):
    """A settled motion, the oracle's distance from it, and what was found of it."""

    seed: int
    orbit: PeriodicOrbit
    phases: float  # largest error of the instant of an impact, in cycles
    multipliers: float  # largest error of a multiplier
    extra: int  # impacts of the oracle that the theory does not have, before a rest

    @property
    def good(self) -> bool:
        """Whether theory and oracle agree."""
        return self.phases < PHASES and self.multipliers < MULTIPLIERS


def period_of(orbit: PeriodicOrbit, late: Any, moved: Any) -> list[OracleEvent]:
    """
    Return the oracle's impacts of one period, from just before the first one to the next such.

    It begins late (s) and with X, X' and Z' moved by so much; the instants count from the motion's
    own first impact.
    """
    rig = orbit.parameters
    side = 1 if orbit.stops[0] == 1 else -1
    values = {name: value for name, value in asdict(rig).items() if name in DEFAULTS}
    begin = mp.mpf(orbit.instants[0]) + late
    turned = mp.mpf(rig.force_phases[0]) + mp.mpf(rig.force_frequencies[0]) * begin
    values['force_phases'] = (turned,)
    x, velocity, damper_velocity = moved
    initial = {
        'initial_primary_position': mp.mpf(orbit.x[0]) + x,
        'initial_primary_velocity': mp.mpf(orbit.primary_velocity_before[0]) + velocity,
        'initial_damper_offset': side * mp.mpf(rig.gap) / 2,
        'initial_damper_velocity': mp.mpf(orbit.damper_velocity_before[0]) + damper_velocity,
    }
    motion = run(values, mp.mpf(orbit.period) * (1 + mp.mpf(_SAME)), initial)
    return [replace(e, time=e.time + late) for e in motion.events if e.kind == 'impact']


def return_of(orbit: PeriodicOrbit, impacts: list[OracleEvent]) -> OracleEvent:
    """Return the impact a period after the first one."""
    period = mp.mpf(orbit.period)
    again = [e for e in impacts if e.stop == orbit.stops[0] and e.time > period / 2]
    return min(again, key=lambda event: abs(event.time - period))


def multipliers_of(orbit: PeriodicOrbit) -> list[complex]:
    """Return the multipliers of the oracle's map of X, X', Z' and the instant, by differences."""
    cycle = mp.mpf(orbit.cycle)
    size = mp.mpf(orbit.x_max)
    units = (size, size / cycle, size / cycle, cycle)

    def after(late: Any, *moved: Any) -> list[Any]:
        event = return_of(orbit, period_of(orbit, late, moved))
        return [
            event.x,
            event.primary_velocity_before,
            event.damper_velocity_before,
            event.time,
        ]

    here = after(mp.mpf(0), *[mp.mpf(0)] * 3)
    matrix = np.zeros((4, 4))
    for column, unit in enumerate(units):
        step = [mp.mpf(0)] * 4
        step[column] = _STEP * unit
        there = after(step[3], *step[:3])
        for row in range(4):
            matrix[row, column] = float((there[row] - here[row]) / (_STEP * units[row]))
    return sorted(np.linalg.eigvals(matrix), key=abs, reverse=True)


def trial(seed: int) -> Trial | None:
    """Settle a rig and hold it against the oracle; None if its motion has no impacts to repeat."""
    settled = settle(Rig(any_rig(seed), compiled=None), cycles=10000)
    if settled.rhythm is None:
        return None
    orbit = settled.orbit
    assert orbit is not None, f'seed {seed}: the solver does not find {settled.rhythm}'
    # From the hardest impact: the next one to it is far away
    hardest = max(
        range(orbit.impacts),
        key=lambda i: abs(orbit.damper_velocity_before[i] - orbit.primary_velocity_before[i]),
    )
    orbit = orbit.begun_at(hardest)
    impacts = period_of(orbit, mp.mpf(0), [mp.mpf(0)] * 3)
    instants = [*(t - orbit.instants[0] for t in orbit.instants), orbit.period]
    late = [
        min(abs(float(event.time) - instant) for event in impacts if event.stop == stop)
        for instant, stop in zip(instants, (*orbit.stops, orbit.stops[0]), strict=True)
    ]
    found = multipliers_of(orbit)
    apart = [min(abs(m - other) for other in found) for m in orbit.multipliers]
    return Trial(
        seed,
        orbit,
        max(late) / orbit.cycle,
        float(max(apart)),
        len(impacts) - len(instants),
    )


def main() -> int:
    """Try rigs and print a table; return 1 if one of them disagrees."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--rigs', type=int, default=200)
    parser.add_argument('--seed', type=int, default=0, help='the first one')
    options = parser.parse_args()
    count, bad, kinds = 0, 0, set()
    for seed in range(options.seed, options.seed + options.rigs):
        found = trial(seed)
        if found is None:
            continue
        orbit = found.orbit
        count, bad = count + 1, bad + (not found.good)
        own = sorted({event.kind.name.lower() for event in orbit.events})
        kinds |= set(own)
        print(
            f'{seed:5d}  {orbit.impacts:3d} impacts in {orbit.cycles:2d} cycles, multiplier '
            f'{abs(orbit.multipliers[0]):.6f}, phases to {found.phases:.0e}, multipliers to '
            f'{found.multipliers:.0e}, {found.extra} more impacts, {own}'
            f'{"" if found.good else "  DISAGREE"}',
            flush=True,
        )
    print(f'{count} settled motions of {options.rigs} rigs, {bad} disagree; with {sorted(kinds)}')
    return int(bad > 0)


if __name__ == '__main__':
    raise SystemExit(main())
