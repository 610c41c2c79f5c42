"""
The best dampers of random structures, against rigs that are run for many gaps.

``PYTHONPATH=.:test python -m design.brute_force --count 20`` prints a line for each structure. A
rig is run on from gap to gap, from a narrow one on, as one would turn a screw: in steps of 3 %
until the motion is lost, then in steps of 0.25 % about the least |X|. The gap of the design must
be that within 1 %, and its |X| within 0.5 %. A rig from rest with that gap is run until it
settles: it must come to that |X| where the design says so, and only there. Where it does not, 150
gaps are tried from rest, up to 95 % of what M alone swings across. None of those may leave 5 %
less than the gap that the design names for a start from rest: the largest |X| of irregular motions
scatters by some per cent.

With ``--worst`` the level and R are uncertain as well, and friction where there is any. 9 x 9 rigs
of levels and values of R, with friction at both ends, are run from rest for 900 cycles, of which
the last 600 count. With the gap to build, and with that of the best worst case, none may be more
than 3 % above the stated worst case; and the gap to build may be 2 % worse than the best of 90
from rest, if it keeps no margin.

With ``--beside 0.15`` the frequency differs from the natural one by up to 15 %. There only |X| is
compared, which hardly depends on the gap.
"""

import argparse
import math
import random
from concurrent.futures import ProcessPoolExecutor
from itertools import repeat
from typing import NamedTuple

import numpy as np

from impact_damper_ros import InitialConditions, Rig, RigParameters, settle
from impact_damper_ros.design.damper_design import best_design
from impact_damper_ros.design.runs_from_rest import at_level, largest_from_rest, widest_hit
from impact_damper_ros.design.worst_case import worst_cases

SEED = 1000
#: Cycles to settle at a gap, and those of which |X| is taken, with samples in each.
_SETTLING, _TAKEN, _SAMPLES = 150, 10, 128
#: Most that largest |X| changes between two cycles of a settled motion.
_STEADY = 0.002
_GAPS_FROM_REST, _MARGIN = 150, 0.95


def from_rest(rig):
    """Return the largest |X| of a rig some time after it was started from rest, m."""
    return float(largest_from_rest(rig, {'gap': [rig.gap]})[0])


def random_structure(seed, beside=0.0):
    """
    Return a structure with a damper of some mass, shaken by a force or by its base.

    The frequency differs from the natural one by up to a share of it.
    """
    draw = random.Random(seed)
    frequency = math.exp(draw.uniform(math.log(0.5), math.log(80.0)))
    r = draw.uniform(0.3, 0.8)
    zeta = math.exp(draw.uniform(math.log(0.003), math.log(0.03)))
    values = {'mass_ratio': math.exp(draw.uniform(math.log(0.5), math.log(8.0))) * zeta}
    if draw.random() < 0.5:
        values |= {'base_amplitudes': draw.uniform(0.1, 5.0), 'base_quantity': 'acceleration'}
        values |= {'base_frequencies': frequency * math.tau, 'force_amplitudes': 0.0}
    else:
        values |= {'force_amplitudes': draw.uniform(0.1, 100.0)}
        values |= {'force_frequencies': frequency * math.tau}
    rig = RigParameters.of_structure(
        primary_mass=math.exp(draw.uniform(math.log(0.2), math.log(2000.0))),
        natural_frequency=frequency,
        damping_ratio=zeta,
        restitution_1=r,
        restitution_2=r,
        **values,
    )
    if draw.random() < 0.3:
        # As much as takes m some way along, whatever the scale of the rig
        speed = rig.response_amplitude * rig.omega
        friction = 0.05 * speed * rig.omega / rig.gravity * draw.uniform(0.2, 1.0)
        rig = rig.replace(friction=min(friction, 0.3))
    if beside:
        rig = rig.with_first_frequency(rig.omega * draw.uniform(1.0 - beside, 1.0 + beside))
    return rig


def followed(running, rig, gaps):
    """
    Run a rig on from gap to gap; return largest |X| at each.

    It is infinite where m does not hit in each cycle, and where |X| goes on changing.
    """
    cycle = math.tau / rig.first_harmonic[1]
    sizes = []
    for gap in gaps:
        running.change(rig.replace(gap=float(gap)))
        running.run(running.time + _SETTLING * cycle)
        times = running.time + np.linspace(0.0, _TAKEN, _TAKEN * _SAMPLES + 1) * cycle
        run = running.run(float(times[-1]), times)
        parts = [np.abs(part).max() for part in np.array_split(run.samples['x'], _TAKEN // 2)]
        lasting = len(run.impacts()) >= _TAKEN and max(parts) < (1.0 + _STEADY) * min(parts)
        sizes.append(max(parts) if lasting else math.inf)
    return np.array(sizes)


def started(rig, gap):
    """
    Return a rig with some gap that runs, of several starts, in the least motion.

    M is let go at its lower turning point, or at rest, and m thrown as fast as it flies in two
    impacts per cycle, or at other speeds.
    """
    there = rig.replace(gap=float(gap))
    speed = gap * rig.first_harmonic[1] / math.pi
    found = []
    for share in (0.0, 0.05, 0.2):
        for factor in (0.7, 1.0, 1.3):
            initial = InitialConditions(
                initial_primary_position=-share * rig.response_amplitude,
                initial_damper_velocity=factor * speed,
            )
            running = Rig(there, initial, compiled=None)
            found.append((followed(running, rig, [gap] * 2)[-1], len(found), running))
    return min(found)[-1]


def least_by_running(rig, widest):
    """Return the gap up to a widest one with which a rig that is run on moves least, and |X|."""
    gaps = np.geomspace(0.3 * widest, widest, 60)
    sizes = followed(started(rig, gaps[0]), rig, gaps)
    best = int(np.argmin(sizes))
    around = gaps[best] * np.arange(0.95, 1.0501, 0.0025)
    running = started(rig, around[0])
    sizes = followed(running, rig, around)
    best = int(np.argmin(sizes))
    return float(around[best]), float(sizes[best])


class Trial(NamedTuple):
    """A design beside brute force."""

    seed: int
    rig: RigParameters
    gap: float
    x_max: float
    brute_gap: float
    brute_x_max: float
    reached: bool
    reached_truly: bool
    from_rest: float
    brute_from_rest: float

    @property
    def ok(self):
        """Whether the design is right."""
        larger = self.x_max / self.brute_x_max - 1.0
        # A rig that is run on beside the resonance may lose the motion before the best gap
        near = self.rig.frequency_ratio != 1.0 or abs(self.gap / self.brute_gap - 1.0) < 0.01
        near &= larger > -0.005 or self.rig.frequency_ratio != 1.0
        return (
            near
            and larger < 0.005
            and self.reached == self.reached_truly
            and (self.from_rest <= 1.05 * self.brute_from_rest)
        )

    def __str__(self):
        """Return a line of a table."""
        rig = self.rig
        return (
            f'{self.seed:5d} {rig.primary_mass:9.3g} {rig.omega / math.tau:7.3g} '
            f'{rig.frequency_ratio:5.3f} {100 * rig.zeta:6.2f} {100 * rig.mass_ratio:6.2f} '
            f'{rig.restitution_1:5.2f} {rig.friction:7.3g} '
            f'{1e3 * self.brute_gap:9.4g} {1e3 * self.gap:9.4g} '
            f'{100 * (self.gap / self.brute_gap - 1):+6.2f} '
            f'{100 * (self.x_max / self.brute_x_max - 1):+6.2f} '
            f'{"yes" if self.reached else "no":>5} {"yes" if self.reached_truly else "no":>5} '
            f'{100 * (self.from_rest / self.brute_from_rest - 1):+7.2f} '
            f'{"" if self.ok else "WRONG"}'
        )


HEAD = (
    ' seed         M     f0     r   zeta    m/M     R    fric     brute    design   diff      X  '
    'rest truly    rest'
)


def trial(seed, beside=0.0):
    """Return a design beside brute force; None if no damper was found."""
    rig = random_structure(seed, beside)
    design = best_design(rig)
    if design is None:
        return None
    gap, least = least_by_running(rig, 1.6 * design.rig.gap)
    settled = settle(Rig(design.rig))
    same = abs(settled.x_max / design.orbit.x_max - 1.0) < 0.005
    reached = settled.rhythm is not None and same
    alone, brute_alone = design.x_max, design.x_max
    if design.starts_by_itself is not None:
        widest = _MARGIN * 2.0 * design.bare
        gaps = np.geomspace(0.1 * widest, widest, _GAPS_FROM_REST)
        brute_alone = min(from_rest(rig.replace(gap=float(g))) for g in gaps)
    return Trial(
        *(seed, rig, design.rig.gap, design.orbit.x_max, gap, least),
        *(design.reached_from_rest, reached, alone, brute_alone),
    )


def uncertain_structure(seed, beside=0.0):
    """Return a structure, in which ranges its R and friction are, and its lowest level."""
    draw = random.Random(seed + 0.5)
    rig = random_structure(seed, beside)
    half = draw.uniform(0.08, 0.17)
    middle = min(max(rig.restitution_1, 0.3 + half), 0.8 - half)
    ends = middle - half, middle + half
    ranges = {'restitution_1': ends, 'restitution_2': ends}
    if rig.friction:
        ranges['friction'] = 0.5 * rig.friction, 1.5 * rig.friction
    return rig.replace(restitution_1=middle, restitution_2=middle), ranges, draw.choice([0.5, 0.8])


def largest_by_running(rig, cycles=900, counted=600):
    """Return the largest |X| of a rig in the last of some cycles from rest."""
    cycle = math.tau / rig.first_harmonic[1]
    # At other phases in each cycle
    times = np.arange(cycles - counted, cycles, 1.0 / (7.0 + 0.618034)) * cycle
    return np.abs(Rig(rig, compiled=None).run(float(times[-1]), times).samples['x']).max()


def worst_by_running(rig, ranges, low):
    """Return the largest |X| over that without the damper, of 9 levels and 9 values of R."""
    ratios = []
    for friction in ranges.get('friction', (rig.friction,)):
        for level in np.linspace(low, 1.0 / low, 9):
            for r in np.linspace(*ranges['restitution_1'], 9):
                there = at_level(rig, level)
                there = there.replace(restitution_1=r, restitution_2=r, friction=friction)
                ratios.append(largest_by_running(there) / there.response_amplitude)
    return max(ratios)


class WorstTrial(NamedTuple):
    """The stated worst cases of a design beside brute force."""

    seed: int
    rig: RigParameters
    low: float
    chosen: float
    brute_chosen: float
    best: float
    brute_best: float
    x_max: float
    brute_x_max: float
    margin: bool

    @property
    def ok(self):
        """Whether the design is right."""
        above = self.brute_chosen / self.chosen, self.brute_best / self.best
        return max(above) < 1.03 and (self.margin or self.x_max < 1.02 * self.brute_x_max)

    def __str__(self):
        """Return a line of a table."""
        rig = self.rig
        return (
            f'{self.seed:5d} {rig.frequency_ratio:5.3f} {100 * rig.zeta:5.2f} '
            f'{100 * rig.mass_ratio:5.2f} {rig.friction:8.3g} {self.low:4.2f} '
            f'{1e3 * rig.gap:9.4g} {self.chosen:7.3f} {self.brute_chosen:7.3f} '
            f'{100 * (self.brute_chosen / self.chosen - 1):+6.1f} '
            f'{self.best:7.3f} {self.brute_best:7.3f} '
            f'{100 * (self.brute_best / self.best - 1):+6.1f} '
            f'{100 * (self.x_max / self.brute_x_max - 1):+6.1f} '
            f'{"yes" if self.margin else "no":>6} '
            f'{"" if self.ok else "WRONG"}'
        )


WORST_HEAD = (
    ' seed     r  zeta   m/M     fric  low       gap  stated   brute   diff  robust   brute'
    '   diff   X 90 margin'
)


def worst_trial(seed, beside=0.0):
    """Return the stated worst cases of a design beside brute force; None without a design."""
    rig, ranges, low = uncertain_structure(seed, beside)
    design = best_design(rig)
    if design is None:
        return None
    worst = worst_cases(design, ranges, (low, 1.0 / low))
    brute = [
        worst_by_running(rig.replace(gap=one.gap), ranges, low)
        for one in (worst.chosen, worst.best)
    ]
    # Up to the widest that is hit: beyond it there is no damper
    gaps = np.geomspace(0.1, 0.999, 90) * widest_hit(design.rig)
    least = min(largest_by_running(rig.replace(gap=float(gap))) for gap in gaps)
    here = largest_by_running(design.built)
    margin = design.starts_by_itself is not None and design.starts_by_itself.keeps_margin
    return WorstTrial(
        *(seed, design.built, low, worst.chosen.ratio, brute[0], worst.best.ratio, brute[1]),
        *(here, least, margin),
    )


def main():
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--count', type=int, default=20)
    parser.add_argument('--seed', type=int, default=SEED)
    parser.add_argument('--beside', type=float, default=0.0)
    parser.add_argument('--jobs', type=int, default=2)
    parser.add_argument('--worst', action='store_true')
    arguments = parser.parse_args()
    seeds = range(arguments.seed, arguments.seed + arguments.count)
    print(WORST_HEAD if arguments.worst else HEAD)
    kind = worst_trial if arguments.worst else trial
    done = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for seed, one in zip(seeds, pool.map(kind, seeds, repeat(arguments.beside)), strict=True):
            print(one or f'{seed:5d} no damper was found', flush=True)
            done.append(one)
    right = sum(one is not None and one.ok for one in done)
    print(f'{right} of {len(done)} right')


if __name__ == '__main__':
    main()
