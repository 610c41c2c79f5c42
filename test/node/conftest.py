"""Processes and clients for the integration tests."""

import itertools

import pytest
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import Trigger

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.rig_client import LATCHED, LIVELY, RigClient, RigParametersClient, SimProcess

_numbers = itertools.count(1)


@pytest.fixture
def client():
    """Return a client of its own for a test: whom it has met costs it time with each message."""
    with RigClient() as client:
        yield client


@pytest.fixture
def launch(tmp_path):
    """Start nodes that do not outlive the test."""
    started = []

    def start(*remaps, **parameters):
        process = SimProcess(tmp_path / f'process_{len(started)}', remaps, **parameters)
        started.append(process)
        return process

    yield start
    for process in started:
        if process.running():
            process.kill()


@pytest.fixture
def namespace():
    """Return a namespace that no other test uses."""
    return f'/rig{next(_numbers)}'


@pytest.fixture(autouse=True)
def every_bag_is_replayed(tmp_path):
    """Hold each whole recording of a test, bit for bit, against the rig that is run again."""
    yield
    for description in sorted(tmp_path.rglob('metadata.yaml')):
        try:
            findings = Replay(RecordedRun(description.parent)).run()
        except RecordingError as error:
            if 'give the law, too' not in str(error):
                raise
            continue
        assert findings.verdict is ReplayVerdict.IDENTICAL, (description.parent, findings)


class SharedRig:
    """The one node, without namespace and with the paper's names, that most tests talk to."""

    def __init__(self, client, process):
        self.client = client
        self.process = process
        self.parameters = RigParametersClient(client)
        self.states = client.listen(JointState, 'joint_states')
        self.impacts = client.listen(JointState, 'impacts')
        self.snapshots = client.listen(String, 'snapshot', LATCHED)
        self.await_states()

    def await_states(self, count=1):
        """Wait for so many more joint states."""
        have = len(self.states)
        until(
            lambda: len(self.states) >= have + count or not self.process.running(),
            'no joint states come',
        )
        assert self.process.running(), self.process.output

    def reset(self):
        """Reset the rig; then no earlier snapshot is under way any more."""
        have = len(self.snapshots)
        assert self.client.call(Trigger, '/sim_node/reset').success
        until(lambda: any('"reason": "reset"' in m.data for m in self.snapshots[have:]))


@pytest.fixture(scope='package')
def shared_rig(tmp_path_factory):
    process = SimProcess(tmp_path_factory.mktemp('shared'), **LIVELY)
    try:
        with RigClient() as client:
            yield SharedRig(client, process)
        assert process.stop() == 0, process.output
        assert 'a callback failed' not in process.output, process.output
    finally:
        process.kill()


@pytest.fixture
def rig(shared_rig):
    """Lend the shared rig, and put its parameters back afterwards."""
    parameters = shared_rig.parameters
    names = [name for name in parameters.names() if name in LIVELY or name.startswith('initial')]
    names += ['force_phases', 'angle', 'one_sided', 'record', 'bag_directory']
    before = dict(zip(names, parameters.get(*names), strict=True))
    yield shared_rig
    assert parameters.set_atomically(**before) == ''
