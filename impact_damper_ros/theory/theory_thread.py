# SPDX-License-Identifier: Apache-2.0
"""Theory in a thread: requests to it, and its answers."""

from __future__ import annotations

import gc
import threading
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from .prediction import ObservedMotion, Prediction, failed_document

#: Time for which the other motions of a rig wait for the next request, s.
_QUIET_S = 0.2
_OFF = 'theory is switched off: predict_motion is false'


class _Request(NamedTuple):
    """A request: a rig, the motion measured on it, and whether a document is wanted."""

    state: Mapping[str, Any]
    measured: ObservedMotion | None
    documented: bool


class TheoryThread:
    """
    The theory of the present rig.

    A request is computed in a thread, whose kernels hold no lock of the interpreter. A newer
    request takes its place as soon as the older one has an answer. The methods return at once.

    Parameters
    ----------
    on_answer : callable, optional
        Called from the thread after each answer.

    Attributes
    ----------
    rigs_requested : int
        Number of requested rigs so far.
    prediction : Prediction or None
        The newest prediction for the last of these rigs; None until there is one.
    document : str
        The newest document, JSON as `theory.documents` describes it; of an earlier rig until
        there is one for the last.
    done : bool
        Whether no more answers are to come.
    enabled : bool
        Whether the theory is computed.
    """

    def __init__(self, on_answer: Callable[[], object] = lambda: None) -> None:
        self.rigs_requested = 0
        self.prediction: Prediction | None = None
        self.document = failed_document(None, '')
        self.done = self.enabled = True
        self._on_answer = on_answer
        self._documents = self._closed = False
        # The newest request, as long as it counts, and whether it waits to be begun
        self._request: _Request | None = None
        self._waiting = False
        self._condition = threading.Condition()
        self._thread = threading.Thread(target=self._run, name='theory', daemon=True)
        self._thread.start()

    def ask(self, state: Mapping[str, Any]) -> None:
        """Request the theory of a rig, given by a snapshot's state, in place of the last one."""
        with self._condition:
            self.rigs_requested += 1
            self._request = _Request(state, None, self._documents)
            # The document stays until there is another one: its time is that of its rig.
            self.prediction = None
            self._begin()

    def ask_like(self, measured: ObservedMotion) -> None:
        """Request the theory of the same rig once more, given its measured motion."""
        with self._condition:
            if self._request is not None:
                self._request = self._request._replace(measured=measured)
                self._begin()

    def want_documents(self, wanted: bool) -> None:
        """Choose whether documents are made; those of the present rig are made only once."""
        with self._condition:
            self._documents = wanted
            if wanted and self._request is not None and not self._request.documented:
                self._begin()

    def enable(self, enabled: bool) -> None:
        """Switch the computation on, or off."""
        with self._condition:
            if enabled != self.enabled:
                self.enabled = enabled
                self.prediction = None
                known = self._request and self._request.state['time']
                self.document = failed_document(known, '' if enabled else _OFF)
                self._begin()

    def close(self) -> None:
        """End the thread, once it has its present answer."""
        with self._condition:
            self._closed = True
            self._condition.notify()

    def _begin(self) -> None:
        """Let the thread begin with the newest request."""
        if self._request is not None:
            self._request = self._request._replace(documented=self._documents)
        self._waiting = self.enabled and self._request is not None
        self.done = not self._waiting
        self._condition.notify()

    # The thread

    def _run(self) -> None:
        # The modules of theory take seconds to load: they are loaded in the thread.
        from .documents import answers

        loaded = False
        while True:
            with self._condition:
                self._condition.wait_for(lambda: self._waiting or self._closed)
                request, self._waiting = self._request, False
            if self._closed or request is None:
                return
            for answer in answers(request.state, request.measured, request.documented):
                with self._condition:
                    if self._closed or request is not self._request or not self.enabled:
                        break
                    self.prediction, document = answer
                    self.document = document or self.document
                    self.done = self.prediction.complete
                self._on_answer()
                with self._condition:
                    # While a knob is turned, the next request comes first.
                    if self._condition.wait_for(lambda: self._waiting or self._closed, _QUIET_S):
                        break
            if not loaded:
                # The garbage collector need not visit everything that has been loaded.
                gc.freeze()
                loaded = True
