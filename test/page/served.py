"""What a browser does with the server: requests, a WebSocket, and frames taken apart."""

import asyncio
import contextlib
import functools
import json
from dataclasses import dataclass

import numpy as np
from running import DEADLINE_S
from tornado.httpclient import AsyncHTTPClient, HTTPRequest
from tornado.websocket import websocket_connect

from impact_damper_ros.page.frames import HEADER, TABLES
from impact_damper_ros.page.gate import Gate
from impact_damper_ros.page.recordings import Recordings
from impact_damper_ros.page.server import PageServer

from .fake_rig import FakeLink, FakeNetwork


def in_loop(test):
    """Run a test that is a coroutine in an event loop."""

    @functools.wraps(test)
    def run(*args, **kwargs):
        asyncio.run(test(*args, **kwargs))

    return run


@dataclass
class Frame:
    flags: int
    end: float
    epoch: float
    samples: np.ndarray
    impacts: np.ndarray
    measured: np.ndarray
    acts: np.ndarray
    ghost_samples: np.ndarray
    ghost_impacts: np.ndarray

    @property
    def state(self):
        """The last sample that is not later than the end, without its time."""
        return self.samples[self.samples[:, 0] <= 1e-6][-1, 1:]


def taken_apart(content):
    """Return a frame as the page reads it."""
    kind, flags, *counts, end, epoch = HEADER.unpack_from(content)
    assert kind == 3
    numbers = np.frombuffer(content[HEADER.size :], '<f4')
    widths = [len(columns) for columns in TABLES.values()]
    sizes = [count * width for count, width in zip(counts, widths, strict=True)]
    assert sum(sizes) == len(numbers)
    tables = np.split(numbers, np.cumsum(sizes)[:-1])
    parts = [t.reshape(-1, width) for t, width in zip(tables, widths, strict=True)]
    return Frame(flags, end, epoch, *parts)


class Page:
    """A page with its WebSocket; it keeps what comes."""

    def __init__(self, socket):
        self.socket = socket
        self.messages = []
        self.frames = []
        self.closed = None
        self._count = 0
        self._changed = asyncio.Condition()
        self._task = asyncio.ensure_future(self._read())

    async def _read(self):
        while True:
            content = await self.socket.read_message()
            async with self._changed:
                if content is None:
                    # Without a code where the connection broke
                    self.closed = self.socket.close_code or 1006
                elif isinstance(content, bytes):
                    self.frames.append(taken_apart(content))
                else:
                    self.messages.append(json.loads(content))
                self._changed.notify_all()
            if content is None:
                return

    async def until(self, condition, what='it did not happen'):
        """Wait for something and return it."""
        try:
            async with asyncio.timeout(DEADLINE_S), self._changed:
                while not (value := condition()):
                    assert self.closed is None or condition(), f'closed: {self.messages[-1:]}'
                    await self._changed.wait()
                return value
        except TimeoutError:
            last = [str(message)[:300] for message in self.messages[-3:]]
            raise AssertionError(f'{what}; {len(self.frames)} frames, {last}') from None

    def of(self, kind):
        return [message for message in self.messages if message['type'] == kind]

    async def next(self, kind, after=0, **wanted):
        """Wait for a message of a kind with some values, after so many of the kind."""

        def found():
            for message in self.of(kind)[after:]:
                if all(message.get(name) == value for name, value in wanted.items()):
                    return message
            return None

        return await self.until(found, f'no {kind} with {wanted}')

    async def send(self, **message):
        await self.socket.write_message(json.dumps(message))

    async def ask(self, **message):
        """Send a request and return its result."""
        self._count += 1
        await self.send(id=self._count, **message)

        def found():
            return [m for m in self.of('answer') if m['id'] == self._count]

        answer = (await self.until(found, f'no answer to {message}'))[0]
        return answer['ok'], answer['reason']

    async def close(self):
        self.socket.close()
        with contextlib.suppress(asyncio.CancelledError):
            await self._task


@contextlib.asynccontextmanager
async def serving(directory, network=None, **options):
    """Run a server; yield it."""
    gate = Gate(options.pop('host', '127.0.0.1'))
    server = PageServer(gate, Recordings(directory), network, **options)
    await server.start(0)
    try:
        yield server
    finally:
        await server.close()


def url(server, path, scheme='http'):
    """Return an address of a server, or of one that is a process of its own."""
    port = server.gate.port if isinstance(server, PageServer) else server.port
    return f'{scheme}://127.0.0.1:{port}{path}'


async def get(server, path, *, headers=None, method='GET', body=None):
    """Return the answer to a request, whatever its code."""
    request = HTTPRequest(
        url(server, path),
        method=method,
        headers=headers or {},
        body=body,
        follow_redirects=False,
        request_timeout=DEADLINE_S,
    )
    return await AsyncHTTPClient().fetch(request, raise_error=False)


@contextlib.asynccontextmanager
async def opened(server, path='/ws', headers=None):
    """Open a page; yield it."""
    request = HTTPRequest(url(server, path, 'ws'), headers=headers or {})
    page = Page(await websocket_connect(request))
    try:
        yield page
    finally:
        await page.close()


def started(link):
    """Return the link to a rig that has run for a while."""
    link.run(20.0)
    return link


@contextlib.asynccontextmanager
async def live_page(directory, link=None):
    """Show a rig that has run for a while to a page; yield its link and the page."""
    link = started(link or FakeLink())
    async with serving(directory, FakeNetwork(link)) as server, opened(server) as page:
        yield link, page
