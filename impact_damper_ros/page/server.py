# SPDX-License-Identifier: Apache-2.0
"""The server: addresses, pages and their sources, and the tick that sends frames."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import socket
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote
from weakref import WeakValueDictionary

from tornado.httpserver import HTTPServer
from tornado.iostream import StreamClosedError
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketClosedError, WebSocketHandler

from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.run_reader import bag_files
from impact_damper_ros.parameters.quoting import plural

from .client import LONGEST_MESSAGE, STALLED_S, Client
from .gate import Gate
from .live import LiveRig
from .presets import load_presets
from .recorded_source import Player, Recording, load_recording
from .recordings import Recordings
from .requests import RequestError
from .source import Source

if TYPE_CHECKING:
    from .ros_client import RosClient

_FRAMES_PER_SECOND = 60.0
#: Interval between two looks for what cannot wait for a tick, s.
_HASTE_S = 0.003
#: Period of the tick while no page is open, s.
_IDLE_PERIOD_S = 0.25
_LOOK_PERIOD_S = 1.0
_LIST_PERIOD_S = 2.0
_COMPLAINT_PERIOD_S = 10.0
#: Time within which a request must have come, s.
_IDLE_S = 10.0
#: Largest number of pages, which slow one another down, and of bytes of open recordings.
_MOST_PAGES, _MOST_BYTES = 100, 600_000_000

_STATIC = Path(__file__).with_name('static')
_POLICY = (
    "default-src 'self'; connect-src 'self'; img-src 'self' data: blob:; style-src 'self'; "
    "frame-src 'self'; object-src 'none'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
#: A report is one file with its own styles and pictures, and no scripts.
_REPORT_POLICY = (
    "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'; "
    "form-action 'none'; frame-ancestors 'self'; sandbox allow-popups"
)
_SEND_BUFFER = 256 * 1024
_PIECE = 256 * 1024


class PageServer:
    """The server; without a network only recordings are shown, `node` is the first rig shown."""

    def __init__(
        self,
        gate: Gate,
        recordings: Recordings,
        network: RosClient | None = None,
        node: str = '',
    ) -> None:
        self.gate = gate
        self.recordings = recordings
        self._network = network
        self._node = node
        #: Rigs that are or were shown, by name, and recordings, by a key of their own
        self.sources: dict[object, Source] = {}
        self._nothing = Source(self._common)
        self._left_at: dict[object, float] = {}
        self._clients: set[Client] = set()
        # Pages that are being opened
        self._opening = 0
        self._rigs: list[str] = []
        self._list: list[dict[str, Any]] = []
        self._looked = self._listed_at = 0.0
        self._failed = -_COMPLAINT_PERIOD_S
        self._tasks: set[asyncio.Task[Any]] = set()
        # These tasks are not cancelled: processes end meanwhile.
        self._endings: set[asyncio.Task[Any]] = set()
        self._http: HTTPServer | None = None
        self._listing: asyncio.Task[None] | None = None
        # One recording is read at a time: pages that ask for the same one wait for it.
        self._reading = asyncio.Lock()
        self._recorded: WeakValueDictionary[object, Recording] = WeakValueDictionary()

    # Start and end

    async def start(self, port: int) -> None:
        """Listen; OSError if the port is taken."""
        sockets = bind_sockets(port, self.gate.host)
        self.gate.port = sockets[0].getsockname()[1]
        self._http = HTTPServer(
            _application(self), idle_connection_timeout=_IDLE_S, max_body_size=LONGEST_MESSAGE
        )
        self._http.add_sockets(sockets)
        self._look_for_rigs()
        self._spawn(self._run(), self._tasks)

    async def close(self) -> None:
        """Stop the server, and leave the network."""
        if self._http is not None:
            self._http.stop()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for client in list(self._clients):
            self.leave(client)
        if self._http is not None:
            await self._http.close_all_connections()
        for key in list(self.sources):
            self._end(key)
        await asyncio.gather(*self._endings, return_exceptions=True)
        if self._network is not None:
            self._network.close()
        self.recordings.close()

    def _spawn(self, work: Any, tasks: set[asyncio.Task[Any]]) -> None:
        """Start a task, and hold a reference to it until it is done."""
        task = asyncio.ensure_future(work)
        tasks.add(task)
        task.add_done_callback(tasks.discard)

    def _end(self, key: object) -> None:
        self._left_at.pop(key, None)
        self._spawn(self.sources.pop(key).close(), self._endings)

    # The tick

    async def _run(self) -> None:
        due = time.monotonic()
        while True:
            now = time.monotonic()
            # Missed ticks are left out.
            period = 1.0 / _FRAMES_PER_SECOND if self._clients else _IDLE_PERIOD_S
            due = max(due + period, now)
            await self._wait(due)
            self._try(self._tick)

    async def _wait(self, due: float) -> None:
        """Wait for a tick; until then sources send what cannot wait for it."""
        while (rest := due - time.monotonic()) > 0.0:
            hasty = [self._hastens(source) for source in list(self.sources.values())]
            await asyncio.sleep(min(rest, _HASTE_S) if any(hasty) else rest)
        await asyncio.sleep(0.0)

    def _hastens(self, source: Source) -> bool:
        found: list[bool] = []
        self._try(lambda: found.append(source.hasten()))
        return any(found)

    def _try(self, work: Callable[[], None]) -> None:
        """Run a part of the tick: a bad message must not stop the other parts."""
        try:
            work()
        except Exception:
            now = time.monotonic()
            if now > self._failed + _COMPLAINT_PERIOD_S:
                self._failed = now
                traceback.print_exc()

    def _tick(self) -> None:
        now = time.monotonic()
        for source in list(self.sources.values()):
            self._try(source.tick)
        for client in list(self._clients):
            self._try(client.pump)
        if now > self._looked + _LOOK_PERIOD_S:
            self._looked = now
            self._look_for_rigs()
            self._end_unused(now)
        if self._clients and now > self._listed_at + _LIST_PERIOD_S:
            self._listed_at = now
            self._spawn(self._list_recordings(), self._tasks)

    def _look_for_rigs(self) -> None:
        rigs = self._network.rigs() if self._network is not None else []
        if rigs != self._rigs:
            self._rigs = rigs
            self._send({'type': 'rigs', 'list': rigs})
        for client in list(self._nothing.clients) if rigs else ():
            client.show(self._rig(rigs[0]))

    def _end_unused(self, now: float) -> None:
        for key, source in list(self.sources.items()):
            if source.clients:
                self._left_at[key] = now
            elif now > self._left_at.setdefault(key, now) + source.kept_s:
                self._end(key)

    async def _list_recordings(self) -> None:
        """Send the list of the recordings to the pages if it has changed; one task for all."""
        if self._listing is None or self._listing.done():
            self._listing = asyncio.ensure_future(self._list_anew())
        await asyncio.shield(self._listing)

    async def _list_anew(self) -> None:
        # In a thread: a slow disk must not delay the frames.
        listed = await asyncio.to_thread(self.recordings.list)
        if listed != self._list:
            self._list = listed
            self._send({'type': 'recordings', 'list': listed})

    def notify(self, text: str) -> None:
        """Show a text on all pages for a while."""
        self._send({'type': 'notice', 'text': text})

    def _send(self, message: dict[str, Any]) -> None:
        for client in list(self._clients):
            client.put(message)

    # Pages

    def _common(self) -> dict[str, Any]:
        presets = [
            {'name': p.name, 'title': p.title, 'description': p.description, 'values': p.values}
            for p in load_presets().values()
        ]
        return {
            'rigs': self._rigs,
            'recordings': self._list,
            'presets': presets,
            # Whether live rigs are possible
            'ros': self._network is not None,
            # Whether the best gap of a structure can be computed
            'designs': True,
            # Address of the page for other machines, which watch; empty if they cannot reach it
            'address': self.gate.url() if self.gate.token else '',
        }

    def _rig(self, name: str) -> Source:
        assert self._network is not None
        if name not in self.sources:
            self.sources[name] = LiveRig(self._network.join(name), self._common)
        return self.sources[name]

    async def open(self, socket: Any, rig: str, bag: str, *, steers: bool) -> Client:
        """Open a page on a rig or a recording; raise a RequestError if that is not possible."""
        if len(self._clients) + self._opening >= _MOST_PAGES:
            raise RequestError(
                f'{plural(_MOST_PAGES, "page")} open already: close one, and reload this one'
            )
        self._opening += 1
        try:
            source = await self._source(rig, bag)
            client = Client(socket, source, self._handle, steers=steers)
            self._clients.add(client)
        finally:
            self._opening -= 1
        return client

    async def _source(self, rig: str, bag: str) -> Source:
        """Return the source for a page."""
        await self._list_recordings()
        if not bag and self._network is None:
            # The newest recording
            bag = next((entry['name'] for entry in self._list), '')
        if bag:
            return await self._player(bag)
        if self._network is None:
            raise RequestError('there is no recording to play, and the page runs without ROS')
        rig = rig or self._node or (self._rigs[0] if self._rigs else '')
        if rig and rig not in (*self._rigs, self._node, *self.sources):
            raise RequestError(f'there is no rig {rig[:200]}')
        return self._rig(rig) if rig else self._nothing

    async def _player(self, bag: str) -> Source:
        """Return a source that plays a recording."""
        try:
            async with self._reading:
                # In a thread: the frames of the other pages go on.
                path, recorded = await asyncio.to_thread(self._recording, bag)
        except (LookupError, RecordingError, ValueError) as error:
            raise RequestError(str(error)) from error
        player = Player(bag, path, recorded, self._common)
        self.sources[player] = player
        return player

    def _recording(self, bag: str) -> tuple[Path, Recording]:
        """Read a recording; pages that play the same one share it."""
        path = self.recordings.path(bag)
        files = bag_files(path)
        key = path, tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)
        found = self._recorded.get(key)
        if found is None:
            others = sum(one.motion.samples.nbytes for one in list(self._recorded.values()))
            found = load_recording(path)
            if others and others + found.motion.samples.nbytes > _MOST_BYTES:
                raise ValueError('the recordings that are open fill the memory: close one of them')
            self._recorded[key] = found
        return path, found

    def leave(self, client: Client) -> None:
        """Remove a page, and close it if it is open."""
        client.close()
        self._clients.discard(client)
        client.source.clients.discard(client)

    async def _handle(self, message: dict[str, Any], client: Client) -> dict[str, Any] | None:
        """Process a request of a page, or let its source do so."""
        if message['type'] != 'compare':
            return await client.source.handle(message)
        name = message['recording']
        if not message['on']:
            self.recordings.cancel_comparison(name)
            return {'ok': True, 'reason': ''}
        try:
            path = await asyncio.to_thread(self.recordings.path, name)
            if not self.recordings.start_comparison(name):
                # All pages are informed of the end of the comparison.
                return {'ok': True, 'reason': ''}
        except LookupError as error:
            raise RequestError(str(error)) from error

        async def work() -> None:
            self._send(await self.recordings.compare(path))

        self._spawn(work(), self._tasks)
        return {'ok': True, 'reason': ''}


class _Guarded(RequestHandler):
    """A request that passes the gate, answered with restrictive security headers."""

    policy = _POLICY
    steers = False

    def initialize(self, server: PageServer) -> None:
        self.server = server

    def set_default_headers(self) -> None:
        self.clear_header('Server')
        for name, value in (
            ('Content-Security-Policy', self.policy),
            ('X-Content-Type-Options', 'nosniff'),
            ('Referrer-Policy', 'no-referrer'),
            ('Cross-Origin-Opener-Policy', 'same-origin'),
            ('Cross-Origin-Resource-Policy', 'same-origin'),
            ('Cache-Control', 'no-cache'),
        ):
            self.set_header(name, value)

    def prepare(self) -> None:
        gate, request = self.server.gate, self.request
        if not gate.accepts_host(request.headers.get('Host', '')):
            raise HTTPError(421, reason='This server has another name')
        origin = request.headers.get('Origin')
        if origin is not None and not gate.accepts_origin(origin, request.headers['Host']):
            raise HTTPError(403, reason='Foreign Origin')
        tokens = self.get_query_argument('token', None), self.get_cookie(gate.cookie)
        self.steers = gate.steers(request.remote_ip or '', self._own_address(), *tokens)

    def _own_address(self) -> str:
        """Return the address of this machine that the request has reached."""
        stream = getattr(self.request.connection, 'stream', None)
        if stream is None or stream.socket is None:
            return ''
        return str(stream.socket.getsockname()[0])

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        error = kwargs.get('exc_info', (None, None))[1]
        why = f': {error.why}' if isinstance(error, _AbsentError) else ''
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{status_code} {self._reason}{why}\n')


class _AbsentError(HTTPError):
    """A requested page or file is absent; `why` is for the user."""

    def __init__(self, why: str) -> None:
        super().__init__(404)
        self.why = why


class _Index(_Guarded):
    def get(self) -> None:
        gate, token = self.server.gate, self.get_query_argument('token', None)
        if token is not None:
            # The token is kept in a cookie that scripts cannot read, and removed from the address.
            right = gate.accepts_token(token)
            if right:
                self.set_cookie(gate.cookie, token, httponly=True, samesite='Strict', path='/')
            # A page that may steer anyway needs no token.
            self.redirect('/' if right or self.steers else '/?wrong_token')
            return
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish((_STATIC / 'index.html').read_bytes())


class _Missing(_Guarded):
    def prepare(self) -> None:
        super().prepare()
        raise HTTPError(404)


class _Static(_Guarded, StaticFileHandler):
    def initialize(self, path: str, server: PageServer) -> None:  # type: ignore[override]
        self.server = server
        StaticFileHandler.initialize(self, path)

    def prepare(self) -> None:
        super().prepare()
        if '\0' in unquote(self.request.path):
            raise HTTPError(404)

    def set_extra_headers(self, path: str) -> None:
        del path
        self.set_header('Cache-Control', 'no-cache')


class _Download(_Guarded):
    """The file of a recording, as long as it is at the beginning."""

    async def get(self, name: str) -> None:
        try:
            path = await asyncio.to_thread(self.server.recordings.file, name)
            stream = await asyncio.to_thread(path.open, 'rb')
        except LookupError as error:
            raise _AbsentError(str(error.args[0])) from None
        except OSError:
            raise HTTPError(404) from None
        with stream:
            rest = os.fstat(stream.fileno()).st_size
            self.set_header('Content-Type', 'application/octet-stream')
            file = f'attachment; filename="{_plain(path.name)}"'
            self.set_header('Content-Disposition', file)
            self.set_header('Content-Length', rest)
            try:
                while piece := await asyncio.to_thread(stream.read, min(_PIECE, rest)):
                    rest -= len(piece)
                    self.write(piece)
                    await asyncio.wait_for(self.flush(), STALLED_S)
            except (StreamClosedError, TimeoutError):
                # The download was cancelled, or the connection takes no more bytes.
                self.detach().close()


def _plain(name: str) -> str:
    """Return a name of a file that every system accepts."""
    plain = ''.join(sign if sign.isalnum() or sign in '._-' else '_' for sign in name)
    return plain.encode('ascii', 'replace').decode().replace('?', '_')


class _Report(_Guarded):
    """The report of a comparison."""

    policy = _REPORT_POLICY

    async def get(self, name: str) -> None:
        try:
            report = self.server.recordings.report(name)
            content = await asyncio.to_thread(report.read_bytes)
        except LookupError as error:
            raise _AbsentError(str(error.args[0])) from None
        except OSError:
            raise HTTPError(404) from None
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        self.finish(content)


class _Socket(_Guarded, WebSocketHandler):
    client: Client | None = None
    opening: asyncio.Task[None]

    def check_origin(self, origin: str) -> bool:
        return self.server.gate.accepts_origin(origin, self.request.headers['Host'])

    def open(self, *args: str, **kwargs: str) -> None:
        del args, kwargs
        # No ping is answered while this method waits.
        self.opening = asyncio.ensure_future(self._begin())

    async def _begin(self) -> None:
        self.set_nodelay(True)
        connection = self.ws_connection
        stream = getattr(connection, 'stream', None)
        if stream is not None and stream.socket is not None:
            # A small buffer: its content is outdated once a page reads again.
            stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        rig, bag = (self.get_query_argument(name, '') for name in ('rig', 'bag'))
        try:
            self.client = await self.server.open(self, rig, bag, steers=self.steers)
        except RequestError as error:
            text = json.dumps({'type': 'status', 'state': 'gone', 'text': str(error)[:2000]})
            with contextlib.suppress(WebSocketClosedError):
                await self.write_message(text)
            self.close(4404)
        else:
            if self.ws_connection is None or self.ws_connection.is_closing():
                self.on_close()

    async def on_message(self, message: str | bytes) -> None:
        await asyncio.shield(self.opening)
        if self.client is not None:
            self.client.take(message)

    def on_close(self) -> None:
        if self.client is not None:
            self.server.leave(self.client)


def _application(server: PageServer) -> Application:
    """Return the application with all addresses of a server."""
    own = {'server': server}
    return Application(
        [
            (r'/', _Index, own),
            (r'/static/(.*)', _Static, {'path': str(_STATIC), **own}),
            (r'/recordings/([^/]+)/download', _Download, own),
            (r'/reports/([^/]+)/report\.html', _Report, own),
            (r'/ws', _Socket, own),
        ],
        default_handler_class=_Missing,
        default_handler_args=own,
        websocket_max_message_size=LONGEST_MESSAGE,
        websocket_ping_interval=STALLED_S,
        log_function=lambda _: None,
    )
