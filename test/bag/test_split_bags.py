"""Bags of several files: each is whole of its own, and all together are the run."""

import json
import os
import random
import re
import resource
import shutil
import time
from pathlib import Path

import pytest
import yaml
from bag import samples
from bag.alterations import cut, rewritten
from bag.recorded_rig import NOTES, RecordedRig, random_requests
from mcap.reader import make_reader
from replay.test_replay import replayed
from rosbags.rosbag2 import Reader

from impact_damper_ros.bag import RunReader, RunWriter, Topic
from impact_damper_ros.cli.compare_run import main as compare_run
from impact_damper_ros.cli.recover_run import main as recover_run
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.replay.findings import ReplayVerdict

CHANGES = ('--change', '2.4:gap=0.012', '--change', '2.4:angle=0.2', '--change', '5:gap=0.009')
HEAD = ('/snapshot', '/parameter_events', '/robot_description')
NOTE = Topic('/note', samples.STRING)


def simulated(directory, *arguments, duration='7'):
    """Let the command record the bench rig."""
    options = ['--duration', duration, '--bag', str(directory), '--quiet']
    assert simulate_rig(['bench_rig', *options, *arguments]) == 0
    return directory


@pytest.fixture(scope='module')
def one(tmp_path_factory):
    """Return a run in one file."""
    return simulated(tmp_path_factory.mktemp('bags') / 'run', *CHANGES)


@pytest.fixture(scope='module')
def split(tmp_path_factory):
    """Return the same run in four files."""
    directory = tmp_path_factory.mktemp('bags') / 'run'
    return simulated(directory, *CHANGES, '--max-bag-duration', '2')


@pytest.fixture
def copy(split, tmp_path):
    return Path(shutil.copytree(split, tmp_path / 'run'))


def files_of(bag):
    return sorted(bag.glob('*.mcap'), key=lambda path: int(path.stem.rpartition('_')[2]))


def contents(path):
    """Return topic, sequence number, stamp and content of the messages of a file, as written."""
    with path.open('rb') as stream:
        return [
            (channel.topic, message.sequence, message.log_time, message.data)
            for _, channel, message in make_reader(stream).iter_messages(log_time_order=False)
        ]


def faults(bag):
    findings = replayed(bag)
    assert findings.verdict is not ReplayVerdict.IDENTICAL
    return findings.faults


def plain(message):
    """Return topic, stamp and content; of a snapshot without number and run."""
    topic, _, stamp, content = message
    return topic, stamp, re.sub(rb'"run": "\w+", "number": \d+', b'', content[8:])


def test_the_files_together_are_the_run(one, split):
    names = [path.name for path in files_of(split)]
    assert names == ['run_0.mcap', 'run_1.mcap', 'run_2.mcap', 'run_3.mcap']
    together, before = [], [()]
    for number, path in enumerate(files_of(split)):
        held = contents(path)
        assert tuple(topic for topic, *_ in held[:3]) == HEAD
        # A file begins at the tick with which the one before ends.
        assert {stamp for _, _, stamp, _ in held[:3]} == {number * 2 * 10**9}
        together += held[3:] if number else held
        if number > 0:
            assert before[-1][::2] == ('/joint_states', held[0][2])
        before = held
    (path,) = files_of(one)
    pairs = zip(map(plain, together), map(plain, contents(path)), strict=True)
    assert all(a == b for a, b in pairs)
    assert {path.name for path in split.iterdir()} == {*names, 'metadata.yaml', 'rig.urdf'}


def test_independent_readers_take_each_file_and_the_bag(split):
    listing = yaml.safe_load((split / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    numbers = {name: 0 for name, _ in RunReader(split).topics}
    for path, listed in zip(files_of(split), listing['files'], strict=True):
        held = contents(path)
        with path.open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True)
            statistics = reader.get_summary().statistics
            records = [record.metadata for record in reader.iter_metadata()]
        stamps = [stamp for _, _, stamp, _ in held]
        counted = statistics.message_start_time, statistics.message_end_time
        assert (*counted, statistics.message_count) == (min(stamps), max(stamps), len(held))
        assert listed == {
            'path': path.name,
            'starting_time': {'nanoseconds_since_epoch': min(stamps)},
            'duration': {'nanoseconds': max(stamps) - min(stamps)},
            'message_count': len(held),
        }
        # What the file notes of itself is what it holds, at its end; at its head, nothing yet.
        empty, noted = (yaml.safe_load(r['serialized_metadata']) for r in records)
        assert (empty['message_count'], empty['relative_file_paths']) == (0, [path.name])
        assert (noted['message_count'], noted['files']) == (len(held), [listed])
        for topic, number, *_ in held:
            assert number == numbers[topic]
            numbers[topic] += 1
    assert sum(numbers.values()) == listing['message_count']
    assert listing['duration'] == {'nanoseconds': 7 * 10**9}
    assert {
        item['topic_metadata']['name']: item['message_count']
        for item in listing['topics_with_message_count']
    } == numbers
    with Reader(split) as reader:
        assert [stamp for _, stamp, _ in reader.messages()] == sorted(
            stamp for path in files_of(split) for _, _, stamp, _ in contents(path)
        )


def test_each_file_and_the_whole_replay_bit_for_bit(one, split):
    whole = replayed(split)
    expected = replayed(one)
    assert (whole.verdict, whole.faults) == (ReplayVerdict.IDENTICAL, [])
    assert (whole.samples, whole.impacts) == (expected.samples, expected.impacts)
    assert whole.samples == 1401
    assert (whole.changes, whole.snapshots) == (expected.changes, expected.snapshots + 3)
    parts = [replayed(path) for path in files_of(split)]
    assert [(part.verdict, part.faults) for part in parts] == [(ReplayVerdict.IDENTICAL, [])] * 4
    assert [part.samples for part in parts] == [401, 400, 400, 200]
    assert sum(part.impacts for part in parts) == whole.impacts


def close_to(value):
    """Return what equals a value of JSON but for round-off."""
    if isinstance(value, dict):
        return {name: close_to(part) for name, part in value.items()}
    if isinstance(value, list):
        return [close_to(part) for part in value]
    return pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value


def test_comparisons_and_what_ifs_are_those_of_one_file(one, split, tmp_path, capsys):
    found, supposed = [], []
    for number, bag in enumerate((one, split)):
        path = tmp_path / f'{number}.json'
        compare_run([str(bag), '--json', str(path)])
        compared = json.loads(path.read_text())
        found.append(compared['stretches'])
        capsys.readouterr()
        assert replay_run([str(bag), '--set', 'restitution_1=0.5', '--json', str(path)]) == 0
        supposed.append(json.loads(path.read_text()))
        # The snapshots with which files begin are compared, too.
        assert supposed[number].pop('bag') == str(bag)
        assert supposed[number]['compared'].pop('snapshots') == 4 + 3 * number
        capsys.readouterr()
    assert len(found[0]) == 3
    # Sums are made of other parts.
    assert found[1] == close_to(found[0])
    assert supposed[0] == close_to(supposed[1])


@pytest.mark.parametrize('seed', range(4))
def test_random_histories_in_files(tmp_path, seed):
    """Resets, pauses and changes between the files, in the midst of them and at their borders."""
    rng = random.Random(seed)
    rig = RecordedRig(offset=rng.choice([0, samples.START])).start()
    begins = []
    while rig.tick < 400:
        rig.run(rng.randrange(5, 60), *random_requests(rng))
        if rng.random() < 0.5:
            begins.append(len(rig.messages))
            rig.record()
        if rng.random() < 0.3:
            rig.serve(*random_requests(rng))
    rig.run(5)
    assert len(begins) > 3
    with RunWriter(tmp_path / 'bag', samples.CONTROLLED, custom=NOTES) as writer:
        for number, (topic, content, stamp) in enumerate(rig.messages):
            if number in begins:
                assert writer.split(stamp)
            assert writer.write(topic, content, stamp)
    assert len(files_of(tmp_path / 'bag')) == len(begins) + 1
    for bag in (tmp_path / 'bag', *files_of(tmp_path / 'bag')):
        findings = replayed(bag)
        assert (findings.verdict, findings.faults) == (ReplayVerdict.IDENTICAL, []), bag


def test_by_size(tmp_path):
    limit = 150_000
    bag = simulated(tmp_path / 'bag', '--max-bag-size', str(limit), duration='40')
    *full, last = [path.stat().st_size for path in files_of(bag)]
    assert len(full) > 2
    # What is still in memory is estimated.
    assert max(full) < 1.5 * limit
    assert min(full) > 0.6 * limit
    assert last < 1.5 * limit
    assert replayed(bag).verdict is ReplayVerdict.IDENTICAL
    assert [replayed(path).verdict for path in files_of(bag)] == [ReplayVerdict.IDENTICAL] * (
        len(full) + 1
    )


@pytest.mark.parametrize(
    ('number', 'listing'), [(0, True), (1, False), (2, True), (3, True), (3, False)]
)
def test_a_missing_file_is_a_fault(copy, tmp_path, number, listing, capsys):
    (copy / f'run_{number}.mcap').unlink()
    if not listing:
        (copy / 'metadata.yaml').unlink()
    found = faults(copy)
    names = f"metadata.yaml lists 'run_{number}.mcap', not there"
    assert any(names in fault for fault in found) is listing
    assert any('the bag is not complete' in fault for fault in found)
    assert replay_run([str(copy)]) in (1, 3)
    assert compare_run([str(copy)]) in (1, 3)
    capsys.readouterr()
    assert recover_run([str(copy), '--output', str(tmp_path / 'saved')]) == 0
    assert (names in capsys.readouterr().out) is listing
    # What is lost is noted, and between two files there is a gap.
    found = replayed(tmp_path / 'saved').faults
    (fault,) = (one for one in found if "recovered from 'run'" in one)
    assert '0 bytes of that could not be used' in fault
    assert len(found) == 1 + (number in (1, 2))


@pytest.mark.parametrize('left', [0, 9000, -3])
def test_the_last_file_is_cut(copy, tmp_path, left, capsys):
    """As after `kill -9`: no metadata.yaml, and a part of the last file, or nothing of it."""
    (copy / 'metadata.yaml').unlink()
    rewritten(copy / 'run_3.mcap', cut(left))
    findings = replayed(copy)
    assert findings.verdict is ReplayVerdict.PARTIAL
    assert not findings.difference_count
    # An empty file is named as well.
    assert len(findings.faults) == 1 + (left == 0)
    assert 'the bag is not complete' in findings.faults[-1]
    assert findings.samples >= 1201
    assert compare_run([str(copy)]) == 3
    capsys.readouterr()
    assert recover_run([str(copy), '--output', str(tmp_path / 'saved')]) == 0
    capsys.readouterr()
    recovered = replayed(tmp_path / 'saved')
    assert recovered.verdict is ReplayVerdict.PARTIAL
    (fault,) = recovered.faults
    assert fault.startswith("the bag is recovered from 'run', which was cut short or damaged: ")
    assert recovered.samples == findings.samples
    (path,) = files_of(tmp_path / 'saved')
    with Reader(tmp_path / 'saved') as reader:
        assert reader.message_count == len(contents(path))


def test_recovered_wholes_and_parts_are_whole(split, tmp_path, capsys):
    for number, source in enumerate((split, *files_of(split))):
        output = tmp_path / str(number)
        assert recover_run([str(source), '--output', str(output)]) == 0
        assert 'is complete: nothing was lost' in capsys.readouterr().out
        assert replayed(output).verdict is ReplayVerdict.IDENTICAL
        parts = files_of(source) if source is split else [source]
        assert contents(files_of(output)[0]) == [m for part in parts for m in contents(part)]


def test_a_bag_of_more_files_than_may_be_open(tmp_path):
    bag = simulated(tmp_path / 'bag', '--max-bag-duration', '1', '--rate', '20', duration='90')
    assert len(files_of(bag)) == 90
    limits = resource.getrlimit(resource.RLIMIT_NOFILE)
    used = max(int(path.name) for path in Path('/proc/self/fd').iterdir())
    resource.setrlimit(resource.RLIMIT_NOFILE, (used + 70, limits[1]))
    try:
        assert replayed(bag).verdict is ReplayVerdict.IDENTICAL
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


# When things go wrong


def record(writer, *, messages=400, width=100):
    """Write notes, one each 10 ms of stamps, with a new file where it is due."""
    count = 0
    for number in range(messages):
        content = samples.serialise(
            samples.STRING, samples.make(samples.STRING, os.urandom(width).hex())
        )
        count += writer.write('/note', content, number * 10**7)
        if writer.split_due(number * 10**7):
            writer.split(number * 10**7)
    return count


def test_a_name_that_is_taken_ends_the_recording(tmp_path):
    told = []
    bag = tmp_path / 'bag'
    with RunWriter(bag, [NOTE], max_duration=1.0, on_error=lambda: told.append(1)) as writer:
        (bag / 'bag_2.mcap').write_bytes(b'')
        record(writer)
    assert told == [1]
    assert str(writer.error).startswith(f"cannot continue recording to '{bag}/bag_2.mcap': ")
    assert 'it exists already' in str(writer.error)
    # What was written is whole, and the file in the way is as it was.
    assert [len(contents(bag / f'bag_{n}.mcap')) for n in (0, 1)] == [101, 100]
    assert (bag / 'bag_2.mcap').read_bytes() == b''
    assert (writer.message_count, writer.dropped) == (201, 199)
    assert not (bag / 'metadata.yaml').exists()
    (bag / 'bag_2.mcap').unlink()
    reader = RunReader(bag)
    assert len(list(reader)) == 201
    assert not reader.complete


# Limits


def test_a_file_is_due_at_its_duration(tmp_path):
    """To the nanosecond, from the first stamp; the next one from where it was asked for."""
    with RunWriter(tmp_path / 'bag', [NOTE], max_duration=2.0) as writer:
        content = samples.serialise(samples.STRING, samples.make(samples.STRING, 'x'))
        begin = 5 * 10**9
        assert not writer.split_due(begin)
        writer.write('/note', content, begin)
        due = [writer.split_due(begin + 2 * 10**9 + k) for k in (-1, 0, 1)]
        assert due == [False, True, True]
        assert writer.split(begin + 2 * 10**9)
        due = [writer.split_due(begin + 4 * 10**9 + k) for k in (-1, 0)]
        assert due == [False, True]


def test_what_a_file_begins_with_may_be_larger_than_the_limit(tmp_path):
    """A snapshot of very many lines, say: a file still lasts a second."""
    head = samples.serialise(
        samples.STRING, samples.make(samples.STRING, os.urandom(150_000).hex())
    )
    with RunWriter(tmp_path / 'bag', [NOTE], max_size=100_000, flush_period=0.02) as writer:
        assert not writer.split_due(0)
        for begin in (0, 10**9, 2 * 10**9):
            writer.write('/note', head, begin)
            while writer.splitting or writer.path.stat().st_size < 150_000:
                time.sleep(0.001)
            assert not writer.split_due(begin + 10**9 - 1)
            assert writer.split_due(begin + 10**9)
            assert writer.split(begin + 10**9)
    assert [len(contents(path)) for path in files_of(tmp_path / 'bag')] == [1, 1, 1, 0]
