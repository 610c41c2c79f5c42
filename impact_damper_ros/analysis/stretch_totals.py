"""Numbers over a whole stretch: swing, impacts and energy, added up as it is read."""

from __future__ import annotations

import math

import numpy as np

from impact_damper_ros.rig import RigParameters

from .cubic import cubic_swing
from .energy import work_between
from .flight_check import Knots
from .force_clock import ForceClock
from .recorded_stretch import RecordedImpacts
from .stretch_measures import Overall

__all__ = ['StretchTotals']

#: Knots after a joint state that are kept until the next one comes; more mean that none comes.
_MOST_HELD = 20_000
#: Errors of the cubics: of a smooth motion, in (W h)^4, and by steps of the friction, in (W h)^3.
_SMOOTH, _STEPS = 1.0 / 200.0, 1.0 / 50.0


class StretchTotals:
    """
    Adds up what `Overall` has; between the parts it keeps the last joint state.

    Parameters
    ----------
    parameters : RigParameters
        The rig, as logged.
    clock : ForceClock or None
        The force; None if its phase is not known, or its frequency not constant.
    """

    def __init__(self, parameters: RigParameters, clock: ForceClock | None) -> None:
        self._rig, self._clock = parameters, clock
        self._held: Knots | None = None
        self._largest = math.nan
        self._covered = self._squares = self._dashpot = self._taken = self._longest = 0.0
        self._force = 0.0 if clock is not None else math.nan
        self._impacts = [0, 0]

    def take(self, knots: Knots, impacts: RecordedImpacts, longest: float) -> None:
        """
        Take the next part.

        Parameters
        ----------
        knots : Knots
            Its joint states and impacts, in order.
        impacts : RecordedImpacts
            The impacts alone.
        longest : float
            Time from one joint state to the next above which samples are missing between, s.
        """
        # A log may hold any number; what overflows is no number in the result.
        with np.errstate(over='ignore', invalid='ignore'):
            self._count(impacts)
            if len(knots):
                size = float(np.abs(knots.x).max())
                self._largest = size if math.isnan(self._largest) else max(self._largest, size)
            if self._held is not None:
                knots = Knots.joined([self._held, knots])
            samples = np.flatnonzero(knots.stop == 0.0)
            if len(samples) > 1:
                self._integrate(knots[samples[0] : samples[-1] + 1], longest)
            begin = int(samples[-1]) if len(samples) else len(knots)
            self._held = knots[begin:] if 0 < len(knots) - begin <= _MOST_HELD else None

    def _count(self, impacts: RecordedImpacts) -> None:
        for stop in (1, 2):
            self._impacts[stop - 1] += int((impacts.stop == stop).sum())
        before = impacts.velocity_before(self._rig)
        # The difference of the squares, without their cancellation
        lost = (before - impacts.velocity_after) * (before + impacts.velocity_after)
        self._taken += 0.5 * self._rig.primary_mass * float(lost.sum())

    def _integrate(self, knots: Knots, longest: float) -> None:
        """Add the integrals from the first knot to the last one, both joint states."""
        samples = np.flatnonzero(knots.stop == 0.0)
        sampled = np.diff(knots.time[samples]) <= longest
        within = np.repeat(sampled, np.diff(samples))
        step = np.diff(knots.time)
        used = within & (step > 0.0)
        if not used.any():
            return
        begin, end, step = knots[:-1][used], knots[1:][used], step[used]
        swing = cubic_swing(
            step, begin.x, end.x, begin.velocity * step, end.velocity_before * step
        )
        force, _, dashpot = work_between(self._rig, self._clock, begin, end)
        self._covered += float(step.sum())
        self._squares += swing.squares
        self._largest = max(self._largest, swing.largest)
        self._force += force
        self._dashpot += dashpot
        self._longest = max(self._longest, float(step.max()))

    def finish(self, duration: float) -> Overall:
        """Return the numbers of a stretch of a length in s."""
        rig = self._rig
        frequencies = [rig.omega, *rig.harmonics[1]]
        if rig.sweep_mode != 'off':
            frequencies.append(rig.sweep_high)
        turned = max(frequencies) * self._longest
        steps = rig.damper_mass / rig.primary_mass if rig.friction * rig.gravity > 0.0 else 0.0
        return Overall(
            duration=duration,
            covered=self._covered,
            x_max=self._largest,
            x_rms=math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan,
            impacts=sum(self._impacts),
            impacts_on_stop_1=self._impacts[0],
            impacts_on_stop_2=self._impacts[1],
            impact_energy=self._taken,
            dashpot_energy=self._dashpot,
            force_work=self._force,
            accuracy=_SMOOTH * turned**4 + _STEPS * steps * turned**3,
        )
