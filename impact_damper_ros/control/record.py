"""Records of what the gap control does: what is published, logged and compared by a replay."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple, Self

from .actuator import Actuators
from .observer import Observer

__all__ = ['CONTROL_JOINTS', 'PAUSED_FRAME', 'Action', 'ControlRecord']

#: Joints of the topic `gap_control`.
CONTROL_JOINTS = ('stop_1', 'stop_2', 'primary')
#: Frame of the joint states of a rig that is held, which are no samples of its motion.
PAUSED_FRAME = 'paused'


class Action(IntEnum):
    """What a record tells of."""

    #: A command starts one or both stops.
    COMMAND = 1
    #: A stop has reached its target.
    ARRIVED = 2
    #: A stop and m have met; the stop stays there.
    TOUCHED = 3
    #: X passed through zero.
    CROSSING = 4


class ControlRecord(NamedTuple):
    """
    One instant of the control.

    Attributes
    ----------
    time : float
        The instant, s.
    action : Action
        What happened.
    target_1, target_2 : float
        Where each stop is to be, Y in m.
    amplitude : float
        Estimate of the amplitude of X, m.
    velocity_1, velocity_2 : float
        Velocity of each stop in M, m/s; 0 of one that has moved at once.
    x_rate : float
        X' of the last sample, m/s.
    energy_1, energy_2 : float
        Energy spent by each actuator so far, J.
    """

    time: float
    action: Action
    target_1: float
    target_2: float
    amplitude: float
    velocity_1: float
    velocity_2: float
    x_rate: float
    energy_1: float
    energy_2: float

    @classmethod
    def of(cls, action: Action, time: float, actuators: Actuators, observer: Observer) -> Self:
        """Return the record of an action, as actuators and observer are after it."""
        target_1, target_2 = actuators.targets
        velocity_1, velocity_2 = actuators.velocities
        energy_1, energy_2 = actuators.energies
        return cls(
            time=time,
            action=action,
            target_1=target_1,
            target_2=target_2,
            amplitude=observer.amplitude,
            velocity_1=velocity_1,
            velocity_2=velocity_2,
            x_rate=observer.last[2] if observer.last else 0.0,
            energy_1=energy_1,
            energy_2=energy_2,
        )

    @property
    def frame_id(self) -> str:
        """What happened, as the topic `gap_control` names it."""
        return self.action.name.lower()

    @property
    def numbers(self) -> tuple[tuple[float, float, float], ...]:
        """Positions, velocities and efforts of `CONTROL_JOINTS`, as the topic has them."""
        return (
            (self.target_1, self.target_2, self.amplitude),
            (self.velocity_1, self.velocity_2, self.x_rate),
            (self.energy_1, self.energy_2, 0.0),
        )
