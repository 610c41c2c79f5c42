"""`fit_rig --topic`: a live rig over DDS."""

import json

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
from node.rig_client import SimProcess
from running import DEADLINE_S, SOURCE, until

from impact_damper_ros import Rig, load_parameters
from impact_damper_ros.bag.topic_columns import TYPES
from impact_damper_ros.cli.fit_rig import main
from impact_damper_ros.fit.measured_motion import NO_OPTIONS
from impact_damper_ros.fit.recorded_motion import (
    TopicMessages,
    beside,
    motion_of_messages,
    recorded_rig,
)
from impact_damper_ros.node.topic_listener import TopicError, listen

RIG, _, _ = load_parameters('bench_rig')
FILE = SOURCE / 'config' / 'bench_rig.yaml'


@pytest.fixture(scope='module')
def node(tmp_path_factory):
    process = SimProcess(
        tmp_path_factory.mktemp('node'),
        ('__ns:=/bench',),
        parameters_file=FILE,
        state_rate=100.0,
        # Stamps are those of the rig, also where the machine stands still for a moment
        publish_clock=True,
    )
    yield process
    process.kill()


@pytest.fixture
def patient(monkeypatch):
    """Wait for the node as long as its start takes on a machine with much else to do."""
    monkeypatch.setattr('impact_damper_ros.node.topic_listener.PATIENCE_S', DEADLINE_S)


@pytest.mark.usefixtures('node', 'patient')
def test_what_comes_over_the_network_is_the_motion_of_the_rig():
    topic = '/bench/joint_states'
    more = [beside(topic, name) for name in ('snapshot', 'impacts')]

    def whole():
        """Return what came, if the snapshot was among it, and not many samples were lost."""
        came = listen(topic, more, TYPES, 3.0)
        if not {message.topic for message in came} >= {topic, *more}:
            return None
        messages = TopicMessages(came, topic, 'live')
        try:
            return messages, motion_of_messages(messages, NO_OPTIONS)
        except ValueError:
            return None

    messages, data = until(whole)
    assert recorded_rig(messages) == RIG
    assert data.quantity == 'displacement'
    there = data.time[data.used]
    exact = Rig(RIG).run(float(there[-1]), there).samples['x']
    # Stamps are whole nanoseconds
    np.testing.assert_allclose(data.motion[data.used], exact, atol=1e-8)
    assert data.impact_deviation == 1e-4


@pytest.mark.usefixtures('node', 'patient')
def test_a_live_rig_is_fitted(tmp_path, capsys):
    result = tmp_path / 'fit.json'
    words = ['--topic', '/bench/joint_states', '--seconds', '5', '--rig', str(FILE)]
    code = main([*words, '--json', str(result)])
    said = capsys.readouterr()
    if code == 2:
        # Of a machine that stood still many samples are lost
        assert 'are missing among' in said.err or 'a step of' in said.err
        return
    found = json.loads(result.read_text('utf-8'))
    assert 'live, /bench/joint_states' in found['source']
    if code == 0:
        for name, one in found['parameters'].items():
            (true,) = np.atleast_1d(getattr(RIG, name))
            assert one['value'] == pytest.approx(true, rel=1e-3, abs=1e-4), name
    else:
        # A machine that stood still has lost samples
        assert found['reasons']
    assert ('NOT accepted' in said.out) == (code == 1)


@pytest.mark.usefixtures('node')
def test_a_topic_that_nobody_publishes(monkeypatch, capsys):
    monkeypatch.setattr('impact_damper_ros.node.topic_listener.PATIENCE_S', 2.0)
    with pytest.raises(TopicError, match=r'nobody publishes /none as .*; topics of these types: '):
        listen('/none', [], TYPES, 1.0)
    assert main(['--topic', '/none', '--seconds', '1']) == 2
    assert 'nobody publishes /none' in capsys.readouterr().err
