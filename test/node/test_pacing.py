"""The grid of ticks, and what is made of lateness."""

import ctypes
import os
import sys
import threading
from fractions import Fraction

import pytest

from impact_damper_ros.node.pacing import CATCH_UP_NS, ORDINARY, Pacer, take_priority
from impact_damper_ros.node.parameters import NodeParameters
from impact_damper_ros.rig.tick_grid import TickGrid
from node.bench import MadeTime

MS = 1_000_000
PR_GET_TIMERSLACK = 30


class FakeTime(MadeTime):
    @property
    def now(self):
        return self.monotonic_ns()

    def spend_ns(self, ns):
        self.spend(ns * 1e-9)


def pacer(period_ns, factor=1.0):
    time = FakeTime(nap=0.0)
    made = Pacer(period_ns, factor, wall=time)
    made.anchor(0)
    return made, time


@pytest.mark.parametrize('rate', [1.0, 3.0, 200.0, 333.3, 1000.0, 1999.0])
def test_ticks_are_rounded_one_by_one(rate):
    grid = TickGrid(rate)
    for tick in (0, 1, 2, 7, 1000, 123_456_789, 10**12):
        exact = Fraction(tick) * 10**9 / Fraction(rate)
        assert abs(grid.instant(tick) - exact) <= Fraction(1, 2)


def test_deadlines_are_absolute():
    """Work and late awakenings within a period do not add up."""
    made, time = pacer(5 * MS)
    for tick in range(1, 1001):
        made.wait(tick * 5 * MS)
        assert time.now == 5_000_000_000 + tick * 5 * MS
        time.spend_ns(tick % 5 * MS)
    assert made.counts()[:4] == (1000, 0, 0, 0)


def test_late_ticks_are_made_up_for_and_counted():
    made, time = pacer(5 * MS)
    made.wait(5 * MS)
    time.spend_ns(52 * MS)
    started = []
    for tick in range(2, 15):
        made.wait(tick * 5 * MS)
        started.append(time.now - 5_000_000_000)
    # Ticks 2 to 11 are due by 57 ms: they come at once, then the old deadlines hold again.
    assert started == [57 * MS] * 10 + [60 * MS, 65 * MS, 70 * MS]
    counts = made.counts()
    # Tick 11 is only 2 ms late and tick 10 is 7 ms late: 2 to 10 miss a whole period.
    assert counts.overruns == 9
    assert counts.slips == 0
    assert counts.worst_lateness_ns == 47 * MS
    assert made.counts().worst_lateness_ns == 0
    assert made.counts().overruns == 9


def test_a_long_stall_is_given_up_once():
    made, time = pacer(5 * MS)
    time.spend_ns(10_000 * MS)
    made.wait(5 * MS)
    assert made.counts()[1:4] == (1, 1, 9995 * MS)
    before = time.now
    made.wait(10 * MS)
    assert time.now == before + 5 * MS
    assert made.counts()[1:4] == (1, 1, 9995 * MS)


def test_just_within_the_bound_nothing_is_given_up():
    made, time = pacer(5 * MS)
    time.spend_ns(5 * MS + CATCH_UP_NS)
    made.wait(5 * MS)
    assert made.counts().slips == 0


@pytest.mark.parametrize('factor', [0.5, 2.0, 1000.0])
def test_real_time_factor_scales_the_deadlines(factor):
    made, time = pacer(5 * MS, factor)
    for tick in range(1, 101):
        made.wait(tick * 5 * MS)
        assert abs(time.now - 5_000_000_000 - tick * 5 * MS / factor) <= 1


def test_free_running_waits_for_nothing_but_leaves_the_processor_at_times():
    made, time = pacer(5 * MS, 0.0)
    began = time.now
    for tick in range(1, 10_001):
        made.wait(tick * 5 * MS)
        time.spend_ns(20_000)
    rested = time.now - began - 10_000 * 20_000
    assert 0.01 < rested / (time.now - began) < 0.1
    assert made.counts()[:4] == (10_000, 0, 0, 0)


def test_a_pause_ends_at_its_instant_and_is_no_tick():
    made, time = pacer(5 * MS)
    made.pause_until(3 * MS)
    assert time.now == 5_000_000_000 + 3 * MS
    time.spend_ns(2 * MS)
    made.pause_until(4 * MS)
    assert time.now == 5_000_000_000 + 5 * MS
    assert made.counts() == (0, 0, 0, 0, 0)


def in_a_thread(action):
    """Return what an action returns in a thread of its own, whose scheduling ends with it."""
    results = []
    thread = threading.Thread(target=lambda: results.append(action()))
    thread.start()
    thread.join()
    return results[0]


def permitted():
    """Return whether a process may have a real-time priority."""

    def probe():
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            return False
        return True

    return in_a_thread(probe)


@pytest.mark.skipif(sys.platform != 'linux', reason='Linux delays ordinary threads')
def test_ordinary_threads_wake_when_they_are_due():
    """By default they may be woken 50 us late."""

    def slack_ns():
        return ctypes.CDLL(None).prctl(PR_GET_TIMERSLACK, 0, 0, 0, 0)

    assert in_a_thread(slack_ns) > 1
    assert in_a_thread(lambda: (take_priority(0), slack_ns())) == (ORDINARY, 1)


def test_a_priority_is_taken_where_it_is_permitted():
    def taken(priority):
        return in_a_thread(lambda: (take_priority(priority), os.sched_getscheduler(0)))

    assert taken(0) == (ORDINARY, os.SCHED_OTHER)
    if permitted():
        assert taken(2) == ('SCHED_FIFO 2', os.SCHED_FIFO)
    else:
        reason = f'{ORDINARY}: no permission for SCHED_FIFO 2'
        assert taken(2) == (reason, os.SCHED_OTHER)
    # Without a pace it would keep the processor from all others.
    assert NodeParameters(real_time_priority=3, real_time_factor=0.0).priority == 0
