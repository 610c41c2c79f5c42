"""The thread that moves the rig is scheduled in real time where permitted, or says why not."""

import contextlib
import os
import threading
from pathlib import Path

import pytest
from running import until
from sensor_msgs.msg import JointState

from impact_damper_ros.node.pacing import ORDINARY, take_priority
from impact_damper_ros.node.parameters import NodeParameters


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
            if os.sched_getscheduler(task) == os.SCHED_FIFO:
                found.append(os.sched_getparam(task).sched_priority)
    return sorted(found)


@pytest.mark.parametrize('priority', [2, 0])
def test_a_priority_is_taken_where_it_is_permitted(priority):
    text, policy = in_a_thread(lambda: (take_priority(priority), os.sched_getscheduler(0)))
    if not priority:
        assert (text, policy) == (ORDINARY, os.SCHED_OTHER)
    elif permitted():
        assert (text, policy) == ('SCHED_FIFO 2', os.SCHED_FIFO)
    else:
        assert (text, policy) == (f'{ORDINARY}: no permission for SCHED_FIFO 2', os.SCHED_OTHER)


def test_the_threads_of_a_node(client, launch, namespace):
    """The engine comes first; the processes of the theory have no priority."""
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}', record=True, predict_motion=True, real_time_priority=3)
    until(lambda: len(states) > 2, lambda: process.output)
    found = priorities(process.pid)
    if permitted():
        assert found[-1] == 3
        assert set(found[:-1]) == {2}
    else:
        assert found == []
    for child in until(lambda: children(process.pid)):
        until(lambda child=child: priorities(child) == [])
    assert process.stop() == 0, process.output
    # Without a pace the priority would keep the processor from all others.
    free = NodeParameters(real_time_priority=3, real_time_factor=0.0)
    assert free.priority == 0


def children(process):
    """Return the processes that a process has started."""
    paths = Path(f'/proc/{process}/task').glob('*/children')
    return [int(number) for path in paths for number in path.read_text().split()]
