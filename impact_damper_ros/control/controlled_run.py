"""Long runs of a rig under gap control: samples and events as arrays, as of a `LongRun`."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig import Event, InitialConditions, Mode, RigParameters, Sample
from impact_damper_ros.rig.accounted_simulator import AccountedSimulator, ModeAccount
from impact_damper_ros.rig.hybrid_motion import RunawayError
from impact_damper_ros.rig.long_run import SAMPLE_TYPE, Outcome, Stretch
from impact_damper_ros.rig.stretch import event_table

from .controlled_rig import ControlledRig
from .parameters import GapControlParameters

__all__ = ['ControlledRun']


#: Most samples that are worked out at once.
_MOST_AHEAD = 256


class _AccountedRig(ControlledRig):
    """A controlled rig that tells the time spent in each mode, and samples ahead."""

    _simulator = AccountedSimulator
    _rig: AccountedSimulator

    def _look(self) -> None:
        """Sample, in compiled code for some samples to come."""
        if not self._rig.knows:
            rate = self._control.gap_control_rate
            count = min(max(1, round(rate * math.tau / self.parameters.omega)), _MOST_AHEAD)
            index = self._controller.sample_index
            self._rig.sample_ahead(np.arange(index, index + count) / rate)
        super()._look()

    def take_account(self) -> ModeAccount:
        """Return the account since this was last asked for, or since the start."""
        return self._rig.take_account()


class ControlledRun:
    """
    One rig under gap control for long runs.

    The motion is that of `ControlledRig`, to the last bit. The control is plain Python; what it
    samples is worked out in compiled code, if there is any.

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
        """Return what the rig's future depends on, as `ControlledRig.snapshot` does."""
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
    ) -> Stretch:
        """
        Let the rig run to a later time.

        Parameters
        ----------
        time : float
            Time to reach, s; not before the present one.
        instants : array_like of float, optional
            Instants at which to sample, s: ascending, from the present time to the one to reach.
        most_events : int, optional
            How many events the rig may have on the way, about.

        Returns
        -------
        Stretch
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
        return Stretch(
            outcome,
            outcome.reason(len(events), begun, rig.time, rig.mode.name.lower()),
            rig.time,
            np.array(samples[: len(when)], SAMPLE_TYPE),
            event_table(events, account.modes_after([event.time for event in events])),
            len(events),
            account.time_in_mode,
        )
