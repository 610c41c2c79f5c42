"""The findings of the gap control study: comparisons of the laws, and its targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from .runs import ANGLES, LAWS, Extent, Measured, ideal_ratio, inclined_rig

#: The laws in tables and legends.
LAW_LABELS = {
    'fixed': 'fixed gap, tuned at 1 N',
    'amplitude symmetric': 'amplitude, symmetric stops',
    'amplitude': 'amplitude, independent stops',
    'timed symmetric': 'timed, symmetric stops',
    'timed': 'timed, independent stops',
}
#: Results of the runs by their keys.
Results = Mapping[tuple[object, ...], Measured]


@dataclass(frozen=True)
class LevelSweep:
    """Runs at several levels of the force at resonance."""

    #: N.
    levels: tuple[float, ...]
    #: Amplitude (rms times sqrt 2) over that without impacts, by law, at each level.
    ratios: dict[str, tuple[float, ...]]
    #: The least possible ratio, in closed form.
    ideal: tuple[float, ...]


def tuned_shares(results: Results, extent: Extent) -> dict[int, float]:
    """Return the best fixed gap at 1 N for each angle, relative to the ideal, from tuning runs."""

    def best(angle: int) -> float:
        return min(extent.gaps, key=lambda share: results['tuning', angle, share].rms)

    return {angle: best(angle) for angle in (0, *ANGLES)}


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

    #: The fixed gap with the smallest rms in the mean over the seeds, m.
    best: float
    #: The rms with that gap, by seed, m.
    rms: tuple[float, ...]
    #: Ratios of rms and of peak to those with that gap, by law, for each seed.
    ratios: dict[str, tuple[tuple[float, float], ...]]


def broadband(results: Results, extent: Extent) -> Broadband:
    """Return the comparison of the broadband runs."""

    def mean_rms(gap: float) -> float:
        return fmean(results['broadband', 'fixed', gap, seed].rms for seed in extent.seeds)

    best = min(extent.broadband_gaps, key=mean_rms)
    fixed = [results['broadband', 'fixed', best, seed] for seed in extent.seeds]
    ratios = {}
    for one in LAWS:
        runs = [results['broadband', one, seed] for seed in extent.seeds]
        ratios[one] = tuple(
            (run.rms / ref.rms, run.peak / ref.peak) for run, ref in zip(runs, fixed, strict=True)
        )
    return Broadband(best, tuple(run.rms for run in fixed), ratios)


@dataclass(frozen=True)
class Target:
    """An upper limit that the control should reach, and the value found."""

    text: str
    limit: float
    reached: float

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
    return [
        Target(
            'timed law at resonance: amplitude over the ideal ζ/(ζ + ζ_eq), largest of all levels',
            1.15,
            max(a / b for a, b in zip(timed, level.ideal, strict=True)),
        ),
        Target(
            'timed law at resonance: spread of the amplitude ratio over a 16-fold range of force',
            0.10,
            _spread(timed),
        ),
        Target(
            'timed law, broadband: rms over that with the best fixed gap, mean of the seeds',
            0.85,
            fmean(rms for rms, _ in found.ratios['timed']),
        ),
        Target(
            'timed law, broadband: the same, largest of the seeds',
            0.85,
            max(rms for rms, _ in found.ratios['timed']),
        ),
    ]
