"""The command, on bags of the live node and on bags written without ROS."""

import csv
import json
import math
import struct
from pathlib import Path

import numpy as np
import pytest
from bag import samples
from bag.recorded_rig import NOTES, TOPICS, RecordedRig, params_file, renamed
from rigs import LIVELY
from running import Running

from impact_damper_ros import Rig
from impact_damper_ros.cli.replay_run import main
from impact_damper_ros.cli.simulate_rig import main as simulate_rig


def run(bag, tmp_path, *arguments):
    """Run the command in this process; return exit code and result."""
    result = tmp_path / 'result.json'
    result.unlink(missing_ok=True)
    code = main([str(bag), '--json', str(result), *arguments])
    return code, json.loads(result.read_text()) if result.exists() else None


def table(path):
    return list(csv.DictReader(path.read_text().splitlines()))


@pytest.fixture(scope='module')
def messages():
    """Return a run of 4 s with changes and a reset."""
    rig = RecordedRig().start().run(300).run(200, ('change', {'gap': 0.012}))
    rig.run(100, ('reset', None)).run(200, ('change', {'restitution_1': 0.7}))
    return rig.messages


@pytest.fixture(scope='module')
def bag(messages, tmp_path_factory):
    return samples.record(tmp_path_factory.mktemp('run') / 'bag', messages, custom=NOTES)


def test_an_identical_replay(bag, tmp_path, capsys):
    code, result = run(bag, tmp_path)
    assert code == 0
    assert result['verdict'] == 'identical'
    compared = result['compared']
    assert (compared['samples'], compared['changes'], compared['resets']) == (801, 2, 1)
    assert (compared['start'], compared['end']) == (0.0, 4.0)
    assert compared['impacts'] > 50
    text = capsys.readouterr().out
    assert 'verdict     identical: the run is reproduced bit for bit' in text
    assert f'801 samples, {compared["impacts"]} impacts' in text
    # A single file, too
    (file,) = bag.glob('*.mcap')
    assert run(file, tmp_path)[0] == 0


def test_a_difference_is_reported_where_it_starts(tmp_path, capsys):
    rig = RecordedRig().start().run(100, ('change', {'friction': 0.1})).run(99)
    rig.rig.change(rig.rig.parameters.replace(gap=0.012))
    rig.run(100)
    code, result = run(rig.save(tmp_path / 'bag'), tmp_path)
    assert code == 1
    first = result['first_difference']
    assert (first['time'], first['topic']) == (1.0, '/joint_states')
    # Both differ by the same, up to round-off.
    assert first['quantity'] in ('position of stop_1', 'position of stop_2')
    assert first['difference'] == pytest.approx(0.001, rel=1e-9)
    assert first['after'] == 'friction = 0.1 at 0.005 s'
    assert result['divergence']['samples'] == 100
    assert result['divergence']['largest_x'] > 1e-4
    text = capsys.readouterr().out
    assert 'DIFFERENT' in text
    assert 'rig time 1.000000000 s' in text
    assert 'after     friction = 0.1 at 0.005 s' in text


def test_what_if_is_what_simulate_rig_says(tmp_path, capsys):
    plain = RecordedRig().start().run(400).save(tmp_path / 'plain')
    states, impacts = tmp_path / 'states.csv', tmp_path / 'impacts.csv'
    files = ('--states', str(states), '--impacts', str(impacts))
    code, result = run(plain, tmp_path, '--set', 'gap=0.006', *files)
    assert code == 0
    rows, hits = table(states), table(impacts)
    params = params_file(tmp_path / 'params.yaml', LIVELY)
    words = ['--duration', '2', '--rate', '200', '--set', 'gap=0.006', *files]
    assert simulate_rig([str(params), *words]) == 0
    more = ('force', 'primary_acceleration')
    assert [{k: v for k, v in r.items() if k not in more} for r in table(states)] == rows
    assert table(impacts) == hits
    assert len(rows) == 401
    # Rows of rest have the same velocities before and after.
    speeds = ('damper_velocity_before', 'damper_velocity_after')
    count = sum(row[speeds[0]] != row[speeds[1]] for row in hits)
    assert result['what_if']['what_if']['impacts'] == count > 20
    # Measured independently
    found = Rig(LIVELY).run(2.0, np.linspace(0.0, 2.0, 20_001))
    x, hits = found.samples['x'], found.impacts()
    lost = {
        name: 0.5
        * mass
        * (hits[f'{name}_velocity_before'] ** 2 - hits[f'{name}_velocity_after'] ** 2)
        for name, mass in (('primary', LIVELY.primary_mass), ('damper', LIVELY.damper_mass))
    }
    recorded = result['what_if']['recorded']
    assert recorded['x_max'] == pytest.approx(np.abs(x).max(), rel=1e-4)
    assert recorded['x_rms'] == pytest.approx(math.sqrt(np.mean(x**2)), rel=1e-3)
    assert recorded['impact_loss'] == pytest.approx(sum(map(sum, lost.values())))
    taken = recorded['impact_energy']
    assert taken == pytest.approx(sum(lost['primary']))
    text = capsys.readouterr().out
    assert 'what if     gap = 0.006 (recorded: 0.01)' in text
    assert 'energy lost in impacts [J]' in text
    assert 'taken from M by impacts [J]' in text


def test_what_if_lists_what_was_recorded(tmp_path, capsys):
    """All values that the held parameter had; of very many, how many more."""
    rig = RecordedRig().start()
    gaps = [0.012 + 0.0001 * k for k in range(17)]
    for gap in gaps:
        rig.run(20, ('change', {'gap': gap}), ('change', {'friction': gap}))
    rig.run(20, ('change', {'initial_primary_position': 0.002}), ('reset', None))
    bag = rig.save(tmp_path / 'bag')
    words = ('--set', 'gap=0.03', '--set', 'initial_primary_position=0.001', '--set', 'angle=0.1')
    figure = tmp_path / 'figure.png'
    code, result = run(bag, tmp_path, *words, '--figure', str(figure))
    assert code == 0
    assert figure.read_bytes()[:8] == b'\x89PNG\r\n\x1a\n'
    width, height = struct.unpack('>II', figure.read_bytes()[16:24])
    assert width > 1500
    assert height > 1000
    told = ' '.join(capsys.readouterr().out.split())
    listed = ', '.join(map(repr, [0.01, *gaps]))
    assert f'gap = 0.03 (recorded: {listed})' in told
    assert 'initial_primary_position = 0.001 (recorded: 0.0)' in told
    assert 'angle = 0.1 (recorded: 0.0)' in told
    assert result['what_if']['recorded_values']['gap'] == [0.01, *gaps]


def test_what_ifs_of_the_recorded_values_and_of_a_base_in_millimetres(bag, tmp_path):
    code, result = run(bag, tmp_path, '--set', 'damper_mass=0.1')
    assert code == 0
    assert result['what_if']['recorded'] == result['what_if']['what_if']
    # The unit of the base is its quantity.
    words = ('--set', 'base_amplitudes=0.5 mm', '--set', 'base_frequencies=30')
    code, result = run(bag, tmp_path, *words)
    held = [result['what_if']['set'][f'base_{name}'] for name in ('amplitudes', 'quantity')]
    assert (code, held) == (0, [[0.0005], 'displacement'])


def test_a_bag_with_a_gap_is_compared_in_part(messages, tmp_path):
    kept = [m for m in messages if not 10**9 < m[2] - samples.START < 1.1e9]
    code, result = run(samples.record(tmp_path / 'gap', kept, custom=NOTES), tmp_path)
    assert (code, result['verdict'], result['missing_samples']) == (3, 'partial', 19)


def test_several_rigs_in_a_bag(messages, tmp_path, capsys):
    topics = [
        samples.Topic(f'{space}{t.name}', t.type, t.qos)
        for space in ('/left', '/right')
        for t in samples.TOPICS
        if 'parameter' not in t.name and 'diagnostics' not in t.name
    ]
    names = {t.name for t in topics}
    with samples.RunWriter(tmp_path / 'two', topics) as writer:
        for space in ('/left', '/right'):
            named = {t: space + t for t in TOPICS.values()}
            for topic, content, stamp in renamed(messages, named, f'{space}/sim_node'):
                if topic in names:
                    writer.write(topic, content, stamp)
    assert run(tmp_path / 'two', tmp_path) == (2, None)
    assert (
        'several rigs: /left/sim_node, /right/sim_node; choose one with --node'
        in capsys.readouterr().err
    )
    for name in ('/left', '/right/sim_node'):
        code, result = run(tmp_path / 'two', tmp_path, '--node', name)
        assert (code, result['compared']['samples']) == (0, 801)
    assert run(tmp_path / 'two', tmp_path, '--node', '/middle/x') == (2, None)
    assert "holds no node '/middle/x'" in capsys.readouterr().err


#: Growth of the memory from a recording to one that is ten times as long, MB.
GROWTH = """
import resource, sys
from impact_damper_ros.cli.replay_run import main
peaks = []
for bag in sys.argv[1:]:
    main([bag, '--quiet', '--set', 'gap=0.02'])
    peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3)
print(peaks[1] - peaks[0])
"""


def test_long_runs_take_little_memory(tmp_path):
    """An hour's worth is measured by hand."""
    bags = [str(tmp_path / str(seconds)) for seconds in (1, 10)]
    for bag in bags:
        words = ('--rate', '1000', '--duration', Path(bag).name, '--quiet', '--bag', bag)
        assert simulate_rig(['bench_rig', *words]) == 0
    with Running(tmp_path, '-c', GROWTH, *bags) as process:
        assert process.wait() == 0, process.output
    assert float(process.output) < 8
