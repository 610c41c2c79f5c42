"""
Dense, vectorised check of claimed first events of single flights.

Every flight is sampled finely compared to its fastest period, in double precision.  Samples
below zero, local minima that could pass below zero, the start of a flight from a stop and a bent
last cell are looked at again in 80 bits.  No bound of the motion is relied on to skip anything.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields
from functools import partial

import numpy as np

from oracle.bracketed_root import bracketed_root
from oracle.flight_cases import (
    EPS,
    REAL,
    Array,
    FlightCases,
    closed_form,
    precise,
    round_off,
    taylor_series,
)

NONE, STOP_1, STOP_2, REVERSAL = 0, 1, 2, 3
OK, MISSED, FALSE = 0, 1, 2
OCTAVES = 60
#: Samples per fastest period
DENSITY = 24
CHUNK = 40_000
BLOCK = 20_000


@dataclass
class Verdict:
    """
    What became of each claim.

    `status` is OK, MISSED (an earlier event, at `missed_at`) or FALSE (no event where one is
    claimed).  `margin` is the lowest value of any watched function before the claimed instant, in
    units of round-off (inf where none came near zero; below -tolerance is a miss); `residual` is
    the value at the claimed instant in the same units.
    """

    status: Array
    margin: Array
    residual: Array
    missed_at: Array

    @property
    def missed(self) -> int:
        """Return the number of flights with an earlier event."""
        return int((self.status == MISSED).sum())

    @property
    def false(self) -> int:
        """Return the number of claimed events that are none."""
        return int((self.status == FALSE).sum())


def watched(
    cases: FlightCases, index: Array, kind: int, motion: tuple[Array, Array, Array]
) -> tuple[Array, Array]:
    """Return a watched function and its slope at times of some flights."""
    s, u, a = motion
    shape = (-1,) + (1,) * (s.ndim - 1)
    h, y0 = (c[index].astype(s.dtype).reshape(shape) for c in (cases.half_gap, cases.y0))
    if kind == STOP_1:
        return (h - y0) - s, -u
    if kind == STOP_2:
        return (h + y0) + s, u
    sign = cases.slide[index].astype(s.dtype).reshape(shape)
    return sign * u, sign * a


def watches(cases: FlightCases, index: Array, kind: int) -> Array:
    """Return whether the flights can have an event of this kind."""
    if kind == STOP_1:
        return np.ones(len(index), dtype=bool)
    return np.asarray((~cases.one_sided if kind == STOP_2 else cases.watch_reversal)[index])


class Check:
    """
    One run of the check over a set of flights.

    Parameters
    ----------
    cases : FlightCases
        The flights.
    kind : array of int
        Claimed first events: NONE, STOP_1, STOP_2 or REVERSAL.
    tau : array
        Claimed instants; where the kind is NONE, how far no event is claimed.
    tolerance : float
        In units of round-off.
    unit : {'local', 'position'}
        Of round-off, see `flight_cases.round_off`.
    """

    def __init__(
        self,
        cases: FlightCases,
        kind: Array,
        tau: Array,
        tolerance: float = 64.0,
        unit: str = 'local',
    ) -> None:
        n = len(cases)
        self.cases, self.kind, self.tau = cases, np.asarray(kind), np.asarray(tau, dtype=float)
        self.tolerance, self.unit = tolerance, unit
        self.margin = np.full(n, np.inf)
        self.missed_at = np.full(n, np.inf)
        self.valid = np.isfinite(self.tau) & (self.tau > 0)
        self.series = taylor_series(cases)
        # (kind, flight, time) to examine, (kind, flight, before, after) to find a minimum in.
        self.points: list[tuple[int, Array, Array]] = []
        self.brackets: list[tuple[int, Array, Array, Array]] = []

    def run(self) -> Verdict:
        """Check everything."""
        cells = np.ones(len(self.cases), dtype=int)
        cells[self.valid] = np.maximum(
            16, np.ceil((self.tau * self.cases.fastest)[self.valid] / (2 * np.pi) * DENSITY)
        )
        self.step = self.tau / cells
        for index, count in self._groups(cells):
            self._sweep(index, count)
        self._starts()
        self._flush()
        residual = self._residuals()
        status = np.where(self.missed_at < np.inf, MISSED, OK)
        false = ~self.valid | ((self.kind != NONE) & ~(residual <= self.tolerance))
        status[(status == OK) & false] = FALSE
        return Verdict(status, self.margin, residual, self.missed_at)

    def _groups(self, cells: Array) -> Iterator[tuple[Array, int]]:
        """Group flights of like length, so that a sweep is a rectangle (finer, never coarser)."""
        level = np.ceil(np.log2(cells) * 4).astype(int)
        harmonics = (self.cases.force_acc != 0) * np.arange(1, self.cases.force_acc.shape[1] + 1)
        active = harmonics.max(axis=1, initial=0)
        for key in np.unique(np.stack([level, active])[:, self.valid], axis=1).T:
            index = np.flatnonzero((level == key[0]) & (active == key[1]) & self.valid)
            count = int(np.ceil(2 ** (key[0] / 4)))
            self.step[index] = self.tau[index] / count
            size = max(1, CHUNK // count)
            for first in range(0, len(index), size):
                yield index[first : first + size], count

    def _sweep(self, index: Array, count: int) -> None:
        cases = self.cases.take(index)
        active = int(((cases.force_acc != 0) * np.arange(1, cases.force_acc.shape[1] + 1)).max())
        t = self.tau[index][:, None] * (np.arange(count + 1) / count)
        step = self.step[index][:, None]
        motion = closed_form(cases.active(active), t)
        noise = round_off(self.cases, index, self.tau[index], 'position')
        rows = np.arange(len(index))
        for kind in (STOP_1, STOP_2, REVERSAL):
            on = watches(cases, rows, kind)
            if not on.any():
                continue
            g, slope = watched(cases, rows, kind, motion)
            floor = 1e3 * noise[1 if kind == REVERSAL else 0][:, None]
            # A slope below its round-off has no sign.
            flat = 1e3 * (noise[1][:, None] if kind != REVERSAL else noise[1][:, None] / step)
            low = (g <= floor) & on[:, None]
            low[:, 0] = low[:, -1] = False
            i, k = np.nonzero(low)
            self.points.append((kind, index[i], t[i, k]))
            dip = (slope[:, :-1] <= flat) & (slope[:, 1:] >= -flat) & on[:, None]
            depth = np.minimum(
                g[:, :-1] - 1.5 * np.abs(slope[:, :-1]) * step,
                g[:, 1:] - 1.5 * np.abs(slope[:, 1:]) * step,
            )
            i, k = np.nonzero(dip & (depth <= floor))
            self.brackets.append((kind, index[i], t[i, k], t[i, k + 1]))
            self._last_cell(kind, index, on, step[:, 0], g, slope)

    def _last_cell(
        self, kind: int, index: Array, on: Array, step: Array, g: Array, slope: Array
    ) -> None:
        """Look closely at a last cell that bends: it may hold two more roots."""
        chord = 6 * (g[:, -1] - g[:, -2])
        bend_before = chord - (4 * slope[:, -2] + 2 * slope[:, -1]) * step
        bend_after = -chord + (2 * slope[:, -2] + 4 * slope[:, -1]) * step
        bent = index[on & (bend_before * bend_after <= 0) & (g[:, -2] <= np.abs(chord))]
        if len(bent):
            back = np.array([1, 7 / 8, 6 / 8, 5 / 8, 4 / 8, 3 / 8, *(0.5 ** np.arange(2, 20))])
            nodes = self.tau[bent][:, None] - self.step[bent][:, None] * back
            self._nodes(kind, bent, nodes)

    def _starts(self) -> None:
        """Look at the start of flights that may come back within the first cell."""
        cases, step = self.cases, self.step
        strength = 2 * cases.strength
        second = self.series[2].astype(float)
        slow = {
            STOP_1: (cases.half_gap - cases.y0, -cases.w0, -second, ~np.isnan(step)),
            STOP_2: (cases.half_gap + cases.y0, cases.w0, second, ~cases.one_sided),
        }
        for kind, (offset, rise, bend, on) in slow.items():
            near = on & self.valid & (offset <= strength * step**2) & (rise >= 0)
            near &= rise <= strength * step
            self._octaves(kind, np.flatnonzero(near), rise, bend)
        rise, bend = np.abs(cases.w0), cases.slide * second
        near = cases.watch_reversal & self.valid & (rise <= strength * step)
        self._octaves(REVERSAL, np.flatnonzero(near), rise, bend)

    def _octaves(self, kind: int, index: Array, rise: Array, bend: Array) -> None:
        """Sample t = step / 2^k, down to where the leading term alone decides the sign."""
        if not len(index):
            return
        strength = 2 * self.cases.strength[index] + 1e-300
        fastest = self.cases.fastest[index]
        first = rise[index] / strength
        second = np.abs(bend[index]) / (strength * fastest)
        first = np.where(rise[index] > 0, first, second)
        with np.errstate(divide='ignore'):
            count = np.log2(self.step[index] / first) + 2
        count = np.clip(np.where(np.isfinite(count), count, OCTAVES), 2, OCTAVES)
        for low, high in ((0, 4), (4, 12), (12, 30), (30, OCTAVES)):
            part = index[(count > low) & (count <= high)]
            nodes = self.step[part][:, None] * 0.5 ** np.arange(high, -1, -1)
            self._nodes(kind, part, nodes)

    def _nodes(self, kind: int, index: Array, nodes: Array) -> None:
        """Examine all nodes of each flight in 80 bits, and the minima between them."""
        size = max(1, CHUNK // nodes.shape[1])
        for k in range(0, len(index), size):
            self._node_chunk(kind, index[k : k + size], nodes[k : k + size])

    def _node_chunk(self, kind: int, index: Array, nodes: Array) -> None:
        n, p = nodes.shape
        flat = np.repeat(index, p)
        t = nodes.astype(REAL).ravel()
        g, slope = self._value(kind, flat, t)
        inside = t > 0
        self._settle(kind, flat[inside], t[inside], g[inside], slope[inside])
        slope = slope.reshape(n, p)
        i, k = np.nonzero((slope[:, :-1] < 0) & (slope[:, 1:] > 0) & (nodes[:, :-1] > 0))
        self.brackets.append((kind, index[i], nodes[i, k], nodes[i, k + 1]))

    def _value(self, kind: int, index: Array, t: Array) -> tuple[Array, Array]:
        """Return a watched function and its slope in 80 bits."""
        motion = precise(self.cases, index, t, self.series)
        return watched(self.cases, index, kind, motion)

    def _slope(self, kind: int, index: Array, t: Array) -> Array:
        return self._value(kind, index, t)[1]

    def _flush(self) -> None:
        """Find the minima and examine the points that were put by."""
        for kind in (STOP_1, STOP_2, REVERSAL):
            chosen = [b[1:] for b in self.brackets if b[0] == kind]
            if chosen:
                index, low, high = (np.concatenate(part) for part in zip(*chosen, strict=True))
                lowest = bracketed_root(partial(self._slope, kind), index, low, high)
                self.points.append((kind, index, lowest))
            points = [p[1:] for p in self.points if p[0] == kind]
            if points:
                index, t = (np.concatenate(part) for part in zip(*points, strict=True))
                t = t.astype(REAL)
                self._settle(kind, index, t, *self._value(kind, index, t))

    def _settle(self, kind: int, index: Array, t: Array, g: Array, slope: Array) -> None:
        """Note the values of a watched function at times before the claimed event."""
        scale = self._scale(kind, index, t, slope)
        value = (g / scale).astype(float)
        np.minimum.at(self.margin, index, value)
        gone = value < -self.tolerance
        np.minimum.at(self.missed_at, index[gone], t[gone].astype(float))

    def _scale(self, kind: int, index: Array, t: Array, slope: Array) -> Array:
        unit = round_off(self.cases, index, t, self.unit)[1 if kind == REVERSAL else 0]
        return np.asarray(unit + EPS * np.abs(slope * t) + 1e-300)

    def _residuals(self) -> Array:
        residual = np.zeros(len(self.cases))
        for kind in (STOP_1, STOP_2, REVERSAL):
            index = np.flatnonzero((self.kind == kind) & self.valid)
            t = self.tau[index].astype(REAL)
            g, slope = self._value(kind, index, t)
            on = watches(self.cases, index, kind)
            scale = self._scale(kind, index, t, slope)
            residual[index] = np.where(on, np.abs(g) / scale, np.inf).astype(float)
        return residual


def check(
    cases: FlightCases, kind: Array, tau: Array, tolerance: float = 64.0, unit: str = 'local'
) -> Verdict:
    """Check claimed first events; see `Check` for the arguments and `Verdict` for the result."""
    kind, tau = np.asarray(kind), np.asarray(tau, dtype=float)
    parts = []
    for k in range(0, max(len(cases), 1), BLOCK):
        block = slice(k, k + BLOCK)
        run = Check(cases.take(block), kind[block], tau[block], tolerance, unit)
        parts.append(run.run())
    return Verdict(
        **{f.name: np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(Verdict)}
    )
