"""The HTTP and WebSocket handlers of the server."""

from __future__ import annotations

import asyncio
import json
import socket
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

from tornado.web import Application, HTTPError, RequestHandler, StaticFileHandler
from tornado.websocket import WebSocketHandler

from .session import LONGEST_MESSAGE, RequestError, Session

if TYPE_CHECKING:
    from .server import PageServer

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
_SEND_BUFFER = 256 * 1024
_PIECE = 256 * 1024


class _Guarded(RequestHandler):
    """A request that passes the gate, answered with restrictive security headers."""

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
            path = await asyncio.to_thread(self.server.recordings.file, unquote(name))
        except LookupError:
            raise HTTPError(404) from None
        plain = ''.join(sign if sign.isalnum() or sign in '._-' else '_' for sign in path.name)
        plain = plain.encode('ascii', 'replace').decode().replace('?', '_')
        self.set_header('Content-Type', 'application/octet-stream')
        self.set_header('Content-Disposition', f'attachment; filename="{plain}"')
        await self.hand_out(path)


class _Compare(_Guarded):
    async def post(self, name: str) -> None:
        try:
            started = await self.server.compare(unquote(name))
        except LookupError:
            raise HTTPError(404) from None
        self.set_status(202 if started else 409)
        self.answer({'started': started})

    def delete(self, name: str) -> None:
        ended = self.server.recordings.cancel_comparison(unquote(name))
        self.set_status(202 if ended else 409)
        self.answer({'ended': ended})


class _Report(_Files):
    policy = _REPORT_POLICY

    async def get(self, name: str, file: str) -> None:
        try:
            path = await asyncio.to_thread(self.server.recordings.report, unquote(name), file)
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
            # A small buffer: what it holds for a page that does not read is outdated afterwards.
            stream.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER)
        rig, bag = (self.get_query_argument(name, '') for name in ('rig', 'bag'))
        try:
            self.session = await self.server.open(self, rig, bag)
        except RequestError as error:
            text = json.dumps({'type': 'status', 'state': 'gone', 'text': str(error)[:2000]})
            await self.write_message(text)
            self.close(4404, 'not found')
        else:
            if self.ws_connection is None or self.ws_connection.is_closing():
                self.on_close()

    async def on_message(self, message: str | bytes) -> None:
        if self.session is not None:
            await self.session.take(message)

    def on_close(self) -> None:
        if self.session is not None:
            self.server.leave(self.session)


def application(server: PageServer) -> Application:
    """Return the application with all addresses of a server."""
    own = {'server': server}
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
