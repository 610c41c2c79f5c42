"""Nodes and clients for the integration tests."""

import itertools

import pytest

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.rig_client import LIVELY, LiveRig, RigClient, SimProcess

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
        process.kill()


@pytest.fixture
def start(client, launch):
    """Start a `LiveRig` in a namespace that no other test uses."""

    def start(*remaps, space='', node='sim_node', **parameters):
        space = space or f'/rig{next(_numbers)}'
        process = launch(f'__ns:={space}', f'__node:={node}', *remaps, **parameters)
        return LiveRig(client, process, space, node)

    return start


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
        recovered = description.parent.name.endswith('_recovered')
        verdict = ReplayVerdict.PARTIAL if recovered else ReplayVerdict.IDENTICAL
        assert findings.verdict is verdict, (description.parent, findings)
        assert len(findings.faults) == recovered


@pytest.fixture(scope='package')
def shared_rig(tmp_path_factory):
    process = SimProcess(tmp_path_factory.mktemp('shared'), **LIVELY)
    try:
        with RigClient() as client:
            rig = LiveRig(client, process)
            rig.pause()
            yield rig
        rig.stop()
    finally:
        process.kill()


@pytest.fixture
def rig(shared_rig):
    """
    Lend the one node that most tests talk to, running with its own parameters.

    Until the next one it is paused: beside other tests it would take a fifth of a processor.
    """
    shared_rig.pause(data=False)
    parameters = shared_rig.parameters
    described = parameters.describe(*parameters.names())
    names = [one.name for one in described if not one.read_only]
    before = dict(zip(names, parameters.get(*names), strict=True))
    yield shared_rig
    shared_rig.change(**before)
    shared_rig.pause()
