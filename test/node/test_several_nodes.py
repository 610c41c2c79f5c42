"""Two rigs side by side, and two nodes of one name."""

import contextlib
import os
from pathlib import Path

from impact_damper_ros.cli.set_rig import main as set_rig
from node.rig_client import LIVELY
from node.test_pacing import permitted
from node.test_recorded_runs import Bag


def priorities(process):
    """Return the real-time priorities of the threads of a process that have one."""
    found = []
    for path in Path(f'/proc/{process}/task').iterdir():
        task = int(path.name)
        # One may end meanwhile.
        with contextlib.suppress(ProcessLookupError):
            if os.sched_getscheduler(task) == os.SCHED_FIFO:
                found.append(os.sched_getparam(task).sched_priority)
    return sorted(found)


def test_rigs_side_by_side(start, tmp_path, capsys):
    slow = {'state_rate': 20.0}
    common = {'record': True, 'bag_directory': str(tmp_path / 'runs'), 'gravity': 0.0, **slow}
    left = start(space='/rig2', real_time_factor=2.0, **common)
    right = start(
        space='/right', publish_clock=True, real_time_priority=3, predict_motion=True, **common
    )
    for rig in (left, right):
        rig.await_states(20)
    # The engine comes first.
    found = priorities(right.process.pid)
    assert (found[-1:], set(found[:-1])) == (([3], {2}) if permitted() else ([], set()))
    assert priorities(left.process.pid) == []
    # Both publish the clock, and report that once.
    clock = 'another node publishes /clock, too'
    for rig in (left, right):
        rig.until(lambda rig=rig: clock in rig.process.output)
    # Two nodes of one name report it, in their log and in the diagnostics; set_rig sets neither.
    other = start(space='/rig2', **LIVELY, **slow)
    words = '2 nodes are named /rig2/sim_node'
    for rig in (left, other):
        rig.until(lambda rig=rig: words in rig.process.output)
    # The reports of both have one name; the other rig has no clock.
    report = left.await_report(
        'network',
        holds=lambda report: (
            words in report.message and int(report.values['Publishers of /clock']) > 1
        ),
    )
    assert report.values['Nodes of this name'] == '2'
    assert set_rig(['--node', '/rig2/sim_node', 'gap=1']) == 2
    # The namespace of the remedy is another one.
    for text in (report.message, capsys.readouterr().err):
        assert words in text
        assert text.rstrip().endswith('(-r __ns:=/rig3)') or '(-r __ns:=/rig3);' in text
    for rig in (other, left, right):
        rig.stop()
    assert [rig.process.output.count(clock) for rig in (left, right, other)] == [1, 1, 0]
    bags = [Bag(directory) for directory in (tmp_path / 'runs').iterdir()]
    nodes = sorted(bag.messages('/parameter_events')[0].node for bag in bags)
    assert nodes == ['/rig2/sim_node', '/right/sim_node']
