"""The server: the pages, their sources, and the tick that sends frames."""

from __future__ import annotations

import asyncio
import json
import time
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any, Protocol

from tornado.httpserver import HTTPServer
from tornado.netutil import bind_sockets

from impact_damper_ros import __version__
from impact_damper_ros.bag import RecordingError
from impact_damper_ros.bag.run_reader import bag_files
from impact_damper_ros.rig.quoting import counted

from .frames import View
from .gate import Gate
from .handlers import application
from .live import Link
from .live_source import LiveSource
from .player import Player
from .presets import load_presets
from .recorded import Recording, load_recording
from .recordings import Recordings
from .session import LONGEST_MESSAGE, RequestError, Session

_FRAMES_PER_SECOND = 60.0
#: Period of the tick while no page is open, s.
_IDLE_PERIOD_S = 0.25
_LOOK_PERIOD_S = 1.0
#: Time for which a rig without pages is kept, s, so that a reloaded page has its traces.
_KEPT_S = 30.0
_LIST_PERIOD_S = 2.0
_COMPLAINT_PERIOD_S = 10.0
#: Largest number of pages; more would slow one another down.
_MOST_PAGES = 100


class Network(Protocol):
    """The ROS network; see `ros_client.RosClient`."""

    def rigs(self) -> list[str]:
        """Return the nodes that are rigs."""

    def join(self, rig: str) -> Link:
        """Return a link to a rig."""

    def close(self) -> None:
        """Leave the network."""


class _NoRig:
    """The source of a page while there is no rig."""

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
        raise RequestError('there is no rig on the network')


class PageServer:
    """
    The server.

    Parameters
    ----------
    gate : Gate
        Access control.
    recordings : Recordings
        The recordings to play and to download.
    network : Network, optional
        The ROS network; without it only recordings can be shown.
    no_answer : type of Exception, optional
        The exception that links raise if a node does not answer.
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
        self._read_last: tuple[object, Recording] | None = None

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
        self._http = HTTPServer(application(self), max_body_size=LONGEST_MESSAGE)
        self._http.add_sockets(sockets)
        self._look_for_rigs()
        self._spawn(self._run())

    async def close(self) -> None:
        """Stop the server, and leave the network."""
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
            self._try(self._tick)

    def _try(self, work: Callable[[], None]) -> None:
        """Do a part of the tick: a bad message must not stop the others."""
        try:
            work()
        except Exception:
            now = time.monotonic()
            if now > self._failed + _COMPLAINT_PERIOD_S:
                self._failed = now
                traceback.print_exc()

    def _tick(self) -> None:
        now = time.monotonic()
        for source in self._sources.values():
            self._try(source.tick)
        for session in list(self._sessions):
            if not isinstance(session.source, LiveSource):
                self._try(session.pump)
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
        """Return the recordings, and send the list to the pages if it has changed."""
        # In a thread: a slow disk must not delay the frames.
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
        Open a session that shows a rig or a recording.

        Raises
        ------
        RequestError
            If it does not exist, or too many pages are open.
        """
        if len(self._sessions) >= _MOST_PAGES:
            raise RequestError(
                f'{counted(_MOST_PAGES, "page")} open already: close one, and reload this one'
            )
        await self.list_recordings()
        if not bag and self._network is None:
            # The newest
            bag = next((entry['name'] for entry in self._list), '')
        if bag:
            return await self._play(socket, bag)
        if self._network is None:
            raise RequestError('there is no recording to play, and the page runs without ROS')
        rig = rig or self._node or (self._rigs[0] if self._rigs else '')
        if rig and rig not in self._rigs and rig not in (self._node, *self._sources):
            raise RequestError(f'there is no rig {rig[:200]}')
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
        """Open a session that plays a recording."""
        try:
            # In a thread: the frames of the other pages go on.
            path, recorded = await asyncio.to_thread(self._read, bag)
        except (LookupError, RecordingError, ValueError) as error:
            raise RequestError(str(error)) from error
        player = Player(bag, path, recorded, self._common)
        session = Session(socket, player)
        self._sessions.add(session)
        player.begin(session)
        return session

    def _read(self, bag: str) -> tuple[Path, Recording]:
        """Read a recording; the last one is cached while its files do not change."""
        path = self.recordings.path(bag)
        files = bag_files(path)
        key = path, tuple((f.name, f.stat().st_size, f.stat().st_mtime_ns) for f in files)
        if self._read_last is None or self._read_last[0] != key:
            self._read_last = key, load_recording(path)
        return path, self._read_last[1]

    def leave(self, session: Session) -> None:
        """Close the session of a page."""
        if session in self._sessions and isinstance(session.source, Player):
            self._end(session.source)
        self._sessions.discard(session)
        if isinstance(session.source, LiveSource):
            session.source.sessions.discard(session)

    async def compare(self, name: str) -> bool:
        """Start a comparison, whose result is sent to all pages; return whether it began."""
        path = await asyncio.to_thread(self.recordings.path, name)
        if not self.recordings.start_comparison(name):
            return False

        async def work() -> None:
            self._send(await self.recordings.compare(path))

        self._spawn(work())
        return True

    def presets(self) -> list[dict[str, Any]]:
        """Return the presets with all their values."""
        return [p.as_dict() | {'values': p.all_values()} for p in self._presets]


def _keep(task: asyncio.Task[Any], tasks: set[asyncio.Task[Any]]) -> None:
    """Hold a reference to a task until it is done."""
    tasks.add(task)
    task.add_done_callback(tasks.discard)
