"""The thread that moves the rig is scheduled in real time where permitted, or says why not."""

import os
import sys
import threading
from pathlib import Path

import pytest
from sensor_msgs.msg import JointState

from impact_damper_ros.nodes.pacing import CATCH_UP_NS, Pacer
from impact_damper_ros.nodes.scheduling import (
    ORDINARY,
    SWITCH_INTERVAL_S,
    WAKING_INTERVAL_S,
    Scheduling,
    sleep_first_in_line,
)
from nodes.rig_client import until
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


def priorities(process='self'):
    """Return the real-time priorities of the threads of a process that have one."""
    tasks = [int(path.name) for path in Path(f'/proc/{process}/task').iterdir()]
    return sorted(
        os.sched_getparam(task).sched_priority
        for task in tasks
        if os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    )


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
    assert policy == os.SCHED_OTHER


def test_what_is_not_inherited():
    def take():
        Scheduling(2, inherited=False).take()
        return priorities(), in_a_thread(lambda: os.sched_getscheduler(0))

    taken, of_a_child = in_a_thread(take)
    assert taken == ([2] if permitted() else [])
    assert of_a_child == os.SCHED_OTHER


def test_none_is_asked_for():
    scheduling = Scheduling(0)
    scheduling.take()
    scheduling.give_up()
    assert scheduling.text == ORDINARY


@pytest.mark.parametrize('priority', [3, 0])
def test_the_engine_takes_the_priority_that_it_is_given(priority):
    with Bench(factor=50.0, priority=priority) as bench:
        bench.engine.start()
        while bench.engine.stamp_ns() < 1e9:
            threading.Event().wait(0.005)
        status = bench.engine.status()
        fifo = priorities()
    if priority and permitted():
        assert (status.scheduling, fifo) == ('SCHED_FIFO 3', [3])
    else:
        assert status.scheduling.startswith(ORDINARY)
        assert fifo == []


@pytest.mark.parametrize(('factor', 'expected'), [(1.0, [1, 1, 1, 1, 2]), (0.0, [])])
def test_the_threads_of_a_paced_node(client, launch, namespace, factor, expected):
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(
        f'__ns:={namespace}', record=True, predict_motion=False, real_time_factor=factor
    )
    until(lambda: len(states) > 2, lambda: process.output)
    # Executor, predictor, writer and its synchronisation, and the engine
    assert priorities(process.pid) == (expected if permitted() else [])
    assert process.stop() == 0, process.output


def test_who_sleeps_first_in_line_is_given_the_interpreter_soon():
    before = sys.getswitchinterval()
    try:
        thread = threading.Thread(target=sleep_first_in_line, args=(1.0,))
        thread.start()
        until(lambda: sys.getswitchinterval() == pytest.approx(WAKING_INTERVAL_S))
        assert thread.is_alive()
        thread.join()
        assert sys.getswitchinterval() == pytest.approx(SWITCH_INTERVAL_S)
    finally:
        sys.setswitchinterval(before)


def test_a_slip_is_told_in_the_waiting_thread():
    now = [0]
    slips = []
    pacer = Pacer(10**6, 1.0, clock=lambda: now[0], on_slip=lambda: slips.append(now[0]))
    pacer.anchor(0)
    for late_ns in (0, CATCH_UP_NS, CATCH_UP_NS + 1):
        now[0] = 10**6 + late_ns
        pacer.wait(10**6)
    assert slips == [10**6 + CATCH_UP_NS + 1]
