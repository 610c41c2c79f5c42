# SPDX-License-Identifier: Apache-2.0
"""Theory from a process of low priority: requests to it, and its answers."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from .background import BackgroundCall
from .prediction import ObservedMotion, Prediction, failed_document


def _answers(*request: Any) -> Iterator[Any]:
    """Yield the answers to a request; the solvers are imported in the process that is for it."""
    from .documents import answers

    yield from answers(*request)


class TheoryProcess:
    """
    What theory says of the present rig, as far as it is known.

    A request is computed in a process of its own, which the next request ends. `poll` takes what
    it has sent, takes microseconds, and should be called some ten times a second while more is to
    come.

    Parameters
    ----------
    documents : bool, optional
        Whether documents are wanted from the beginning; see `want_documents`.
    compute : callable, optional
        What the process yields for a state, what was measured, and whether a document is wanted.

    Attributes
    ----------
    course : int
        Number of rigs that were asked for so far.
    prediction : Prediction or None
        The newest one for the last of them.
    document : str
        The newest document for it, JSON as `theory.documents` describes it; without entries as
        long as nothing is known.
    seconds : float
        Time from the request to the newest answer, s.
    done : bool
        Whether no more answers are to come.
    enabled : bool
        Whether anything is computed.
    """

    def __init__(
        self, *, documents: bool = False, compute: Callable[..., Iterator[Any]] = _answers
    ) -> None:
        self.course = 0
        self.prediction: Prediction | None = None
        self.document = json.dumps(failed_document(None, ''))
        self.seconds = 0.0
        self.done = self.enabled = True
        self._documents = documents
        self._compute = compute
        self._call: BackgroundCall | None = None
        # The newest request: its rig, what was measured on that, and when it was made
        self._state: Mapping[str, Any] | None = None
        self._measured: ObservedMotion | None = None
        self._documented = False
        self._began = 0.0

    @property
    def process(self) -> int:
        """Number of the process that computes; 0 if there is none."""
        return self._call.number if self._call is not None else 0

    def ask(self, state: Mapping[str, Any]) -> None:
        """Request the theory of a rig, given by the state of a snapshot, and forget the last."""
        self.course += 1
        self._state, self._measured = state, None
        self._forget()
        self._request()

    def ask_like(self, measured: ObservedMotion) -> None:
        """Request that of the same rig once more, given how it was measured to move."""
        self._measured = measured
        self._request()

    def want_documents(self, wanted: bool) -> None:
        """Choose whether documents are made; those of the present rig are made only once."""
        self._documents = wanted
        if wanted and not self._documented:
            self._request()

    def enable(self, enabled: bool) -> None:
        """Switch the computation on, or off."""
        if enabled != self.enabled:
            self.enabled = enabled
            self._forget()
            self._request()

    def poll(self) -> bool:
        """Take the answers that have come; return whether there are any."""
        call, news = self._call, False
        for answer in call.poll() if call is not None else ():
            self._take(answer)
            news = True
        if call is not None and call.end:
            if not self.done:
                self._take(Prediction(error=call.end))
                news = True
            self.close()
        return news

    def close(self) -> None:
        """End the process."""
        if self._call is not None:
            self._call.close()
            self._call = None

    def _forget(self, failure: str = '') -> None:
        self.prediction = None
        text = failure if self.enabled else 'theory is switched off: predict_motion is false'
        known = self._state['time'] if self._state is not None else None
        self.document = json.dumps(failed_document(known, text))

    def _request(self) -> None:
        self.close()
        self._documented = self._documents
        self._began = time.monotonic()
        self.done = self._state is None or not self.enabled
        if not self.done:
            request = self._state, self._measured, self._documents
            self._call = BackgroundCall(self._compute, *request)

    def _take(self, answer: Prediction | str | None) -> None:
        if answer is None:
            self.done = True
        elif isinstance(answer, str):
            self.document = answer
        elif answer.error:
            self._forget(answer.error)
            self.prediction = replace(answer, complete=True)
            self.done = True
        elif (
            answer.complete
            or answer.basis == 'measured'
            or self.prediction is None
            or not self.prediction.complete
        ):
            # Asked for once more, a search begins with less than what is known.
            self.prediction = answer
        self.seconds = time.monotonic() - self._began
