"""What a snapshot says of what was done."""

import json
import re

from impact_damper_ros.bag.snapshots import Snapshots, mathematics

INITIAL = {'initial_primary_position': 0.0, 'initial_damper_offset': 0.0}
TOPICS = {'joint_states': '/a/joint_states', 'snapshot': '/a/seen', 'diagnostics': '/diagnostics'}


def test_what_was_done_is_listed_in_order_and_once():
    snapshots = Snapshots('/a/rig', TOPICS, INITIAL, 200.0, 7)
    first = json.loads(snapshots.text(0, 'start', {}))
    assert (first['done'], first['number'], first['stamp_offset_ns']) == ([], 1, 7)
    assert first['topics'] == {'joint_states': '/a/joint_states', 'snapshot': '/a/seen'}
    assert first['mathematics'] == mathematics()
    before = {'gap': 1.0, 'force_amplitudes': (1.0,)}
    assert not snapshots.change(before, dict(before))
    assert snapshots.change(before, {'gap': 2.0, 'force_amplitudes': (1.0, 2.0)})
    snapshots.move_stamps(7)
    snapshots.move_stamps(9)
    assert snapshots.change({}, {'initial_damper_offset': 0.5})
    after = {**INITIAL, 'initial_damper_offset': 0.5}
    snapshots.reset(after)
    second = json.loads(snapshots.text(5, 'reset', {}))
    assert second['done'] == [
        ['change', {'gap': 2.0, 'force_amplitudes': [1.0, 2.0]}],
        ['stamp_offset_ns', 9],
        ['change', {'initial_damper_offset': 0.5}],
        ['reset', after],
    ]
    assert (second['initial'], second['stamp_offset_ns'], second['number']) == (after, 9, 2)
    assert json.loads(snapshots.text(6, 'record', {}))['done'] == []


def test_all_snapshots_of_a_run_name_it():
    snapshots, other = (Snapshots('/a/rig', TOPICS, INITIAL, 200.0) for _ in range(2))
    runs = [json.loads(snapshots.text(0, 'start', {}))['run']]
    snapshots.reset(INITIAL)
    runs.append(json.loads(snapshots.text(9, 'reset', {}))['run'])
    assert runs[0] == runs[1] != json.loads(other.text(0, 'start', {}))['run']
    assert re.fullmatch('[0-9a-f]{32}', runs[0])
