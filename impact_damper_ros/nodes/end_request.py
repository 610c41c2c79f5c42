"""
SIGINT, SIGTERM and SIGHUP as one request to end, however often they come.

rclpy's own signal handler wakes executors and shuts ROS down from a thread of its own, for each
signal anew. A second signal, while the node is being taken apart after the first, finds guard
conditions that are just being freed, and the process crashes. Here a signal only writes a byte
into a socket, whatever the process is doing, and the node takes itself apart in its own order.
A SIGHUP, of a terminal that is gone, is ignored if the process was started so, as nohup does.
"""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Callable

__all__ = ['EndRequest']

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class EndRequest:
    """
    Take the signals that end a process, and note that one has come; from the main thread only.

    There is one in a process. What the signals did before does not come back: they are ignored
    from `close` on, since an impatient one must not spoil the exit code.
    """

    def __init__(self) -> None:
        """Take the signals from now on."""
        self._received = threading.Event()
        self._wake: Callable[[], object] | None = None
        self._waking = threading.Lock()
        self._reading, self._writing = socket.socketpair()
        self._writing.setblocking(False)
        # Python writes to the socket at once, also while the main thread waits in foreign code;
        # the handler itself comes later and has nothing left to do. Of a signal without any
        # handler of Python nothing would be written.
        signal.set_wakeup_fd(self._writing.fileno(), warn_on_full_buffer=False)
        for number in SIGNALS:
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
                signal.signal(number, lambda *_: None)
        self._thread = threading.Thread(target=self._listen, name='signals', daemon=True)
        self._thread.start()

    @property
    def received(self) -> bool:
        """Whether the process has been told to end."""
        return self._received.is_set()

    def wake_with(self, wake: Callable[[], object] | None) -> None:
        """Call this from another thread when a signal comes; once returned, nothing else."""
        with self._waking:
            self._wake = wake

    def close(self) -> None:
        """Ignore the signals from now on."""
        signal.set_wakeup_fd(-1)
        for number in SIGNALS:
            signal.signal(number, signal.SIG_IGN)
        self._writing.close()
        self._thread.join()
        self._reading.close()

    def _listen(self) -> None:
        while self._reading.recv(64):
            self._received.set()
            with self._waking:
                if self._wake is not None:
                    self._wake()
