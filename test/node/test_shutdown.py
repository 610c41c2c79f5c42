"""How the node ends: by signals, while recording, and when its engine fails."""

import signal
import time

import pytest

from impact_damper_ros.bag import RunReader
from node.rig_client import LIVELY

#: As a terminal starts it, or `nohup`, however the tests were started.
STARTED = """
import signal, sys
signal.signal(signal.SIGHUP, signal.{before})
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


@pytest.mark.parametrize(
    ('before', 'signals'),
    [('SIG_DFL', [signal.SIGHUP]), ('SIG_IGN', [signal.SIGTERM, signal.SIGTERM])],
)
def test_signals_end_the_node_with_a_complete_bag(start, before, signals):
    lasting = before == 'SIG_IGN'
    code = STARTED.format(before=before)
    rig = start(code=code, record=True, predict_motion=lasting, **LIVELY)
    rig.await_states(20)
    if lasting:
        # It outlives its terminal; the thread of its theory, which ends with it, prints nothing
        rig.process.send(signal.SIGHUP)
        rig.await_states(100)
        rig.await_report('predicted motion', holds=lambda r: r.values['State'] == 'found')
    for number in signals:
        rig.process.send(number)
        time.sleep(0.01)
    rig.ended()
    assert 'recorded' in rig.process.output
    assert 'Traceback' not in rig.process.output
    assert rig.bag()


IMPATIENT = """
import os
import signal
import sys
import threading

from rclpy.signals import SignalHandlerGuardCondition
from impact_damper_ros.node import sim_node

destroy_node = sim_node.SimNode.destroy_node

def destroy_slowly(node):
    done = threading.Event()

    def insist():
        while not done.wait(1e-4):
            os.kill(os.getpid(), signal.SIGINT)
            os.kill(os.getpid(), signal.SIGTERM)

    insisting = threading.Thread(target=insist)
    insisting.start()
    for _ in range(20_000):
        SignalHandlerGuardCondition(node.context).destroy()
    done.set()
    insisting.join()
    destroy_node(node)

sim_node.SimNode.destroy_node = destroy_slowly
sys.exit(sim_node.main())
"""


def test_signals_and_requests_while_the_node_is_taken_apart_do_no_harm(start):
    # An executor destroys its guard condition, which rclpy's own handling of a signal may be
    # just about to trigger; many of them make that crash certain.
    rig = start(code=IMPATIENT)
    rig.await_states()
    rig.reset()
    for _ in range(50):
        rig.client.ask(rig.name, 'reset')
        rig.client.ask(rig.name, 'pause', data=True)
    rig.stop()
    # What it says as it starts, and nothing after that, but that the machine was late
    lines = [line for line in rig.process.output.splitlines() if 'the stamps were' not in line]
    assert rig.process.output.count('[INFO]') == 1
    assert lines[-1].endswith('recording  off')


#: A signal comes while the node is made.
EARLY = """
import os, signal, sys
from impact_damper_ros.node import sim_node

def signalled(*arguments, **named):
    os.kill(os.getpid(), signal.SIGTERM)
    return engine(*arguments, **named)

engine, sim_node.Engine = sim_node.Engine, signalled
sys.exit(sim_node.main())
"""


def test_a_signal_during_start_up_ends_the_node_quietly(start):
    """One before that in `test_interruption`."""
    rig = start(code=EARLY)
    rig.ended()
    assert '[ERROR]' not in rig.process.output


FAILING_ENGINE = """
import sys
from impact_damper_ros import Rig
from impact_damper_ros.node import sim_node

advance = Rig.advance

def fail_later(rig, time, *others, **options):
    if time > 0.5:
        raise RuntimeError('no first root')
    return advance(rig, time, *others, **options)

Rig.advance = fail_later
sys.exit(sim_node.main())
"""


def test_a_failed_engine_is_reported_and_the_bag_finished(start):
    rig = start(code=FAILING_ENGINE, record=True)
    assert rig.process.wait() == 1
    assert 'the engine failed' in rig.process.output
    assert 'RuntimeError: no first root' in rig.process.output
    topics = RunReader(rig.bag()).topics.values()
    counts = {topic.name: topic.message_count for topic in topics}
    # The samples at 0, 5, ... 500 ms
    assert counts[f'{rig.space}/joint_states'] == 101
