# SPDX-License-Identifier: Apache-2.0
"""Theory from a process of low priority: requests to it, its answers, and a new one if it ends."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from .child_process import ChildProcess
from .prediction import ObservedMotion, Prediction

#: Pause before a process that has ended is started again; doubled each time, up to the second
#: number, until one answers.
BACK_OFF_S, LONGEST_BACK_OFF_S = 0.5, 60.0
_WORKER = ('-m', 'impact_damper_ros.theory.worker')


def failed_document(time: float | None, text: str) -> dict[str, Any]:
    """Return the document of a rig for which there is no theory."""
    reason = {'type': 'theory_failed', 'text': text} if text else None
    return {'time': time, 'orbit': None, 'gap_curve': None, 'theory_failed': reason}


class TheoryProcess:
    """
    What theory says of the present rig, as far as it is known.

    There is no thread: `poll` takes what the process has sent, and starts it if there is none. It
    takes microseconds, and should be called some ten times a second while more is to come.

    Parameters
    ----------
    documents : bool, optional
        Whether documents are wanted from the beginning; see `want_documents`.
    warn : callable, optional
        Takes a text when the process has ended.
    command : sequence of str, optional
        What the process runs.

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
    restarts : int
        How often a process has been replaced.
    trouble : str
        Why there is no process at present; empty if there is one, or none is needed.
    last_trouble : str
        Why the last process ended, if one did.
    """

    def __init__(
        self,
        *,
        documents: bool = False,
        warn: Callable[[str], object] = lambda _: None,
        command: Sequence[str] = _WORKER,
    ) -> None:
        self.course = 0
        self.prediction: Prediction | None = None
        self.document = json.dumps(failed_document(None, ''))
        self.seconds = 0.0
        self.done = self.enabled = True
        self.restarts = 0
        self.trouble = self.last_trouble = ''
        self._documents = documents
        self._warn = warn
        self._command = command
        self._child: ChildProcess | None = None
        # The newest request: its number, its rig, what was measured on that, and when it was made
        self._number = 0
        self._state: Mapping[str, Any] | None = None
        self._measured: ObservedMotion | None = None
        self._documented = False
        self._began = 0.0
        self._pause, self._due = BACK_OFF_S, 0.0

    @property
    def process(self) -> int:
        """Number of the process; 0 if there is none."""
        return self._child.number if self._child is not None else 0

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
        """Switch the process on, or off."""
        if enabled == self.enabled:
            return
        self.enabled, self.trouble = enabled, ''
        self._pause, self._due = BACK_OFF_S, 0.0
        self._forget()
        self._request()
        if not enabled:
            self.close()

    def poll(self) -> bool:
        """Take the answers that have come; return whether there are any, or a new trouble."""
        if self._child is None:
            if not self.enabled or self._state is None or time.monotonic() < self._due:
                return False
            return self._start()
        news = False
        for number, answer in self._child.poll():
            if number == self._number:
                self._take(answer)
                news = True
        if end := self._child.end:
            self.close()
            self._fail(f'the process of the theory has ended {end}')
        return news or bool(end)

    def close(self) -> None:
        """End the process."""
        if self._child is not None:
            self._child.close()
            self._child = None

    def _forget(self, failure: str = '') -> None:
        self.prediction = None
        text = failure if self.enabled else 'theory is switched off: predict_motion is false'
        known = self._state['time'] if self._state is not None else None
        self.document = json.dumps(failed_document(known, text))

    def _request(self) -> None:
        self._documented = self._documents
        self._number += 1
        self._began = time.monotonic()
        self.done = self._state is None or not self.enabled
        if self._child is not None and not self.done:
            self._child.send((self._number, self._state, self._measured, self._documents))

    def _take(self, answer: Prediction | str | None) -> None:
        self._pause = BACK_OFF_S
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

    def _start(self) -> bool:
        """Start the process with the newest request; return whether that failed."""
        try:
            self._child = ChildProcess(*self._command)
        except OSError as error:
            self._fail(f'the process of the theory cannot be started: {error}')
            return True
        self.trouble = ''
        if not self.done:
            self._request()
        return False

    def _fail(self, trouble: str) -> None:
        self.last_trouble = trouble
        self.trouble = f'{trouble}; it is started again after {self._pause:g} s'
        self._due = time.monotonic() + self._pause
        self._pause = min(2.0 * self._pause, LONGEST_BACK_OFF_S)
        self.restarts += 1
        self._warn(self.trouble)
