"""The command, on bags of the live node and on bags written without ROS, whole and faulty."""

import csv
import json
import math
import re
import struct

import numpy as np
import pytest
from bag import ros2_bags, samples
from bag.alterations import cut, rewritten
from bag.recorded_rig import NOTES, RecordedRig, params_file
from rigs import BENCH

from impact_damper_ros import EventKind, InitialConditions, Rig, RigParameters
from impact_damper_ros.cli.compare_run import main
from impact_damper_ros.cli.simulate_rig import main as simulate_rig


def run(bag, tmp_path, *arguments):
    """Run the command in this process; return exit code and result."""
    result = tmp_path / 'result.json'
    result.unlink(missing_ok=True)
    code = main([str(bag), '--json', str(result), '--quiet', *arguments])
    return code, json.loads(result.read_text()) if result.exists() else None


def verdicts(result):
    return [stretch['verdict'] for stretch in result['stretches']]


@pytest.fixture(scope='module')
def messages():
    """Return 24 s, then 24 s with another gap, and a reset."""
    rig = RecordedRig(BENCH, rate=200.0).start().run(4800)
    rig.run(4800, ('change', {'gap': 0.021})).run(200, ('reset', None))
    return rig.messages


@pytest.fixture(scope='module')
def bag(messages, tmp_path_factory):
    return samples.record(tmp_path_factory.mktemp('run') / 'bag', messages, custom=NOTES)


def places(messages, topic):
    return [i for i, message in enumerate(messages) if message[0] == topic]


def stamped(message, stamp_ns):
    """Return a message whose header has another stamp."""
    topic, content, stamp = message
    header = struct.pack('<iI', *divmod(stamp_ns, 10**9))
    return topic, content[:4] + header + content[12:], stamp


def numbered(message, number_of):
    """Return a message with another first position, as a function of what it was."""
    topic, content, stamp = message
    first = samples.numbers(content)[0][0]
    old, new = (struct.pack('<d', value) for value in (first, number_of(first)))
    return topic, content.replace(old, new, 1), stamp


def test_what_it_says(bag, tmp_path, capsys):
    assert main([str(bag), '--json', str(tmp_path / 'result.json')]) == 0
    result = json.loads((tmp_path / 'result.json').read_text())
    assert (result['exit_code'], result['complete'], result['faults']) == (0, True, [])
    assert result['samples'] == 9801
    first, second, third = result['stretches']
    assert [s['begins'] for s in result['stretches']] == ['start', 'change', 'reset']
    assert second['cause'] == 'gap = 0.021 m (was 0.024 m)'
    assert (second['start'], second['end']) == (24.005, 48.005)
    assert verdicts(result) == ['agrees', 'agrees', third['verdict']]
    assert third['verdict'] in ('too short', 'not settled yet')
    for stretch, ratio in ((first, 0.1071954), (second, None)):
        assert (stretch['kind'], stretch['cycles']) == ('periodic', 1)
        assert stretch['measured']['last_period']['stops'] == [1, 2]
        assert stretch['predicted']['stable']
        assert stretch['decay']['measured'] == pytest.approx(
            stretch['decay']['predicted'], abs=2e-3
        )
        assert abs(stretch['energy']['residual']) < stretch['energy']['tolerance']
        if ratio:
            assert stretch['measured']['x_max_ratio'] == pytest.approx(ratio, rel=1e-5)
    text = capsys.readouterr().out
    for words in (
        'stretch 2    24.005 s to 48.005 s; begins with: gap = 0.021 m (was 0.024 m)',
        'periodic, 2 impacts in 1 cycle, stops 1,2, settled at',
        'phase [cycles]     X [mm]',
        'Impact 1, on stop 1',
        'Energy balance',
        'work of the force',
        'largest multiplier 0.8711',
        'Largest |X|, impacts and energy',
        'verdict    agrees',
        'in all       2 agrees',
    ):
        assert words in text
    # A single file, too
    (file,) = bag.glob('*.mcap')
    code, alone = run(file, tmp_path)
    assert (code, alone['stretches']) == (0, result['stretches'])


def test_an_angle_changed_on_the_way(tmp_path):
    """X counts from the equilibrium of each stretch."""
    rig = RecordedRig(BENCH, rate=50.0).start().run(1200)
    rig.run(1200, ('change', {'angle': 0.05})).run(1200, ('change', {'gravity': 0.0}))
    code, result = run(rig.save(tmp_path / 'bag'), tmp_path)
    assert (code, result['faults']) == (0, [])
    assert verdicts(result) == ['agrees'] * 3
    for one in result['stretches']:
        assert one['measured']['x_max'] == pytest.approx(one['predicted']['x_max'], rel=1e-3)


@pytest.mark.parametrize(
    ('settings', 'kind', 'reason'),
    [
        (
            ('gap_control=timed', 'gap_min=0.002', 'gap_max=0.05', 'actuator_speed=2.0'),
            'periodic',
            'the gap is under control (timed)',
        ),
        (
            ('multisine_level=1.0', 'multisine_low=20', 'multisine_high=45', 'multisine_lines=9'),
            'not periodically driven',
            'the force is a multisine',
        ),
    ],
)
def test_what_has_no_theory_is_measured(tmp_path, capsys, settings, kind, reason):
    params = params_file(tmp_path / 'params.yaml', BENCH)
    words = [word for setting in settings for word in ('--set', setting)]
    words += ['--duration', '12', '--bag', str(tmp_path / 'bag'), '--quiet']
    assert simulate_rig([str(params), *words]) == 0
    assert main([str(tmp_path / 'bag'), '--json', '-']) == 0
    said = capsys.readouterr()
    assert 'verdict    no prediction' in said.err
    (stretch,) = json.loads(said.out)['stretches']
    assert (stretch['kind'], stretch['verdict']) == (kind, 'no prediction')
    assert reason in stretch['sentence']
    assert stretch['measured']['impacts'] > 20
    energy = stretch['energy']
    assert abs(energy['residual']) < energy['tolerance'] < 1e-4 * abs(energy['force'])


def test_the_response_of_a_recorded_sweep_is_that_of_simulate_rig(tmp_path, capsys):
    bag, response, report = (tmp_path / name for name in ('bag', 'response.csv', 'report'))
    words = ['bench_rig', '--duration', '36', '--bag', str(bag), '--quiet']
    for setting in (
        *('force_amplitudes=0', 'base_amplitudes=0.06g', 'sweep_mode=up_down', 'sweep_low=4Hz'),
        *('sweep_high=6Hz', 'sweep_step=0.5Hz', 'sweep_dwell=4'),
    ):
        words += ['--set', setting]
    assert simulate_rig([*words, '--response', str(response)]) == 0
    assert main([str(bag), '--json', '-', '--report', str(report)]) == 0
    said = capsys.readouterr()
    assert 'Response over frequency' in said.err
    (stretch,) = json.loads(said.out)['stretches']
    found = stretch['response']
    best = int(np.argmax(found['x']))
    assert (stretch['kind'], stretch['verdict']) == ('not periodically driven', 'swept')
    size, hertz = found['x'][best], found['frequency'][best] / math.tau
    sentence = (
        f'the frequency of the base is swept: |X| is largest, {size:.5g} m at {hertz:.4g} Hz'
    )
    assert stretch['sentence'].startswith(f'{sentence}, without damper 0.029')
    assert sentence in said.err
    rows = list(csv.DictReader(response.read_text().splitlines()))
    for name, column, scale in (
        ('frequency', 'frequency [Hz]', 1.0 / math.tau),
        ('x', 'x [mm]', 1e3),
        ('relative', 'x - b [mm]', 1e3),
        ('acceleration_without', 'acceleration without damper [g]', 1.0 / 9.80665),
        ('impacts', 'impacts per cycle', 1.0),
    ):
        expected = [float(row[column]) for row in rows]
        assert [scale * value for value in found[name]] == pytest.approx(expected, rel=1e-8), name
    assert found['upwards'] == [row['way'] == 'up' for row in rows]
    assert len(rows) == 9
    page = (report / 'report.html').read_text()
    assert 'Response over frequency' in page
    assert re.search(
        r'Transmissibility.{0,200}at [\d.]+ Hz; [\d.]+ without damper', page, re.DOTALL
    )
    assert not re.search('no prediction|not reached', page)
    energy = stretch['energy']
    assert abs(energy['residual']) < energy['tolerance']


def test_a_recording_of_ros2_bag(messages, tmp_path):
    """Times of arrival, other metadata, and topics that overtake each other."""
    arrived = ros2_bags.joined(messages, 0)
    code, result = run(samples.record(tmp_path / 'bag', arrived), tmp_path)
    assert (code, result['faults']) == (0, [])
    assert verdicts(result)[:2] == ['agrees', 'agrees']
    assert result['samples'] == 9801
    # The recorder may lose messages one by one.
    lost = set(places(arrived, '/impacts')[150:152])
    lossy = [m for i, m in enumerate(arrived) if i not in lost]
    code, result = run(samples.record(tmp_path / 'lossy', lossy), tmp_path)
    assert (code, verdicts(result)[:2]) == (0, ['agrees', 'agrees'])


def logs(result):
    return [stretch['log'] for stretch in result['stretches']]


LOGS = ['differs', 'reproduced', 'reproduced']


def test_faults_are_found_where_they_are(messages, tmp_path, capsys):
    hit = places(messages, '/impacts')[120]
    stamp = messages[hit][2]
    late = stamp + 1_000_000
    shifted = list(messages)
    shifted[hit] = (*stamped(messages[hit], late)[:2], late)
    shifted.sort(key=lambda m: m[2])
    code, result = run(samples.record(tmp_path / 'shifted', shifted, custom=NOTES), tmp_path)
    assert (code, result['exit_code'], logs(result)) == (1, 1, LOGS)
    # Neither verdict overrides the other.
    assert verdicts(result)[:2] == ['agrees', 'agrees']
    findings = result['stretches'][0]['differences']
    assert [(d['quantity'], d['topic']) for d in findings] == [('stamp', '/impacts')]
    assert findings[0]['text'].count(str(late)) == 1
    assert findings[0]['time'] == pytest.approx((stamp - samples.START) / 1e9, abs=1e-9)
    missing = [m for i, m in enumerate(messages) if i != hit]
    bag = samples.record(tmp_path / 'missing', missing, custom=NOTES)
    assert main([str(bag), '--json', str(tmp_path / 'missing.json')]) == 1
    result = json.loads((tmp_path / 'missing.json').read_text())
    assert (logs(result), verdicts(result)[:2]) == (LOGS, ['agrees', 'agrees'])
    (finding,) = result['stretches'][0]['differences']
    assert (finding['quantity'], finding['topic']) == ('impact', '/impacts')
    out = capsys.readouterr().out
    assert 'is missing in the log (stop_' in out
    assert '\n  log        DIFFERS\n  verdict    agrees: ' in out


def test_a_bag_that_was_cut(bag, tmp_path):
    half = rewritten(bag, cut(0.5), tmp_path / 'cut.mcap')
    code, result = run(half, tmp_path)
    assert (code, result['complete'], verdicts(result)[0]) == (3, False, 'agrees')
    assert 'not complete' in result['faults'][0]


def test_numbers_that_are_none_and_stamps_going_back(messages, tmp_path):
    states = places(messages, '/joint_states')
    wrong = list(messages)
    for place in states[3000:3003]:
        wrong[place] = numbered(wrong[place], lambda _: math.nan)
    code, result = run(samples.record(tmp_path / 'nan', wrong, custom=NOTES), tmp_path)
    assert (code, logs(result)) == (1, LOGS)
    assert verdicts(result)[:2] == ['agrees', 'agrees']
    assert 'is nan m in the log' in result['stretches'][0]['differences'][0]['text']
    assert result['log']['differences'] == 3
    back = list(messages)
    for place in states[2000:2004]:
        back[place] = stamped(back[place], back[place][2] - 10**10)
    code, result = run(samples.record(tmp_path / 'back', back, custom=NOTES), tmp_path)
    assert code == 1
    assert any('4 joint states are missing' in fault for fault in result['faults'])
    # They are where their stamps are.
    assert (result['log']['differences'], verdicts(result)[:2]) == (4, ['agrees', 'agrees'])


def test_a_finding_is_in_the_stretch_of_its_instant(tmp_path):
    """An impact in the tick of a change is of the stretch before, the change of the one after."""
    rig = RecordedRig().start()
    while True:
        before = len(rig.messages)
        # Another gap at each tick
        rig.run(1, ('change', {'gap': 0.008 + 1e-6 * rig.tick}))
        topics = [topic for topic, *_ in rig.messages[before:]]
        if '/impacts' in topics and topics.index('/impacts') < topics.index('/snapshot'):
            break
    messages = rig.run(200).messages
    hit, change = (before + topics.index(topic) for topic in ('/impacts', '/snapshot'))
    messages[hit] = numbered(messages[hit], lambda x: x + 1e-3)
    messages[change] = altered_number(messages[change])
    code, result = run(rig.save(tmp_path / 'bag'), tmp_path)
    assert code == 1
    wrong = [s for s in result['stretches'] if s['differences']]
    one, other = (s['differences'] for s in wrong)
    assert one[0]['text'].startswith('position of primary on /impacts at ')
    assert (other[0]['quantity'], other[0]['topic']) == ('number', '/snapshot')
    assert wrong[1]['number'] == wrong[0]['number'] + 1
    assert result['log']['differences'] == len(one) + len(other)


def altered_number(message):
    """Return a snapshot whose number is another one."""
    topic, content, stamp = message
    held = json.loads(samples.STORE.deserialize_cdr(content, samples.STRING).data)
    held['number'] += 7
    text = samples.make(samples.STRING, json.dumps(held))
    return topic, samples.serialise(samples.STRING, text), stamp


def test_paused_runs_are_not_cut(tmp_path):
    rig = RecordedRig(BENCH).start().run(500)
    rig.serve(('resume', 10**9))
    rig.run(500)
    rig.serve(('change', {'gap': 0.02}))
    rig.serve(('change', {'friction': 0.0}))
    rig.serve(('resume', 7 * 10**9))
    code, result = run(rig.run(500).save(tmp_path / 'bag'), tmp_path)
    assert (code, len(result['stretches'])) == (0, 2)
    assert 'paused 2 times' in result['remarks'][0]
    assert result['stretches'][1]['cause'] == (
        'gap = 0.02 m (was 0.024 m), friction = 0 (was 0.02)'
    )
    assert (result['end'], result['samples']) == (7.5, 1501)


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize(('count', 'value'), [(1, None), (3, None), (40, 1e12), (600, 1e300)])
def test_a_report_of_short_and_of_wrong_recordings(tmp_path, count, value):
    """A few messages, one of which may have a number that X cannot have."""
    pytest.importorskip('matplotlib')
    rig = RecordedRig(BENCH).start().run(600)
    few = [m for m in rig.messages if m[0] in ('/joint_states', '/impacts')][:count]
    middle = len(few) // 2
    if value is not None:
        few[middle] = numbered(few[middle], lambda _: value)
    start = [m for m in rig.messages if m[0] == '/snapshot'][-1:]
    bag = samples.record(tmp_path / 'bag', [*start, *few])
    report = tmp_path / 'report'
    code, result = run(bag, tmp_path, '--report', str(report))
    assert code in (0, 1, 3)
    assert 0 <= result['samples'] + result['impacts'] <= len(few)
    assert (report / 'report.html').exists()


NOISE = {'multisine_level': 0.5, 'multisine_low': 20.0, 'multisine_high': 40.0}
TWO = {'force_amplitudes': (0.5, 0.4), 'force_frequencies': (30.0, 33.0), 'force_phases': (0, 0)}


def test_a_change_to_the_same_value_under_a_multisine(tmp_path):
    """No snapshot follows it, and there are more harmonics than entries of the force arrays."""
    rig = RecordedRig(BENCH).start().run(100, ('change', {**TWO, **NOISE}))
    rig.run(100, ('change', {'gap': BENCH.gap}))
    code, result = run(rig.save(tmp_path / 'bag'), tmp_path)
    assert (code, len(result['stretches'])) == (0, 2)
    assert result['log']['differences'] == 0


def test_joint_states_that_are_far_apart(tmp_path):
    """The numbers are those of the replayed motion, however few samples there are."""
    found = {}
    for rate in (1.0, 20.0, 400.0):
        bag = RecordedRig(BENCH, rate=rate).start().run(int(3 * rate)).save(tmp_path / str(rate))
        (found[rate],) = run(bag, tmp_path)[1]['stretches']
    for rate in (1.0, 20.0):
        for part, key in (('overall', 'x_max'), ('overall', 'x_rms'), ('measured', 'x_max')):
            assert found[rate][part][key] == pytest.approx(found[400.0][part][key], rel=1e-9)


FREE = BENCH.replace(friction=0.0, damping=3.0, gap=1.0)


@pytest.mark.parametrize(
    ('rig', 'velocity'),
    [
        (FREE, 0.002),
        (FREE.replace(gap=0.4), -0.0035),
        (FREE.replace(gap=9.0, angle=2e-5), -0.003),
        (FREE.replace(gap=8.0, angle=-4e-5, one_sided=True), 0.04),
        (FREE.replace(gap=4.0, one_sided=True, air_force=0.1), 0.6),
    ],
)
def test_a_loose_mass_that_drifts_has_not_settled(tmp_path, rig, velocity):
    """Without friction only an impact ends a drift, and the exact rig has it where it is said."""
    initial = InitialConditions(initial_damper_velocity=velocity)
    bag = RecordedRig(rig, initial, rate=25.0).start().run(750).save(tmp_path / 'bag')
    code, result = run(bag, tmp_path)
    assert code == 0
    (stretch,) = result['stretches']
    cycle = math.tau / rig.force_frequencies[0]
    exact = Rig(rig, initial)
    hits = [e for e in exact.advance(400.0) if e.kind is EventKind.IMPACT and e.time > 30.0]
    said = re.search(r'hits stop (\d) after about (\S+) more cycles', stretch['sentence'])
    assert stretch['kind'] == 'without impacts'
    assert stretch['verdict'] == ('not settled yet' if hits else 'agrees')
    assert bool(said) == bool(hits)
    if hits:
        assert int(said[1]) == hits[0].stop
        assert float(said[2]) == pytest.approx((hits[0].time - 30.0) / cycle, rel=5e-3, abs=1.5)


def test_a_loose_mass_that_creeps_between_samples(tmp_path):
    """Each sample is taken where friction holds m, which slides once in each cycle."""
    rig = RigParameters(gap=1000.0, friction=1.85, gravity=1.0, angle=0.785, damping=1.5)
    bag = RecordedRig(rig, rate=1.0 / math.tau).start().run(60).save(tmp_path / 'bag')
    _, result = run(bag, tmp_path)
    (stretch,) = result['stretches']
    assert (stretch['kind'], stretch['verdict']) == ('without impacts', 'no prediction')
    assert stretch['sentence'].startswith('m slides')
    bag = RecordedRig(rig.replace(friction=2.0), rate=1.0 / math.tau).start().run(60)
    _, result = run(bag.save(tmp_path / 'held'), tmp_path)
    assert verdicts(result) == ['agrees']


def text_of_six_seconds(tmp_path, capsys, *settings):
    """Return what is printed of a run of the bench rig without friction."""
    words = [word for setting in ('friction=0', *settings) for word in ('--set', setting)]
    words += ['--duration', '6', '--quiet', '--bag', str(tmp_path / 'bag')]
    assert simulate_rig(['bench_rig', *words]) == 0
    main([str(tmp_path / 'bag')])
    return capsys.readouterr().out


def test_a_mass_at_rest_in_space_does_not_drift(tmp_path, capsys):
    """Without friction m stays at Z = 0 while X swings in: its place in M is another matter."""
    text = text_of_six_seconds(tmp_path, capsys, 'gap=200 mm')
    assert 'M vibrates without m' in text
    assert 'does not keep its place' not in text


@pytest.mark.parametrize('offset', ['0', '5m'])
def test_free_vibration_left_where_m_hits_a_stop_later(offset, tmp_path, capsys):
    """It is that of M at the end, e^(-zeta omega t) of the whole, wherever m is on its way."""
    start = 'initial_damper_velocity=0.5', f'initial_damper_offset={offset}'
    text = text_of_six_seconds(tmp_path, capsys, 'gap=20', *start)
    found = re.search(r'vibration left is (\S+) of it; .* hits stop 1', text)
    assert float(found[1]) == pytest.approx(math.exp(-0.01 * 31.416 * 6.0), rel=0.03)
