# SPDX-License-Identifier: Apache-2.0
"""
Pacing: the instants of ticks, the priority of their thread, and the request to end.

Policy for lateness. Deadlines are absolute, so a late tick does not delay the next one. A rig less
than `CATCH_UP` behind catches up: the missed ticks are computed and published back to back, and
none is left out. Further behind, it gives the lost wall time up and counts its deadlines from
there (a slip): rig time then lags wall time by as much, but the samples stay on their grid without
a gap.
Stamps that count from the system time are moved on, so that they agree with the time of the other
nodes; with a step of the system clock they are moved as well. Late ticks and slips are counted and
reported in the diagnostics.

Under the ordinary scheduler other programs may delay the thread by some milliseconds. With a
real-time priority it gets a processor as soon as a tick is due; the lowest ones are enough, since
ordinary threads have none. They need a permission: root's, the capability CAP_SYS_NICE, or a limit
RTPRIO (`ulimit -r`). Without one, the thread keeps ordinary scheduling.

rclpy's own signal handler wakes executors and shuts ROS down from a thread of its own, at each
signal. A second signal during the shutdown meets guard conditions that are just being freed, and
the process crashes. Here a signal only writes a byte into a socket, and the node shuts down in its
own order. SIGHUP, of a closed terminal, is ignored if the process was started so, as by nohup.
"""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from typing import NamedTuple

#: Lateness, in wall time, beyond which the lost time is given up instead of made up for.
CATCH_UP_NS = 250_000_000
#: Longest time between two readings of clocks that are compared.
_AT_ONCE_NS = 50_000_000
# A free-running rig leaves the processor for a moment this often, so that parameter calls and the
# log's writer are served.
FREE_RUN_STRETCH_NS = 10_000_000
FREE_RUN_REST_S = 0.0005


def _system_zero_ns() -> int:
    """Return the system time at the zero of the monotonic clock."""
    while True:
        before_ns, system_ns = time.monotonic_ns(), time.time_ns()
        # Unless the thread was interrupted between the readings
        if time.monotonic_ns() - before_ns < _AT_ONCE_NS:
            return system_ns - before_ns


class StampClock:
    """
    Stamps of rig time.

    Simulated stamps count from 0. Others count from the system time at the start; a pause or a
    slip moves them on with the wall clock, and a step of the system clock moves them as far.
    """

    def __init__(self, *, simulated: bool) -> None:
        """Begin at 0."""
        self.offset_ns = 0  # stamp of rig time 0
        self._simulated = simulated
        # Of the monotonic clock's zero
        self._zero_ns = 0

    def begin(self) -> None:
        """Set rig time 0 to now."""
        if not self._simulated:
            self._zero_ns = _system_zero_ns()
            self.catch_up(0)

    def now(self, time_ns: int) -> int:
        """Return the stamp of a message sent now by a rig that is paused at a rig time."""
        stamp_ns = self.offset_ns + time_ns
        if self._simulated:
            return stamp_ns
        return max(stamp_ns, self._zero_ns + time.monotonic_ns())

    def catch_up(self, time_ns: int) -> bool:
        """Let a rig time be now, after a pause or a slip; return whether that moves stamps."""
        before, self.offset_ns = self.offset_ns, self.now(time_ns) - time_ns
        return self.offset_ns != before

    def step_ns(self) -> int:
        """Return how far the system clock is from the stamps, or 0 for a small difference."""
        step_ns = 0 if self._simulated else _system_zero_ns() - self._zero_ns
        return step_ns if abs(step_ns) > CATCH_UP_NS else 0

    def follow(self, step_ns: int) -> None:
        """Move the stamps with a step of the system clock."""
        self._zero_ns += step_ns
        self.offset_ns += step_ns


class PacingCounts(NamedTuple):
    """What the pacer has counted; totals, but for the worst lateness since the last report."""

    ticks: int
    overruns: int
    slips: int
    slipped_ns: int
    worst_lateness_ns: int


class Pacer:
    """Wait for the ticks of one rig; 0 for the factor runs as fast as possible."""

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
        self.set_pace(period_ns, real_time_factor)
        self._clock = clock
        self._sleep = sleep
        self._on_slip = on_slip
        self._anchor_ns = self._anchor_rig_ns = 0
        self._stretch_began_ns = clock()
        self._ticks = self._overruns = self._slips = self._slipped_ns = 0
        self._worst_ns = 0

    def set_pace(self, period_ns: int, real_time_factor: float) -> None:
        """Go on at another pace, from the next `anchor` on."""
        self._factor = real_time_factor
        self._late_after_ns = round(period_ns / real_time_factor) if real_time_factor else 0

    def anchor(self, rig_ns: int) -> None:
        """Let rig time run on from `rig_ns` now."""
        self._anchor_ns = self._clock()
        self._anchor_rig_ns = rig_ns

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
        """Return the counts; called from another thread, at a report."""
        worst_ns, self._worst_ns = self._worst_ns, 0
        return PacingCounts(self._ticks, self._overruns, self._slips, self._slipped_ns, worst_ns)

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
        self._worst_ns = max(self._worst_ns, late_ns)
        if late_ns > self._late_after_ns:
            self._overruns += 1
        if late_ns > CATCH_UP_NS:
            self._anchor_ns += late_ns
            self._slips += 1
            self._slipped_ns += late_ns
            self._on_slip()

    def _rest_at_times(self) -> None:
        if self._clock() - self._stretch_began_ns > FREE_RUN_STRETCH_NS:
            self._sleep(FREE_RUN_REST_S)
            self._stretch_began_ns = self._clock()


ORDINARY = 'ordinary'


def take_priority(priority: int) -> str:
    """
    Give the calling thread, and those that it will start, a real-time priority; 0 for none.

    Returns the scheduling that it has: ``'SCHED_FIFO 1'``, or ``'ordinary'`` with the reason.
    """
    if not priority:
        return ORDINARY
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError:
        return f'{ORDINARY}: no permission for SCHED_FIFO {priority}'
    except (AttributeError, OSError) as error:
        return f'{ORDINARY}: {error}'
    return f'SCHED_FIFO {priority}'


SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class EndRequest:
    """
    Take the signals that end a process, and note that one has come; from the main thread only.

    There is one in a process. What the signals did before does not come back: they are ignored
    from `close` on, since an impatient one must not spoil the exit code.
    """

    def __init__(self) -> None:
        """Take the signals from now on."""
        self._received = threading.Event()
        self._wake: Callable[[], object] | None = None
        self._waking = threading.Lock()
        self._reading, self._writing = socket.socketpair()
        self._writing.setblocking(False)
        # Python writes to the socket at once, also while the main thread waits in foreign code;
        # the handler itself comes later and has nothing left to do. Of a signal without any
        # handler of Python nothing would be written.
        signal.set_wakeup_fd(self._writing.fileno(), warn_on_full_buffer=False)
        for number in SIGNALS:
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, lambda *_: None)
        self._thread = threading.Thread(target=self._listen, name='signals', daemon=True)
        self._thread.start()

    @property
    def received(self) -> bool:
        """Whether a signal has asked the process to end."""
        return self._received.is_set()

    def wake_with(self, wake: Callable[[], object] | None) -> None:
        """Set the function that is called on a signal, from another thread."""
        with self._waking:
            self._wake = wake

    def close(self) -> None:
        """Ignore the signals from now on."""
        signal.set_wakeup_fd(-1)
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        self._writing.close()
        self._thread.join()
        self._reading.close()

    def _listen(self) -> None:
        while self._reading.recv(64):
            self._received.set()
            with self._waking:
                if self._wake is not None:
                    self._wake()
