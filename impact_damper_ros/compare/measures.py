# SPDX-License-Identifier: Apache-2.0
"""Measurements of a stretch: its steady part, energy, and the arrays for plots."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.orbits.transmissibility import Transmissibility
from impact_damper_ros.replay.rows import Samples

from .result import Array, EnergyBalance, ImpactStates, MotionCurve, Spectrum, SteadyPart
from .stretches import RecordedStretch

#: Relative round-off of a balance.
_BALANCE_ERROR = 1e-9
_MOST_ROWS, _PER_CYCLE = 12_000, 200
_MOST_LINES = 4096
_MOST_SPECTRUM_SAMPLES = 2**17
_HIGHEST_HARMONIC = 12.0


def measured_motion(
    stretch: RecordedStretch,
    start: float,
    end: float,
    period: ImpactStates | None = None,
    per_cycle: float = math.nan,
) -> SteadyPart:
    """
    Measure a part of a stretch, as far as it was kept.

    The last period of a periodic motion and its impacts per cycle are given; otherwise the impacts
    are counted.
    """
    flights, rig = stretch.flights.cut(start, end), stretch.parameters
    times, hits = flights.rows['time'], flights.impacts
    if len(flights):
        start, end = float(times[0]), float(times[-1])
    found, largest = flights.integrals()
    x_rms = found.x_rms
    if flights.drive is None:
        inside = (stretch.samples['time'] >= start) & (stretch.samples['time'] <= end)
        x_rms = math.sqrt(np.sum(stretch.samples['x'][inside] ** 2) / max(inside.sum(), 1))
    steady = stretch.drive is not None
    cycles = (end - start) / cycle_of(rig) * steady
    if math.isnan(per_cycle) and cycles > 0.0:
        per_cycle = len(hits) / cycles
    return SteadyPart(
        start=start,
        end=end,
        x_max=largest,
        x_rms=x_rms,
        x_max_ratio=rig.x_max_ratio(largest) if steady else math.nan,
        impacts=len(hits),
        impacts_per_cycle=per_cycle,
        mean_impulse=float(hits['impulse'].mean()) if len(hits) else 0.0,
        largest_impulse=float(hits['impulse'].max(initial=0.0)),
        last_period=period,
        transmissibility=found.transmissibility if steady else Transmissibility(),
    )


def energy_balance(
    stretch: RecordedStretch, start: float, end: float, periods: int
) -> EnergyBalance | None:
    """Balance the energy from one instant to another, both after their impact, if any."""
    flights = stretch.flights.cut(start, end)
    if not len(flights):
        return None
    found, _ = flights.integrals()
    stored = flights.stored_energy()
    spent = found.dashpot + found.friction + found.both + stored
    scale = abs(found.force) + abs(found.air) + found.dashpot + found.friction + abs(found.both)
    return EnergyBalance(
        start=float(flights.rows['time'][0]),
        end=float(flights.rows['time'][-1]),
        periods=periods,
        force=found.force,
        air=found.air,
        dashpot=found.dashpot,
        friction=found.friction,
        impacts=found.both,
        stored=stored,
        residual=found.force + found.air - spent,
        tolerance=_BALANCE_ERROR * scale,
    )


def motion_curve(stretch: RecordedStretch, start: float, cycle: float) -> MotionCurve | None:
    """Return the motion from an instant on; of a motion with too many events, its end."""
    flights, samples = stretch.flights.cut(start, stretch.end), stretch.samples
    # The last events, if there are very many
    flights = flights[max(0, len(flights) - _MOST_ROWS // 4) :]
    if not len(flights):
        return None
    per_second = min(_PER_CYCLE / cycle, _MOST_ROWS / max(float(flights.spans.sum()), 1e-9))
    time, x, velocity, y, relative = flights.curve(per_second)
    stops = []
    for name in ('stop_1', 'stop_2'):
        place = samples[name] - samples['x']
        absent = not len(samples) or (name == 'stop_2' and stretch.parameters.one_sided)
        stops.append(np.full(len(time), np.nan) if absent else _last_values(time, samples, place))
    return MotionCurve(time, x, velocity, y, relative, *stops)


def _last_values(time: Array, samples: Samples, values: Array) -> Array:
    """Return the value of the last sample at or before each instant."""
    index = np.searchsorted(samples['time'], time, side='right') - 1
    found: Array = values[np.clip(index, 0, None)]
    return found


def spectrum(samples: Samples, force_frequency: float) -> Spectrum | None:
    """Return the amplitude spectrum of X at the end of some evenly spaced samples."""
    steps = np.diff(samples['time'])
    if len(steps) < 16:
        return None
    step = float(np.median(steps))
    if step <= 0.0:
        # Each sample stands there twice.
        return None
    uneven = np.flatnonzero(np.abs(steps - step) > 1e-3 * step)
    begin = int(uneven[-1]) + 1 if len(uneven) else 0
    highest = 0.5 / step
    if force_frequency > 0.0:
        highest = min(highest, _HIGHEST_HARMONIC * force_frequency)
    most = min(_MOST_SPECTRUM_SAMPLES, int(_MOST_LINES / (highest * step)))
    x = samples['x'][begin:][-most:]
    if len(x) < 16:
        return None
    window = np.hanning(len(x) + 1)[:-1]
    amplitude: Array = np.abs(np.fft.rfft((x - x.mean()) * window)) * (2.0 / window.sum())
    frequency: Array = np.arange(len(amplitude)) / (len(x) * step)
    shown = frequency <= highest
    return Spectrum(
        frequency=frequency[shown][:_MOST_LINES],
        amplitude=amplitude[shown][:_MOST_LINES],
        force_frequency=force_frequency,
        resolution=float(frequency[1]),
        window='Hann',
    )
