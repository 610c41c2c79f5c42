"""The simulator with an account of its modes, which events alone do not tell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .mode import Mode
from .origin import Origin
from .simulator import Simulator

__all__ = ['AccountedSimulator', 'ModeAccount']


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
    """A `Simulator` that tells the time spent in each mode; see there."""

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
