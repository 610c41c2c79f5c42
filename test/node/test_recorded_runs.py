"""Recordings of a running node, read with rosbags, which shares nothing with this package."""

import json
import resource
from contextlib import suppress
from itertools import pairwise

from diagnostic_msgs.msg import DiagnosticStatus
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros import RigParameters
from impact_damper_ros.bag import RecordingError, RunReader, recover_run
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.rig_client import LATCHED, LIVELY, stamp_ns


class Bag:
    """All messages of a bag, by topic."""

    def __init__(self, directory):
        self.topics = {}
        self.order = []
        with AnyReader([directory], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            for connection, log_time, raw in reader.messages():
                message = reader.deserialize(raw, connection.msgtype)
                self.topics.setdefault(connection.topic, []).append((log_time, message, raw))
                self.order.append((connection.topic, log_time))

    def messages(self, topic):
        return [message for _, message, _ in self.topics.get(topic, [])]


def stamp_of(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


FIELDS = {1: 'bool', 2: 'integer', 3: 'double', 4: 'string', 8: 'double_array'}


def values_of(parameters):
    """Return the values of parameters by name."""
    found = {p.name: getattr(p.value, f'{FIELDS[p.value.type]}_value') for p in parameters}
    return {n: tuple(v) if hasattr(v, 'tolist') else v for n, v in found.items()}


def replayed(place):
    """Replay a recording, bit for bit; return the findings."""
    findings = Replay(RecordedRun(place)).run()
    assert findings.verdict is ReplayVerdict.IDENTICAL, findings
    return findings


def compare_heard(bag, topic, messages, least):
    def numbers(message):
        return [list(part) for part in (message.position, message.velocity, message.effort)]

    # Impacts of a chatter may have the same stamp.
    logged = {}
    for message in bag.messages(f'/{topic}'):
        logged.setdefault(stamp_of(message.header.stamp), []).append(numbers(message))
    until(lambda: stamp_ns(messages[-1].header.stamp) >= max(logged), 'they stay out')
    heard = [m for m in list(messages) if stamp_ns(m.header.stamp) in logged]
    assert len(heard) > least
    for message in heard:
        assert numbers(message) in logged[stamp_ns(message.header.stamp)]


BAND = {'low': 20.0, 'high': 60.0, 'lines': 6.0, 'level': 1}
STEPS = {'mode': 'up_down', 'low': 28.1, 'high': 34, 'step': 0.5, 'dwell': 0.02}
CHANGES = (
    {'gap': 0.012},
    {'restitution_1': 0.6, 'restitution_2': 0.8},
    {'force_amplitudes': [10.0, 1.0]},
    {'force_frequencies': [31.0, 50.0]},
    {f'multisine_{name}': value for name, value in BAND.items()},
    {f'sweep_{name}': value for name, value in STEPS.items()},
    {'gap': 0.004, 'multisine_seed': 5},
    {'angle': 0.3},
)


def test_a_run_is_reproduced_from_its_bag(rig, tmp_path):
    rig.change(gap=0.008, bag_directory=str(tmp_path / 'runs'))
    rig.await_states(5)
    assert rig.parameters.set(record=True) == ''
    assert rig.parameters.set(record=True) == ''
    states, impacts = rig.states, rig.impacts
    first = len(impacts)
    for change in CHANGES:
        rig.change(**change)
        rig.await_states(20)
    rig.until(lambda: len(impacts) > first + 10)
    report = rig.await_report('recording', holds=lambda r: int(r.values['Messages']) > 0)
    assert report.message == 'recording'
    assert report.values['File'].endswith('_0.mcap')
    # A change with the end of the recording is in it.
    rig.change(gap=0.021, real_time_factor=1.5, record=False)
    # By the time of the answer the bag is whole.
    (directory,) = (tmp_path / 'runs').iterdir()
    assert RunReader(directory).complete
    bag = Bag(directory)
    assert [topic for topic, _ in bag.order[:2]] == ['/snapshot', '/parameter_events']
    assert [t for _, t in bag.order] == sorted(t for _, t in bag.order)
    events = bag.messages('/parameter_events')
    assert events[0].node == '/sim_node'
    values = values_of(events[0].new_parameters)
    assert values.keys() == set(rig.parameters.names())
    assert (values['gap'], values['record']) == (0.008, True)
    last = values_of(events[-1].changed_parameters)
    assert last == {'gap': 0.021, 'real_time_factor': 1.5, 'record': False}
    assert bag.messages('/diagnostics')
    findings = replayed(directory)
    assert (findings.impacts >= 10, findings.changes) == (True, len(CHANGES) + 1)
    held = json.loads(bag.messages('/snapshot')[-1].data)['state']['parameters']
    assert (held['gap'], held['force_amplitudes']) == (0.021, [10.0, 1.0])
    assert (held['multisine_lines'], held['sweep_mode']) == (6, 'up_down')
    # What was published is what was logged.
    compare_heard(bag, 'joint_states', states, 50)
    compare_heard(bag, 'impacts', impacts, 10)


def test_names_descriptions_and_what_a_killed_node_leaves(start):
    """Of a node of another name, with a remapped topic, that records from the start."""
    rig = start('joint_states:=js', node='damper', record=True, **LIVELY)
    states = rig.listen(JointState, 'js')
    rig.until(lambda: len(states) > 10)
    topic = {name: f'{rig.space}/{name}' for name in ('js', 'snapshot', 'robot_description')}
    assert rig.parameters.set(gap=0.3) == ''
    # A wider gap needs a longer deck; other changes are not seen.
    for changes in ({'restitution_1': 0.5}, {'gap_control': 'timed'}):
        rig.change(**changes)
    forces = {'force_amplitudes': [10.0], 'force_frequencies': [31.6]}
    narrow = RigParameters(**{**LIVELY, **forces})
    wide = robot_description(narrow.replace(gap=0.3))
    controlled = robot_description(narrow.replace(gap=0.3), gap_max=1000.0)
    seen = rig.listen(String, 'robot_description', LATCHED)
    rig.until(lambda: seen)
    assert seen[0].data == controlled
    assert rig.call('reset')[0]
    rig.await_report('rig')
    # A second recording begins with what is to be seen then.
    rig.change(record=False)
    rig.change(record=True, gap_control='off')
    count = len(states)
    rig.until(lambda: len(states) > count + 250)
    first, second = rig.bags()
    heard_ns = stamp_ns(states[-1].header.stamp)

    def written_ns():
        records = RunReader(second).messages([topic['js']])
        return max((record.stamp_ns for record in records), default=0)

    def is_written():
        # The file may grow while it is read.
        with suppress(RecordingError):
            return written_ns() >= heard_ns

    # Half a second later, but for what the machine takes to get to it, it is in the file.
    rig.until(is_written)
    rig.process.kill()
    last_ns = written_ns()
    assert not RunReader(second).complete
    recover_run(second)
    (recovered,) = (bag for bag in rig.bags() if bag not in (first, second))
    of_first, of_second = Bag(first), Bag(recovered)
    assert stamp_of(of_second.messages(topic['js'])[-1].header.stamp) == last_ns
    for bag, described, place in (
        (of_first, [robot_description(narrow), wide, controlled], first),
        (of_second, [wide], second),
    ):
        found = [message.data for message in bag.messages(topic['robot_description'])]
        assert found == described
        assert (place / 'rig.urdf').read_text(encoding='utf-8') == described[0]
        assert bag.order == sorted(bag.order, key=lambda entry: entry[1])
        assert {*topic.values(), '/parameter_events'} <= bag.topics.keys()
        assert bag.messages('/parameter_events')[0].node == rig.name
    reader = RunReader(first)
    assert (reader.complete, list(reader.faults())) == (True, [])
    for key, name in (('joint_states', 'js'), ('robot_description', 'robot_description')):
        assert reader.custom[key] == topic[name]
    # Recorded from the very start, as one run over the reset.
    snapshots = [json.loads(m.data) for m in of_first.messages(topic['snapshot'])]
    assert [deed[0] for s in snapshots for deed in s['done']].count('reset') == 1
    assert len({snapshot['run'] for snapshot in snapshots}) == 1
    assert snapshots[0]['time_ns'] == 0
    begin = stamp_of(of_first.messages(topic['js'])[0].header.stamp)
    assert begin == snapshots[0]['stamp_offset_ns']


def test_a_long_run_goes_to_several_files(rig, tmp_path):
    runs = tmp_path / 'runs'

    def files():
        # One is named when it is made, and has its head a little later.
        found = sorted(runs.glob('run_*/*.mcap'), key=lambda path: path.stat().st_mtime_ns)
        return [path for path in found if path.stat().st_size]

    rig.change(bag_directory=str(runs), max_bag_duration=1.0)
    rig.change(record=True)
    rig.until(lambda: len(files()) > 1)
    rig.change(gap=0.012)
    reason = rig.parameters.set(max_bag_duration=0.1)
    assert 'give 0 (no limit) or a number from 1 to' in reason
    assert rig.parameters.get('max_bag_duration', 'max_bag_size') == [1.0, 0]
    # For the next recording
    rig.change(max_bag_duration=0.0)
    made = len(files())
    rig.until(lambda: len(files()) > made + 1)
    rig.change(record=False)
    (directory,) = runs.iterdir()
    assert RunReader(directory).complete
    paths = [directory / f'{directory.name}_{n}.mcap' for n in range(len(files()))]
    assert set(paths) == set(files())
    borders = []
    for path in paths:
        bag = Bag(path)
        assert [topic for topic, _ in bag.order[:2]] == ['/snapshot', '/parameter_events']
        borders.append((bag.order[0][1], bag.order[-1][1]))
        values = values_of(bag.messages('/parameter_events')[0].new_parameters)
        assert values.keys() == set(rig.parameters.names())
        assert values['record'] is True
        assert replayed(path).faults == []
    assert values['gap'] == 0.012
    for (begin_ns, end_ns), (next_ns, _) in pairwise(borders):
        # A file begins at the tick with which the one before ends; later only after a slip.
        assert end_ns == next_ns >= begin_ns + 10**9
    rig.change(record=True)
    rig.change(record=False)
    (other,) = (run for run in runs.iterdir() if run != directory)
    values = values_of(Bag(other).messages('/parameter_events')[0].new_parameters)
    assert values['max_bag_duration'] == 0.0


def test_a_directory_that_cannot_be_written_rejects_the_recording(rig, tmp_path):
    blocker = tmp_path / 'file'
    blocker.write_text('in the way')
    rig.change(bag_directory=str(blocker / 'runs'))
    # Nor does it take effect as one of several.
    for more in ({}, {'gap': 0.02}):
        reason = rig.parameters.set_atomically(record=True, **more)
        assert 'cannot record to' in reason
        assert str(blocker) in reason
        assert rig.parameters.get('record', 'gap') == [False, 0.01]
        rig.await_states(5)


def test_a_full_disk_ends_the_recording_but_not_the_rig(start):
    # Stamps count from 0, so that a stall of the machine does not move them.
    rig = start(publish_clock=True, **LIVELY)
    rig.await_states()

    def limit_files(size=resource.RLIM_INFINITY):
        """Let no file grow beyond this: what the kernel says then stands for a full disk."""
        limits = (size, resource.RLIM_INFINITY)
        resource.prlimit(rig.process.pid, resource.RLIMIT_FSIZE, limits)

    limit_files(16384)
    rig.change(record=True)
    rig.until(lambda: rig.parameters.get('record') is False)
    assert 'the rig runs on' in rig.process.output
    rig.await_report('recording', holds=lambda report: report.level == DiagnosticStatus.ERROR)
    rig.await_states(20)
    stamps = [stamp_ns(m.header.stamp) for m in list(rig.states)]
    assert all((stamp - stamps[0]) % 5_000_000 == 0 for stamp in stamps)
    # With room again, recording is possible again.
    limit_files()
    rig.change(record=True)
    rig.await_states(20)
    rig.change(record=False)
    assert [RunReader(run).complete for run in rig.bags()].count(True) == 1
    # If the summary of the bag does not fit any more, that is an error, too.
    rig.change(record=True)
    limit_files(8192)
    early = rig.process.output.count('ended early')
    rig.change(record=False)
    rig.until(lambda: rig.process.output.count('ended early') > early)
    line = [line for line in rig.process.output.splitlines() if 'ended early' in line][-1]
    assert '[ERROR]' in line
    assert 'largest size allowed' in line
    assert rig.parameters.get('record') is False
    rig.stop()
