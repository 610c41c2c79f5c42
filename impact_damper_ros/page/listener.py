# SPDX-License-Identifier: Apache-2.0
"""A server of HTTP with no more connections than it can serve."""

from __future__ import annotations

import asyncio
import resource
import socket
from collections.abc import Iterable
from typing import Any

from tornado.http1connection import HTTP1ServerConnection
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream

#: Time for which nobody is let in where there is no room, s.
_PAUSE_S = 0.25


def share_of_files(most: int) -> int:
    """Return a quarter of the files that this process may have open, but not more than `most`."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return most if limit == resource.RLIM_INFINITY else max(1, min(most, limit // 4))


class Listener(HTTPServer):
    """
    A server that closes its oldest idle connection for a new one; without one, that one waits.

    Tornado's own accepts without end: without a free file descriptor it is called for the waiting
    connection again and again. WebSockets do not count; the server bounds its pages.
    """

    #: Largest number of connections.
    most = 256
    _listening: list[socket.socket]
    #: Connections, the oldest first
    _streams: dict[IOStream, None]

    @property
    def count(self) -> int:
        """Present number of connections."""
        return len(self._streams)

    def add_sockets(self, sockets: Iterable[socket.socket]) -> None:
        """Accept connections of sockets that listen."""
        self._listening, self._streams = list(sockets), {}
        self._resume()

    def stop(self) -> None:
        """Accept no more."""
        self._pause()
        for listening in self._listening:
            listening.close()
        self._listening.clear()

    def _resume(self) -> None:
        for listening in self._listening:
            asyncio.get_running_loop().add_reader(listening, self._accept, listening)

    def _pause(self) -> None:
        for listening in self._listening:
            asyncio.get_running_loop().remove_reader(listening)

    def _accept(self, listening: socket.socket) -> None:
        """Accept one connection; there is another call for each further one."""
        if self._make_room():
            try:
                connection, address = listening.accept()
            except (BlockingIOError, ConnectionAbortedError):
                return
            except OSError:  # there is no file descriptor left
                pass
            else:
                self.handle_stream(IOStream(connection), address)
                return
        self._pause()
        asyncio.get_running_loop().call_later(_PAUSE_S, self._resume)

    def _make_room(self) -> bool:
        """Close an idle connection where there are too many; return whether there is room."""
        if self.count < self.most:
            return True
        idle = next((stream for stream in self._streams if stream.reading()), None)
        if idle is not None:
            del self._streams[idle]
            idle.close()
        return idle is not None

    def handle_stream(self, stream: IOStream, address: tuple[Any, ...]) -> None:
        """Serve a connection."""
        self._streams[stream] = None
        super().handle_stream(stream, address)

    def on_close(self, server_conn: object) -> None:
        """Forget a connection: it is closed, or a WebSocket by now."""
        assert isinstance(server_conn, HTTP1ServerConnection)
        self._streams.pop(server_conn.stream, None)
        super().on_close(server_conn)
