"""
The simulator for long runs with a controller: an account of its modes, and samples ahead.

Events alone do not tell the modes. Samples take most of the time of such a run; as long as nobody
touches the rig, those to come can be worked out at once by the compiled run loop.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .event import Event, Sample
from .loop import Loop, has_numba
from .mode import Mode
from .origin import Origin
from .parameters import InitialConditions, RigParameters
from .run_loop import DONE, Progress
from .simulator import Simulator
from .stretch import EVENT_TYPE

__all__ = ['AccountedSimulator', 'ModeAccount']

#: Most events that are gone through for samples ahead.
_MOST_INSTANTS = 1000


class ModeAccount(NamedTuple):
    """
    The modes of a rig over a time.

    Attributes
    ----------
    time_in_mode : ndarray of float, shape (8,)
        Time spent in each `Mode`, s.
    begins : ndarray of float, shape (n,)
        When a flight began, s; the first one is that under way at the beginning, at -infinity.
    modes : ndarray of int, shape (n,)
        Its mode.
    """

    time_in_mode: npt.NDArray[np.float64]
    begins: npt.NDArray[np.float64]
    modes: npt.NDArray[np.int64]

    def modes_after(self, times: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the mode after each of some instants; after the last event of one instant."""
        found: npt.NDArray[np.int64] = self.modes[
            np.searchsorted(self.begins, times, side='right') - 1
        ]
        return found


class AccountedSimulator(Simulator):
    """A `Simulator` that tells the time spent in each mode and can sample ahead; see there."""

    #: Samples ahead, the next one last.
    _ahead: list[list[float]] | None = None
    _loop: Loop | None = None
    _counted: float | None = None
    _spent: npt.NDArray[np.float64]
    _begun: list[tuple[float, int]]

    def _begin(self, origin: Origin) -> None:
        if self._counted is None:
            self._open(origin)
        else:
            self._count(origin.time)
            self._begun.append((origin.time, origin.mode))
        super()._begin(origin)

    def _open(self, origin: Origin) -> None:
        """Begin an account at the present time."""
        self._counted = self._time
        self._spent = np.zeros(len(Mode))
        self._begun = [(-np.inf, origin.mode)]

    def _count(self, time: float) -> None:
        """Put down the time up to an instant, which a change may place a digit early."""
        assert self._counted is not None
        if time > self._counted:
            self._spent[self._origin.mode] += time - self._counted
            self._counted = time

    def take_account(self) -> ModeAccount:
        """Return the account since this was last asked for, or since the start."""
        self._count(self._time)
        begins, modes = zip(*self._begun, strict=True)
        account = ModeAccount(self._spent, np.array(begins), np.array(modes, dtype=np.int64))
        self._open(self._origin)
        return account

    def sample_ahead(self, instants: npt.NDArray[np.float64]) -> None:
        """
        Work out the samples at instants ahead, for `sample` to return once they are reached.

        Parameters
        ----------
        instants : ndarray
            Ascending, s; not before the present time.

        Notes
        -----
        To the last bit they are what `sample` returns without this, if nobody does anything to
        the rig before; else they are forgotten. Without a compiler, or in a sweep, nothing is
        worked out.
        """
        self._ahead = []
        if self._parameters.sweep_mode != 'off' or not has_numba():
            return
        if self._loop is None or self._loop.machine is not self._machine:
            mass = self._parameters.damper_mass
            self._loop = Loop(self._machine, mass, compiled=True)
        rows = np.empty((len(instants), len(Sample._fields)))
        progress = self._loop.run(
            Progress(DONE, self._loop.packed(self._origin), self._time, 0, 0, 0),
            *(float(instants[-1]), instants, rows, np.empty(0, EVENT_TYPE), _MOST_INSTANTS),
            np.zeros(len(Mode)),
        )
        self._ahead = rows[: progress.sampled][::-1].tolist()

    def sample(self) -> Sample:
        """Return the motion at the present time, after any event at that instant."""
        ahead = self._ahead
        return Sample(*ahead[-1]) if ahead and self.knows else super().sample()

    @property
    def knows(self) -> bool:
        """Whether the sample at the present time has been worked out."""
        ahead = self._ahead
        while ahead and ahead[-1][0] < self._time:
            ahead.pop()
        return bool(ahead and ahead[-1][0] == self._time)

    def change(self, parameters: RigParameters) -> list[Event]:
        """Let new parameters take effect; see `Simulator.change`."""
        self._ahead = None
        return super().change(parameters)

    def move_stops(
        self, stop_1: float | None, stop_2: float | None, speed: float = np.inf
    ) -> list[Event]:
        """Let stops move; see `Simulator.move_stops`."""
        self._ahead = None
        return super().move_stops(stop_1, stop_2, speed)

    def reset(self, initial: InitialConditions | None = None) -> None:
        """Put the rig back; see `Simulator.reset`."""
        self._ahead = None
        super().reset(initial)
