"""What the gap control study found: comparisons, and verdicts on its targets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from .runs import ANGLES, LAWS, Extent, Response, ideal_ratio, inclined_rig

__all__ = [
    'Broadband',
    'LevelSweep',
    'Results',
    'Target',
    'broadband',
    'level_sweep',
    'targets',
    'tuned_shares',
]


Results = Mapping[tuple[object, ...], Response]


@dataclass(frozen=True)
class LevelSweep:
    """
    A sweep over the level of the force at resonance.

    Attributes
    ----------
    levels : tuple of float
        N.
    tuned : float
        The best fixed gap at level 1, over the optimal gap of the ideal amplitude there.
    ratios : dict
        Amplitude (rms times sqrt 2) over that without impacts, by law, at each level.
    ideal : tuple of float
        The same at best, by closed form.
    """

    levels: tuple[float, ...]
    tuned: float
    ratios: dict[str, tuple[float, ...]]
    ideal: tuple[float, ...]


def tuned_shares(results: Results, extent: Extent) -> dict[int, float]:
    """Return the best fixed gap of each angle at level 1, from the runs that look for it."""

    def best(angle: int) -> float:
        return min(extent.gaps, key=lambda share: results['tuning', angle, share].rms)

    return {angle: best(angle) for angle in (0, *ANGLES)}


def level_sweep(results: Results, extent: Extent, angle: int = 0) -> LevelSweep:
    """Return the level sweep of the rig at an angle."""
    rig = inclined_rig(angle)
    forced = [rig.replace(force_amplitudes=[level]) for level in extent.levels]
    ratios = {
        one: tuple(
            math.sqrt(2.0) * results['level', angle, one, level].rms / alone.response_amplitude
            for level, alone in zip(extent.levels, forced, strict=True)
        )
        for one in ('fixed', *LAWS)
    }
    share = tuned_shares(results, extent)[angle]
    return LevelSweep(extent.levels, share, ratios, tuple(map(ideal_ratio, forced)))


@dataclass(frozen=True)
class Broadband:
    """
    Broadband runs.

    Attributes
    ----------
    best : float
        The fixed gap with the smallest rms in the mean of the seeds, m.
    rms, peak : tuple of float
        With that gap, by seed, m.
    ratios : dict
        Ratios of rms and of peak to those, by law, for each seed.
    """

    best: float
    rms: tuple[float, ...]
    peak: tuple[float, ...]
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
    return Broadband(
        best, tuple(run.rms for run in fixed), tuple(run.peak for run in fixed), ratios
    )


@dataclass(frozen=True)
class Target:
    """
    A target of the control, and what was reached.

    Attributes
    ----------
    words : str
        What is asked.
    limit : float
        At most this.
    reached : float
        What was found.
    """

    words: str
    limit: float
    reached: float

    @property
    def met(self) -> bool:
        """Whether it is met."""
        return self.reached <= self.limit


def _spread(values: Sequence[float]) -> float:
    """Return by how much values differ from the middle of their range, relative to it."""
    return (max(values) - min(values)) / (max(values) + min(values))


def targets(results: Results, extent: Extent) -> list[Target]:
    """Return the targets with what was reached."""
    level = level_sweep(results, extent)
    found = broadband(results, extent)
    timed = level.ratios['timed']
    return [
        Target(
            'timed law at resonance: amplitude over the ideal ζ/(ζ + ζ_eq), at the worst level',
            1.15,
            max(a / b for a, b in zip(timed, level.ideal, strict=True)),
        ),
        Target(
            'timed law at resonance: spread of the amplitude ratio over a 16-fold range of force',
            0.10,
            _spread(timed),
        ),
        Target(
            'timed law, broadband: rms over that of the best fixed gap, mean of the seeds',
            0.85,
            fmean(rms for rms, _ in found.ratios['timed']),
        ),
        Target(
            'timed law, broadband: the same for the worst seed',
            0.85,
            max(rms for rms, _ in found.ratios['timed']),
        ),
    ]
