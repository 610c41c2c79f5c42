"""
Long runs of a rig under gap control: samples and events as arrays, as of a `LongRun`.

Samples for the control take most of the time of such a run. Until the next command, those to come
are computed together by the compiled run loop.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig import GapControlParameters
from impact_damper_ros.rig.event import Event, Sample
from impact_damper_ros.rig.hybrid_motion import RunawayError
from impact_damper_ros.rig.long_run import (
    EVENT_TYPE,
    SAMPLE_TYPE,
    Loop,
    Outcome,
    RunResult,
    event_table,
    has_numba,
)
from impact_damper_ros.rig.mode import Mode
from impact_damper_ros.rig.origin import Origin
from impact_damper_ros.rig.parameters import InitialConditions, RigParameters
from impact_damper_ros.rig.run_loop import DONE, Progress
from impact_damper_ros.rig.simulator import Simulator

from .controlled_rig import ControlledRig

#: Most events on the way to samples ahead.
_MOST_INSTANTS = 1000


class ModeAccount(NamedTuple):
    """
    The modes of a rig over a time.

    Attributes
    ----------
    time_in_mode : ndarray of float, shape (8,)
        Time spent in each `Mode`, s.
    begins : ndarray of float, shape (n,)
        When each flight began, s; -infinity for the one at the beginning.
    modes : ndarray of int, shape (n,)
        Mode of each flight.
    """

    time_in_mode: npt.NDArray[np.float64]
    begins: npt.NDArray[np.float64]
    modes: npt.NDArray[np.int64]

    def modes_after(self, times: npt.ArrayLike) -> npt.NDArray[np.int64]:
        """Return the mode after each instant, after all events at that instant."""
        found: npt.NDArray[np.int64] = self.modes[
            np.searchsorted(self.begins, times, side='right') - 1
        ]
        return found


class AccountedSimulator(Simulator):
    """A `Simulator` that records the time spent in each mode, and computes samples ahead."""

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
        """Begin to account at the present time."""
        self._counted = self._time
        self._spent = np.zeros(len(Mode))
        self._begun = [(-np.inf, origin.mode)]

    def _count(self, time: float) -> None:
        """Account for the time up to an instant; a change may place it a digit early."""
        assert self._counted is not None
        if time > self._counted:
            self._spent[self._origin.mode] += time - self._counted
            self._counted = time

    def take_account(self) -> ModeAccount:
        """Return the account since the last call, or since the start."""
        self._count(self._time)
        begins, modes = zip(*self._begun, strict=True)
        account = ModeAccount(self._spent, np.array(begins), np.array(modes, dtype=np.int64))
        self._open(self._origin)
        return account

    def sample_ahead(self, instants: npt.NDArray[np.float64]) -> None:
        """
        Compute the samples at instants ahead, for `sample` to return once they are reached.

        They equal to the last bit what `sample` returns otherwise, and are dropped at a change of
        the rig. Without numba, or with a stepped sine, none are computed.
        """
        self._ahead = []
        if self._parameters.sweep_mode != 'off' or not has_numba():
            return
        if self._loop is None or self._loop.constants is not self._constants:
            mass = self._parameters.damper_mass
            self._loop = Loop(self._constants, mass, compiled=True)
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
        """Whether the sample at the present time has been computed."""
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


#: Most samples that are computed together.
_MOST_AHEAD = 256


class _AccountedRig(ControlledRig):
    """A controlled rig that records the time spent in each mode, and samples ahead."""

    _simulator = AccountedSimulator
    _rig: AccountedSimulator

    def _look(self) -> None:
        """Take the sample that is due, computed with some to come."""
        if not self._rig.knows:
            rate = self._control.gap_control_rate
            count = min(max(1, round(rate * math.tau / self.parameters.omega)), _MOST_AHEAD)
            index = self._controller.sample_index
            self._rig.sample_ahead(np.arange(index, index + count) / rate)
        super()._look()

    def take_account(self) -> ModeAccount:
        """Return the account since the last call, or since the start."""
        return self._rig.take_account()


class ControlledRun:
    """
    One rig under gap control for long runs.

    The motion is that of `ControlledRig`, to the last bit. The control is plain Python; its
    samples are computed by compiled code where numba is installed.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    initial : InitialConditions, optional
        Where it starts; at rest with m in the middle of the gap, if not given.
    control : GapControlParameters, optional
        The control; off, if not given.

    Raises
    ------
    ParameterError
        If m would not start between the stops.
    """

    def __init__(
        self,
        parameters: RigParameters,
        initial: InitialConditions | None = None,
        control: GapControlParameters | None = None,
    ) -> None:
        """Start the rig."""
        self._rig = _AccountedRig(parameters, initial, control=control)

    @classmethod
    def restore(cls, snapshot: dict[str, Any]) -> ControlledRun:
        """
        Continue from a snapshot of a `ControlledRig`, bit for bit.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        run = cls.__new__(cls)
        run._rig = _AccountedRig.restore(snapshot)
        return run

    def snapshot(self) -> dict[str, Any]:
        """Return all that the rig's future depends on, as `ControlledRig.snapshot` does."""
        return self._rig.snapshot()

    @property
    def time(self) -> float:
        """Time reached, s."""
        return self._rig.time

    @property
    def parameters(self) -> RigParameters:
        """The rig's present parameters."""
        return self._rig.parameters

    @property
    def control(self) -> GapControlParameters:
        """The present parameters of the control."""
        return self._rig.control

    @property
    def mode(self) -> Mode:
        """Present mode, after any event at the present time."""
        return self._rig.mode

    def change(self, parameters: RigParameters, control: GapControlParameters) -> list[Event]:
        """
        Let new parameters take effect at the present time, as `ControlledRig.change` does.

        Returns
        -------
        list of Event
            The impact that closing the gap on m causes, if any.
        """
        return self._rig.change(parameters, control)

    def advance(
        self, time: float, instants: npt.ArrayLike = (), *, most_events: int = 1_000_000
    ) -> RunResult:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.
        instants : array_like of float, optional
            Instants at which to sample, s: ascending, from the present time to the one to reach.
        most_events : int, optional
            About the most events on the way.

        Returns
        -------
        RunResult
            Samples and events, among them the passages of X through zero and what the stops do,
            and whether the time was reached.

        Raises
        ------
        ValueError
            If a time is before the present one, not finite, or not in order.
        """
        rig, begun = self._rig, self._rig.time
        when = np.array(instants, dtype=float).reshape(-1).tolist()
        events: list[Event] = []
        samples: list[Sample] = []
        outcome = Outcome.COMPLETE
        try:
            for instant in [*when, time]:
                events += rig.advance(instant, most_events - len(events))
                if rig.time < instant:
                    outcome = Outcome.TOO_MANY_EVENTS
                    break
                samples.append(rig.sample())
        except RunawayError:
            outcome = Outcome.RUNAWAY
        account = rig.take_account()
        return RunResult(
            outcome,
            outcome.reason(len(events), begun, rig.time, rig.mode.name.lower()),
            rig.time,
            np.array(samples[: len(when)], SAMPLE_TYPE),
            event_table(events, account.modes_after([event.time for event in events])),
            len(events),
            account.time_in_mode,
        )
