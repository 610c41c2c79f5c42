"""The command that measures frame times, as CONTRIBUTING.md and benchmarks name it."""

import os
import re
import subprocess
import sys

import pytest

pytest.importorskip('tornado', reason='the page needs Tornado')
pytest.importorskip('rclpy', reason='a live rig needs ROS')

import chromium
from node.rig_client import DEADLINE_S, SOURCE


def test_frame_times_of_each_window():
    chromium.needed()
    done = subprocess.run(
        [sys.executable, '-m', 'page.frame_times', '--seconds', '1', '--window', '3'],
        cwd=SOURCE,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join([str(SOURCE), str(SOURCE / 'test')])},
        capture_output=True,
        text=True,
        timeout=4.0 * DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    rows = re.findall(
        r'^\| (\d+) × (\d+) \| ([\d.]+), ([\d.]+) ms \| ([\d.]+), ([\d.]+) ms '
        r'\| ([\d.]+), ([\d.]+) ms \| (\d+) /s \|$',
        done.stdout,
        re.MULTILINE,
    )
    assert [row[:2] for row in rows] == [('360', '780'), ('1280', '800'), ('2560', '1440')]
    for row in rows:
        between, late, drawing, late_drawing, age, late_age, rate = map(float, row[2:])
        assert 0.0 < between <= late
        assert 0.0 < drawing <= late_drawing
        # Drawn in the frame before, of a joint state that was there by then
        assert drawing < age <= late_age < 10_000.0
        # Of a second only, with a frame or two that were late before it
        assert 0.0 < rate <= 75.0
