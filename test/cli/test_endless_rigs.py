"""Rigs with impacts without end in every command: it ends, says why, and leaves whole files."""

import csv
import json
import re

import pytest
from bag import samples
from bag.recorded_rig import NOTES, RecordedRig
from rig.endless_rigs import ENDLESS

from impact_damper_ros.bag import RunReader
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.cli.solve_periodic import main as solve_periodic

MOST = 1500
REMEDY = 'make the stops less elastic or the gap wider, or allow more with --most-events'


def table(path):
    return list(csv.DictReader(path.read_text().splitlines()))


def endless_file(path, name):
    """Write the parameters file of an endless rig."""
    parameters, initial = ENDLESS[name]
    values = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in {**parameters.as_dict(), **initial.as_dict()}.items()
    }
    path.write_text(json.dumps({'/**': {'ros__parameters': values}}))
    return path


@pytest.mark.parametrize(
    ('name', 'law'),
    [('high frequency', 'off'), ('weight', 'timed')],
)
def test_simulate_rig_ends_with_whole_files(tmp_path, capsys, name, law):
    bag, events, states = tmp_path / 'bag', tmp_path / 'events.csv', tmp_path / 'states.csv'
    code = simulate_rig(
        [
            str(endless_file(tmp_path / 'rig.yaml', name)),
            *('--duration', '10', '--rate', '2e5', '--set', f'gap_control={law}'),
            *('--most-events', str(MOST), '--bag', str(bag)),
            *('--events', str(events), '--states', str(states)),
        ]
    )
    assert code == 1
    err = capsys.readouterr().err
    said = re.search(
        r'simulate_rig: the rig had (\d+) events from 0 s to (\S+) s, the last in mode (\w+): '
        rf'{REMEDY}; '
        rf'the output so far is in {events}.part and {states}.part and {bag}\n',
        err,
    )
    rows = table(tmp_path / 'events.csv.part')
    assert MOST <= int(said[1]) == len(rows) < MOST + 10
    assert float(said[2]) == pytest.approx(float(rows[-1]['time']), rel=1e-3)
    assert 'largest |X|' not in err
    assert f'{sum(row["kind"] == "impact" for row in rows)} impact' in err
    assert all(row['stop_1'] for row in table(tmp_path / 'states.csv.part'))
    reader = RunReader(bag)
    assert reader.complete
    assert reader.unusable == reader.dropped == 0
    impacts = sum(row['kind'] == 'impact' for row in rows)
    assert reader.topics['/impacts', samples.JOINT_STATE].message_count == impacts
    assert replay_run([str(bag)]) == 0
    assert f'{impacts} impacts' in capsys.readouterr().out
    assert compare_run([str(bag)]) == 0


def test_a_change_of_parameters_ends_the_hammering(tmp_path, capsys):
    """What came before a change does not count."""
    bag = tmp_path / 'bag'
    code = simulate_rig(
        [
            str(endless_file(tmp_path / 'rig.yaml', 'weight')),
            *('--duration', '0.5', '--most-events', str(MOST), '--bag', str(bag)),
            *('--change', '1e-5:restitution_1=0.5'),
        ]
    )
    assert code == 0, capsys.readouterr().err
    assert replay_run([str(bag)]) == 0


def test_a_what_if_ends_where_its_events_do(tmp_path, capsys):
    bag = RecordedRig().start().run(100).save(tmp_path / 'bag')
    states, impacts = tmp_path / 'states.csv', tmp_path / 'impacts.csv'
    hammering, initial = ENDLESS['weight']
    words = [
        word
        for name in ('angle', 'gravity', 'one_sided', 'restitution_1')
        for word in ('--set', f'{name}={getattr(hammering, name)}')
    ]
    offset = f'initial_damper_offset={initial.initial_damper_offset}'
    files = ('--states', str(states), '--impacts', str(impacts))
    most = ('--most-events', str(MOST))
    assert replay_run([str(bag), *words, '--set', offset, *most, *files]) == 1
    err = capsys.readouterr().err
    assert re.search(
        rf'replay_run: what if: the rig had {MOST} events from 0 s to .*: {REMEDY}', err
    )
    assert [float(row['time']) for row in table(tmp_path / 'states.csv.part')] == [0.0]
    # Without the offset m bounces by millimetres, which takes long enough.
    assert replay_run([str(bag), *words, *most, *files]) == 0
    assert len(table(states)) == 101


def test_a_recording_that_would_not_end_is_refused(tmp_path, capsys):
    """Its snapshots are of another rig than the one that was recorded."""
    messages = RecordedRig().start().run(400).messages
    for true, false in ((b'"air_force": 0.0', b'"air_force": 9e8'), (b'_1": 0.75', b'_1": 1.00')):
        assert any(true in content for _, content, _ in messages)
        messages = [(t, content.replace(true, false), stamp) for t, content, stamp in messages]
    messages = [(t, content.replace(b'_2": 0.75', b'_2": 1.00'), n) for t, content, n in messages]
    bag = samples.record(tmp_path / 'bag', messages, custom=NOTES)
    assert replay_run([str(bag)]) == 2
    assert re.search(
        r'cannot be run on from rig time .*: the rig had \d+ events from', capsys.readouterr().err
    )


def test_solve_periodic_leaves_such_a_rig(tmp_path, capsys):
    params = str(endless_file(tmp_path / 'rig.yaml', 'weight'))
    assert solve_periodic([params, '--impacts', '3', '--stops', '1,1,1']) == 3
    assert 'no periodic motion with 3 impacts in 1 cycle was found' in capsys.readouterr().err
