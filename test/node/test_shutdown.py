"""How the node ends: by signals, while recording, and when its engine fails."""

import signal
import time

import pytest
from running import until
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros.bag import RunReader
from node.rig_client import LIVELY


def run_directory(process_directory):
    (directory,) = (process_directory / 'runs').iterdir()
    return directory


#: As a terminal starts it, however the tests were started.
TERMINAL = """
import signal, sys
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


@pytest.mark.parametrize(
    'signals',
    [
        (signal.SIGTERM, signal.SIGTERM),
        (signal.SIGHUP,),
    ],
    ids=lambda signals: '+'.join(s.name for s in signals),
)
def test_signals_end_the_node_with_a_complete_bag(client, launch, namespace, tmp_path, signals):
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}', code=TERMINAL, record=True, **LIVELY)
    until(lambda: len(states) > 20, lambda: process.output)
    for number in signals:
        process.send(number)
        time.sleep(0.01)
    assert process.wait() == 0, process.output
    assert 'Traceback' not in process.output
    assert 'recorded' in process.output
    reader = RunReader(run_directory(tmp_path / 'process_0'))
    assert reader.complete
    assert reader.unusable == 0


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


def test_signals_while_the_node_is_taken_apart_do_no_harm(client, launch, namespace):
    # An executor destroys its guard condition, which rclpy's own handling of a signal may be
    # just about to trigger; many of them make that crash certain.
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}', code=IMPATIENT)
    until(lambda: states, lambda: process.output)
    assert process.stop(signal.SIGINT) == 0, process.output
    # What it says as it starts, and nothing after that, but that the machine was late
    lines = [line for line in process.output.splitlines() if 'the stamps were' not in line]
    assert process.output.count('[INFO]') == 1
    assert lines[-1].endswith('recording  off')


def test_a_signal_during_start_up_ends_the_node_quietly(launch, namespace):
    for delay in (0.35, 0.5):
        process = launch(f'__ns:={namespace}')
        time.sleep(delay)
        # Before Python runs our code a signal is Python's to handle; after that it is clean.
        code = process.stop(signal.SIGTERM)
        assert code in (0, -signal.SIGTERM), process.output


def test_service_calls_during_shutdown(client, launch, namespace):
    """Of a node that is paused."""
    states = client.listen(JointState, f'{namespace}/joint_states')
    process = launch(f'__ns:={namespace}')
    until(lambda: states, lambda: process.output)
    assert client.call(Trigger, f'{namespace}/sim_node/reset').success
    assert client.call(SetBool, f'{namespace}/sim_node/pause').success
    for _ in range(50):
        client.request(f'{namespace}/sim_node/reset', Trigger.Request())
        client.request(f'{namespace}/sim_node/pause', SetBool.Request(data=True))
    assert process.stop(signal.SIGINT) == 0, process.output
    assert 'Traceback' not in process.output


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


def test_a_failed_engine_is_reported_and_the_bag_finished(launch, namespace, tmp_path):
    process = launch(f'__ns:={namespace}', code=FAILING_ENGINE, record=True)
    assert process.wait() == 1
    assert 'the engine failed' in process.output
    assert 'RuntimeError: no first root' in process.output
    reader = RunReader(run_directory(tmp_path / 'process_0'))
    assert reader.complete
    counts = {topic.name: topic.message_count for topic in reader.topics.values()}
    # The samples at 0, 5, ... 500 ms
    assert counts[f'{namespace}/joint_states'] == 101
