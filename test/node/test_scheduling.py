"""The thread that moves the rig is scheduled in real time where permitted, or says why not."""

import contextlib
import os
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from sensor_msgs.msg import JointState

from impact_damper_ros.node import pacing as scheduling
from impact_damper_ros.node.pacing import (
    CATCH_UP_NS,
    ORDINARY,
    SWITCH_INTERVAL_S,
    WAKING_INTERVAL_S,
    Pacer,
    Scheduling,
    sleep_first_in_line,
)
from node.rig_client import stamp_ns, until
from node.test_engine import Bench


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
    found = []
    for path in Path(f'/proc/{process}/task').iterdir():
        task = int(path.name)
        # One may end meanwhile.
        with contextlib.suppress(ProcessLookupError):
            if os.sched_getscheduler(task) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO:
                found.append(os.sched_getparam(task).sched_priority)
    return sorted(found)


def test_a_priority_is_taken_where_it_is_permitted_and_given_up():
    def take_and_give_up():
        own = Scheduling(2)
        texts = [own.text]
        own.take()
        texts.append(own.text)
        own.give_up()
        return [*texts, own.text, os.sched_getscheduler(0)]

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
    own = Scheduling(0)
    own.take()
    own.give_up()
    assert own.text == ORDINARY


@pytest.mark.parametrize('priority', [3, 0])
def test_the_engine_takes_the_priority_that_it_is_given(priority):
    with Bench(factor=5.0, priority=priority) as bench:
        bench.engine.start()
        until(lambda: bench.engine.stamp_ns() > 1e9)
        fifo = priorities()
        status = bench.engine.status()
    if priority and permitted() and status.pacing.slips:
        # This machine has stood still: given up, before or after the look at the priorities.
        assert status.scheduling == f'{ORDINARY}: the pace could not be held'
        assert fifo in ([3], [])
    elif priority and permitted():
        assert (status.scheduling, fifo) == ('SCHED_FIFO 3', [3])
    else:
        assert status.scheduling.startswith(ORDINARY)
        assert fifo == []


@pytest.mark.parametrize(('factor', 'expected'), [(1.0, [1, 1, 1, 1, 2]), (0.0, [])])
def test_the_threads_of_a_paced_node(client, launch, namespace, factor, expected):
    states = client.listen(JointState, f'{namespace}/joint_states')
    reports = client.listen(DiagnosticArray, '/diagnostics')
    process = launch(
        f'__ns:={namespace}', record=True, predict_motion=False, real_time_factor=factor
    )
    until(lambda: len(states) > 2, lambda: process.output)
    found = priorities(process.pid)
    seen_ns = stamp_ns(states[-1].header.stamp)

    def slips():
        """Return how often the pace was given up until after that look, in a list."""
        return [
            int(value.value)
            for report in list(reports)
            for status in report.status
            for value in status.values
            if status.name == f'{namespace[1:]}/sim_node: pacing'
            and value.key.startswith('Slips')
            and stamp_ns(report.header.stamp) > seen_ns
        ]

    # Executor, predictor, writer and its synchronisation, and the engine, unless this machine
    # has stood still and the engine has given its own up
    held = not until(slips)[0]
    if not permitted():
        expected = []
    assert found == expected or (not held and found == expected[:-1])
    assert process.stop() == 0, process.output


def test_who_sleeps_first_in_line_is_given_the_interpreter_soon(monkeypatch):
    before = sys.getswitchinterval()
    slept = []

    def sleep(seconds):
        slept.append((seconds, sys.getswitchinterval()))

    monkeypatch.setattr(scheduling, 'time', SimpleNamespace(sleep=sleep))
    try:
        sleep_first_in_line(1.0)
        assert slept == [(1.0, pytest.approx(WAKING_INTERVAL_S))]
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
