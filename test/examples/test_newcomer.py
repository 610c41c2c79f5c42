"""The two nodes of the page *Tuning*, with a rig over DDS."""

import sys

import pytest
from rigs import FRICTION
from running import SOURCE, Running

from impact_damper_ros import find_orbits
from impact_damper_ros.cli.set_rig import main as set_rig

pytest.importorskip('rclpy', reason='needs ROS 2')
from node.rig_client import SimProcess
from node.test_motion_reports import INCLINED


def test_a_subscriber_and_a_table_over_the_gap(tmp_path):
    examples = SOURCE / 'examples'
    with (
        SimProcess(tmp_path / 'rig', **INCLINED),
        Running(tmp_path, sys.executable, examples / 'subscriber.py') as subscriber,
        Running(tmp_path, sys.executable, examples / 'tune.py', '37', '33') as tune,
    ):
        assert tune.wait() == 0, tune.output
        subscriber.until(lambda: ' mm, ' in subscriber.output)
        # However late it has met the rig, |X| grows on from here, through impacts.
        assert set_rig(['force_amplitudes=20']) == 0
        subscriber.until(lambda: 'mm, after stop_' in subscriber.output)
        assert subscriber.stop() == 0
        assert 'Traceback' not in subscriber.output
    head, *rows = tune.output.splitlines()
    assert head.startswith('gap [m]  motion')
    for row, gap in zip(rows, (37.0, 33.0), strict=True):
        value, state, *stops, x_max = row.split()
        assert (float(value), state, stops) == (gap, 'periodic', ['[1,', '2]'])
        orbit = find_orbits(FRICTION.replace(gap=gap), (1, 2)).orbits[0]
        assert float(x_max) == pytest.approx(orbit.x_max, rel=5e-3)
