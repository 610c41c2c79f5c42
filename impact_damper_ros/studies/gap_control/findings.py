"""The findings of the gap control study: comparisons of the laws, and its targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from .runs import (
    ANGLES,
    INDEPENDENT_LAWS,
    LAWS,
    Extent,
    Measured,
    ideal_ratio,
    inclined_rig,
    optimal_gap,
)

#: The laws in tables and legends.
LAW_LABELS = {
    'fixed': 'fixed gap, tuned at 1 N',
    'amplitude symmetric': 'amplitude, symmetric stops',
    'amplitude': 'amplitude, independent stops',
    'timed symmetric': 'timed, symmetric stops',
    'timed': 'timed, independent stops',
    'predictive': 'predictive (knows the model)',
}
#: Results of the runs by their keys.
Results = Mapping[tuple[object, ...], Measured]


@dataclass(frozen=True)
class LevelSweep:
    """Runs at several levels of the force at resonance."""

    levels: tuple[float, ...]  # N
    #: Amplitude (rms times sqrt 2) over that without impacts, by law, at each level.
    ratios: dict[str, tuple[float, ...]]
    ideal: tuple[float, ...]  # the least possible ratio, in closed form


def tuned_shares(results: Results, extent: Extent) -> dict[int, float]:
    """Return the best fixed gap at 1 N for each angle, relative to the ideal, from tuning runs."""

    def best(angle: int) -> float:
        return min(extent.gaps, key=lambda share: results['tuning', angle, share].rms)

    return {angle: best(angle) for angle in (0, *ANGLES)}


def best_gap_at_resonance(results: Results, extent: Extent) -> tuple[float, float]:
    """Return the best fixed gap of the level rig at 1 N, m, and X over that without impacts."""
    share = tuned_shares(results, extent)[0]
    rig = inclined_rig(0)
    ratio = math.sqrt(2.0) * results['tuning', 0, share].rms / rig.response_amplitude
    return share * optimal_gap(rig), ratio


def level_sweep(results: Results, extent: Extent, angle: int = 0) -> LevelSweep:
    """Return the results over the level of the force, for the rig at an angle."""
    rig = inclined_rig(angle)
    forced = [rig.replace(force_amplitudes=[level]) for level in extent.levels]
    ratios = {
        one: tuple(
            math.sqrt(2.0) * results['level', angle, one, level].rms / alone.response_amplitude
            for level, alone in zip(extent.levels, forced, strict=True)
        )
        for one in ('fixed', *LAWS)
    }
    return LevelSweep(extent.levels, ratios, tuple(map(ideal_ratio, forced)))


@dataclass(frozen=True)
class Broadband:
    """Runs under broadband excitation."""

    #: The fixed gap with the smallest rms in the mean over the seeds, m, and that mean.
    best: float
    best_rms: float
    #: The fixed gap with the smallest rms for each seed, m, and that rms.
    own: tuple[float, ...]
    own_rms: tuple[float, ...]
    #: Ratios of rms and of peak to those with the best gap of each seed, by law.
    ratios: dict[str, tuple[tuple[float, float], ...]]
    #: Ratios of rms to that with the one gap that is best for all seeds, by law.
    common: dict[str, tuple[float, ...]]
    #: Ratios of rms under the timed law to the least with a gap of whole metres.
    coarse: tuple[float, ...]
    #: Ratios of rms with stops of finite speed to that with the best gap of each seed, by law.
    real: dict[str, tuple[float, ...]]


def broadband(results: Results, extent: Extent) -> Broadband:
    """Return the comparison of the broadband runs."""
    fixed = {
        gap: [results['broadband', 'fixed', gap, seed] for seed in extent.seeds]
        for gap in extent.broadband_gaps
    }
    best = min(fixed, key=lambda gap: fmean(run.rms for run in fixed[gap]))
    own = [min(fixed, key=lambda gap: fixed[gap][k].rms) for k in range(len(extent.seeds))]
    least = [fixed[gap][k] for k, gap in enumerate(own)]
    ratios, common, real = {}, {}, {}
    for one in LAWS:
        runs = [results['broadband', one, seed] for seed in extent.seeds]
        ratios[one] = tuple(
            (run.rms / ref.rms, run.peak / ref.peak) for run, ref in zip(runs, least, strict=True)
        )
        common[one] = tuple(run.rms / ref.rms for run, ref in zip(runs, fixed[best], strict=True))
    whole = [gap for gap in fixed if gap.is_integer()]
    coarse = tuple(
        results['broadband', 'timed', seed].rms / min(fixed[gap][k].rms for gap in whole)
        for k, seed in enumerate(extent.seeds)
    )
    for one in INDEPENDENT_LAWS:
        runs = [results['real', 'broadband', one, seed] for seed in extent.seeds]
        real[one] = tuple(run.rms / ref.rms for run, ref in zip(runs, least, strict=True))
    return Broadband(
        best,
        fmean(run.rms for run in fixed[best]),
        tuple(own),
        tuple(run.rms for run in least),
        ratios,
        common,
        coarse,
        real,
    )


@dataclass(frozen=True)
class Power:
    """Mean powers of runs with stops of finite speed, W."""

    impacts: float
    dashpot: float
    actuators: float

    @property
    def share(self) -> float:
        """What the actuators spend over what impacts and dashpot dissipate."""
        return self.actuators / (self.impacts + self.dashpot)


def mean_power(runs: Sequence[Measured]) -> Power:
    """Return the mean powers of some runs."""
    return Power(
        fmean(run.impact_power for run in runs),
        fmean(run.dashpot_power for run in runs),
        fmean(run.actuator_power for run in runs),
    )


def real_power(results: Results, extent: Extent, where: str, name: str) -> Power:
    """Return the powers at resonance under 1 N, or the mean of the seeds under broadband."""
    keys: Sequence[float] = extent.seeds if where == 'broadband' else (1.0,)
    return mean_power([results['real', where, name, key] for key in keys])


@dataclass(frozen=True)
class Target:
    """An upper limit that the control should reach, and the value found."""

    text: str
    limit: float
    reached: float  # with stops that move at once
    #: With stops of finite speed, and what their actuators spend over what M loses.
    real: float
    share: float

    @property
    def met(self) -> bool:
        """Whether it is met."""
        return self.reached <= self.limit


def _spread(values: Sequence[float]) -> float:
    """Return half the range of values over its centre."""
    return (max(values) - min(values)) / (max(values) + min(values))


def targets(results: Results, extent: Extent) -> list[Target]:
    """Return the targets with the values reached."""
    level = level_sweep(results, extent)
    found = broadband(results, extent)
    timed = level.ratios['timed']
    forced = [inclined_rig(0).replace(force_amplitudes=[value]) for value in extent.levels]
    real = [
        math.sqrt(2.0) * results['real', 'level', 'timed', value].rms / rig.response_amplitude
        for value, rig in zip(extent.levels, forced, strict=True)
    ]
    resonance = real_power(results, extent, 'level', 'timed').share
    random = real_power(results, extent, 'broadband', 'timed').share

    def over_ideal(ratios: Sequence[float]) -> float:
        return max(a / b for a, b in zip(ratios, level.ideal, strict=True))

    return [
        Target(
            'timed law at resonance: amplitude over the ideal ζ/(ζ + ζ_eq), largest of all levels',
            1.15,
            over_ideal(timed),
            over_ideal(real),
            resonance,
        ),
        Target(
            'timed law at resonance: spread of the amplitude ratio over a 16-fold range of force',
            0.10,
            _spread(timed),
            _spread(real),
            resonance,
        ),
        Target(
            'timed law, broadband: rms over that with the best fixed gap of each seed, mean of '
            'the seeds',
            0.85,
            fmean(rms for rms, _ in found.ratios['timed']),
            fmean(found.real['timed']),
            random,
        ),
        Target(
            'timed law, broadband: the same, largest of the seeds',
            0.85,
            max(rms for rms, _ in found.ratios['timed']),
            max(found.real['timed']),
            random,
        ),
    ]
