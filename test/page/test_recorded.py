"""Recordings: played to their end, cut ones too, with jumps and another rig beside."""

import asyncio
import contextlib
import json
import os
import shutil
import threading
from pathlib import Path
from urllib.parse import quote

import numpy as np
import pytest
from bag import samples
from bag.alterations import cut, file_of, rewritten
from bag.recorded_rig import RecordedRig

from impact_damper_ros import EventKind, Rig, load_parameters
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.cli.replay_run import main as replay_run
from impact_damper_ros.cli.simulate_rig import main as simulate_rig
from impact_damper_ros.page.recorded_source import load_recording
from impact_damper_ros.page.recordings import Recordings
from impact_damper_ros.parameters.parameters_file import presets

from .fake_rig import FakeLink, FakeNetwork
from .served import get, in_loop, opened, serving

SECONDS = 12.0


@pytest.fixture(scope='module')
def runs(tmp_path_factory):
    """Make a directory with a recording that changes its gap and then its angle."""
    directory = tmp_path_factory.mktemp('runs')
    arguments = ['--change', '4:gap=0.03', '--change', '8:angle=0.1', '--quiet']
    bag = str(directory / 'run')
    assert simulate_rig(['bench_rig', '--duration', f'{SECONDS}', '--bag', bag, *arguments]) == 0
    return directory


@pytest.fixture(scope='module')
def recorded(runs):
    return load_recording(runs / 'run')


def test_the_angle_is_that_of_each_instant(tmp_path):
    rig = RecordedRig().start().run(200)
    rig.run(200, ('change', {'angle': 0.2})).run(100, ('reset', None))
    angles = load_recording(rig.save(tmp_path / 'bag')).motion.samples[:, 7]
    assert angles.tolist() == [0.0] * 201 + [0.2] * 300


def test_of_a_recording_over_a_restart_the_first_run_is_shown(tmp_path):
    first = RecordedRig(offset=0).start().run(60)
    second = RecordedRig(offset=10**10).start().run(90)
    bag = samples.record(tmp_path / 'bag', [*first.messages, *second.messages])
    recording = load_recording(bag)
    assert recording.remark == 'the node was restarted: run 1 of 2 is shown'
    assert len(recording.motion.samples) == 61


def test_recording_is_read_as_it_was(recorded):
    rig, _, _ = load_parameters(presets()['bench_rig'])
    samples = recorded.motion.samples
    assert len(samples) == pytest.approx(200 * SECONDS, abs=2)
    assert recorded.start == pytest.approx(0.0, abs=0.006)
    assert recorded.motion.end == pytest.approx(SECONDS)
    simulator = Rig(rig)
    for row in samples[100:700:50]:
        simulator.advance(row[0])
        sample = simulator.sample()
        assert row[1:5] == pytest.approx(
            [sample.x, sample.primary_velocity, sample.z, sample.damper_velocity], rel=1e-12
        )
    # Positions count from the equilibrium of each time: X goes on around zero when tilted.
    late = samples[samples[:, 0] > 9.0]
    assert abs(late[:, 1].mean()) < 1e-3
    assert late[-1, 7] == 0.1
    assert recorded.changes == [
        {'time': 0.0, 'kind': 'stretch', 'values': {}, 'preset': 'Bench rig'},
        {'time': 4.0, 'kind': 'change', 'values': {'gap': 0.03}, 'preset': ''},
        {'time': 8.0, 'kind': 'change', 'values': {'angle': 0.1}, 'preset': ''},
    ]
    assert [recorded.number_at(time) for time in (0.0, 3.99, 4.0, 7.0, 8.0, 99.0)] == [
        0,
        0,
        1,
        1,
        2,
        2,
    ]
    assert recorded.stretch(1).values['initial_damper_offset'] == 0.0
    assert recorded.remark == ''


def test_a_cut_recording_is_read_as_far_as_it_goes(runs, tmp_path, recorded):
    bag = tmp_path / 'cut'
    bag.mkdir()
    whole = runs / 'run'
    rewritten(whole, cut(0.5), bag / file_of(whole).name)
    half = load_recording(bag)
    assert 'cut short' in half.remark
    count = len(half.motion.samples)
    assert 200 < count < len(recorded.motion.samples)
    assert np.array_equal(half.motion.samples, recorded.motion.samples[:count], equal_nan=True)


def test_what_is_no_recording_is_refused(tmp_path):
    (tmp_path / 'broken_0.mcap').write_bytes(b'\x89MCAP0\r\n' + b'x' * 1000)
    with pytest.raises(RecordingError):
        load_recording(tmp_path / 'broken_0.mcap')


@in_loop
async def test_a_recording_is_played_to_its_end(runs):
    async with serving(runs / 'run') as server, opened(server) as page:
        hello = await page.next('hello', mode='player', bag='run')
        assert hello['duration'] == pytest.approx(SECONDS, abs=0.01)
        assert len(hello['changes']) == 3
        assert {k['name']: k['value'] for k in hello['parameters']}['gap'] == 0.024
        await page.send(type='play', speed=100)
        await page.next('status', state='ended')

        def changed():
            # Changes that a late tick passes at once are one message.
            values = {}
            for message in page.of('parameters'):
                assert message['kind'] == 'change'
                values |= message['values']
            return values == {'gap': 0.03, 'angle': 0.1}

        await page.until(changed, 'no changes')
        # A busy server sends the last frame after the state.
        await page.until(lambda: page.frames[-1].end == pytest.approx(SECONDS), 'no end')
        times = np.concatenate([f.samples[:, 0] + f.end for f in page.frames])
        motion = load_recording(runs / 'run').motion
        assert times == pytest.approx(motion.samples[:, 0], abs=1e-4)
        assert sum(len(f.impacts) for f in page.frames) == len(motion.impacts)
        # From the end it begins again.
        await page.send(type='play', speed=0.01)
        await page.until(lambda: page.frames[-1].end < 1.0)
        assert any(frame.flags & 2 for frame in page.frames[-2:])


@in_loop
async def test_scrub_and_jumps(runs, recorded):
    async with serving(runs) as server, opened(server, '/ws?bag=run') as page:
        await page.next('hello', mode='player')
        await page.send(type='play', speed=0)
        await page.next('status', state='paused')
        times = []
        for message in (
            {'type': 'seek', 'time': 6.0},
            {'type': 'jump', 'to': 'impact', 'direction': 1},
            {'type': 'jump', 'to': 'impact', 'direction': 1},
            {'type': 'jump', 'to': 'impact', 'direction': -1},
            {'type': 'jump', 'to': 'change', 'direction': 1},
            {'type': 'jump', 'to': 'change', 'direction': -1},
            {'type': 'jump', 'to': 'stretch', 'direction': -1},
            {'type': 'jump', 'to': 'change', 'direction': -1},
            {'type': 'seek', 'time': 1e9},
        ):
            await page.send(**message)
            times.append((await page.next('seek_done', after=len(times)))['time'])
        impacts = recorded.motion.impacts[:, 0]
        after = impacts[impacts > 6.0]
        assert times[:4] == pytest.approx([6.0, after[0], after[1], after[0]])
        assert times[4:6] == pytest.approx([8.0, 4.0])
        assert times[6:] == pytest.approx([recorded.start, recorded.start, SECONDS], abs=0.006)
        # Steps go to the next impact or sample, as on a live rig.
        await page.send(type='seek', time=6.0)
        assert (await page.ask(type='service', name='step_to_impact'))[0]
        await page.until(lambda: page.frames[-1].end == pytest.approx(after[0], abs=1e-9))
        samples = recorded.motion.samples[:, 0]
        first = samples[samples > after[0]][0]
        assert (await page.ask(type='service', name='step'))[0]
        await page.until(lambda: page.frames[-1].end == pytest.approx(first, abs=1e-9))
        count = len(page.of('seek_done'))
        await page.send(type='jump', to='sample', direction=-1)
        back = (await page.next('seek_done', after=count))['time']
        assert back == samples[samples < first][-1] < after[0]
        assert 'recording' in (await page.ask(type='set', values={'gap': 1.0}))[1]
        for wrong in ({'to': 'moon', 'direction': 1}, {'to': 'impact', 'direction': 'up'}):
            assert not (await page.ask(type='jump', **wrong))[0]


@in_loop
async def test_what_if_shows_another_rig(runs, tmp_path):
    report = tmp_path / 'report.json'
    async with serving(runs / 'run') as server, opened(server) as page:
        await page.next('hello', mode='player')
        await page.send(type='play', speed=0)
        # Initial conditions are held as well.
        await page.send(type='what_if', values={'initial_primary_position': 0.001})
        await page.next('what_if', done=True)
        (first, *_) = await page.until(lambda: [f for f in page.frames if len(f.ghost_samples)])
        assert first.ghost_samples[0, 1] == pytest.approx(0.001, rel=0.1)
        seen = len(page.of('what_if'))
        await page.send(type='what_if', values={'gap': 0.02})
        end = await page.next('what_if', after=seen, done=True)
        assert end['on']
        assert end['until'] == pytest.approx(SECONDS)
        assert end['text'] == 'computed from its initial conditions'
        # The numbers are those that the command prints.
        assert replay_run([str(runs / 'run'), '--set', 'gap=0.02', '--json', str(report)]) == 0
        printed = json.loads(report.read_text())['what_if']
        assert end['totals'] == {name: printed[name] for name in ('recorded', 'what_if')}
        assert end['totals']['what_if']['impacts'] > 10
        await page.send(type='seek', time=3.0)
        frame = (
            await page.until(
                lambda: [f for f in page.frames if f.end == 3.0 and len(f.ghost_samples)]
            )
        )[-1]
        # At the same instants as the recorded one
        assert np.array_equal(frame.ghost_samples[:, 0], frame.samples[:, 0])
        rig, _, _ = load_parameters(presets()['bench_rig'])
        other = Rig(rig.replace(gap=0.02))
        hits = [e for e in other.advance(3.0) if e.kind is EventKind.IMPACT]
        sample, row = other.sample(), frame.ghost_samples[frame.ghost_samples[:, 0] <= 0.0][-1]
        assert row[1:7] == pytest.approx(
            [
                *(sample.x, sample.primary_velocity, sample.z, sample.damper_velocity),
                *(sample.stop_1, sample.stop_2),
            ],
            rel=1e-5,
        )
        assert frame.ghost_impacts[frame.ghost_impacts[:, 0] <= 0.0][:, 8] == pytest.approx(
            [hit.impulse for hit in hits], rel=1e-5
        )
        seen = len(page.of('what_if'))
        await page.send(type='what_if', values={'gap': -1.0})
        refused = await page.next('what_if', after=seen, done=True)
        assert not refused['on']
        assert 'gap is -1.0 m' in refused['text']
        seen = len(page.of('what_if'))
        await page.send(type='what_if', values={'state_rate': 1.0})
        assert 'not a parameter' in (await page.next('what_if', after=seen, done=True))['text']
        seen = len(page.of('what_if'))
        await page.send(type='what_if', values=None)
        assert (await page.next('what_if', after=seen, on=False))['done']


@in_loop
async def test_a_bag_that_vanishes_while_it_is_played(runs, tmp_path):
    place = tmp_path / 'runs'
    shutil.copytree(runs, place)
    async with serving(place) as server, opened(server, '/ws?bag=run') as page:
        await page.until(lambda: page.frames)
        shutil.rmtree(place / 'run')
        seen = page.frames[-1].end
        await page.until(lambda: page.frames[-1].end > seen)
        await page.send(type='what_if', values={'gap': 0.02})
        end = await page.next('what_if', done=True)
        assert (end['on'], 'no such file' in end['text']) == (False, True)
        await page.send(type='seek', time=1.0)
        await page.next('seek_done')
        assert page.closed is None


@in_loop
async def test_recordings_are_listed_played_and_handed_out(runs, tmp_path):
    """A loose file beside them is one of them; the newest is shown first."""
    place = tmp_path / 'runs'
    shutil.copytree(runs, place)
    (place / 'empty').mkdir()
    (place / '.hidden').mkdir()
    (file,) = (place / 'run').glob('*.mcap')
    shutil.copy(file, place / 'loose.mcap')
    async with serving(place) as server:
        listed = {one['name']: one for one in server.recordings.list()}
        assert set(listed) == {'run', 'loose.mcap'}
        for one in listed.values():
            assert (one['whole'], one['files'], one['size']) == (True, 1, file.stat().st_size)
            assert one['duration'] == pytest.approx(SECONDS, abs=0.01)
        assert listed['run']['start'] == listed['loose.mcap']['start']
        answer = await get(server, '/recordings/run/download')
        assert answer.body == file.read_bytes()
        assert answer.headers['Content-Disposition'] == f'attachment; filename="{file.name}"'
        for path, bag in (('/ws', 'loose.mcap'), ('/ws?bag=run', 'run')):
            async with opened(server, path) as page:
                hello = await page.next('hello', bag=bag)
                assert hello['duration'] == pytest.approx(SECONDS, abs=0.01)
    only = Recordings(place / 'run')
    assert (only.single, only.names()) == ('run', ['run'])
    with pytest.raises(LookupError):
        only.path('empty')


@in_loop
async def test_no_recording_leads_out_of_its_directory_or_has_a_reader_wait(runs, tmp_path):
    """A link shows what is elsewhere; a pipe that nobody writes to never ends."""
    place, elsewhere = tmp_path / 'runs', tmp_path / 'elsewhere'
    shutil.copytree(runs / 'run', elsewhere)
    (file,) = elsewhere.glob('*.mcap')
    for name in ('file', 'listing', 'pipe', 'piped_listing'):
        shutil.copytree(runs / 'run', place / name)
    for path, target in (
        (place / 'link', elsewhere),
        (place / 'loose.mcap', file),
        (place / 'file' / 'other.mcap', file),
        (place / 'listing' / 'metadata.yaml', elsewhere / 'metadata.yaml'),
    ):
        path.unlink(missing_ok=True)
        path.symlink_to(target)
    for path in (place / 'pipe' / 'x.mcap', place / 'piped_listing' / 'metadata.yaml'):
        path.unlink(missing_ok=True)
        os.mkfifo(path)
    # Not a file of the bag
    shutil.copytree(runs / 'run', place / 'good')
    os.mkfifo(place / 'good' / 'note.txt')
    async with serving(place) as server:
        assert [one['name'] for one in server.recordings.list()] == ['good']
        for name in ('link', 'loose.mcap', 'file', 'listing', 'pipe', 'piped_listing'):
            assert (await get(server, f'/recordings/{name}/download')).code == 404
            async with opened(server, f'/ws?bag={name}') as page:
                await page.until(lambda page=page: page.closed == 4404)
        async with opened(server, '/ws?bag=good') as page:
            await page.until(lambda: page.frames)
    # Who names a link means what it leads to.
    assert Recordings(place / 'link').names() == ['elsewhere']


@in_loop
async def test_what_cannot_be_downloaded_says_why(tmp_path):
    bag = tmp_path / 'split'
    given = [
        'bench_rig',
        '--duration',
        '5',
        '--bag',
        str(bag),
        '--max-bag-duration',
        '2',
        '--quiet',
    ]
    assert simulate_rig(given) == 0
    whole = (bag / 'split_0.mcap').read_bytes()
    (tmp_path / 'cut.mcap').write_bytes(whole[:20_000])
    async with serving(tmp_path) as server:
        listed = {one['name']: one for one in server.recordings.list()}
        assert (listed['split']['files'], listed['split']['whole']) == (3, True)
        assert (listed['cut.mcap']['files'], listed['cut.mcap']['whole']) == (1, False)
        for path, words in (
            ('/recordings/split/download', 'split has 3 files: copy its directory'),
            ('/recordings/none/download', 'there is no recording none'),
            ('/reports/split/report.html', 'there is no such report'),
        ):
            answer = await get(server, path)
            assert (answer.code, answer.body.decode()) == (404, f'404 Not Found: {words}\n')


@in_loop
async def test_any_name_is_listed_downloaded_and_played(runs, tmp_path):
    names = {
        b'caf\xe9': 'caf\\udce9',
        b'100%25': '100%25',
        b'a%2fb': 'a%2fb',
        '<i>äß \u202e'.encode(): '<i>äß \\u202e',
        b'a#b?c=d': 'a#b?c=d',
    }
    for name in names:
        shutil.copytree(runs / 'run', tmp_path / os.fsdecode(name))
    async with serving(tmp_path) as server:
        listed = json.loads(json.dumps(server.recordings.list()))
        assert {one['name'] for one in listed} == set(names.values())
        for name in names.values():
            assert (await get(server, f'/recordings/{quote(name, safe="")}/download')).code == 200
            async with opened(server, f'/ws?bag={quote(name, safe="")}') as page:
                assert (await page.next('hello'))['bag'] == name
                await page.until(lambda page=page: page.frames)


@in_loop
async def test_a_recording_that_grows_is_downloaded_as_it_was(tmp_path, monkeypatch):
    """And a download that is cancelled leaves no trace."""
    (tmp_path / 'run').mkdir()
    file = tmp_path / 'run' / 'run_0.mcap'
    file.write_bytes(b'a' * 3_000_000)
    plain, reported = os.fstat, []
    monkeypatch.setattr('tornado.web.app_log.error', lambda *words, **_: reported.append(words))

    def growing(number):
        """Between the promise of a length and the end."""
        found = plain(number)
        with file.open('ab') as more:
            more.write(b'b' * 500_000)
        return found

    async with serving(tmp_path, FakeNetwork(FakeLink())) as server:
        monkeypatch.setattr('impact_damper_ros.page.server.os.fstat', growing)
        monkeypatch.setattr('impact_damper_ros.page.server._PIECE', 100_001)
        answer = await get(server, '/recordings/run/download')
        assert answer.body == b'a' * 3_000_000
        assert answer.headers['Content-Length'] == '3000000'
        reader, writer = await asyncio.open_connection('127.0.0.1', server.gate.port)
        host = f'127.0.0.1:{server.gate.port}'
        writer.write(f'GET /recordings/run/download HTTP/1.1\r\nHost: {host}\r\n\r\n'.encode())
        await reader.readuntil(b'\r\n\r\n')
        writer.transport.abort()
        while len(server._http._connections) > 1:
            await asyncio.sleep(0.01)
    assert reported == []


@in_loop
async def test_many_pages_at_once_share_what_they_play(runs, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.page.server._MOST_PAGES', 10)
    read = []
    monkeypatch.setattr(
        'impact_damper_ros.page.server.load_recording',
        lambda path: read.append(path) or load_recording(path),
    )
    async with serving(runs) as server, contextlib.AsyncExitStack() as stack:
        pages = await asyncio.gather(
            *(stack.enter_async_context(opened(server, '/ws?bag=run')) for _ in range(14))
        )
        for page in pages:
            await page.until(lambda page=page: page.messages)
        shown = [page for page in pages if page.of('hello')]
        assert len(shown) == 10
        for page in shown:
            await page.until(lambda page=page: page.frames)
            await page.send(type='play', speed=0)
        for page in shown:
            await page.next('orbit', found=True, complete=True)
        assert len(read) == 1
        # Of another setting it is computed once more, for those that are there
        for page, time in ((shown[1], 1.0), (shown[0], 6.0)):
            await page.send(type='seek', time=time)

        def differ():
            orbits = [page.of('orbit')[-1] for page in shown[:2]]
            return all(one['found'] and one['complete'] for one in orbits) and (
                orbits[0]['x_max'] != orbits[1]['x_max']
            )

        for page in shown[:2]:
            await page.until(differ, 'the theory of both settings is the same')
        refused = [page for page in pages if page not in shown]
        assert all('10 pages open already' in page.messages[0]['text'] for page in refused)


@in_loop
async def test_only_numbers_lead_somewhere(runs):
    async with serving(runs) as server, opened(server, '/ws?bag=run') as page:
        await page.until(lambda: page.frames)
        for request in (
            *({'type': 'seek', 'time': time} for time in ('nan', 'inf', '3', None, True, [])),
            *({'type': 'play', 'speed': speed} for speed in ('nan', None)),
            *({'type': 'view', 'window': 3.0, 'rate': rate} for rate in ('nan', None)),
            {'type': 'view', 'window': 'inf', 'rate': 60},
            {'type': 'jump', 'to': 'impact', 'direction': 'nan'},
        ):
            ok, reason = await page.ask(**request)
            assert (ok, reason.endswith('give a number')) == (False, True)
        seen = page.frames[-1].end
        await page.until(lambda: page.frames[-1].end > seen)


@in_loop
async def test_no_directory_is_read_between_two_frames(runs, monkeypatch):
    """A slow disk must not delay them: all that reads directories runs in other threads."""
    scanned, plain = [], Path.iterdir

    def iterdir(path):
        scanned.append((path, threading.current_thread() is threading.main_thread()))
        return plain(path)

    async with serving(runs) as server:
        monkeypatch.setattr(Path, 'iterdir', iterdir)
        async with opened(server, '/ws?bag=run') as page:
            await page.next('hello')
            await page.ask(type='compare', recording='none', on=True)
        for path in ('/recordings/run/download', '/reports/run/report.html'):
            await get(server, path)
    assert len(scanned) > 4
    assert [path for path, in_loop in scanned if in_loop] == []


def test_bags_that_do_not_change_are_described_once(runs, monkeypatch):
    read = []
    monkeypatch.setattr(
        'impact_damper_ros.page.recordings.read_listing',
        lambda path: read.append(path) or None,
    )
    recordings = Recordings(runs)
    first = recordings.list()
    assert recordings.list() == first
    assert len(read) == 1
    extra = runs / 'run' / 'note.txt'
    extra.write_text('changed', encoding='utf-8')
    try:
        recordings.list()
    finally:
        extra.unlink()
    assert len(read) == 2


@in_loop
async def test_a_comparison_is_cancelled_and_made(tmp_path):
    bag = str(tmp_path / 'run')
    assert simulate_rig(['bench_rig', '--duration', '3', '--bag', bag, '--quiet']) == 0
    async with serving(tmp_path) as server, opened(server, '/ws?bag=run') as page:
        await page.next('hello')
        compare = {'type': 'compare', 'recording': 'run', 'on': True}
        assert await page.ask(**compare) == (True, '')
        # Asked for again, also by another page, it is the same one.
        assert await page.ask(**compare) == (True, '')
        assert 'no recording none' in (await page.ask(**{**compare, 'recording': 'none'}))[1]
        while server.recordings._comparing['run'] is None:
            await asyncio.sleep(0.01)
        assert await page.ask(**{**compare, 'on': False}) == (True, '')
        done = await page.next('compare_done')
        assert (done['ok'], done['text']) == (False, 'the comparison of run was cancelled')
        assert await page.ask(**compare) == (True, '')
        done = await page.next('compare_done', after=1)
        assert done['ok'], done['text']
        assert done['url'] == '/reports/run/report.html'
        report = await get(server, done['url'])
        assert report.headers['Content-Type'].startswith('text/html')
        policy = report.headers['Content-Security-Policy']
        assert "default-src 'none'" in policy
        assert 'sandbox' in policy
        assert 'script' not in policy
        assert 'replayed bit for bit' in report.body.decode()
        assert (await get(server, '/reports/run/other.html')).code == 404


@in_loop
async def test_a_recording_that_is_not_there(runs, tmp_path):
    for place, path, words in (
        (runs, '/ws?bag=none', 'no recording none'),
        (tmp_path, '/ws', 'no recording to play'),
    ):
        async with serving(place) as server, opened(server, path) as page:
            await page.until(lambda page=page: page.closed == 4404)
            assert words in page.messages[0]['text']
