"""A stretch that repeats, or comes to: its last period, the prediction, and the way there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .approach import DecayRate, decay_rate, distances_to, period_states
from .force_clock import ForceClock
from .matched_orbit import MatchedOrbit, impact_table, match_orbit, state_row
from .recurrence import SETTLED, ImpactTable, Recurrence
from .run_curves import Array, Convergence
from .steady_part import last_period, period_end
from .stretch_kind import StretchKind
from .stretch_measures import Decay, Finding, ImpactStates

__all__ = ['PeriodicPart', 'periodic_part']

#: Periods shown, at most, and after the stamps hide all that is left.
_MOST_SHOWN_PERIODS, _PERIODS_BEYOND = 4000, 60
_HIDDEN = 3.0
#: How much farther than its own bound the run may be from the motion it approaches.
_MARGIN = 3.0
_FLOORS = 5.0
_SOLVED = 1e-9
_DIFFERENT = 1e-3


@dataclass(frozen=True)
class PeriodicPart:
    """
    What is known of a motion that repeats.

    Attributes
    ----------
    period : ImpactStates
        Its last period.
    time : float
        Instant of the first impact of that, rig time, s.
    match : MatchedOrbit
        The predicted motion.
    decay : DecayRate
        The measured decay.
    times, distances : ndarray of shape (p,)
        Beginning of each period, s, and its distance from the predicted motion; from the last
        period, if there is no prediction.
    allowed : float
        Distance of the last period that the remaining transient and the stamps account for.
    settled_at : float or None
        Instant from which the distance is less than `SETTLED`, s.
    table : ImpactTable
        What scales the states.
    recurrence : Recurrence
        How the motion repeats.
    """

    period: ImpactStates
    time: float
    match: MatchedOrbit
    decay: DecayRate
    times: Array
    distances: Array
    allowed: float
    settled_at: float | None
    table: ImpactTable
    recurrence: Recurrence

    @property
    def predicted_factor(self) -> float:
        """Largest modulus of the multipliers; NaN without a prediction."""
        orbit = self.match.orbit
        return abs(orbit.multipliers[0]) if orbit is not None else np.nan

    def as_decay(self) -> Decay:
        """Return measured against predicted decay."""
        return Decay(
            measured=self.decay.factor,
            predicted=self.predicted_factor,
            periods=self.decay.stop - self.decay.start,
            distance=float(self.distances[-1]),
            floor=self.table.floor,
        )

    def as_curve(self) -> Convergence:
        """Return the way to the periodic motion, for a plot."""
        hidden = np.flatnonzero(self.distances < _HIDDEN * self.table.floor)
        last = min(
            int(hidden[0]) + _PERIODS_BEYOND if len(hidden) else _MOST_SHOWN_PERIODS,
            _MOST_SHOWN_PERIODS,
        )
        return Convergence(
            time=self.times[:last],
            distance=self.distances[:last],
            floor=self.table.floor,
            fitted_from=min(self.decay.start, last),
            fitted_to=min(self.decay.stop, last),
            measured=self.decay.factor,
            predicted=self.predicted_factor,
        )

    def differences(self) -> list[Finding]:
        """Return what differs most between the last period and the predicted one."""
        orbit = self.match.orbit
        if orbit is None or orbit.impacts != len(self.period.stops):
            return []
        found = []
        late = round(self.period.phases[0] - orbit.phases[0])
        groups = (
            ('phase', 'cycles', self.period.phases, orbit.phases, 1.0),
            ('X', 'm', self.period.x, orbit.x, self.table.length),
            (
                "X' after",
                'm/s',
                self.period.primary_velocity_after,
                orbit.primary_velocity_after,
                self.table.speed,
            ),
            (
                "Z' after",
                'm/s',
                self.period.damper_velocity_after,
                orbit.damper_velocity_after,
                self.table.speed,
            ),
        )
        for name, unit, measured, predicted, size in groups:
            pairs = []
            for a, b in zip(measured, predicted, strict=True):
                off = a - b
                if name == 'phase':
                    off -= late
                    off -= orbit.cycles * round(off / orbit.cycles)
                pairs.append((abs(off) / size, off, b))
            worst = max(range(len(pairs)), key=lambda i: pairs[i][0])
            share, off, expected = pairs[worst]
            if share <= self.allowed:
                continue
            where = f'{name} at impact {worst + 1} (stop {orbit.stops[worst]})'
            found.append(
                Finding(
                    quantity=where,
                    unit=unit,
                    time=self.time,
                    measured=expected + off,
                    expected=expected,
                    tolerance=self.allowed * size,
                    text=(
                        f'{where} is {expected + off:.9g} {unit}, predicted {expected:.9g} '
                        f'{unit}: off by {off:+.4g} {unit}'
                    ),
                )
            )
        return found


def periodic_part(clock: ForceClock, kind: StretchKind, *, predict: bool) -> PeriodicPart:
    """
    Analyse a motion that repeats.

    Parameters
    ----------
    clock : ForceClock
        The force and the rig, as logged.
    kind : StretchKind
        How the motion repeats, and its impacts.
    predict : bool
        Whether there is a theory for it.
    """
    recurrence, impacts = kind.recurrence, kind.impacts
    assert recurrence is not None
    n = recurrence.impacts
    table = impact_table(impacts, clock.zero, clock.cycle)
    end = period_end(table.stop, n)
    rows = period_states(table, recurrence, end)
    period = last_period(clock, impacts, recurrence, end)
    measured = rows[-1].copy()
    whole = np.floor(measured[0])
    measured[:n] -= whole
    if predict:
        match = match_orbit(clock, period, measured, recurrence, table)
    else:
        match = MatchedOrbit(None, np.inf, '')
    reference = rows[-1]
    if match.orbit is not None:
        reference = state_row(match.orbit, table)
        first = reference[0]
        reference[:n] = first + (reference[:n] - first) % recurrence.cycles
        reference[:n] += whole + round(measured[0] - first)
    decay = decay_rate(rows, table.floor)
    distances = distances_to(rows, reference)
    if match.orbit is None:
        distances = distances[:-1] if len(distances) > 1 else distances
    begins = end - n * np.arange(len(rows), 0, -1)
    factor = decay.factor if decay.factor < 1.0 else recurrence.factor
    recent = float(recurrence.distance[-6:].max())
    allowed = _MARGIN * recent / (1.0 - min(factor, 0.999)) + _FLOORS * table.floor + _SOLVED
    far = np.flatnonzero(distances > max(SETTLED, 0.0))
    settled = int(far[-1]) + 1 if len(far) else 0
    times = impacts.time[begins][: len(distances)]
    return PeriodicPart(
        period=period,
        time=float(impacts.time[end - n]),
        match=match,
        decay=decay,
        times=times,
        distances=distances,
        allowed=allowed,
        settled_at=float(times[settled]) if settled < len(times) else None,
        table=table,
        recurrence=recurrence,
    )
