"""The server: what a request must bring, what it gets, and that no page can harm the others."""

import asyncio
import contextlib
import json
import re
import socket

import pytest
from running import DEADLINE_S
from tornado.httpclient import HTTPClientError
from tornado.websocket import WebSocketClosedError

from impact_damper_ros import GapControlParameters, InitialConditions, Rig, RigParameters, settle
from impact_damper_ros.page.client import Client
from impact_damper_ros.page.live import LiveRig
from impact_damper_ros.page.requests import REQUESTS
from impact_damper_ros.page.source import Source

from .fake_rig import FakeLink, FakeNetwork, diagnostics
from .served import get, in_loop, live_page, opened, serving, started, taken_apart, url
from .test_structure import TYPED

# Requests


@in_loop
async def test_every_answer_keeps_foreign_things_out(tmp_path):
    async with serving(tmp_path, FakeNetwork()) as server:
        for path in ('/', '/nothing', '/static/nothing.js'):
            answer = await get(server, path)
            policy = answer.headers['Content-Security-Policy']
            assert "default-src 'self'" in policy
            assert 'unsafe' not in policy
            assert "object-src 'none'" in policy
            assert answer.headers['X-Content-Type-Options'] == 'nosniff'
            assert answer.headers['Referrer-Policy'] == 'no-referrer'
            assert 'Server' not in answer.headers or answer.headers['Server'] == ''
        assert (await get(server, '/nothing')).code == 404
        answer = await get(server, '/recordings/%3Cscript%3E/download')
        assert answer.code == 404
        assert answer.headers['Content-Type'].startswith('text/plain')


@in_loop
async def test_foreign_host_and_origin_are_refused_everywhere(tmp_path):
    """DNS rebinding: the name of an attacker, which leads to this machine."""
    async with serving(tmp_path, FakeNetwork(FakeLink())) as server:
        port = server.gate.port
        for path in ('/', '/static/app.js', '/ws', '/nothing'):
            answer = await get(server, path, headers={'Host': f'attacker.example:{port}'})
            assert answer.code == 421
            assert b'attacker' not in answer.body
        for origin in ('http://attacker.example', 'null', f'http://localhost:{port}'):
            with pytest.raises(HTTPClientError) as refused:
                async with opened(server, headers={'Origin': origin}):
                    pass
            assert refused.value.code == 403
            assert (await get(server, '/', headers={'Origin': origin})).code == 403
        async with opened(server, headers={'Origin': url(server, '')}) as page:
            await page.next('hello')


def other_machine(monkeypatch):
    """Let requests look as if they came from another machine."""
    monkeypatch.setattr('impact_damper_ros.page.gate.is_loopback', lambda _: False)
    monkeypatch.setattr(
        'impact_damper_ros.page.server._Guarded._own_address', lambda _: '192.0.2.1'
    )


@in_loop
async def test_another_machine_watches_and_steers_with_the_token(tmp_path, monkeypatch):
    link = FakeLink()
    async with serving(tmp_path, FakeNetwork(link), host='0.0.0.0') as server:
        gate, own = server.gate, len(link.calls)
        token = {'Cookie': f'{gate.cookie}={gate.token}'}
        # This machine needs none.
        async with opened(server) as page:
            assert (await page.next('hello'))['steers'] is True
        other_machine(monkeypatch)
        for path in ('/?token=wrong', '/?token=', '/?token=%C3%A4'):
            answer = await get(server, path)
            assert (answer.code, answer.headers['Location']) == (302, '/?wrong_token')
            assert 'Set-Cookie' not in answer.headers
        # Who has the token keeps it, whatever link is opened later.
        answer = await get(server, f'/?token={gate.token}')
        assert (answer.code, answer.headers['Location']) == (302, '/')
        cookie = answer.headers['Set-Cookie']
        assert 'HttpOnly' in cookie
        assert 'SameSite=Strict' in cookie
        for path in ('/', '/?token=wrong'):
            assert 'Set-Cookie' not in (await get(server, path, headers=token)).headers
        for headers in ({}, {'Cookie': f'{gate.cookie}=wrong'}, token):
            steers = headers is token
            assert (await get(server, '/', headers=headers)).code == 200
            async with opened(server, headers=headers) as page:
                hello = await page.next('hello')
                assert (hello['steers'], hello['address']) == (steers, gate.url())
                assert gate.token not in json.dumps(hello)
                # Who watches changes nothing.
                await page.until(lambda page=page: any(m['parameters'] for m in page.of('hello')))
                for request in (
                    {'type': 'set', 'values': {'gap': 20.0 + steers}},
                    {'type': 'service', 'name': 'reset'},
                    {'type': 'begin', 'values': {'gap': 25.0}},
                    {'type': 'compare', 'recording': 'none', 'on': True},
                ):
                    ok, reason = await page.ask(**request)
                    assert ('only watches' in reason) == (not steers)
                    assert ok == (steers and request['type'] != 'compare')
        assert [call[0] for call in link.calls[own:]] == ['set', 'reset', 'set', 'reset']
        # The token does not make a foreign name a friend.
        strange = {**token, 'Host': f'attacker.example:{gate.port}'}
        assert (await get(server, '/', headers=strange)).code == 421


PATHS = (
    *('/static/../server.py', '/static/..%2fserver.py', '/static/%2e%2e/server.py'),
    *('/static//etc/passwd', '/static/..\\server.py', '/static/%00', '/static/'),
    *('/recordings/../download', '/recordings/..%2f..%2fetc/download'),
    *('/recordings/%2fetc%2fpasswd/download', '/recordings/.%2fsecret/download'),
    *('/reports/..%2f..%2fetc/passwd', '/reports/one/..%2freport.html'),
)


@in_loop
async def test_no_path_leads_out(tmp_path):
    runs = tmp_path / 'runs'
    runs.mkdir()
    (tmp_path / 'secret').mkdir()
    (tmp_path / 'secret' / 'secret_0.mcap').write_bytes(b'its content')
    async with serving(runs, FakeNetwork()) as server:
        host = f'127.0.0.1:{server.gate.port}'
        for path in PATHS:
            # As it is, without the client that tidies it up
            reader, writer = await asyncio.open_connection('127.0.0.1', server.gate.port)
            head = f'GET {path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n'
            writer.write(head.encode())
            answer = await reader.read()
            writer.close()
            await writer.wait_closed()
            assert re.match(rb'HTTP/1.1 (400|403|404) ', answer), (path, answer[:80])
            assert b'its content' not in answer, path
            assert b'import' not in answer, path


# Pages


@in_loop
async def test_a_page_is_shown_the_rig(tmp_path):
    async with live_page(tmp_path, FakeLink(rig=RigParameters(gravity=1.0, angle=0.5))) as (
        link,
        page,
    ):
        hello = (await page.until(lambda: [m for m in page.of('hello') if m['parameters']]))[0]
        assert hello['mode'] == 'live'
        assert (hello['rig'], hello['rigs']) == ('/sim_node', ['/sim_node'])
        values = {knob['name']: knob['value'] for knob in hello['parameters']}
        assert (values['gap'], values['angle']) == (37.0, 0.5)
        assert {p['name'] for p in hello['presets']} >= {'bench', 'paper', 'chaos'}
        await page.until(lambda: page.frames)
        # Positions count from the equilibrium.
        sample = link.rig.sample()
        frame = page.frames[-1]
        assert frame.state[[0, 2]] == pytest.approx([sample.x, sample.z], rel=1e-5)
        assert frame.state[6] == pytest.approx(0.5)
        assert frame.end == pytest.approx(20.0)
        link.change(angle=0.3)
        link.run(0.5)
        turned = await page.next('parameters', values={'angle': 0.3})
        assert turned['time'] == pytest.approx(20.0)
        assert (turned['kind'], turned['preset']) == ('change', '')
        await page.until(lambda: page.frames[-1].end > 20.4)
        assert page.frames[-1].state[0] == pytest.approx(link.rig.sample().x, rel=1e-5)


@in_loop
async def test_a_design_holds_up_no_other_request_and_the_rig_moves_so(tmp_path):
    """Nor the answer to a ping, which comes in the same order."""
    async with live_page(tmp_path) as (link, page):
        await page.until(lambda: [m for m in page.of('hello') if m['parameters']])
        await page.send(type='structure', id='long', values=TYPED)
        assert await page.ask(type='set', values={'gap': 30.0}) == (True, '')
        assert len(page.of('answer')) == 1
        answer = await page.next('answer', id='long')
        assert answer['ok']
        # It changes nothing by itself.
        assert link.rig.parameters.gap == 30.0
        design, values = answer['design'], answer['values']
        best = pytest.approx((0.02148, 0.00176444), rel=1e-4)
        assert (design['gap'], design['x_max']) == best
        # From rest the rig comes to the best gap of all.
        assert (design['best_gap'], design['best_x_max']) == best
        assert design['reached']
        there, start, control = (
            kind(**{name: values[name] for name in kind().as_dict()})
            for kind in (RigParameters, InitialConditions, GapControlParameters)
        )
        assert settle(Rig(there, start)).x_max == pytest.approx(design['x_max'], rel=1e-3)
        assert control.gap_min < there.gap < control.gap_max
        assert not control.active
        assert there.sweep_low < there.omega < there.sweep_high
        assert (await page.ask(type='begin', values=values))[0]
        assert link.rig.parameters.gap == there.gap
        # Another knob comes first by now.
        knobs = [k['name'] for k in page.of('hello')[-1]['parameters'] if k['first']]
        assert 'base_amplitudes' in knobs
        assert 'force_amplitudes' not in knobs


#: Messages, and what they are answered
MESSAGES = [
    *((text, 'the message cannot be read') for text in ('', '{', '[' * 60_000)),
    *((text, 'a message must be a JSON object') for text in ('[]', 'null', '3')),
    # What JSON does not have, or no number can hold
    ('{"type": "set", "values": {"gap": NaN}}', 'NaN is not a number in JSON'),
    ('{"type": "set", "values": {"gap": 1e400}}', '1e400 is too large for a number'),
    (f'{{"type": "seek", "time": 1{"0" * 400}}}', 'is too large for a number'),
    *((f'{{"type": {kind}}}', 'is no request: give one of view') for kind in ('1', '"off"')),
    # Each field of each request by its name
    *(
        (json.dumps({'type': kind}), f'{kind} has no {next(iter(fields))}')
        for kind, fields in REQUESTS.items()
    ),
    *(
        (json.dumps({'type': kind, **{key: [] for key in fields}}), f' of {kind} is []: give')
        for kind, fields in REQUESTS.items()
    ),
    ('{"type": "set", "values": {"gap": {"text": "1"}}}', 'gap has no unit'),
    ('{"type": "set", "values": {"a": {"text": "1"}}}', 'a is not a parameter'),
    ('{"type": "service", "name": "shutdown"}', 'shutdown is not a service'),
    ('{"type": "seek", "time": 1}', 'seek is not a request for a live rig'),
    ('{"type": "compare", "recording": "a", "on": true}', 'there is no recording a'),
]


@in_loop
async def test_every_message_is_answered_and_does_no_harm(tmp_path, monkeypatch):
    monkeypatch.setattr('traceback.print_exc', lambda: None)
    async with live_page(tmp_path) as (link, page):
        await page.until(lambda: page.frames)
        for text, words in MESSAGES:
            before, seen = len(page.messages), len(page.frames)
            await page.socket.write_message(text)

            def refused(before=before):
                return [m for m in page.messages[before:] if m.get('ok') is False]

            answer = await page.until(refused, text[:80])
            assert words in answer[0]['reason'], text[:80]
            link.run(0.2)
            await page.until(lambda seen=seen: len(page.frames) > seen, text[:80])


@in_loop
async def test_too_long_messages_close_that_page_only(tmp_path):
    link = started(FakeLink())
    async with (
        serving(tmp_path, FakeNetwork(link)) as server,
        opened(server) as page,
        opened(server) as other,
    ):
        await page.until(lambda: page.frames)
        with contextlib.suppress(WebSocketClosedError):
            await page.socket.write_message('x' * 200_000)
        await page.until(lambda: page.closed is not None)
        seen = len(other.frames)
        link.run(0.2)
        await other.until(lambda: len(other.frames) > seen)


@in_loop
async def test_a_longer_window_brings_what_is_before(tmp_path):
    async with live_page(tmp_path) as (link, page):
        await page.until(lambda: page.frames)
        await page.send(type='view', window=60.0, rate=60)
        link.run(30.0)
        frame = await page.until(lambda: [f for f in page.frames if len(f.samples) > 9000])
        assert len(frame[0].samples) == pytest.approx(10_000, abs=1)
        # A page that has more than it shows needs nothing.
        seen = len(page.frames)
        await page.send(type='view', window=4.0, rate=60)
        link.run(0.1)
        await page.until(lambda: page.frames[seen:])
        assert not page.frames[-1].flags


@in_loop
async def test_a_rig_that_comes_later_is_found_and_one_that_is_not_there_is_named(tmp_path):
    network = FakeNetwork()
    async with serving(tmp_path, network) as server, opened(server) as page:
        hello = await page.next('hello')
        assert (hello['rig'], hello['rigs']) == ('', [])
        assert (await page.next('status'))['state'] == 'gone'
        assert 'no rig' in (await page.ask(type='set', values={'gap': 1.0}))[1]
        assert not (await page.ask(type='begin', values={'gap': 1.0}))[0]
        link = network.links.setdefault('/left/sim_node', FakeLink('/left/sim_node'))
        link.run(1.0)
        assert (await page.next('hello', rig='/left/sim_node'))['rigs'] == ['/left/sim_node']
        async with opened(server, '/ws?rig=/right/sim_node') as lost:
            await lost.until(lambda: lost.closed == 4404)
            assert 'there is no rig /right/sim_node' in lost.messages[0]['text']


@in_loop
async def test_silence_and_reports_of_the_node_are_its_state(tmp_path, monkeypatch):
    monkeypatch.setattr('impact_damper_ros.page.live.GONE_S', 0.2)
    async with live_page(tmp_path) as (link, page):
        await page.next('status', state='gone')
        link.run(0.1)
        link.report((1, 'pacing', 'cannot hold 200 Hz', {'Overruns': '3'}))
        seen = len(page.of('status'))
        status = await page.next('status', after=seen, state='lagging')
        assert status['text'] == 'cannot hold 200 Hz'


@in_loop
async def test_a_rig_whose_messages_cannot_be_taken_harms_no_other(tmp_path):
    class Broken(FakeLink):
        def poll(self):
            raise ValueError('a message that nobody has thought of')

    right = started(FakeLink('/right/sim_node'))
    async with (
        serving(tmp_path, FakeNetwork(Broken('/left/sim_node'), right)) as server,
        opened(server, '/ws?rig=/left/sim_node'),
        opened(server, '/ws?rig=/right/sim_node') as page,
    ):
        await page.until(lambda: page.frames)


@in_loop
async def test_reports_of_another_rig_are_no_sign_of_life(tmp_path, monkeypatch):
    """All rigs report on the same topic."""
    monkeypatch.setattr('impact_damper_ros.page.live.GONE_S', 0.3)
    async with live_page(tmp_path, FakeLink('/left/sim_node')) as (link, page):
        await page.until(lambda: page.frames)

        async def others():
            while True:
                link.messages['diagnostics'].append(
                    diagnostics((0, 'right/sim_node: pacing', 'holds 200 Hz', {}))
                )
                await asyncio.sleep(0.05)

        task = asyncio.ensure_future(others())
        await page.next('status', state='gone')
        task.cancel()
        assert page.of('diagnostics')[-1]['message'] == ''


# Slow pages


class Stalled:
    """A page that does not read."""

    def __init__(self):
        self.sent = []
        self.writes = []
        self.closed = False

    def write_message(self, message, binary=False):
        self.sent.append((message, binary))
        self.writes.append(asyncio.get_running_loop().create_future())
        return self.writes[-1]

    def close(self):
        self.closed = True


@in_loop
async def test_a_stalled_page_costs_one_frame():
    """Whatever happens meanwhile; when it reads again it gets all of the window at once."""
    link = started(FakeLink())
    rig = LiveRig(link, dict)
    rig.tick()
    sink = Stalled()
    client = Client(sink, rig, lambda message, _: rig.handle(message))
    client.pump()
    sent = len(sink.sent)
    for k in range(2000):
        link.run(0.02)
        rig.tick()
        client.put({'type': 'status', 'state': 'running', 'time': k})
        client.put({'type': 'diagnostics', 'message': 'x' * 1000})
        client.pump()
    assert len(sink.sent) == sent
    assert len(client._waiting) < 10
    for write in sink.writes:
        write.set_result(None)
    client.pump()
    (*texts, (frame, binary)) = sink.sent[sent:]
    assert json.loads(texts[-2][0])['time'] == 1999
    assert binary
    assert taken_apart(frame).end == pytest.approx(60.0)
    assert len(frame) < 300_000
    assert not sink.closed
    await rig.close()


@in_loop
async def test_a_page_that_stalls_for_long_or_floods_is_let_go(monkeypatch):
    nothing = Source(dict)
    sink = Stalled()
    client = Client(sink, nothing, lambda message, _: nothing.handle(message))
    for k in range(300):
        client.put({'type': 'parameters', 'time': k})
    assert sink.closed
    assert not client._waiting
    monkeypatch.setattr('impact_damper_ros.page.client.STALLED_S', 0.0)
    sink = Stalled()
    client = Client(sink, nothing, lambda message, _: nothing.handle(message))
    client.pump()
    await asyncio.sleep(0.01)
    client.pump()
    assert sink.closed


@in_loop
async def test_a_real_page_that_does_not_read_is_bounded(tmp_path):
    """What waits for it in the server does not grow with what happens."""
    link = started(FakeLink())
    async with serving(tmp_path, FakeNetwork(link)) as server:
        plain = socket.socket()
        plain.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        plain.setblocking(False)
        loop = asyncio.get_running_loop()
        await loop.sock_connect(plain, ('127.0.0.1', server.gate.port))
        head = (
            f'GET /ws HTTP/1.1\r\nHost: 127.0.0.1:{server.gate.port}\r\nUpgrade: websocket\r\n'
            'Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n'
            'Sec-WebSocket-Version: 13\r\n\r\n'
        )
        await loop.sock_sendall(plain, head.encode())
        while not server._clients:
            await asyncio.sleep(0.01)
        (client,) = server._clients
        buffered = []
        async with asyncio.timeout(DEADLINE_S):
            # Until the buffers of the kernel are full
            while client._last is None or client._last.done():
                client.show(client.source)
                await asyncio.sleep(0.005)
            for _ in range(200):
                link.run(0.05)
                server._tick()
                sink = client._sink
                buffered.append(sink.ws_connection.stream._write_buffer._size)
        assert max(buffered) < 500_000
        assert buffered[-1] == buffered[0]
        plain.close()
