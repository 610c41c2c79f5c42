"""Measured records and random lines on a live rig over DDS; recorded and replayed."""

import json
from pathlib import Path

import numpy as np
import pytest
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from impact_damper_ros import Rig
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.parameters.parameters_file import load_parameters
from node.rig_client import LATCHED, RigParametersClient

CONFIG = Path(__file__).parents[2] / 'config'
BENCH = CONFIG / 'bench_rig.yaml'


@pytest.mark.parametrize('quantity', ['force', 'base'])
def test_a_record_acts_from_the_start_and_from_a_reset(
    launch, client, namespace, quantity, tmp_path
):
    """Its copy is in each snapshot; `every_bag_is_replayed` replays the recording."""
    states = client.listen(JointState, f'{namespace}/joint_states')
    snapshots = client.listen(String, f'{namespace}/snapshot', LATCHED)
    process = launch(
        f'__ns:={namespace}',
        parameters_file=BENCH,
        force_amplitudes='[0.0]',
        record=True,
        **{f'{quantity}_record': CONFIG / f'{quantity}_record.csv'},
    )

    def wait_for_states(count):
        enough = len(states) + count
        until(lambda: len(states) > enough or not process.running(), lambda: process.output)

    def resets():
        held = [json.loads(message.data) for message in list(snapshots)]
        return [each['state'] for each in held if each['reason'] == 'reset']

    wait_for_states(50)
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    assert not parameters.set(gap=0.02)
    assert 'fixed while the node runs' in parameters.set(**{f'{quantity}_record': 'none'})
    assert client.call(Trigger, f'{namespace}/sim_node/reset').success
    held = until(resets)[-1]
    wait_for_states(200)
    assert process.stop() == 0, process.output
    (copy,) = held['records']
    assert (copy['quantity'], copy['name']) == (quantity, f'{quantity}_record.csv')
    # Anew from the reset on, and the base from rest
    assert copy['start'] == held['time']
    assert held['recorded']['base_speed'] == 0.0
    # The snapshot is enough to go on.
    (record,) = Rig.restore(held).measured_records
    table = np.loadtxt(CONFIG / f'{quantity}_record.csv', delimiter=',', skiprows=2)
    scale = 9.80665 if quantity == 'base' else 1.0
    assert record.values.tolist() == (table[:, 1] * scale).tolist()
    found = replayed(tmp_path)
    for since in (0.0, held['time']):
        then = (found[:, 0] >= since) & (found[:, 0] < since + 1.0)
        assert np.abs(found[then, 1] - found[then, 9]).max() > 1e-4


def test_a_bad_record_is_refused_at_the_start(launch, tmp_path):
    path = tmp_path / 'record.csv'
    path.write_text('t [s],force [N]\n0,1\n0.1,2\n0.1,3\n0.3,1\n')
    process = launch(parameters_file=BENCH, force_record=path)
    assert process.wait() != 0
    assert "line 4, column 't [s]': 0.1 after 0.1: the column must rise" in process.output
    process = launch(parameters_file=BENCH, base_record=tmp_path / 'none.csv')
    assert process.wait() != 0
    assert 'cannot be read (No such file or directory)' in process.output
    assert 'Traceback' not in process.output


def test_random_lines_of_a_file(launch, client, namespace, tmp_path):
    """The node starts with the file of --rig-out, and moves as the command does."""
    rig, states = tmp_path / 'rig.yaml', tmp_path / 'states.csv'
    words = ['bench_rig', '--set', 'force_amplitudes=0', '--duration', '0.5', '--quiet']
    random = ['--base-psd', str(CONFIG / 'random_base.csv'), '--psd-lines', '60']
    assert simulate_rig([*words, *random, '--rig-out', str(rig), '--states', str(states)]) == 0
    assert len(load_parameters(rig)[0].base_amplitudes) == 61
    process = launch(f'__ns:={namespace}', parameters_file=rig, record=True)
    heard = client.listen(JointState, f'{namespace}/joint_states')
    until(lambda: len(heard) > 150 or not process.running(), lambda: process.output)
    assert process.stop() == 0, process.output
    expected, found = np.loadtxt(states, delimiter=',', skiprows=1), replayed(tmp_path)
    until_then = found[:, 0] <= 0.5
    here = np.isin(expected[:, 0], found[until_then, 0])
    assert here.sum() > 50
    assert found[until_then, 1].tolist() == expected[here, 1].tolist()


def replayed(directory):
    """Return the samples of the one recording in a directory, by `replay_run`."""
    (description,) = directory.rglob('metadata.yaml')
    path = directory / 'again.csv'
    assert replay_run([str(description.parent), '--states', str(path)]) == 0
    return np.loadtxt(path, delimiter=',', skiprows=1)
