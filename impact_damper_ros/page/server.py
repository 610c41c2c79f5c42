"""The server: addresses, what each request must bring, and the tick that shows the rigs."""

from __future__ import annotations

import asyncio
import json
import socket
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets
from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketHandler

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.run_reader import bag_files

from .frames import View
from .gate import Gate
from .live import Link
from .live_source import LiveSource
from .player import Player
from .presets import load_presets
from .recorded import Recorded, load_recording
from .recordings import Recordings
from .session import LONGEST_MESSAGE, Refusal, Session

STATIC = Path(__file__).with_name('static')
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
_FRAMES_PER_SECOND = 60.0
#: With nobody to show anything to, the network is looked at this often.
_IDLE_PERIOD_S = 0.25
_LOOK_PERIOD_S = 1.0
#: A rig that nobody looks at is left after this time, s: who loads the page anew finds the traces.
_KEPT_S = 30.0
_LIST_PERIOD_S = 2.0
_COMPLAINT_PERIOD_S = 10.0
_SEND_BUFFER = 256 * 1024
_PIECE = 256 * 1024


class Network(Protocol):
    """The ROS network; see `ros_client.RosClient`."""

    def rigs(self) -> list[str]:
        """Return the nodes that are rigs."""

    def join(self, rig: str) -> Link:
        """Return a link to a rig."""

    def close(self) -> None:
        """Leave the network."""


class _NoRig:
    """Shown until there is a rig."""

    def __init__(self, common: Callable[[], dict[str, Any]]) -> None:
        self._common = common

    def hello(self) -> dict[str, Any]:
        return {
            'type': 'hello',
            'version': __version__,
            'mode': 'live',
            'rig': '',
            'parameters': [],
            'presets': [],
            'window': 30.0,
            'can_record': False,
            'static_deflection': 0.0,
            'one_sided': False,
            **self._common(),
        }

    def frame(self, view: View) -> bytes | None:
        del view
        return None

    async def handle(self, message: dict[str, Any], session: Session) -> dict[str, Any] | None:
        del session
        if message['type'] == 'theory':
            return None
        raise Refusal('there is no rig in the network')


class PageServer:
    """
    The server.

    Parameters
    ----------
    gate : Gate
        Who may use it.
    recordings : Recordings
        What it plays and hands out.
    network : Network, optional
        The ROS network; without it recordings are played only.
    no_answer : type of Exception, optional
        What links raise if a node does not answer.
    node : str, optional
        The rig to show first.

    Attributes
    ----------
    gate : Gate
        As given.
    """

    def __init__(
        self,
        gate: Gate,
        recordings: Recordings,
        network: Network | None = None,
        no_answer: type[Exception] = TimeoutError,
        node: str = '',
    ) -> None:
        self.gate = gate
        self.recordings = recordings
        self._network = network
        self._no_answer = no_answer
        self._node = node
        self._presets = list(load_presets())
        self._sources: dict[str, LiveSource] = {}
        self._left_at: dict[str, float] = {}
        self._sessions: set[Session] = set()
        self._rigs: list[str] = []
        self._listed = json.dumps([])
        self._list: list[dict[str, Any]] = []
        self._looked = self._listed_at = 0.0
        self._failed = -_COMPLAINT_PERIOD_S
        self._tasks: set[asyncio.Task[Any]] = set()
        # These are not cancelled: processes end meanwhile.
        self._endings: set[asyncio.Task[Any]] = set()
        self._http: HTTPServer | None = None
        self._read_last: tuple[object, Recorded] | None = None

    # Start and end

    async def start(self, port: int) -> None:
        """
        Listen.

        Raises
        ------
        OSError
            If the port is taken.
        """
        sockets = bind_sockets(port, self.gate.host)
        self.gate.port = sockets[0].getsockname()[1]
        self._http = HTTPServer(self._application(), max_body_size=LONGEST_MESSAGE)
        self._http.add_sockets(sockets)
        self._look_for_rigs()
        self._spawn(self._run())

    async def close(self) -> None:
        """End all."""
        if self._http is not None:
            self._http.stop()
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        for session in list(self._sessions):
            session.outbox.close()
            self.leave(session)
        if self._http is not None:
            await self._http.close_all_connections()
        await asyncio.gather(*self._endings, return_exceptions=True)
        for source in self._sources.values():
            await source.close()
        if self._network is not None:
            self._network.close()
        self.recordings.close()

    def _application(self) -> Application:
        own = {'server': self}
        return Application(
            [
                (r'/', _Index, own),
                (r'/favicon.ico', _Nothing, own),
                (r'/static/(.*)', _Static, {'path': str(STATIC), **own}),
                (r'/presets', _Presets, own),
                (r'/recordings', _List, own),
                (r'/recordings/([^/]+)/download', _Download, own),
                (r'/recordings/([^/]+)/compare', _Compare, own),
                (r'/reports/([^/]+)/([^/]+)', _Report, own),
                (r'/ws', _Socket, own),
            ],
            default_handler_class=_Missing,
            default_handler_args=own,
            websocket_max_message_size=LONGEST_MESSAGE,
            websocket_ping_interval=20,
            log_function=lambda _: None,
        )

    def _spawn(self, work: Any) -> None:
        _keep(asyncio.ensure_future(work), self._tasks)

    def _end(self, source: LiveSource | Player) -> None:
        _keep(asyncio.ensure_future(source.close()), self._endings)

    # The tick

    async def _run(self) -> None:
        due = time.monotonic()
        while True:
            now = time.monotonic()
            # A tick that is missed is missed.
            period = 1.0 / _FRAMES_PER_SECOND if self._sessions else _IDLE_PERIOD_S
            due = max(due + period, now)
            await asyncio.sleep(due - now)
            try:
                self._tick()
            except Exception:  # what one message holds must not stop the others
                if now > self._failed + _COMPLAINT_PERIOD_S:
                    self._failed = now
                    traceback.print_exc()

    def _tick(self) -> None:
        now = time.monotonic()
        for source in self._sources.values():
            source.tick()
        for session in list(self._sessions):
            if not isinstance(session.source, LiveSource):
                session.pump()
        if now > self._looked + _LOOK_PERIOD_S:
            self._looked = now
            self._look_for_rigs()
            self._leave_rigs(now)
        if self._sessions and now > self._listed_at + _LIST_PERIOD_S:
            self._listed_at = now
            self._spawn(self.list_recordings())

    def _look_for_rigs(self) -> None:
        if self._network is None:
            return
        rigs = self._network.rigs()
        if rigs != self._rigs:
            self._rigs = rigs
            self._send({'type': 'rigs', 'list': rigs})
        waiting = [s for s in self._sessions if isinstance(s.source, _NoRig)]
        if rigs and waiting:
            for session in waiting:
                self._show(session, rigs[0])
                session.greet()

    def _leave_rigs(self, now: float) -> None:
        for name, source in list(self._sources.items()):
            if source.sessions:
                self._left_at[name] = now
            elif now > self._left_at.get(name, now) + _KEPT_S:
                self._end(self._sources.pop(name))
                self._left_at.pop(name, None)

    async def list_recordings(self) -> list[dict[str, Any]]:
        """Return the recordings, and say so to the pages if there are others."""
        # By a thread: a slow disk must not hold up the frames.
        loop = asyncio.get_running_loop()
        self._list = await loop.run_in_executor(None, self.recordings.list)
        listed = json.dumps(self._list)
        if listed != self._listed:
            self._listed = listed
            self._send({'type': 'recordings', 'list': self._list})
        return self._list

    def _send(self, message: dict[str, Any]) -> None:
        for session in list(self._sessions):
            session.outbox.put(message)

    # Pages

    def _common(self) -> dict[str, Any]:
        return {'rigs': self._rigs, 'recordings': self._list}

    def _source(self, rig: str) -> LiveSource:
        assert self._network is not None
        if rig not in self._sources:
            self._sources[rig] = LiveSource(
                self._network.join(rig), self._no_answer, self._presets, self._common
            )
            self._left_at[rig] = time.monotonic()
        return self._sources[rig]

    def _show(self, session: Session, rig: str) -> None:
        source = self._source(rig)
        session.source = source
        source.sessions.add(session)
        source.greet(session)

    async def open(self, socket: Any, rig: str, bag: str) -> Session:
        """
        Begin to show something to a page.

        Raises
        ------
        Refusal
            If there is no such thing.
        """
        await self.list_recordings()
        if not bag and self._network is None:
            # The newest
            bag = next((entry['name'] for entry in self._list), '')
        if bag:
            return await self._play(socket, bag)
        if self._network is None:
            raise Refusal('there is no recording here, and no ROS')
        rig = rig or self._node or (self._rigs[0] if self._rigs else '')
        if rig and rig not in self._rigs and rig not in (self._node, *self._sources):
            raise Refusal(f'there is no rig {rig[:200]}')
        source: Any = self._source(rig) if rig else _NoRig(self._common)
        session = Session(socket, source)
        self._sessions.add(session)
        if isinstance(source, LiveSource):
            source.sessions.add(session)
            source.greet(session)
        else:
            session.outbox.put({'type': 'status', 'state': 'gone', 'text': 'no rig', 'time': None})
        return session

    async def _play(self, socket: Any, bag: str) -> Session:
        """Begin to play a recording to a page."""
        loop = asyncio.get_running_loop()
        try:
            path = self.recordings.path(bag)
            # Read by a thread; the frames of the others go on.
            recorded = await loop.run_in_executor(None, self._read, path)
        except (LookupError, RecordingError, ValueError) as error:
            raise Refusal(str(error)) from error
        player = Player(bag, path, recorded, self._common)
        session = Session(socket, player)
        self._sessions.add(session)
        player.begin(session)
        return session

    def _read(self, path: Path) -> Recorded:
        """Read a recording, unless it has just been read and is as it was."""
        files = bag_files(path)
        key = path, tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)
        if self._read_last is None or self._read_last[0] != key:
            self._read_last = key, load_recording(path)
        return self._read_last[1]

    def leave(self, session: Session) -> None:
        """Forget a page."""
        if session in self._sessions and isinstance(session.source, Player):
            self._end(session.source)
        self._sessions.discard(session)
        if isinstance(session.source, LiveSource):
            session.source.sessions.discard(session)

    def compare(self, name: str) -> bool:
        """Start a comparison, whose end all pages hear of."""
        if not self.recordings.start_comparison(name):
            return False

        async def work() -> None:
            self._send(await self.recordings.compare(name))

        self._spawn(work())
        return True

    def presets(self) -> list[dict[str, Any]]:
        """Return the presets with all their values."""
        return [p.as_dict() | {'values': p.all_values()} for p in self._presets]


def _keep(task: asyncio.Task[Any], tasks: set[asyncio.Task[Any]]) -> None:
    """Keep a task until it is done."""
    tasks.add(task)
    task.add_done_callback(tasks.discard)


class _Guarded(RequestHandler):
    """A request that the gate has let in, answered with headers that keep foreign things out."""

    policy = _POLICY

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
        if request.method not in ('GET', 'HEAD') and origin is None:
            raise HTTPError(403, reason='Origin is missing')
        given = self.get_query_argument('token', None), self.get_cookie(gate.cookie)
        if not gate.accepts_token(*given):
            raise HTTPError(403, reason='The token is missing: open the address with it')

    def write_error(self, status_code: int, **kwargs: Any) -> None:
        del kwargs
        self.set_header('Content-Type', 'text/plain; charset=utf-8')
        self.finish(f'{status_code} {self._reason}\n')

    def answer(self, value: Any) -> None:
        """Answer in JSON."""
        self.set_header('Content-Type', 'application/json; charset=utf-8')
        self.finish(json.dumps(value, allow_nan=False))


class _Index(_Guarded):
    def get(self) -> None:
        gate = self.server.gate
        if gate.token and self.get_query_argument('token', None) is not None:
            # Kept in a cookie that scripts cannot read, and out of addresses that are passed on
            self.set_cookie(gate.cookie, gate.token, httponly=True, samesite='Strict', path='/')
            self.redirect('/')
            return
        self.set_header('Content-Type', 'text/html; charset=utf-8')
        try:
            self.finish((STATIC / 'index.html').read_bytes())
        except OSError:
            raise HTTPError(404) from None


class _Nothing(_Guarded):
    def get(self) -> None:
        self.set_status(204)


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


class _Presets(_Guarded):
    def get(self) -> None:
        self.answer(self.server.presets())


class _List(_Guarded):
    async def get(self) -> None:
        self.answer(await self.server.list_recordings())


class _Files(_Guarded):
    async def hand_out(self, path: Path) -> None:
        self.set_header('Content-Length', path.stat().st_size)
        if self.request.method == 'HEAD':
            return
        with path.open('rb') as stream:
            while piece := stream.read(_PIECE):
                self.write(piece)
                await self.flush()


class _Download(_Files):
    async def get(self, name: str) -> None:
        try:
            path = self.server.recordings.file(unquote(name))
        except LookupError:
            raise HTTPError(404) from None
        plain = ''.join(sign if sign.isalnum() or sign in '._-' else '_' for sign in path.name)
        plain = plain.encode('ascii', 'replace').decode().replace('?', '_')
        self.set_header('Content-Type', 'application/octet-stream')
        self.set_header('Content-Disposition', f'attachment; filename="{plain}"')
        await self.hand_out(path)


class _Compare(_Guarded):
    def post(self, name: str) -> None:
        try:
            started = self.server.compare(unquote(name))
        except LookupError:
            raise HTTPError(404) from None
        self.set_status(202 if started else 409)
        self.answer({'started': started})


class _Report(_Files):
    policy = _REPORT_POLICY

    async def get(self, name: str, file: str) -> None:
        try:
            path = self.server.recordings.report(unquote(name), file)
        except LookupError:
            raise HTTPError(404) from None
        kind = 'text/html' if path.suffix == '.html' else 'application/json'
        self.set_header('Content-Type', f'{kind}; charset=utf-8')
        await self.hand_out(path)


class _Socket(_Guarded, WebSocketHandler):
    session: Session | None = None

    def check_origin(self, origin: str) -> bool:
        return self.server.gate.accepts_origin(origin, self.request.headers['Host'])

    async def open(self, *args: str, **kwargs: str) -> None:
        del args, kwargs
        self.set_nodelay(True)
        connection = self.ws_connection
        stream = getattr(connection, 'stream', None)
        if stream is not None and stream.socket is not None:
            # What the kernel holds of a page that does not read is old when it reads again.
            stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        rig, bag = (self.get_query_argument(name, '') for name in ('rig', 'bag'))
        try:
            self.session = await self.server.open(self, rig, bag)
        except Refusal as refusal:
            text = json.dumps({'type': 'status', 'state': 'gone', 'text': str(refusal)[:2000]})
            await self.write_message(text)
            self.close(4404, 'there is no such thing')
        else:
            if self.ws_connection is None or self.ws_connection.is_closing():
                self.on_close()

    async def on_message(self, message: str | bytes) -> None:
        if self.session is not None:
            await self.session.take(message)

    def on_close(self) -> None:
        if self.session is not None:
            self.server.leave(self.session)
