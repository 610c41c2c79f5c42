# SPDX-License-Identifier: Apache-2.0
"""
The claims of Bapat (1995), each with the numbers it rests on and whether they hold.

    python examples/paper/claims.py [--out DIR] [--quick]

All figures are computed first, which takes some minutes. A change of the displacement by less than
10 % counts as small. A claim is reproduced if all of its conditions hold, and in part if some do:
claims.csv. With --quick there are fewer values and no branches of four impacts: what is not known
is no condition then, and verdicts may differ.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import figure_2
import figure_3
import figure_4
import figure_5
import figure_6
import numpy as np
from bapat_rigs import ABOVE, BASIC, OPERATIONS, TILTED, VERTICAL, scaled_rig
from figure_2 import WORDS
from series import Best, Series, best_of, branches_along, durations, near, ratio, same, settled

from impact_damper_ros import (
    GapControlParameters,
    InitialConditions,
    Rig,
    RigParameters,
    find_orbits,
    plausible_stops,
    run_flights,
    with_value,
)
from output import options, say, show, write_rows

#: Relative change of the displacement that counts as small in practice.
SMALL = 0.1
SEQUENCES = {2: ((1, 2),), 3: figure_2.MANY[:2], 4: figure_2.MANY[2:]}
Found = Mapping[str, Series]


@dataclass(frozen=True)
class Claim:
    """A claim: the figure it is about, the numbers, and the conditions that they decide."""

    about: str
    text: str
    numbers: dict[str, float]
    holds: dict[str, bool]
    #: Whether the numbers are those of the paper but for their last digits.
    nearly: bool = False

    @property
    def verdict(self) -> str:
        """Whether it is reproduced."""
        if all(self.holds.values()):
            return 'reproduced'
        if self.nearly:
            return 'reproduced with a different number'
        return 'reproduced in part' if any(self.holds.values()) else 'not reproduced'


def least_ratio(rig: RigParameters) -> float:
    """Return the least stable Xmax/A with two impacts per cycle; NaN without any."""
    found = find_orbits(rig, (1, 2), simulate=False).orbits
    fit = (orbit.x_max_ratio for orbit in found if orbit.stable and orbit.viable)
    return min(fit, default=math.nan)


def least_over(series: Series, values: Sequence[float], *stops: tuple[int, ...]) -> np.ndarray:
    """Return the least stable Xmax/A at some values; NaN where there is none."""
    ranges = series.stable_ranges(*stops)
    return np.array(
        [
            series.least(float(value), *stops)
            if any(low <= value <= high for low, high in ranges)
            else math.nan
            for value in values
        ]
    )


def excess(
    one: Series, other: Series, values: Sequence[float], *stops: tuple[int, ...]
) -> np.ndarray:
    """Return the relative excess of the displacement wherever both are stable."""
    change = least_over(one, values, *stops) / least_over(other, values, *stops) - 1.0
    return change[np.isfinite(change)]


def range_of(name: str, values: Sequence[float]) -> dict[str, float]:
    """Return least and greatest of some values."""
    known = [value for value in values if math.isfinite(value)]
    return {f'{name}, least': min(known), f'{name}, most': max(known)} if known else {}


# The theory itself


def symmetric_displacements(rig: RigParameters) -> list[float]:
    """
    Return X at stop 1 in the symmetric motions, from a quadratic.

    Notes
    -----
    m crosses with the speed v = (2 X + d) Omega/pi, so momentum and restitution give M's speeds
    -v (1 - R + 2 mu)/(1 + R) before and -v (1 - R - 2 mu R)/(1 + R) after stop 1. Half a cycle
    later M must be in the mirrored state. This gives A sin and A cos linearly in v, and the sum of
    their squares is A^2 (Masri and Caughey, 1966).
    """
    mu, restitution = rig.mass_ratio, rig.restitution_1
    rate, omega, zeta = rig.force_frequencies[0], rig.omega, rig.zeta
    half, eta = math.pi / rate, math.sqrt(1.0 - zeta**2)
    # Free vibration over half a cycle of the force
    sine, cosine = math.sin(eta * omega * half), math.cos(eta * omega * half)
    decay = math.exp(-zeta * omega * half)
    phi = decay * np.array(
        [
            [cosine + zeta / eta * sine, sine / (eta * omega)],
            [-omega / eta * sine, cosine - zeta / eta * sine],
        ]
    )
    k = (1.0 + phi[0, 0]) / phi[0, 1]
    after = -(1.0 - restitution - 2.0 * mu * restitution) / (1.0 + restitution)
    # Free part of X over v; then X - free = A sin, and its rate over Omega = A cos
    free = 2.0 * mu / (phi[1, 0] - k * (1.0 + phi[1, 1]))
    a, b = 0.5 * half - free, -0.5 * rig.gap
    c = (after + k * free) / rate
    speeds = np.roots([a**2 + c**2, 2.0 * a * b, b**2 - rig.response_amplitude**2])
    return [0.5 * (float(v) * half - rig.gap) for v in speeds if np.isreal(v) and v > 0.0]


def theory_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims that theory, earlier results and simulation agree."""
    errors = []
    for basic in (BASIC, ABOVE):
        for gap in np.arange(24.0, 56.1, 4.0):
            rig = basic.replace(gap=float(gap))
            solved = [o.x[0] for o in find_orbits(rig, (1, 2), simulate=False).orbits]
            errors += [
                min(abs(x / other - 1.0) for other in solved)
                for x in map(float, symmetric_displacements(rig))
            ]
    yield Claim(
        'text',
        'the theory of the horizontal damper agrees with earlier results',
        {'symmetric motions in closed form': len(errors), 'largest error of X': max(errors)},
        {'error below 1e-9': max(errors) < 1e-9},
    )
    yield simulation_claim(found)


def simulation_claim(found: Found) -> Claim:
    """Judge the agreement by every settled run and every stable motion at the marks."""
    apart, longer, stable, reached, lost, irregular = [], [], 0, 0, [], 0
    for name, series in found.items():
        followed = {branch.orbits[0].stops for branch in series.branches}
        runs: dict[float, list] = {}
        for value, motion in series.runs:
            runs.setdefault(value, []).append(motion)
        for value, motions in runs.items():
            theory = series.at(value)
            attractors = [orbit for orbit in theory if orbit.stable]
            stable += len(attractors)
            reached += sum(any(same(one, orbit) for one in motions) for orbit in attractors)
            for motion in motions:
                if motion.rhythm is None:
                    irregular += motion.period is None
                    continue
                known = [orbit for orbit in theory if same(motion, orbit)]
                if known:
                    apart.append(abs(ratio(motion)[0] / ratio(known[0])[0] - 1.0))
                    continue
                alike = any(motion.rhythm.shifts(stops) for stops in followed)
                if motion.rhythm.cycles == 1 and alike:
                    lost.append(f'{name} at {value:g}')
                solved = motion.orbit
                longer.append(math.inf if solved is None else abs(motion.x_max / solved.x_max - 1))
    solved_too = [value for value in longer if value < 1e-4]
    return Claim(
        'all',
        'theory and simulation agree well, with incline, friction and unequal restitution',
        {
            'settled runs on a branch': len(apart),
            'largest difference of Xmax': max(apart),
            'stable motions at the marks': stable,
            'of which runs settle into': reached,
            'settled runs on no branch': len(longer),
            'of which the solver finds': len(solved_too),
            'runs that do not repeat': irregular,
            **dict.fromkeys(lost, math.nan),
        },
        {
            'displacements agree to 1e-6': max(apart) < 1e-6,
            'runs settle into every stable motion': reached == stable,
            'every run of one cycle with the same stops is on a branch': not lost,
            'the solver finds all other settled motions': len(solved_too) == len(longer),
        },
    )


# Figure 2: the gap


def followed_sequences(found: Found) -> dict[int, Sequence[tuple[int, ...]]]:
    """Return the sequences of stops of Figure 2 by the impacts, those with a branch somewhere."""
    counts = {len(branch.orbits[0].stops) for one in found.values() for branch in one.branches}
    return {count: sequences for count, sequences in SEQUENCES.items() if count in counts}


def gap_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about displacements and ranges of stability over the gap."""
    level = found['horizontal']
    others = {name: series for name, series in found.items() if name != 'horizontal'}
    gaps = np.arange(4.0, 64.1, 0.5)
    numbers, least = {}, {}
    for count, sequences in followed_sequences(found).items():
        word = WORDS[count]
        rows = {
            name: np.concatenate([excess(one, level, gaps, stops) for stops in sequences])
            for name, one in others.items()
        }
        for name, row in rows.items():
            numbers |= range_of(f'{word} impacts, {name}', row)
        if known := [float(row.min()) for row in rows.values() if len(row)]:
            least[word] = min(known)
    wide = gaps[gaps >= 25.0]
    inner = min(float(excess(one, level, wide, (1, 2)).min()) for one in others.values())
    numbers['two impacts, gaps from 25 m, least'] = inner
    numbers |= {f'Xmax/A at 37 m, {name}': one.least(37.0, (1, 2)) for name, one in found.items()}
    yield Claim(
        '2',
        'gravity and friction are detrimental: the displacement is larger than that of the '
        'horizontal frictionless damper',
        numbers,
        {f'{word} impacts': value >= 0.0 for word, value in least.items()}
        | {'two impacts, gaps from 25 m': inner > 0.0},
    )
    yield from range_claims(found)
    yield least_claim(level)


def range_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about ranges of stability, by stop sequence and by number of impacts."""
    by_stops = {
        ''.join(map(str, stops)): {name: one.stable_width(stops) for name, one in found.items()}
        for sequences in followed_sequences(found).values()
        for stops in sequences
    }
    by_number = {
        WORDS[count]: {name: one.stable_width(*sequences) for name, one in found.items()}
        for count, sequences in followed_sequences(found).items()
    }

    def losses(widths: Mapping[str, Mapping[str, float]]) -> dict[str, list[float]]:
        return {
            key: [row['horizontal'] - width for name, width in row.items() if name != 'horizontal']
            for key, row in widths.items()
        }

    smaller = {
        how: [loss > 0.0 for row in losses(widths).values() for loss in row]
        for how, widths in (('stop sequence', by_stops), ('number of impacts', by_number))
    }
    yield Claim(
        '2',
        'gravity and friction reduce the ranges of stability in most cases',
        {
            f'width [m] of {key}, {name}': width
            for widths in (by_stops, by_number)
            for key, row in widths.items()
            for name, width in row.items()
        }
        | {f'smaller, by {how}': sum(cases) / len(cases) for how, cases in smaller.items()},
        {f'by {how}': 2 * sum(cases) > len(cases) for how, cases in smaller.items()},
    )
    numbers, holds = {}, {}
    for how, widths, two in (
        ('stop sequence', by_stops, '12'),
        ('number of impacts', by_number, 'two'),
    ):
        metres = {key: max(row) for key, row in losses(widths).items()}
        shares = {key: loss / max(widths[key]['horizontal'], 1e-9) for key, loss in metres.items()}
        numbers |= {f'largest loss [m], {key}': loss for key, loss in metres.items()}
        numbers |= {f'largest loss, share, {key}': loss for key, loss in shares.items()}
        holds[f'in metres, by {how}'] = metres[two] == max(metres.values())
        holds[f'as a share, by {how}'] = shares[two] == max(shares.values())
    yield Claim(
        '2',
        'the largest reduction of a range of stability is that of two impacts per cycle',
        numbers,
        holds,
    )


def least_claim(level: Series) -> Claim:
    """Judge which number of impacts reduces the displacement most, off and at the resonance."""
    numbers, least = {}, {}
    for count, word in WORDS.items():
        best = best_of(b for b in level.branches if len(b.orbits[0].stops) == count)
        if best is not None:
            value, orbit, *_ = best
            least[count] = orbit.x_max_ratio
            numbers |= {
                f'{word} impacts': orbit.x_max_ratio,
                f'{word} impacts, gap [m]': value,
                f'{word} impacts, longest over shortest duration': max(durations(orbit))
                / min(durations(orbit)),
            }
    longer = [ratio(m)[0] for _, m in level.runs if m.rhythm is not None and m.rhythm.cycles > 1]
    numbers['settled runs of longer periods'] = min(longer, default=math.inf)
    resonant = {
        count: min(
            (
                orbit.x_max_ratio
                for gap in np.arange(10.0, 59.0, 6.0)
                for stops in plausible_stops(BASIC, count)
                for orbit in find_orbits(
                    BASIC.replace(gap=float(gap)), stops, simulate=False
                ).orbits
                if orbit.stable and orbit.viable
            ),
            default=math.inf,
        )
        for count in WORDS
    }
    numbers |= {f'r = 1, {WORDS[count]} impacts': value for count, value in resonant.items()}
    return Claim(
        '2',
        'two equally spaced impacts per cycle reduce the displacement most (introduction)',
        numbers,
        {
            'equally spaced': numbers['two impacts, longest over shortest duration'] < 1.0 + 1e-6,
            'least at r = 1.02': least[2] <= min([*least.values(), *longer]),
            'least at r = 1': resonant[2] == min(resonant.values()),
        },
    )


# Figure 3: restitution, angle, frequency and friction


def response_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about restitution, angle, frequency and friction."""
    gaps, edge = np.arange(20.0, 70.1, 0.5), 41.0
    numbers = {
        f'd = 50 m, {kind}': found[f'a, horizontal, {kind}'].least(50.0)
        for kind in ('equal', 'unequal')
    }
    holds, inner = {}, []
    for name, operation in OPERATIONS.items():
        pair = found[f'a, {name}, unequal'], found[f'a, {name}, equal']
        lower = excess(*pair, gaps[gaps >= edge])
        rigs = [
            BASIC.replace(gravity=2.0, gap=gap, **operation) for gap in (41.0, 45.0, 50.0, 55.0)
        ]
        swapped = {'restitution_1': 0.72, 'restitution_2': 0.78}
        upper = [least_ratio(rig.replace(**swapped)) / least_ratio(rig) - 1.0 for rig in rigs]
        numbers |= range_of(f'{name}, larger R at the lower stop', excess(*pair, gaps))
        numbers |= range_of(f'{name}, larger R at the lower stop, from {edge:g} m', lower)
        numbers |= range_of(f'{name}, larger R at the upper stop', upper)
        holds[f'{name}, larger R at the lower stop'] = float(lower.min()) >= 0.0
        holds[f'{name}, larger R at the upper stop'] = np.nanmin(upper) >= 0.0
        inner += [*lower, *upper]
    holds[f'below 10 % from {edge:g} m on'] = np.nanmax(np.abs(inner)) < SMALL
    yield Claim(
        '3a',
        'slightly different restitutions are detrimental, but insignificantly in practice',
        numbers,
        holds,
    )
    yield angle_claim(found)
    yield from frequency_claims(found)
    values = (0.0, 0.1, 0.2, 0.5)
    ratios = [found['d'].least(value) for value in values]
    yield Claim(
        '3d',
        'a large friction force has a significant effect; sliding friction should be kept low',
        {f'Xmax/A at γ = {v:g}': one for v, one in zip(values, ratios, strict=True)}
        | {'stable up to γ': stable_from(found['d'], 0.0)},
        {'a half more at γ = 0.5': ratios[-1] > 1.5 * ratios[0]},
    )
    forces = {angle: friction_force(angle) for angle in (0.0, 15.0, 45.0, 90.0)}
    yield Claim(
        '3d',
        'the friction force is largest in horizontal operation',
        {f'force at {angle:g}° [N]': force for angle, force in forces.items()},
        {'largest at 0°': forces[0.0] > max(force for angle, force in forces.items() if angle)},
    )


def stable_from(series: Series, value: float) -> float:
    """Return the end of the range of stability that begins at a value."""
    return next((high for low, high in series.stable_ranges() if low <= value <= high), math.nan)


def friction_force(angle: float) -> float:
    """Return the friction on m as the simulator has it, N: half of what its direction changes."""
    rig = BASIC.replace(angle=math.radians(angle), friction=0.2)
    rates = []
    for speed in (5.0, -5.0):
        run = Rig(rig, InitialConditions(initial_damper_velocity=speed))
        run.advance(0.01)
        rates.append((run.sample().damper_velocity - speed) / 0.01)
    return 0.5 * rig.damper_mass * (rates[1] - rates[0])


def angle_claim(found: Found) -> Claim:
    """Judge whether inclination matters more at the resonance."""
    angles, gaps = (4.0, 5.0, 8.0, 10.0), (41.0, 45.0, 50.0, 55.0)
    numbers, rises = {}, {}
    for name, rig in (('r = 1', BASIC), ('r = 1.02', ABOVE)):
        series = found[f'b, {name}']
        rises[name] = [series.least(a) / series.least(0.0) - 1.0 for a in angles]
        numbers |= {f'{name}, {a:g}°': rise for a, rise in zip(angles, rises[name], strict=True)}
        numbers[f'{name}, stable up to [°]'] = stable_from(series, 0.0)
        steep = min(orbit.x_max_ratio for orbit in series.at(45.0))
        numbers[f'{name}, 45°, not stable'] = steep / series.least(0.0) - 1.0
        for gap in gaps:
            level = rig.replace(gap=gap)
            inclined = level.replace(angle=math.radians(10.0))
            rise = least_ratio(inclined) / least_ratio(level) - 1.0
            numbers[f'{name}, 10°, d = {gap:g} m'] = rise
    pairs = list(zip(rises['r = 1'], rises['r = 1.02'], strict=True))
    return Claim(
        '3b',
        'inclination is detrimental, and more so at r = 1 than at r = 1.02 (d = 37 m)',
        numbers,
        {
            'detrimental': all(min(pair) > 0.0 for pair in pairs),
            'more so at r = 1': all(one > other for one, other in pairs),
        },
    )


def frequency_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about small inclinations over the input frequency."""
    rates = np.union1d(np.arange(0.999, 1.006, 0.0005), np.arange(1.006, 1.121, 0.002))
    level = least_over(found['c, 0°'], rates)
    numbers, holds = {}, {}
    for angle in figure_3.ANGLES[1:]:
        change = least_over(found[f'c, {angle}°'], rates) / level - 1.0
        far = rates > 1.005
        numbers |= range_of(f'{angle}°, Ω above 1.005', change[far])
        numbers |= range_of(f'{angle}°, Ω up to 1.005', change[~far])
        gone = np.isfinite(level) & ~np.isfinite(change)
        numbers[f'{angle}°, share of frequencies not stable'] = (
            gone.sum() / np.isfinite(level).sum()
        )
        holds[f'{angle}°, detrimental'] = np.nanmin(change) >= 0.0
        holds[f'{angle}°, small above Ω = 1.005'] = np.nanmax(change[far]) < SMALL
        holds[f'{angle}°, small up to Ω = 1.005'] = np.nanmax(change[~far]) < SMALL
        holds[f'{angle}°, stable'] = not gone.any()
    yield Claim('3c', 'for small inclination the effect is small, but detrimental', numbers, holds)
    rigs = {
        f'd = {gap:g} m': BASIC.replace(gap=gap) for gap in (25.0, 30.0, 37.0, 45.0, 50.0, 55.0)
    }
    rigs |= {
        'R = 0.65': BASIC.replace(restitution_1=0.65, restitution_2=0.65),
        'R = 0.85': BASIC.replace(restitution_1=0.85, restitution_2=0.85),
        'm = 0.03 kg': BASIC.replace(damper_mass=0.03),
        'm = 0.06 kg': BASIC.replace(damper_mass=0.06),
        'C = 0.05 N s/m': BASIC.replace(damping=0.05),
        'F = 2 N': BASIC.replace(force_amplitudes=(2.0,)),
    }
    changes: dict[int, dict[str, list[float]]] = {angle: {} for angle in (5, 10, 15)}
    for name, basic in rigs.items():
        for rate in (1.01, 1.02, 1.04, 1.06, 1.08, 1.1):
            rig = basic.replace(force_frequencies=(rate,))
            reference = least_ratio(rig)
            for angle in changes if math.isfinite(reference) else ():
                inclined = rig.replace(angle=math.radians(angle))
                changes[angle].setdefault(name, []).append(least_ratio(inclined) / reference - 1.0)
    numbers, holds = {}, {}
    for angle, rows in changes.items():
        values = np.concatenate(list(rows.values()))
        numbers |= range_of(f'{angle}°', values)
        numbers[f'{angle}°, cases'] = len(values)
        numbers[f'{angle}°, cases below 10 %'] = int(np.sum(values < SMALL))
        numbers[f'{angle}°, cases not stable'] = int(np.sum(np.isnan(values)))
        holds[f'{angle}°, detrimental'] = np.nanmin(values) >= 0.0
        holds[f'{angle}°, small'] = bool(np.all(values < SMALL))
    for name in rigs:
        values = [value for rows in changes.values() for value in rows.get(name, ())]
        numbers[f'{name}, most'] = max(value for value in values if math.isfinite(value))
    yield Claim('3c', 'the effect is similar for other parameters with r > 1', numbers, holds)


# Figure 4: the natural frequency


def natural_frequency_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about the natural frequency."""
    tilted, level = (found[name] for name in figure_4.RIGS)
    damped = TILTED.replace(damping=0.1)
    readings = {
        'ζ = 0.05, r = 1, F/K = 1 m': damped,
        'ζ = 0.05, r = 1, A = 100 m': damped.replace(force_amplitudes=(10.0,)),
        'AK/F = 1, r = 1, so ζ = 0.5': TILTED.replace(damping=1.0),
        'AK/F = 1, ζ = 0.05, so r = 1.411': damped.replace(
            force_frequencies=(math.sqrt(2.0 - 4.0 * damped.zeta**2),)
        ),
        'F/K = 1 m, r = 1, ζ = 0.005': TILTED,
    }
    omegas = np.geomspace(0.5, 20.0, 13)
    numbers = {}
    for name, rig in readings.items():
        gain = rig.response_amplitude * rig.stiffness / rig.force_amplitudes[0]
        numbers[f'AK/F of {name}'] = gain
        stable = [math.isfinite(least_ratio(scaled_rig(rig, float(omega)))) for omega in omegas]
        numbers[f'share of ω with a stable motion, {name}'] = sum(stable) / len(omegas)
    yield Claim(
        '4',
        'AK/F₀ = 1, ζ = 0.05 and r = 1 are kept while ω varies',
        numbers,
        {
            'AK/F₀ = 1 at ζ = 0.05 and r = 1': abs(
                numbers[f'AK/F of {next(iter(readings))}'] - 1.0
            )
            < 0.1
        },
    )
    low, high = tilted.stable_ranges()[-1]
    ratios = [tilted.least(float(omega)) for omega in np.geomspace(1.0001 * low, high, 25)]
    horizontal = level.least(1.0)
    alone = {
        'gravity alone': TILTED.replace(friction=0.0),
        'friction alone': TILTED.replace(angle=0.0),
        'both': TILTED,
    }
    some = (1.0, 2.0, 5.0, 10.0, 20.0)
    excesses = {
        name: [least_ratio(scaled_rig(rig, omega)) / horizontal - 1.0 for omega in some]
        for name, rig in alone.items()
    }
    yield Claim(
        '4',
        'gravity and friction matter less as the natural frequency rises',
        {'stable from ω [rad/s]': low, 'Xmax/A there': ratios[0], 'Xmax/A at 20': ratios[-1],
         'horizontal without friction': horizontal}
        | {f'{name}, ω = {omega:g}': value for name, row in excesses.items()
           for omega, value in zip(some, row, strict=True)},
        {
            'Xmax/A falls': all(b < a for a, b in pairwise(ratios)),
            'each effect falls': all(b < a for row in excesses.values() for a, b in pairwise(row)),
            'within 1 % of the level at 20': abs(ratios[-1] / horizontal - 1.0) < 0.01,
            'stable from 0.5 rad/s on': low <= 0.5,
        },
    )  # fmt: skip
    changes = {}
    for omega in (1.0, 5.0, 20.0):
        (orbit, *_) = find_orbits(scaled_rig(TILTED, omega), (1, 2), simulate=False).orbits
        before, after = orbit.damper_velocity_before, orbit.damper_velocity_after
        pairs = zip(after, before[1:] + before[:1], strict=True)
        changes[f'ω = {omega:g}'] = max(abs(b / a - 1.0) for a, b in pairs)
    yield Claim(
        '4',
        'because the speed of m then changes relatively less between impacts',
        changes,
        {'falls': all(b < a for a, b in pairwise(changes.values()))},
    )


# Figures 5 and 6: the optimal gap, and compressed air


def optimum_claims(optima: Mapping[float, Best]) -> Iterator[Claim]:
    """Judge the claims about the optimal gap over the angle."""
    first = optima[0.0]
    shift = max(abs(p.value / first.value - 1.0) for a, p in optima.items() if a <= 15.0)
    edges = [angle for angle, best in optima.items() if best.limit]
    yield Claim(
        '5a',
        'for small angles the optimal gap is nearly that of the horizontal damper',
        {f'optimal gap [m], {angle:g}°': best.value for angle, best in optima.items()}
        | {'largest change up to 15°': shift, 'at an edge of stability from [°]': min(edges)},
        {'below 2 % up to 15°': shift < 0.02},
    )
    ratios = {angle: best.orbit.x_max_ratio for angle, best in optima.items()}
    yield Claim(
        '5b',
        'gravity makes the displacement at the optimal gap larger',
        {f'Xmax/A, {angle:g}°': value for angle, value in ratios.items()},
        {'rises with the angle': all(b > a for a, b in pairwise(ratios.values()))},
    )


def least_with_air(series: Series) -> tuple[float, float]:
    """Return the air force over that of friction with the least Xmax/A, and that."""
    best = best_of(series.branches)
    assert best is not None
    return best.value, best.orbit.x_max_ratio


def air_claims(found: Found) -> Iterator[Claim]:
    """Judge the claims about compressed air."""
    # F_i = 2 m g_i is read as an air force p that is twice the net force m g_i on m: p = 2 m γ g
    net, own, ends, best = {}, {}, {}, {}
    small: dict[str, bool] = {}
    by_gap: dict[str, bool] = {}
    for name, series in found.items():
        free, without = series.least(1.0), series.least(0.0)
        near_free = least_over(series, np.linspace(0.5, 1.5, 11)) / free - 1.0
        little = least_over(series, np.linspace(0.0, 0.5, 6)) / without - 1.0
        net |= {f'{name}, Xmax/A without net force': free}
        net |= range_of(f'{name}, p = 0.5 to 1.5 mγg', near_free)
        net |= {f'{name}, p = 2 mγg': series.least(2.0) / free - 1.0}
        own |= {f'{name}, Xmax/A without air': without, f'{name}, p = 0.5 mγg': little[-1]}
        small[f'{name}, net force up to 0.5 mγg'] = np.abs(near_free).max() < SMALL
        small[f'{name}, air force up to 0.5 mγg'] = np.abs(little).max() < SMALL
        ends[f'{name}, stable up to p/mγg'] = stable_from(series, 0.0)
        share, lowest = least_with_air(series)
        at = partial(with_value, series.rig(0.0), 'gap')
        tuned = best_of(branches_along(at, 12.0, 64.0, (20.0, 37.0, 50.0), name='gap'))
        assert tuned is not None
        best |= {
            f'{name}, least with air': lowest,
            f'{name}, at p/mγg': share,
            f'{name}, against no friction': lowest / free - 1.0,
            f'{name}, against no air': lowest / without - 1.0,
            f'{name}, least with the best gap': tuned.orbit.x_max_ratio,
            f'{name}, best gap [m]': tuned.value,
        }
        by_gap[f'{name}: the best gap without air does as well'] = (
            tuned.orbit.x_max_ratio < 1.05 * lowest
        )
    yield Claim(
        '6',
        'a small force of compressed air has an insignificant effect (γ = 0.5, horizontal)',
        net | own,
        small,
    )
    yield Claim(
        '6',
        'at a large force the motion becomes unstable',
        ends,
        {name.replace('stable up to', 'unstable at 5.5'): end < 5.5 for name, end in ends.items()},
    )
    yield Claim('6', 'compressed air is not promising in practice', best, by_gap)


# The vertical rig


def vertical_rig(intensity: float) -> RigParameters:
    """Return the paper's vertical one-sided rig with the gravity that gives A Omega^2/g."""
    rate = VERTICAL.force_frequencies[0]
    return VERTICAL.replace(gravity=VERTICAL.response_amplitude * rate**2 / intensity)


def vertical_claims() -> Iterator[Claim]:
    """Judge the claims about the vertical rig with one stop, and the platform on springs."""
    branches = branches_along(vertical_rig, 0.2, 2.0, (0.8,), ((1,),))
    ((low, high),) = Series(vertical_rig, 0.2, 2.0, tuple(branches)).stable_ranges()
    yield Claim(
        'text',
        'vertical, one stop (Ω = 10 rad/s, μ = 0.01, R = 0.75): one impact per cycle is stable '
        'for 0.45 < AΩ²/g < 1.12',
        {'from': low, 'to': high},
        {'from 0.45': round(low, 2) == 0.45, 'to 1.12': round(high, 2) == 1.12},
        nearly=abs(low / 0.45 - 1.0) < 0.01 and abs(high / 1.12 - 1.0) < 0.01,
    )
    restitution = VERTICAL.restitution_1
    lightest = math.pi * (1.0 - restitution) / (1.0 + restitution)
    doubling = math.hypot(lightest, 2.0 * (1.0 + restitution**2) / (1.0 + restitution) ** 2)
    yield Claim(
        'text',
        'this range agrees with earlier results for a table too heavy to be moved by the ball',
        {'heavy table, from': lightest, 'heavy table, to': doubling,
         'from, apart': low / lightest - 1.0, 'to, apart': high / doubling - 1.0},
        {'within 3 %': max(abs(low / lightest - 1.0), abs(high / doubling - 1.0)) < 0.03},
    )  # fmt: skip
    numbers, apart = {}, []
    for intensity in (0.5, 0.8, 1.1):
        orbit = find_orbits(vertical_rig(intensity), (1,), simulate=False).orbits[0]
        run = settled(near(orbit), 3000)
        numbers |= {
            f'AΩ²/g = {intensity:g}, Xmax/A of the solver': orbit.x_max_ratio,
            f'AΩ²/g = {intensity:g}, settled run': ratio(run)[0],
        }
        apart.append(abs(ratio(run)[0] / orbit.x_max_ratio - 1.0))
    yield Claim(
        'text',
        'a mass on a platform on springs is a case of the general theory (conclusions)',
        numbers,
        {'solver and simulation agree to 1e-6': max(apart) < 1e-6},
    )


# The coefficients of friction and gravity, and the control of the gap


def coefficient_claim() -> Claim:
    """Judge that g, angle and friction act only through g sin(angle) and mu g cos(angle)."""
    one = ABOVE.replace(angle=math.radians(45.0), gravity=1.0, friction=0.5)
    weight, grip = math.sin(one.angle), 0.5 * math.cos(one.angle)
    errors = []
    for angle in (10.0, 30.0, 60.0):
        steep = math.radians(angle)
        gravity = weight / math.sin(steep)
        other = one.replace(
            angle=steep, gravity=gravity, friction=grip / (gravity * math.cos(steep))
        )
        for gap in (30.0, 37.0, 45.0):
            pair = [
                find_orbits(rig.replace(gap=gap), (1, 2), simulate=False).orbits
                for rig in (one, other)
            ]
            errors += [min(map(orbit.distance, pair[1])) for orbit in pair[0]]
    return Claim(
        'text',
        'friction and gravity enter the equations of the impacts by two coefficients only',
        {'motions of rigs with the same g sin θ and γ g cos θ': len(errors),
         'largest distance': max(errors)},
        {'distance below 1e-9': max(errors) < 1e-9},
    )  # fmt: skip


def control_claim(found: Found) -> Claim:
    """Judge the control of the gap by this program's timed law, a reconstruction."""
    numbers, holds = {}, {}
    for name, series in found.items():
        rig, (_, lowest) = series.rig(0.0), least_with_air(series)
        cycle = math.tau / rig.force_frequencies[0]
        for friction in (rig.friction, 0.0):
            law = GapControlParameters(
                gap_control='timed',
                gap_control_stops='independent',
                gap_control_rate=32.0 * rig.omega / math.tau,
            )
            run = Rig(rig.replace(friction=friction), control=law, compiled=None)
            run.run(240.0 * cycle, record=False)
            largest = run_flights(run, 320.0 * cycle).integrals()[1]
            controlled = f'{name}, γ = {friction:g}, gap controlled'
            numbers[controlled] = largest / rig.response_amplitude
            if friction:
                holds[f'{name}, γ = {friction:g}'] = numbers[controlled] < lowest
        numbers[f'{name}, least with air'] = lowest
    return Claim(
        '6',
        'active control of the gap is better than compressed air (earlier results)',
        numbers,
        holds,
    )


def all_claims(quick: bool) -> Iterator[Claim]:
    """Compute all figures, and judge the claims in the order of the paper's figures."""
    say(f'The figures come first, which takes {"a minute or two" if quick else "some minutes"}.')
    found = {}
    for module in (figure_2, figure_3, figure_4, figure_6):
        name = module.__name__[-1]
        say(f'Figure {name}')
        found[name] = module.series_of_figure(quick)
    say('The claims')
    yield from theory_claims(
        {f'{figure}: {name}': one for figure, row in found.items() for name, one in row.items()}
    )
    yield from gap_claims(found['2'])
    yield from response_claims(found['3'])
    yield from natural_frequency_claims(found['4'])
    say('Figure 5')
    yield from optimum_claims(figure_5.optima_of_figure(quick))
    yield from air_claims(found['6'])
    yield from vertical_claims()
    yield coefficient_claim()
    yield control_claim(found['6'])


def main() -> None:
    """Judge, print and write."""
    arguments = options(__doc__)
    if arguments.quick:
        print('A coarse look: verdicts may differ from those of the full run.\n', flush=True)
    claims = []
    for number, claim in enumerate(all_claims(arguments.quick), 1):
        claims.append(claim)
        print(f'{number}. [{claim.about}] {claim.text}')
        print('   ' + ', '.join(f'{name} {value:.5g}' for name, value in claim.numbers.items()))
        print(
            '   ' + ', '.join(f'{"yes" if h else "NO"}: {name}' for name, h in claim.holds.items())
        )
        print(f'   -> {claim.verdict}\n', flush=True)
    show(
        ('no.', 'about', 'claim', 'verdict', 'does not hold'),
        (
            (number, claim.about, claim.text, claim.verdict,
             ', '.join(name for name, holds in claim.holds.items() if not holds))
            for number, claim in enumerate(claims, 1)
        ),
    )  # fmt: skip
    write_rows(
        arguments.out / 'claims.csv',
        ('no.', 'about', 'claim', 'kind', 'name', 'value', 'verdict'),
        (
            [number, claim.about, claim.text, kind, name, float(value), claim.verdict]
            for number, claim in enumerate(claims, 1)
            for kind, values in (('quantity', claim.numbers), ('condition', claim.holds))
            for name, value in values.items()
        ),
    )


if __name__ == '__main__':
    main()
