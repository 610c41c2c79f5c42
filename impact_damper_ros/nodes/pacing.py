"""
When a tick is due: a grid of instants in rig time, and deadlines on the monotonic clock.

Policy for lateness. Deadlines are absolute, so a late tick does not delay the next one. As long
as the rig is less than `CATCH_UP` behind, it makes up for it: the missed ticks are computed and
published back to back, none is left out. Further behind, it gives the lost wall time up and takes
its deadlines from there (a slip): rig time then lags wall time by so much more, but the samples
stay on their grid without a hole. Stamps that count from the system time are moved on by as much,
so that they stay with the time of the other nodes. Both are counted, and reported in the
diagnostics.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

__all__ = ['Pacer', 'PacingCounts', 'StampClock', 'TickGrid']

NS_PER_S = 1_000_000_000
#: Lateness, in wall time, beyond which the lost time is given up instead of made up for.
CATCH_UP_NS = 250_000_000
# Longest sleep at a stretch: what has to be answered between two ticks far apart waits no longer.
NAP_NS = 20_000_000
#: Lateness, in wall time, up to which the pace is held.
STEADY_NS = 50_000_000
# A free-running rig leaves the processor for a moment this often, so that parameter calls and the
# log's writer are served.
FREE_RUN_STRETCH_NS = 10_000_000
FREE_RUN_REST_S = 0.0005


class TickGrid:
    """
    Instants of the ticks in whole nanoseconds, each rounded from its exact value k / rate.

    Parameters
    ----------
    rate : float
        Ticks per second of rig time.
    """

    def __init__(self, rate: float) -> None:
        """Take the rate as the exact fraction that the float is."""
        self._numerator, self._denominator = float(rate).as_integer_ratio()

    def instant(self, tick: int) -> int:
        """Return the instant of a tick in nanoseconds; tick 0 is at 0."""
        scaled = 2 * tick * NS_PER_S * self._denominator
        return (scaled + self._numerator) // (2 * self._numerator)


class StampClock:
    """
    Stamps of rig time.

    Parameters
    ----------
    simulated : bool
        Stamps count from 0, as those of a simulator do. Otherwise from the system time at the
        start, and a pause or a slip moves them on with the wall clock.

    Attributes
    ----------
    offset_ns : int
        Stamp of rig time 0.
    """

    def __init__(self, *, simulated: bool) -> None:
        """Begin at 0."""
        self.offset_ns = 0
        self._simulated = simulated
        # Of the monotonic clock's zero
        self._zero_ns = 0

    def begin(self) -> None:
        """Let rig time 0 be now."""
        if not self._simulated:
            self._zero_ns = time.time_ns() - time.monotonic_ns()
            self.catch_up(0)

    def now(self, time_ns: int) -> int:
        """Return the stamp of what is said now of a rig that stands at a rig time."""
        stamp_ns = self.offset_ns + time_ns
        if self._simulated:
            return stamp_ns
        return max(stamp_ns, self._zero_ns + time.monotonic_ns())

    def catch_up(self, time_ns: int) -> bool:
        """Let a rig time be now, after a pause or a slip; return whether that moves stamps."""
        before, self.offset_ns = self.offset_ns, self.now(time_ns) - time_ns
        return self.offset_ns != before


class PacingCounts(NamedTuple):
    """What the pacer has counted; totals, but for the worst lateness since the last report."""

    ticks: int
    overruns: int
    slips: int
    slipped_ns: int
    worst_lateness_ns: int


@dataclass
class _Worst:
    lateness_ns: int = 0


class Pacer:
    """
    Wait for the ticks of one rig.

    Parameters
    ----------
    period_ns : int
        Rig time between two ticks.
    real_time_factor : float
        Rig seconds per wall second; 0 runs as fast as possible.
    clock, sleep : callable
        Monotonic clock in nanoseconds and sleep in seconds, for tests.
    on_slip : callable
        Called at each slip, in the waiting thread.
    """

    def __init__(
        self,
        period_ns: int,
        real_time_factor: float,
        *,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
        on_slip: Callable[[], object] = lambda: None,
    ) -> None:
        """Start counting from nothing; `anchor` sets the first deadline."""
        self._factor = real_time_factor
        self._late_after_ns = round(period_ns / real_time_factor) if real_time_factor else 0
        self._clock = clock
        self._sleep = sleep
        self._on_slip = on_slip
        self._anchor_ns = self._anchor_rig_ns = 0
        self._stretch_began_ns = self._unsteady_ns = clock()
        self._ticks = self._overruns = self._slips = self._slipped_ns = 0
        self._worst = _Worst()

    def anchor(self, rig_ns: int) -> None:
        """Let rig time run on from `rig_ns` now."""
        self._anchor_ns = self._clock()
        self._anchor_rig_ns = rig_ns

    def lateness(self, rig_ns: int) -> int:
        """Return by how much wall time an instant of rig time is late by now, ns."""
        return self._clock() - self._deadline(rig_ns) if self._factor else 0

    @property
    def steady_ns(self) -> int:
        """For how long the pace has been held so far, in wall time."""
        return self._clock() - self._unsteady_ns

    def approach(self, rig_ns: int, interrupted: Callable[[], bool]) -> bool:
        """
        Sleep until an instant is no more than a nap away.

        Parameters
        ----------
        rig_ns : int
            The instant in rig time.
        interrupted : callable
            Called between naps; true ends the wait.

        Returns
        -------
        bool
            False if the wait was interrupted.
        """
        if self._factor:
            deadline = self._deadline(rig_ns)
            while deadline - self._clock() > NAP_NS:
                self._sleep(NAP_NS * 1e-9)
                if interrupted():
                    return False
        return True

    def pause_until(self, rig_ns: int) -> None:
        """Sleep until an instant of rig time, which is not that of a tick."""
        if self._factor:
            self._sleep_until(self._deadline(rig_ns))

    def wait(self, rig_ns: int) -> None:
        """Sleep until the tick at `rig_ns`, in rig time, is due, and count how late it is."""
        self._ticks += 1
        if self._factor:
            self._count_lateness(self._sleep_until(self._deadline(rig_ns)))
        else:
            self._rest_at_times()

    def counts(self) -> PacingCounts:
        """Return what was counted; called from another thread, at a report."""
        worst, self._worst = self._worst, _Worst()
        return PacingCounts(
            self._ticks, self._overruns, self._slips, self._slipped_ns, worst.lateness_ns
        )

    def _deadline(self, rig_ns: int) -> int:
        """Return the instant on the monotonic clock at which an instant of rig time is due."""
        elapsed = rig_ns - self._anchor_rig_ns
        if self._factor != 1.0:
            elapsed = round(elapsed / self._factor)
        return self._anchor_ns + elapsed

    def _sleep_until(self, deadline: int) -> int:
        """Return how late it is then, ns."""
        while (left := deadline - self._clock()) > 0:
            self._sleep(left * 1e-9)
        return -left

    def _count_lateness(self, late_ns: int) -> None:
        worst = self._worst
        if late_ns > worst.lateness_ns:
            worst.lateness_ns = late_ns
        if late_ns > self._late_after_ns:
            self._overruns += 1
        if late_ns > STEADY_NS:
            self._unsteady_ns = self._clock()
        if late_ns > CATCH_UP_NS:
            self._anchor_ns += late_ns
            self._slips += 1
            self._slipped_ns += late_ns
            self._on_slip()

    def _rest_at_times(self) -> None:
        if self._clock() - self._stretch_began_ns > FREE_RUN_STRETCH_NS:
            self._sleep(FREE_RUN_REST_S)
            self._stretch_began_ns = self._clock()
