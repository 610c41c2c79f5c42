"""`make demo`, shortened: the live node, its knobs, the recording, the comparison."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from running import DEADLINE_S

import impact_damper_ros

ROOT = Path(impact_damper_ros.__file__).parents[1]
#: The same time of the rig as in the shortest demonstration, in a third of that of the clock, on
#: a machine so busy that the client takes 27 s of the rig until it has met the node.
FASTER = """
import sys
import time
from pathlib import Path
sys.path.insert(0, 'examples')
import demo

run = Path(sys.argv[1])

class SlowClient(demo.RigParameterClient):
    def __init__(self, *arguments):
        super().__init__(*arguments)
        while sum(file.stat().st_size for file in run.rglob('*.mcap')) < 150_000:
            time.sleep(0.05)

demo.RigParameterClient = SlowClient
demo.SPEED *= 3.0
sys.exit(demo.main())
"""


def test_the_demonstration(tmp_path):
    pytest.importorskip('rclpy', reason='the demonstration runs the node')
    pytest.importorskip('matplotlib', reason='the demonstration draws a picture')
    anyreader = pytest.importorskip('rosbags.highlevel').AnyReader
    done = subprocess.run(
        [*(sys.executable, '-c', FASTER, str(tmp_path / 'run')), *('--duration', '8')],
        cwd=ROOT,
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    pattern = r'^.* (\d\.\d\d) +(\d+\.\d) mm +0\.\d{3} +(\d+) mN s +([\d.]+) s, ([\d.]+) s$'
    rows = re.findall(pattern, done.stdout, re.M)
    assert len(rows) == 3
    # Too narrow a gap: three impacts a cycle; the right one: two, less motion.
    assert 2.8 < float(rows[0][0]) < 3.2
    assert 1.9 < float(rows[1][0]) < 2.2
    assert float(rows[1][1]) < float(rows[0][1])

    report = tmp_path / 'run' / 'report'
    page = (report / 'report.html').read_text(encoding='utf-8')
    assert page.count('<section class="stretch"') == 3
    stretches = json.loads((report / 'report.json').read_text('utf-8'))['stretches']
    # The same numbers of the same part of each stage as in the report
    for row, stretch in zip(rows, stretches, strict=True):
        measured = stretch['measured']
        assert float(row[0]) == pytest.approx(measured['impacts_per_cycle'], abs=0.00501)
        assert float(row[1]) == pytest.approx(1e3 * measured['x_max'], abs=0.0501)
        assert float(row[2]) == pytest.approx(1e3 * measured['mean_impulse'], abs=0.501)
        part = [measured['start'], measured['end']]
        assert [float(row[3]), float(row[4])] == pytest.approx(part, abs=0.0501)
    _, second, tilted = stretches
    assert tilted['kind'] == 'chaotic'
    # The instant of the change is another one each time, and chaos makes that another motion: of
    # such runs the exponents spread by 0.02 about 0.30.
    assert tilted['measures']['lyapunov_exponent'] == pytest.approx(0.30, abs=0.12)
    assert second['parameters']['gap'] == 0.024
    assert second['verdict'] == 'agrees'
    assert second['measured']['x_max'] == pytest.approx(0.00325, rel=0.01)
    assert 'gap = 0.024 m (was 0.0145 m): agrees.' in ' '.join(done.stdout.split())

    (bag,) = (tmp_path / 'run').glob('run_*')
    with anyreader([bag]) as reader:
        counts = {topic: info.msgcount for topic, info in reader.topics.items()}
        gaps = [
            parameter.value.double_value
            for connection, _, raw in reader.messages(
                [c for c in reader.connections if c.topic == '/parameter_events']
            )
            for parameter in reader.deserialize(raw, connection.msgtype).changed_parameters
            if parameter.name == 'gap'
        ]
    assert gaps == [0.024]
    assert counts['/joint_states'] > 2000
    assert counts['/impacts'] > 100
    assert counts['/snapshot'] >= 3
