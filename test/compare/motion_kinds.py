"""
How often `compare_run` is right about the kind of a motion, undecided, or wrong.

    PYTHONPATH=.:test python -m compare.motion_kinds [--rigs N] [--workers N] [--list]

Rigs of the paper, of the bench and random ones run for 20,000 cycles of the force in compiled
code. That gives the answers: the period and the cycle from which on the motion keeps it; else
the Lyapunov exponent of the last 10,000 cycles with its standard error, and how well weighted
averages over their halves agree. Rigs for which this is not clear are left out, and counted.
Then the first 30, 100, 300 and 1000 cycles of each are judged as a recording is.

A motion that comes to repeat is *periodic* or *transient*; it may be called periodic once it is
within 1 % of what it comes to. Some are chaotic for hundreds of cycles first: *chaotic* is right
of these, too, as long as they are, since no run of finite length excludes that chaos ends.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from time import perf_counter
from typing import NamedTuple

import numpy as np
from compare.recorded import built
from numpy.typing import NDArray
from rigs import BENCH, FRICTION, OFF_RESONANCE, VERTICAL
from tqdm import tqdm

from impact_damper_ros import EventKind, InitialConditions, Outcome, Rig, RigParameters
from impact_damper_ros.compare.motion_kind import StretchKind, kind_of
from impact_damper_ros.compare.stretches import LoggedRig
from impact_damper_ros.orbits.flight_arrays import Flights, FlightStart
from impact_damper_ros.orbits.irregularity import average_spread
from impact_damper_ros.orbits.lyapunov import growth_exponent
from impact_damper_ros.orbits.recurrence import MotionKind
from impact_damper_ros.orbits.settled_motion import relative_states

CUTS = (30, 100, 300, 1000)
LONG, MOST_EVENTS = 20_000, 4_000_000
LONGEST_PERIOD, REPEATED = 1024, 1e-8
ARRIVED, NEAR = 1e-3, 1e-2
#: What makes an answer clear.
CHAOTIC_ERRORS, NO_EXPONENT, REGULAR, IRREGULAR = 10.0, 1e-3, 1e-5, 3e-4
#: A motion that settles after more cycles than this, with more growth than e to this, was chaotic.
LEAST_CHAOS, CHAOTIC_GROWTH = 100, 20.0
#: Cycles at the end without an impact that make a motion one without.
QUIET = 1000

RIGHT, UNDECIDED, WRONG = 'right', 'undecided', 'wrong'

#: Its two impacts per cycle lose their stability to a torus (Neimark-Sacker).
HEAVY = OFF_RESONANCE.replace(damping=0.05, damper_mass=0.3, restitution_1=0.6, restitution_2=0.6)
DISPLACED = InitialConditions(initial_primary_position=1.0)


class Case(NamedTuple):
    """A rig and its start."""

    name: str
    parameters: RigParameters
    initial: InitialConditions

    @property
    def cycle(self) -> float:
        """Duration of a cycle of the force, s."""
        return math.tau / self.parameters.force_frequencies[0]


class Answer(NamedTuple):
    """What a long run says of a rig."""

    kind: MotionKind | None
    period: int
    settled: int
    distance: dict[int, float]
    exponent: float
    error: float
    spread: float
    chaotic_first: bool

    @property
    def name(self) -> str:
        """The row of the table."""
        name = self.kind.value if self.kind else 'not clear'
        return f'{name}, after chaos' if self.chaotic_first else name


class Outcomes(NamedTuple):
    """A rig, the answer, and what its beginnings are found to be."""

    case: Case
    answer: Answer
    found: dict[int, tuple[str, str]]
    seconds: float


def cases(random: int) -> Iterator[Case]:
    """Yield the rigs; the random ones, the same each time, last."""
    still = InitialConditions()
    for gap in (5, 7, 8, 9, 10, 12, 13, 14, 16, 18, 20, 22, 25, 30, 37, 45, 50, 54, 57):
        yield Case(f'level, gap {gap}', OFF_RESONANCE.replace(gap=float(gap)), DISPLACED)
    for gap in (8, 10, 12, 15, 17, 20, 22, 25, 30, 40, 50, 60):
        yield Case(f'inclined, gap {gap}', FRICTION.replace(gap=float(gap)), DISPLACED)
    for gap in (8.5, 8.6, 8.7, 8.757, 8.8, 8.9, 9.0, 9.05, 9.1, 9.15, 9.2, 9.25, 9.3, 9.4, 9.5):
        rig = HEAVY.replace(gap=gap, force_frequencies=(1.1,))
        yield Case(f'heavy at 1.1, gap {gap}', rig, DISPLACED)
    for gap in (9.8, 9.9, 9.95, 10, 10.062, 10.1, 10.2, 10.25, 10.3, 10.35, 10.4, 10.45, 10.5):
        yield Case(f'heavy, gap {gap}', HEAVY.replace(gap=float(gap)), DISPLACED)
    for angle in (0.0, 0.05, 0.1, 0.12, 0.14, 0.15, 0.16, 0.18, 0.2, 0.25, 0.3):
        yield Case(f'bench, angle {angle}', BENCH.replace(angle=angle), still)
    for gap in (0.012, 0.0145, 0.02, 0.026, 0.028, 0.03, 0.032, 0.036):
        yield Case(f'bench, gap {gap}', BENCH.replace(gap=gap), still)
    for force in (0.8, 1.1, 1.15, 1.25, 1.3, 1.4, 1.6, 1.8, 2.0, 2.5):
        yield Case(f'vertical, force {force}', VERTICAL.replace(force_amplitudes=force), still)
    draw = np.random.default_rng(11)
    for number in range(random):
        rate = draw.uniform(0.7, 1.5)
        rig = RigParameters(
            damping=10.0 ** draw.uniform(-2.0, -0.8),
            damper_mass=10.0 ** draw.uniform(-1.7, -0.4),
            restitution_1=draw.uniform(0.3, 0.9),
            restitution_2=draw.uniform(0.3, 0.9),
            angle=draw.choice([0.0, draw.uniform(0.0, 0.8)]),
            friction=draw.choice([0.0, draw.uniform(0.0, 0.3)]),
            gravity=draw.choice([0.0, 1.0]),
            force_frequencies=(rate,),
        )
        gap = rig.response_amplitude * 10.0 ** draw.uniform(-0.7, 0.6)
        yield Case(f'random {number}', rig.replace(gap=gap), DISPLACED if gap > 2.5 else still)


def section(case: Case, samples: NDArray[np.void]) -> NDArray[np.float64]:
    """Return the states at the ends of cycles, over the largest of the second half."""
    omega = case.parameters.omega
    states = relative_states(samples) / np.array([1.0, omega, 1.0, omega])
    scaled: NDArray[np.float64] = states / np.abs(states[len(states) // 2 :]).max()
    return scaled


def kind_after(rig: Rig, cycles: int) -> StretchKind:
    """Return what the next cycles of a rig are found to be."""
    cycle = math.tau / rig.parameters.force_frequencies[0]
    state, end = rig.snapshot(), rig.time + cycles * cycle
    result = rig.run(end, np.linspace(rig.time, end, 4 * cycles + 1)[1:])
    logged = LoggedRig(rig.parameters, state=state)
    stretch = built(logged, result.samples, result.events, rig.snapshot())
    return kind_of(stretch, cycle)


def answered(case: Case) -> Answer | None:
    """Return the answer of a long run; None if it has no end."""
    cycle, rig = case.cycle, Rig(case.parameters, case.initial, compiled=None)
    start, drive, _ = FlightStart.of(rig)
    stretch = rig.run(LONG * cycle, np.arange(1, LONG + 1) * cycle, most_events=MOST_EVENTS)
    if stretch.outcome is not Outcome.COMPLETE:
        return None
    states = section(case, stretch.samples)
    events = stretch.events
    period, settled, distance = 0, LONG, dict.fromkeys(CUTS, math.inf)
    for k in range(1, LONGEST_PERIOD + 1):
        if np.abs(states[-2 * k :] - states[-3 * k : -k]).max() < REPEATED:
            period = k
            break
    if period:
        limit = states[-period:][(np.arange(LONG) - LONG) % period]
        far = np.abs(states - limit).max(axis=1)
        late = np.flatnonzero(far > ARRIVED)
        settled = int(late[-1]) + 1 if len(late) else 0
        distance = {cut: float(far[cut - 1]) for cut in CUTS}
    half = LONG // 2
    rows = np.concatenate([start, events, FlightStart.of(rig).row])
    flights = Flights.between(case.parameters, rows, drive)

    def growth(first: int, last: int) -> tuple[float, float]:
        """Return the exponent between two cycles, and its standard error, per cycle."""
        found = growth_exponent(flights, first * cycle, last * cycle)
        return cycle * found.value, cycle * found.standard_error

    exponent, error = growth(half, LONG)
    chaotic_first = False
    if period and settled > LEAST_CHAOS:
        chaotic_first = growth(0, settled)[0] * settled > CHAOTIC_GROWTH
    spread = average_spread(states[half:])
    hit = events['time'][events['kind'] == EventKind.IMPACT]
    kind = None
    if period and (hit > (LONG - QUIET) * cycle).any():
        kind = MotionKind.PERIODIC
    elif period:
        kind = MotionKind.NO_IMPACTS
    elif exponent > CHAOTIC_ERRORS * error and spread > IRREGULAR:
        kind = MotionKind.CHAOTIC
    elif abs(exponent) < NO_EXPONENT and spread < REGULAR:
        kind = MotionKind.QUASI_PERIODIC
    return Answer(kind, period, settled, distance, exponent, error, spread, chaotic_first)


def judged(answer: Answer, cut: int, found: StretchKind) -> str:
    """Return whether what is found of the first cycles is right."""
    if found.kind is MotionKind.UNDECIDED:
        return UNDECIDED
    if answer.kind in (MotionKind.CHAOTIC, MotionKind.QUASI_PERIODIC):
        return RIGHT if found.kind is answer.kind else WRONG
    if found.kind is MotionKind.PERIODIC:
        assert found.recurrence is not None
        same = found.recurrence.cycles == answer.period and answer.distance[cut] < NEAR
        return RIGHT if same else WRONG
    if found.kind is MotionKind.CHAOTIC:
        return RIGHT if answer.chaotic_first and answer.settled > cut else WRONG
    return RIGHT if found.kind is MotionKind.TRANSIENT else WRONG


def judge(case: Case, cuts: tuple[int, ...] = CUTS) -> Outcomes | None:
    """Judge the beginnings of a rig."""
    answer = answered(case)
    if answer is None:
        return None
    found: dict[int, tuple[str, str]] = {}
    began = perf_counter()
    for cut in cuts:
        kind = kind_after(Rig(case.parameters, case.initial), cut)
        outcome = judged(answer, cut, kind) if answer.kind else ''
        found[cut] = outcome, f'{kind.kind.value}: {kind.evidence}'
    return Outcomes(case, answer, found, perf_counter() - began)


def main() -> None:
    """Judge them all, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n\n')[0])
    parser.add_argument('--rigs', type=int, default=60, help='random ones among them [60]')
    parser.add_argument('--workers', type=int, default=1, help='processes [1]')
    parser.add_argument('--list', action='store_true', help='list all, not just the wrong ones')
    arguments = parser.parse_args()
    wanted = list(cases(arguments.rigs))
    with ProcessPoolExecutor(arguments.workers, get_context('spawn')) as pool:
        results = list(tqdm(pool.map(judge, wanted), total=len(wanted), disable=None))
    done = [result for result in results if result is not None]
    clear = [result for result in done if result.answer.kind is not None]
    counts: Counter[tuple[str, int, str]] = Counter()
    for case, answer, found, _ in done:
        name = answer.name
        for cut, (outcome, text) in found.items():
            if answer.kind:
                counts[name, cut, outcome] += 1
            if arguments.list or outcome == WRONG:
                print(
                    f'{case.name}, {cut} cycles: {outcome}. After {LONG}: {name}, period '
                    f'{answer.period}, settled at {answer.settled}, exponent '
                    f'{answer.exponent:+.4f} +- {answer.error:.4f}, spread {answer.spread:.1g}. '
                    f'Found {text}'
                )
    print(f'{len(wanted)} rigs, {len(clear)} of which have a clear answer')
    print('right / undecided / wrong, by the cycles that are recorded\n')
    print(f'{"after 20,000 cycles":<27}{"rigs":>5}' + ''.join(f'{cut:>14}' for cut in CUTS))
    rows = sorted({result.answer.name for result in clear})
    for name in [*rows, 'all']:
        chosen = [r for r in clear if name in ('all', r.answer.name)]
        line = f'{name:<27}{len(chosen):>5}'
        for cut in CUTS:
            row = [
                sum(counts[n, cut, outcome] for n in (rows if name == 'all' else [name]))
                for outcome in (RIGHT, UNDECIDED, WRONG)
            ]
            line += f'{" / ".join(map(str, row)):>14}'
        print(line)
    seconds = sum(result.seconds for result in done)
    number = sum(len(result.found) for result in done)
    print(f'\n{seconds / max(number, 1):.2f} s for each of {number} judgements')


if __name__ == '__main__':
    main()
