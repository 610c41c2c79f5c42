"""Recordings of a running node, read with rosbags, which shares nothing with this package."""

import json
import resource
import shutil
from itertools import pairwise

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore
from running import until
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from std_srvs.srv import SetBool, Trigger

from impact_damper_ros import RigParameters
from impact_damper_ros.bag import RunReader, recover_run
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.replay.findings import ReplayVerdict
from impact_damper_ros.replay.replay import Replay
from impact_damper_ros.replay.run import RecordedRun
from node.rig_client import LATCHED, LIVELY, RigParametersClient, stamp_ns


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


def value_of(parameter):
    value = parameter.value
    field = {
        1: 'bool_value',
        2: 'integer_value',
        3: 'double_value',
        4: 'string_value',
        8: 'double_array_value',
    }[value.type]
    found = getattr(value, field)
    return tuple(found) if value.type == 8 else found


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


def test_a_run_is_reproduced_from_its_bag(rig, tmp_path):
    assert rig.parameters.set_atomically(gap=0.008, bag_directory=str(tmp_path / 'runs')) == ''
    rig.await_states(5)
    reports = rig.client.listen(DiagnosticArray, '/diagnostics')
    assert rig.parameters.set(record=True) == ''
    assert rig.parameters.set(record=True) == ''
    impacts = len(rig.impacts)
    for change in (
        {'gap': 0.012},
        {'restitution_1': 0.6, 'restitution_2': 0.8},
        {'force_amplitudes': [10.0, 1.0]},
        {'force_frequencies': [31.0, 50.0]},
        {
            'multisine_level': 1,
            'multisine_low': 20.0,
            'multisine_high': 60.0,
            'multisine_lines': 6.0,
        },
        {
            'sweep_mode': 'up_down',
            'sweep_low': 28.1,
            'sweep_high': 34,
            'sweep_step': 0.5,
            'sweep_dwell': 0.02,
        },
        {'gap': 0.004, 'multisine_seed': 5},
        {'angle': 0.3},
    ):
        assert rig.parameters.set_atomically(**change) == ''
        rig.await_states(20)
    until(lambda: len(rig.impacts) > impacts + 10)

    def recording_report():
        for report in list(reports):
            for status in report.status:
                values = {v.key: v.value for v in status.values}
                if status.name == 'sim_node: recording' and int(values['Messages']) > 0:
                    assert status.message == 'recording'
                    return values
        return None

    report = until(recording_report)
    assert report['File'].endswith('_0.mcap')
    assert rig.parameters.set(record=False) == ''
    # By the time of the answer the bag is whole.
    (directory,) = (tmp_path / 'runs').iterdir()
    assert RunReader(directory).complete
    bag = Bag(directory)
    assert [topic for topic, _ in bag.order[:2]] == ['/snapshot', '/parameter_events']
    assert [t for _, t in bag.order] == sorted(t for _, t in bag.order)
    dump = bag.messages('/parameter_events')[0]
    assert dump.node == '/sim_node'
    values = {p.name: value_of(p) for p in dump.new_parameters}
    assert set(values) == set(rig.parameters.names())
    assert (values['gap'], values['record']) == (0.008, True)
    last = bag.messages('/parameter_events')[-1]
    assert [(p.name, value_of(p)) for p in last.changed_parameters] == [('record', False)]
    assert bag.messages('/diagnostics')
    assert replayed(directory).impacts >= 10
    last = json.loads(bag.messages('/snapshot')[-1].data)['state']['parameters']
    assert (last['gap'], last['force_amplitudes']) == (0.004, [10.0, 1.0])
    assert (last['multisine_lines'], last['sweep_mode']) == (6, 'up_down')
    # What was published is what was logged.
    compare_heard(bag, 'joint_states', rig.states, 50)
    compare_heard(bag, 'impacts', rig.impacts, 10)


def test_a_change_and_the_end_of_a_recording_in_one_request(rig, tmp_path):
    assert rig.parameters.set(bag_directory=str(tmp_path)) == ''
    for last in ({'gap': 0.021}, {'gap': 0.012, 'real_time_factor': 1.5}, {'real_time_factor': 1}):
        assert rig.parameters.set(record=True) == ''
        rig.await_states(20)
        assert rig.parameters.set_atomically(**last, record=False) == ''
        (bag,) = tmp_path.iterdir()
        findings = replayed(bag)
        assert findings.changes == ('gap' in last)
        shutil.rmtree(bag)


def test_names_are_those_of_the_namespace_and_remapped_also_in_a_bag(
    client, launch, namespace, tmp_path
):
    states = client.listen(JointState, f'{namespace}/js')
    reports = client.listen(DiagnosticArray, '/diagnostics')
    remaps = (f'__ns:={namespace}', '__node:=damper', 'joint_states:=js')
    process = launch(*remaps, record=True, **LIVELY)
    until(lambda: len(states) > 10, lambda: process.output)
    parameters = RigParametersClient(client, f'{namespace}/damper')
    assert parameters.set(gap=2) == ''
    assert parameters.get('gap') == 2.0
    assert client.call(Trigger, f'{namespace}/damper/reset').success
    assert client.call(SetBool, f'{namespace}/damper/pause').success
    name = f'{namespace[1:]}/damper: rig'
    until(lambda: any(status.name == name for r in list(reports) for status in r.status))
    assert process.stop() == 0
    (directory,) = (tmp_path / 'process_0' / 'runs').iterdir()
    bag = Bag(directory)
    assert {f'{namespace}/js', f'{namespace}/snapshot', '/parameter_events'} <= set(bag.topics)
    assert bag.messages('/parameter_events')[0].node == f'{namespace}/damper'
    assert RunReader(directory).custom['joint_states'] == f'{namespace}/js'
    # Recorded from the very start, as one run over the reset.
    snapshots = [json.loads(m.data) for m in bag.messages(f'{namespace}/snapshot')]
    assert [deed[0] for s in snapshots for deed in s['done']].count('reset') == 1
    assert len({snapshot['run'] for snapshot in snapshots}) == 1
    first = snapshots[0]
    assert first['time_ns'] == 0
    assert stamp_of(bag.messages(f'{namespace}/js')[0].header.stamp) == first['stamp_offset_ns']


def test_the_robot_description_is_on_the_network_and_in_the_bag(
    client, launch, namespace, tmp_path
):
    rig = RigParameters(**{**LIVELY, 'force_amplitudes': [10.0], 'force_frequencies': [31.6]})
    topic = f'{namespace}/robot_description'
    process = launch(f'__ns:={namespace}', record=True, **LIVELY)
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    # A wider gap needs a longer deck; other changes are not seen.
    for changes in ({'gap': 0.3}, {'restitution_1': 0.5}, {'gap_control': 'timed'}):
        assert parameters.set_atomically(**changes) == ''
    wide = robot_description(rig.replace(gap=0.3))
    controlled = robot_description(rig.replace(gap=0.3), gap_max=1000.0)
    heard = client.listen(String, topic, LATCHED)
    until(lambda: heard, lambda: process.output)
    assert heard[0].data == controlled
    # A second recording begins with what is to be seen then.
    assert parameters.set(record=False) == ''
    assert parameters.set_atomically(record=True, gap_control='off') == ''
    assert process.stop() == 0
    first, second = sorted((tmp_path / 'process_0' / 'runs').iterdir())
    for directory, seen in ((first, [robot_description(rig), wide, controlled]), (second, [wide])):
        bag = Bag(directory)
        assert [message.data for message in bag.messages(topic)] == seen
        assert (directory / 'rig.urdf').read_text(encoding='utf-8') == seen[0]
        assert bag.order == sorted(bag.order, key=lambda entry: entry[1])
        reader = RunReader(directory)
        assert (reader.complete, list(reader.faults())) == (True, [])
        assert reader.custom['robot_description'] == topic
        # It is offered as it was, and no tool takes it for a snapshot: the recording is replayed.


def test_a_killed_run_is_recovered(client, launch, namespace, tmp_path):
    topic = f'{namespace}/joint_states'
    states = client.listen(JointState, topic)
    process = launch(f'__ns:={namespace}', record=True, **LIVELY)
    until(lambda: len(states) > 250, lambda: process.output)
    (directory,) = (tmp_path / 'process_0' / 'runs').iterdir()
    heard_ns = stamp_ns(states[-1].header.stamp)

    def written_ns():
        return max((r.stamp_ns for r in RunReader(directory).records([topic])), default=0)

    # Half a second later, but for what the machine takes to get to it, it is in the file.
    until(lambda: written_ns() >= heard_ns, 'the recording lags behind')
    process.kill()
    last_ns = written_ns()
    assert not RunReader(directory).complete
    recover_run(directory)
    recovered = [d for d in (tmp_path / 'process_0' / 'runs').iterdir() if RunReader(d).complete]
    bag = Bag(recovered[0])
    assert stamp_of(bag.messages(topic)[-1].header.stamp) == last_ns


def test_a_long_run_goes_to_several_files(client, launch, namespace, tmp_path):
    runs = tmp_path / 'process_0' / 'runs'
    process = launch(f'__ns:={namespace}', record=True, max_bag_duration=1, **LIVELY)
    parameters = RigParametersClient(client, f'{namespace}/sim_node')

    def files():
        # One is named when it is made, and has its head a little later.
        found = sorted(runs.glob('run_*/*.mcap'), key=lambda path: path.stat().st_mtime_ns)
        return [path for path in found if path.stat().st_size]

    until(lambda: len(files()) > 1, lambda: process.output)
    assert parameters.set(gap=0.012) == ''
    assert 'give 0 (no limit) or a number from 1 to' in parameters.set(max_bag_duration=0.1)
    assert parameters.get('max_bag_duration', 'max_bag_size') == [1.0, 0]
    # For the next recording
    assert parameters.set(max_bag_duration=0.0) == ''
    made = len(files())
    until(lambda: len(files()) > made + 1, lambda: process.output)
    assert parameters.set(record=False) == ''
    (directory,) = runs.iterdir()
    assert RunReader(directory).complete
    paths = [directory / f'{directory.name}_{n}.mcap' for n in range(len(files()))]
    assert set(paths) == set(files())
    borders = []
    for path in paths:
        bag = Bag(path)
        first, second = bag.order[:2]
        assert (first[0], second[0]) == (f'{namespace}/snapshot', '/parameter_events')
        borders.append((first[1], bag.order[-1][1]))
        values = {p.name: value_of(p) for p in bag.messages('/parameter_events')[0].new_parameters}
        assert set(values) == set(parameters.names())
        assert values['record'] is True
        gap = values['gap']
    assert gap == 0.012
    for (begin_ns, end_ns), (next_ns, _) in pairwise(borders):
        # A file begins at the tick with which the one before ends; later only after a slip.
        assert end_ns == next_ns >= begin_ns + 10**9
    for path in (directory, *paths):
        assert replayed(path).faults == []
    assert parameters.set(record=True) == ''
    assert process.stop() == 0
    (other,) = (run for run in runs.iterdir() if run != directory)
    values = Bag(other).messages('/parameter_events')[0].new_parameters
    assert {p.name: value_of(p) for p in values}['max_bag_duration'] == 0.0


def test_a_directory_that_cannot_be_written_rejects_the_recording(rig, tmp_path):
    blocker = tmp_path / 'file'
    blocker.write_text('in the way')
    assert rig.parameters.set(bag_directory=str(blocker / 'runs')) == ''
    reason = rig.parameters.set(record=True)
    assert 'cannot record to' in reason
    assert str(blocker) in reason
    assert rig.parameters.get('record') is False
    rig.await_states(5)
    # Nor does it take effect as one of several.
    reason = rig.parameters.set_atomically(gap=0.02, record=True)
    assert 'cannot record to' in reason
    assert rig.parameters.get('gap') == 0.01


def test_a_full_disk_ends_the_recording_but_not_the_rig(client, launch, namespace, tmp_path):
    states = client.listen(JointState, f'{namespace}/joint_states')
    reports = client.listen(DiagnosticArray, '/diagnostics')
    # Stamps count from 0, so that a stall of the machine does not move them.
    process = launch(f'__ns:={namespace}', publish_clock=True, **LIVELY)
    until(lambda: states, lambda: process.output)
    # No file may grow beyond this: what the kernel says then stands for a full disk.
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (16384, resource.RLIM_INFINITY))
    parameters = RigParametersClient(client, f'{namespace}/sim_node')
    assert parameters.set(record=True) == ''
    until(lambda: parameters.get('record') is False, lambda: process.output)
    assert 'the rig runs on' in process.output

    def failed():
        return any(
            s.name == f'{namespace[1:]}/sim_node: recording' and s.level == DiagnosticStatus.ERROR
            for report in list(reports)
            for s in report.status
        )

    until(failed)
    count = len(states)
    until(lambda: len(states) > count + 20)
    start_ns = stamp_ns(states[0].header.stamp)
    assert all((stamp_ns(m.header.stamp) - start_ns) % 5_000_000 == 0 for m in list(states))
    # With room again, recording is possible again.
    unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, unlimited)
    assert parameters.set(record=True) == ''
    count = len(states)
    until(lambda: len(states) > count + 20)
    assert parameters.set(record=False) == ''
    runs = sorted((tmp_path / 'process_0' / 'runs').iterdir())
    assert [RunReader(run).complete for run in runs].count(True) == 1
    # If the summary of the bag does not fit any more, that is an error, too.
    assert parameters.set(record=True) == ''
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (8192, resource.RLIM_INFINITY))
    early = process.output.count('ended early')
    assert parameters.set(record=False) == ''
    until(lambda: process.output.count('ended early') > early)
    line = [line for line in process.output.splitlines() if 'ended early' in line][-1]
    assert '[ERROR]' in line
    assert 'largest size allowed' in line
    assert parameters.get('record') is False
    assert process.stop() == 0


def test_two_nodes_record_side_by_side(client, launch, tmp_path):
    spaces = ('/left', '/right')
    runs = tmp_path / 'runs'
    heard = {s: client.listen(JointState, f'{s}/joint_states') for s in spaces}
    started = {
        s: launch(f'__ns:={s}', record=True, bag_directory=str(runs), **LIVELY) for s in spaces
    }
    until(
        lambda: all(len(messages) > 20 for messages in heard.values()),
        lambda: '\n'.join(process.output for process in started.values()),
    )
    assert [process.stop() for process in started.values()] == [0, 0]
    bags = [Bag(directory) for directory in runs.iterdir()]
    assert len(bags) == 2
    assert {bag.messages('/parameter_events')[0].node for bag in bags} == {
        f'{s}/sim_node' for s in spaces
    }
