"""The thread that moves the rig is scheduled in real time where permitted, or says why not."""

import os
import threading
from pathlib import Path

import pytest

from impact_damper_ros.nodes.pacing import CATCH_UP_NS, Pacer
from impact_damper_ros.nodes.scheduling import ORDINARY, Scheduling
from nodes.test_engine import Bench


def in_a_thread(action):
    """Return what an action returns in a thread of its own, whose scheduling ends with it."""
    results = []
    thread = threading.Thread(target=lambda: results.append(action()))
    thread.start()
    thread.join()
    return results[0]


def permitted():
    def probe():
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        except PermissionError:
            return False
        return True

    return in_a_thread(probe)


def policies():
    """Return scheduling policy and priority of each thread of this process."""
    tasks = [int(path.name) for path in Path('/proc/self/task').iterdir()]
    return [
        (os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK, os.sched_getparam(task))
        for task in tasks
    ]


def test_a_priority_is_taken_where_it_is_permitted_and_given_up_for_good():
    def take_and_give_up():
        scheduling = Scheduling(2)
        texts = [scheduling.text]
        scheduling.take()
        texts.append(scheduling.text)
        scheduling.give_up()
        return [*texts, scheduling.text, os.sched_getscheduler(0)]

    before, taken, given_up, policy = in_a_thread(take_and_give_up)
    assert before == ORDINARY
    if permitted():
        assert (taken, given_up) == ('SCHED_FIFO 2', f'{ORDINARY}: the pace could not be held')
    else:
        assert taken == given_up == f'{ORDINARY}: no permission for SCHED_FIFO 2'
    assert policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER


def test_none_is_asked_for():
    scheduling = Scheduling(0)
    scheduling.take()
    scheduling.give_up()
    assert scheduling.text == ORDINARY


@pytest.mark.parametrize(('factor', 'real_time'), [(50.0, True), (0.0, False)])
def test_only_a_paced_engine_takes_a_priority(factor, real_time):
    with Bench(factor=factor, priority=3) as bench:
        bench.engine.start()
        while bench.engine.stamp_ns() < 1e9:
            threading.Event().wait(0.005)
        status = bench.engine.status()
        fifo = [param.sched_priority for policy, param in policies() if policy == os.SCHED_FIFO]
    if real_time and permitted():
        assert (status.scheduling, fifo) == ('SCHED_FIFO 3', [3])
    else:
        assert status.scheduling.startswith(ORDINARY)
        assert fifo == []


def test_a_slip_is_told_in_the_waiting_thread():
    now = [0]
    slips = []
    pacer = Pacer(10**6, 1.0, clock=lambda: now[0], on_slip=lambda: slips.append(now[0]))
    pacer.anchor(0)
    for late_ns in (0, CATCH_UP_NS, CATCH_UP_NS + 1):
        now[0] = 10**6 + late_ns
        assert pacer.wait(10**6, lambda: False)
    assert slips == [10**6 + CATCH_UP_NS + 1]
