# SPDX-License-Identifier: Apache-2.0
"""
Pacing: the instants of ticks, their stamps, and the priority of their thread.

Policy for lateness. Deadlines are absolute, so a late tick does not delay the next one. A rig less
than `CATCH_UP` behind catches up: the missed ticks are computed and published back to back, and
none is left out. A rig further behind drops the lost wall time and counts its deadlines from there
(a slip): rig time then lags wall time by as much, but the samples stay on their grid without a
gap. Late ticks and slips are counted and reported in the diagnostics.

Stamps that count from the system time agree with that of the other nodes. There is one rule for
slips and for a system clock that was set: stamps that are further than `CATCH_UP` from the system
time are moved to it.

Under the ordinary scheduler other programs may delay the thread by some milliseconds. With a
real-time priority the thread gets a processor as soon as a tick is due; the lowest priorities are
enough, since ordinary threads have none. Priorities need a permission: root's, the capability
CAP_SYS_NICE, or a limit RTPRIO (`ulimit -r`). Without one, the thread keeps ordinary scheduling.
"""

from __future__ import annotations

import ctypes
import os
import time
from contextlib import suppress
from typing import NamedTuple, Protocol

#: Lateness, in wall time, beyond which the lost time is dropped instead of made up for.
CATCH_UP_NS = 250_000_000
# A free-running rig leaves the processor for a moment this often, so that parameter calls and the
# log's writer are served.
FREE_RUN_NS = 10_000_000
FREE_RUN_REST_S = 0.0005


class WallTime(Protocol):
    """The clocks that pace a rig: functions of the module `time`."""

    def monotonic_ns(self) -> int:
        """Return the monotonic time, ns."""

    def monotonic(self) -> float:
        """Return the monotonic time, s."""

    def time_ns(self) -> int:
        """Return the system time, ns."""

    def sleep(self, seconds: float, /) -> None:
        """Wait."""


class StampClock:
    """Stamps of rig time: simulated ones count from 0, others from the system time."""

    def __init__(self, *, simulated: bool, wall: WallTime = time) -> None:
        """Begin at 0."""
        self.offset_ns = 0  # stamp of rig time 0
        self._simulated = simulated
        self._wall = wall

    def now(self, time_ns: int) -> int:
        """Return the stamp of a message sent now by a rig that stands still at a rig time."""
        stamp_ns = self.offset_ns + time_ns
        return stamp_ns if self._simulated else max(stamp_ns, self._wall.time_ns())

    def catch_up(self, time_ns: int) -> bool:
        """Let a rig time be now, at a start or after a pause; return whether stamps move."""
        before, self.offset_ns = self.offset_ns, self.now(time_ns) - time_ns
        return self.offset_ns != before

    def follow(self, time_ns: int, *, back: bool) -> int:
        """
        Move the stamps to the system time if they are far from it; return by how much, ns.

        Without `back` they are moved on only.
        """
        apart_ns = 0 if self._simulated else self._wall.time_ns() - self.offset_ns - time_ns
        if abs(apart_ns) <= CATCH_UP_NS or (apart_ns < 0 and not back):
            return 0
        self.offset_ns += apart_ns
        return apart_ns


class PacingCounts(NamedTuple):
    """Counts of the pacer: totals, but for the worst lateness since the last report."""

    ticks: int
    overruns: int
    slips: int
    slipped_ns: int
    worst_lateness_ns: int


class Pacer:
    """Waits for the ticks of one rig; with the factor 0 the rig runs as fast as possible."""

    def __init__(self, period_ns: int, real_time_factor: float, *, wall: WallTime = time) -> None:
        """Start with all counts 0; `anchor` sets the first deadline."""
        self.set_pace(period_ns, real_time_factor)
        self._wall = wall
        self._anchor_ns = self._anchor_rig_ns = 0
        self._free_since_ns = wall.monotonic_ns()
        self._ticks = self._overruns = self._slips = self._slipped_ns = 0
        self._worst_ns = 0

    def set_pace(self, period_ns: int, real_time_factor: float) -> None:
        """Go on at another pace, from the next `anchor` on."""
        #: Rig time per wall time; 0: as fast as possible
        self.factor = real_time_factor
        self._late_after_ns = round(period_ns / real_time_factor) if real_time_factor else 0

    def anchor(self, rig_ns: int) -> None:
        """Let rig time continue from `rig_ns` at the present time."""
        self._anchor_ns = self._wall.monotonic_ns()
        self._anchor_rig_ns = rig_ns

    def pause_until(self, rig_ns: int) -> None:
        """Sleep until an instant of rig time, which is not that of a tick."""
        if self.factor:
            self._sleep_until(self._deadline(rig_ns))

    def wait(self, rig_ns: int) -> None:
        """Sleep until the tick at `rig_ns`, in rig time, is due, and count how late it is."""
        self._ticks += 1
        if self.factor:
            self._count_lateness(self._sleep_until(self._deadline(rig_ns)))
        else:
            self._rest_at_times()

    def counts(self) -> PacingCounts:
        """Return the counts; called from another thread, at a report."""
        worst_ns, self._worst_ns = self._worst_ns, 0
        return PacingCounts(self._ticks, self._overruns, self._slips, self._slipped_ns, worst_ns)

    def _deadline(self, rig_ns: int) -> int:
        """Return the instant on the monotonic clock at which an instant of rig time is due."""
        elapsed = rig_ns - self._anchor_rig_ns
        if self.factor != 1.0:
            elapsed = round(elapsed / self.factor)
        return self._anchor_ns + elapsed

    def _sleep_until(self, deadline: int) -> int:
        """Sleep until an instant; return the lateness then, ns."""
        while (left := deadline - self._wall.monotonic_ns()) > 0:
            self._wall.sleep(left * 1e-9)
        return -left

    def _count_lateness(self, late_ns: int) -> None:
        self._worst_ns = max(self._worst_ns, late_ns)
        if late_ns > self._late_after_ns:
            self._overruns += 1
        if late_ns > CATCH_UP_NS:
            self._anchor_ns += late_ns
            self._slips += 1
            self._slipped_ns += late_ns

    def _rest_at_times(self) -> None:
        if self._wall.monotonic_ns() - self._free_since_ns > FREE_RUN_NS:
            self._wall.sleep(FREE_RUN_REST_S)
            self._free_since_ns = self._wall.monotonic_ns()


ORDINARY = 'ordinary'
#: Timer slack of ordinary threads, ns, which is 50 us on Linux unless it is set; and the
#: option of prctl that sets it.
_SLACK_NS, _PR_SET_TIMERSLACK = 1, 29


def take_priority(priority: int) -> str:
    """
    Give the calling thread, and those that it will start, a real-time priority; 0 for none.

    Returns the scheduling that it has: ``'SCHED_FIFO 1'``, or ``'ordinary'`` with the reason.
    Ordinary threads wake when they are due from then on, too, and wait for the lock of the
    interpreter no longer than they have to.
    """
    with suppress(AttributeError, OSError):
        # Only Linux has it
        ctypes.CDLL(None).prctl(_PR_SET_TIMERSLACK, _SLACK_NS, 0, 0, 0)
    if not priority:
        return ORDINARY
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f'{ORDINARY}: no permission for SCHED_FIFO {priority}'
    except (AttributeError, OSError) as error:
        return f'{ORDINARY}: {error}'
    return f'SCHED_FIFO {priority}'
