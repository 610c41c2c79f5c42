"""Bags made to do harm: one clear line each, no traceback, no hang, and bounded memory."""

import json
import os
import random
import shutil
import signal
import sqlite3
import struct
import zlib

import lz4.frame
import pytest
import zstandard
from bag import bounded_commands, ros2_bags, samples
from bag.altered_bags import altered, chunks_of, cut, flipped, placed, rewritten, write
from bag.recorded_rig import LIVELY, NOTES, RecordedRig, renamed
from mcap.opcode import Opcode

from impact_damper_ros.bag import RecordingError, RunReader
from impact_damper_ros.bag.mcap_file import McapFile
from impact_damper_ros.bag.sqlite_file import SqliteFile
from impact_damper_ros.parameters.quoting import as_line, shown
from impact_damper_ros.replay.run import RecordedRun


@pytest.fixture(scope='module')
def messages():
    return RecordedRig(rate=50.0).start().run(100).messages


@pytest.fixture(scope='module')
def quiet():
    """Return a run without impacts."""
    return RecordedRig(LIVELY.replace(gap=100.0), rate=50.0).start().run(20).messages


@pytest.fixture(scope='module')
def bag(messages, tmp_path_factory):
    return write(tmp_path_factory.mktemp('bags') / 'own', messages, every=40)


def said(bag, words, *, commands=('compare_run', 'replay_run', 'recover_run')):
    """Run the commands, and check that each of them ends well and says so."""
    for command in commands:
        assert bounded_commands.run(command, bag) == ''
        text = bounded_commands.output_of(command, bag).read_text()
        if command != 'recover_run':
            assert words in text, text
            assert sum(words in line for line in text.splitlines()) == 1


def with_snapshots(directory, messages, change):
    changed = []
    for topic, content, stamp in messages:
        if topic == '/snapshot':
            text = change(content[8:-1].decode()).encode('utf-8', 'surrogatepass')
            content = b'\0\1\0\0' + struct.pack('<I', len(text) + 1) + text + b'\0'
        changed.append((topic, content, stamp))
    return write(directory, changed)


def put(path, value):
    """Return a change of a snapshot that puts a value at a path."""

    def change(text):
        held = part = json.loads(text)
        *names, last = path.split('.')
        for name in names:
            part = part[name]
        part[last] = value
        return json.dumps(held)

    return change


@pytest.mark.parametrize(
    ('change', 'words'),
    [
        (lambda _: '[' * 100_000, 'it is nested too deep'),
        (lambda t: t.replace('"x": 0.0', '"x": NaN'), 'NaN is no number of JSON'),
        (put('state.origin.x', None), 'origin.x is None: give a number from'),
        (put('state.origin.velocity', '1.0'), "origin.velocity is '1.0': give a number"),
        (
            put('state.origin.mode', 99),
            'origin.mode is 99: give a whole number from 0 to',
        ),
        (put('state.origin.angles', []), 'origin.angles has 0 entries, the force has 1'),
        (put('state.time', 1e9), 'its state is of rig time 1000000000.0 s, the message of 0.0 s'),
        (put('state.parameters.gap', 'x' * 10**5), 'gap is '),
        (put('state.parameters.gap', -1.0), 'gap is -1.0'),
        (put('state.sweep.step', -(2**62)), 'sweep.step is -4611686018427387904: give a whole'),
        (put('state.sweep.due', 5.0), 'sweep.due is 5.0 s at step 0 of 0'),
        (put('state.origin.velocity', 1e300), 'origin.velocity is 1e+300: give a number'),
        (put('state.format', [2]), 'is of format [2]; this version reads format'),
        (put('stamp_offset_ns', '5'), "stamp_offset_ns is '5'"),
        (put('rate', 0.0), 'rate is 0.0: give a number from 1e-12 to'),
        (put('reason', ['start']), "reason is ['start']: it must be a text"),
        (put('node', 5), 'node is 5: it must be a text'),
        (put('topics', {'joint_states': 5}), 'topics is '),
        (put('done', [['change', {'gap': 0.01}]] * 20_000), 'done has 20000 entries: at most'),
    ],
    ids=range(19),
)
def test_snapshots(tmp_path, messages, change, words):
    path = with_snapshots(tmp_path / 'bag', messages, change)
    with pytest.raises(RecordingError) as caught:
        RecordedRun(path)
    assert words in str(caught.value)
    assert str(caught.value).isprintable()
    assert len(str(caught.value)) < 3000


def test_flights_that_end_before_or_take_hours_to_search(tmp_path, messages, quiet):
    for name, run, words in (
        ('over', messages, 'ends at -999999'),
        ('long', quiet, 'takes too long'),
    ):
        path = with_snapshots(tmp_path / name, run, put('state.origin.time', -1e9))
        said(path, words, commands=('replay_run',))


@pytest.mark.parametrize(
    ('text', 'words'),
    [
        ('[' * 50_000, 'nest'),  # by this package's limit, or by that of libyaml
        ('rosbag2_bagfile_information: !!timestamp x', 'is not the metadata of a bag'),
        ('rosbag2_bagfile_information: {relative_file_paths: ["\x1b[31m"]}', 'not the metadata'),
        ('rosbag2_bagfile_information: {relative_file_paths: [5]}', 'are not all texts'),
        ('rosbag2_bagfile_information: {relative_file_paths: 5}', 'is not the metadata'),
        ('#' * 2**24, 'it is 8388609 characters long; at most 8388608 are read'),
        ('\ud800', 'is not the metadata of a bag'),
    ],
    ids=range(7),
)
def test_metadata_yaml(tmp_path, bag, text, words):
    path = tmp_path / 'bag'
    shutil.copytree(bag, path)
    (path / 'metadata.yaml').write_bytes(text.encode('utf-8', 'surrogatepass'))
    said(path, words, commands=('replay_run', 'recover_run'))


@pytest.mark.parametrize('place', ['bag', 'metadata', 'only', 'directory'])
def test_pipes_are_not_waited_for(tmp_path, bag, place):
    path = tmp_path / 'bag'
    if place in ('bag', 'metadata'):
        shutil.copytree(bag, path)
    if place == 'bag':
        (path / 'metadata.yaml').unlink()
    pipe = {'bag': path / 'x_1.mcap', 'metadata': path / 'metadata.yaml', 'only': path}
    if place == 'directory':
        (path / 'x.mcap').mkdir(parents=True)
    else:
        pipe[place].unlink(missing_ok=True)
        os.mkfifo(pipe[place])
    said(path, 'it is a directory, a pipe or a device, not a regular file')


def zeros(count):
    """Return so many zeros compressed by zstd, without ever holding them."""
    compressor = zstandard.ZstdCompressor().compressobj()
    piece = bytes(10_000_000)
    parts = [compressor.compress(piece) for _ in range(count // len(piece))]
    return b''.join([*parts, compressor.flush()])


@pytest.mark.parametrize(
    ('name', 'count', 'declared', 'words'),
    [
        (b'zstd', 3_900_000_000, 3_900_000_000, '3900000000 bytes are declared; at most'),
        (b'zstd', 3_900_000_000, 1000, 'more than the 1000 bytes declared'),
        (b'lz4', 500_000_000, 1000, 'more than the 1000 bytes declared'),
        (b'\x1b[31m', 10, 10, 'unknown compression'),
    ],
    ids=['declared', 'zstd', 'lz4', 'unknown'],
)
def test_chunks_that_expand_to_gigabytes(tmp_path, bag, name, count, declared, words):
    packed = lz4.frame.compress(bytes(count)) if name == b'lz4' else zeros(count)

    def change(found):
        at = chunks_of(found)[1]
        head = struct.pack('<QQQII', 0, 2**62, declared, 0, len(name))
        found[at] = Opcode.CHUNK, head + name + struct.pack('<Q', len(packed)) + packed

    path = altered(bag, tmp_path / 'bag', change)
    assert path.stat().st_size < 10**7
    said(path, words)
    text = bounded_commands.output_of('recover_run', path).read_text()
    assert 'is complete' not in text
    assert 'fault: the bag is not whole' in text


@pytest.mark.parametrize(
    ('place', 'words'),
    [(1, 'belong to no whole message'), (45, 'the checksum of its data does not match')],
    ids=['record', 'content'],
)
def test_lengths_of_gigabytes(tmp_path, bag, place, words):
    """Of a chunk's record, and of what is in it."""
    path = tmp_path / 'bag'
    shutil.copytree(bag, path)

    def change(content):
        starts = [start for opcode, start, _ in placed(content) if opcode == Opcode.CHUNK]
        position = next(start for start in starts if start > 20_000)
        struct.pack_into('<Q', content, position + place, 4_000_000_000)

    rewritten(path, change)
    for command in bounded_commands.COMMANDS:
        assert bounded_commands.run(command, path) == ''
    text = bounded_commands.output_of('replay_run', path).read_text()
    assert words in text


@pytest.mark.parametrize('what', ['file', 'message'])
def test_other_things_that_expand_to_gigabytes(tmp_path, messages, what):
    path = tmp_path / 'bag'
    if what == 'file':
        path.mkdir()
        (path / 'bag_0.mcap.zstd').write_bytes(zeros(3_900_000_000))
        words = 'its compressed content is not a file of a bag'
    else:
        changed = list(messages)
        at = next(i for i, m in enumerate(messages) if m[0] == '/joint_states')
        changed[at] = ('/joint_states', zeros(3_900_000_000), messages[at][2])
        ros2_bags.write_bag(path, ros2_bags.joined(changed, 0))
        words = 'cannot be expanded: it expands to more than'
    for command in bounded_commands.COMMANDS:
        assert bounded_commands.run(command, path) == ''
    assert words in bounded_commands.output_of('replay_run', path).read_text()


@pytest.mark.parametrize('count', [1, 20])
@pytest.mark.parametrize('content', ['zeros', 'messages'])
def test_chunks_cost_no_more_than_their_file_accounts_for(tmp_path, bag, content, count):
    """A few kB of zstd expand to 128 MiB of records of 9 bytes, or of 31: some seconds each."""
    record = bytes(9) if content == 'zeros' else struct.pack('<BQHIQQ', 5, 22, 1, 0, 0, 0)
    size = 4 * 10**7 // len(record) * len(record)
    packed = zstandard.ZstdCompressor().compress(record * (size // len(record)))
    head = struct.pack('<QQQII', 0, 2**62, size, 0, 4) + b'zstd' + struct.pack('<Q', len(packed))

    def change(found):
        at = chunks_of(found)[1]
        found[at : at + 1] = [(Opcode.CHUNK, head + packed)] * count

    path = altered(bag, tmp_path / 'bag', change)
    assert path.stat().st_size < 10**6
    for command in ('replay_run', 'recover_run'):
        assert bounded_commands.run(command, path, seconds=20) == ''
    text = bounded_commands.output_of('replay_run', path).read_text()
    words = {
        ('zeros', 1): 'a record in it is cut or of no kind that a chunk may hold',
        ('messages', 1): 'it holds more than 1048576 messages',
    }
    assert words.get((content, count), 'no recording is so compressible') in text


def with_messages(database, query):
    """Replace the table of messages of a database."""
    (file,) = database.glob('*.db3')
    connection = sqlite3.connect(file)
    connection.execute('ALTER TABLE messages RENAME TO stored')
    connection.execute(query)
    connection.commit()
    connection.close()


@pytest.mark.parametrize(
    'query',
    [
        'CREATE VIEW messages AS WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) '
        'SELECT n AS id, 1 AS topic_id, n AS timestamp, zeroblob(100) AS data FROM r',
        'CREATE VIEW messages AS SELECT a.* FROM stored a, stored b, stored c, stored d',
        'CREATE TABLE messages (id INTEGER PRIMARY KEY, topic_id INTEGER, '
        'timestamp AS (length(hex(zeroblob(100000000)))), data AS (zeroblob(100000000)))',
    ],
    ids=['recursion', 'product', 'computed'],
)
def test_databases_that_compute_their_messages(tmp_path, messages, query):
    path = ros2_bags.write_database(tmp_path / 'bag', ros2_bags.joined(messages, 0))
    with_messages(path, query)
    for command in bounded_commands.COMMANDS:
        assert bounded_commands.run(command, path, seconds=10) == ''
        text = bounded_commands.output_of(command, path).read_text()
        assert 'it has no table messages, or not a plain one' in text
    assert [file.name for file in path.iterdir() if file.suffix not in ('.db3', '.yaml')] == []


def test_a_database_that_takes_more_work_than_its_size_accounts_for(tmp_path, messages):
    """Topics by a view of their own; Ctrl-C ends a query of SQLite, too."""
    path = ros2_bags.write_database(tmp_path / 'bag', ros2_bags.joined(messages, 0))
    (file,) = path.glob('*.db3')
    reader = SqliteFile(file, file)
    endless = 'WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT n FROM r'
    with (
        pytest.raises(RecordingError, match='it takes much more work to read than its size'),
        reader.opened() as connection,
    ):
        connection.execute(f'SELECT MAX(n) FROM ({endless})').fetchall()
    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt), reader.opened() as connection:  # noqa: PT012
            reader._budget = 10**15
            connection.execute(f'SELECT MAX(n) FROM ({endless})').fetchall()
    finally:
        signal.signal(signal.SIGALRM, before)


def interrupt(number, _):
    raise KeyboardInterrupt(number)


def test_very_many_topics(tmp_path, bag):
    """Each with a long quality of service, of which 16 MB are a file of some kB."""
    qos = b'- history: keep_last\n  depth: 10\n  reliability: reliable\n' * 250

    def change(found):
        channels = [
            (Opcode.CHANNEL, struct.pack('<HH', n, 1) + text(b'/t%d' % n) + text(b'cdr') + note)
            for n in range(100, 1100)
        ]
        records = b''.join(struct.pack('<BQ', o, len(held)) + held for o, held in channels)
        packed = zstandard.ZstdCompressor().compress(records)
        head = struct.pack('<QQQII', 0, 0, len(records), zlib.crc32(records), 4) + b'zstd'
        found.insert(2, (Opcode.CHUNK, head + struct.pack('<Q', len(packed)) + packed))

    def text(content):
        return struct.pack('<I', len(content)) + content

    pair = text(b'offered_qos_profiles') + text(qos)
    note = text(pair)
    path = altered(bag, tmp_path / 'bag', change, listing=False)
    rewritten(path, cut(-40))
    for command in ('replay_run', 'recover_run'):
        assert bounded_commands.run(command, path, seconds=20) == ''
    saved = path.with_name(f'{path.stem}_recovered')
    assert sum(len(McapFile(file, file).channels) for file in saved.glob('*.mcap')) > 1000


def test_metadata_of_very_many_entries(tmp_path, bag):
    """Of 7 MB of them, which once took 1.3 GB."""
    path = tmp_path / 'bag'
    shutil.copytree(bag, path)
    text = '[' + '1,' * 3_500_000 + ']'
    (path / 'metadata.yaml').write_text(f'rosbag2_bagfile_information: {text}\n')
    said(path, 'it has more than 400000 entries', commands=('replay_run', 'recover_run'))


def test_chunks_that_overlap_in_time_are_not_all_held(tmp_path, monkeypatch):
    """As many chunks as one likes may say that they begin at the same instant."""
    monkeypatch.setattr('impact_damper_ros.bag.run_reader._MOST_HELD', 100_000)
    text = samples.serialise(samples.STRING, samples.make(samples.STRING, 'x' * 1000))
    rows = [
        ('/snapshot', text, stamp) for _ in range(10) for stamp in (0, 10**9) for _ in range(9)
    ]
    run = RunReader(write(tmp_path / 'bag', rows, every=18))
    with pytest.raises(RecordingError, match='its chunks overlap so much in time'):
        list(run)


def test_no_escape_sequence_reaches_the_terminal(tmp_path, messages):
    """Not by the name of a topic or node, of a file, or a text within."""
    names = {
        topic: f'{topic}\x1b[31m\n\u202e' for topic in NOTES.values() if topic != NOTES['node']
    }
    notes = {name: names.get(topic, '/n\x1b]0;x\x07') for name, topic in NOTES.items()}
    topics = [samples.Topic(names.get(t.name, t.name), t.type, t.qos) for t in samples.CONTROLLED]
    changed = renamed([*messages, messages[-1]], names, notes['node'])
    path = samples.record(tmp_path / 'bag\x1b[31m', changed, topics, custom=notes)
    for command in bounded_commands.COMMANDS:
        assert bounded_commands.run(command, path) == ''
    text = bounded_commands.output_of('replay_run', path).read_text()
    assert r'node /n\x1b]0;x\x07' in text
    assert r'messages of /joint_states\x1b[31m\n\u202e that are there twice: 1' in text


def test_printable_texts():
    assert as_line('gap 0.02 µm') == 'gap 0.02 µm'
    assert as_line('a\x1b[31m\n\t\x9b\u202e\udcff') == r'a\x1b[31m\n\t\x9b\u202e\udcff'
    assert shown(10**5000) == 'int of too many digits'
    assert len(shown('x' * 1000)) < 120
    assert as_line('x' * 5000) == 'x' * 2000 + '...'


@pytest.mark.parametrize('form', ['file', 'listing', 'snapshot', 'sqlite'])
def test_altered_bytes_end_in_one_clear_line(tmp_path, messages, bag, form):
    """Wherever they are: no traceback, no hang, and only the documented exit codes."""
    if form == 'sqlite':
        ros2_bags.write_database(tmp_path / 'whole', ros2_bags.joined(messages, 0))
        bag = tmp_path / 'whole'
    dice = random.Random(form)
    for number in range(4):
        path = tmp_path / f'bag_{number}'
        if form == 'snapshot':
            hurt = [(t, flipped(c, dice) if t == '/snapshot' else c, s) for t, c, s in messages]
            write(path, hurt)
        else:
            shutil.copytree(bag, path)
            file = path / 'metadata.yaml' if form == 'listing' else path
            rewritten(file, lambda content: flipped(content, dice))
        # The listing of a bag is read before anything is compared.
        for command in list(bounded_commands.COMMANDS)[form == 'listing' :]:
            assert bounded_commands.run(command, path) == '', (command, path)
