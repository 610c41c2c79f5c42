# SPDX-License-Identifier: Apache-2.0
"""What the control reports: each of its acts, as the topic `gap_control` has it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from operator import attrgetter
from typing import Any, NamedTuple, Self

#: Joints of the topic `gap_control`.
CONTROL_JOINTS = ('stop_1', 'stop_2', 'primary')


class Action(IntEnum):
    """
    What the control does or reports.

    Examples
    --------
    >>> from collections import Counter
    >>> from impact_damper_ros import GapControlParameters, Rig, RigParameters
    >>> control = GapControlParameters(gap_control='amplitude')
    >>> rig = Rig(RigParameters(gravity=0.0), control=control)
    >>> _ = rig.advance(100.0)
    >>> Counter(act.action for act in rig.acts)[Action.CROSSING]
    30
    """

    #: A command started one or both stops.
    COMMAND = 1
    #: A stop reached its target.
    ARRIVED = 2
    #: A stop and m met: m blocks the stop.
    TOUCHED = 3
    #: X passed through zero.
    CROSSING = 4
    #: A stop that m blocked moves by itself again.
    STARTED = 5
    #: A controller outside the rig gave a command; NaN for entries that the command leaves out.
    ORDER = 6


@dataclass(slots=True)
class ActRow:
    """A row of the table of acts; see `ControlAct`."""

    time: float = 0.0
    target_1: float = 0.0
    target_2: float = 0.0
    amplitude: float = 0.0
    velocity_1: float = 0.0
    velocity_2: float = 0.0
    x_rate: float = 0.0
    energy_1: float = 0.0
    energy_2: float = 0.0
    action: int = 0


#: Reads the fields of a row in their order.
act_fields = attrgetter(*ActRow.__dataclass_fields__)


class ControlAct(NamedTuple):
    """
    One instant of the control.

    Attributes
    ----------
    time : float
        The instant, s.
    action : Action
        What happened.
    target_1, target_2 : float
        Target of each stop, Y in m.
    amplitude : float
        Estimate of the amplitude of X, m.
    velocity_1, velocity_2 : float
        Velocity of each stop in M, m/s; 0 for one that moves at once.
    x_rate : float
        X' of the last sample, m/s.
    energy_1, energy_2 : float
        Energy spent by each actuator so far, J.
    force : float
        The active force on M that an order sets, N; else 0.

    Examples
    --------
    >>> from impact_damper_ros import GapControlParameters, Rig, RigParameters
    >>> control = GapControlParameters(gap_control='amplitude')
    >>> rig = Rig(RigParameters(gravity=0.0), control=control)
    >>> _ = rig.advance(10.0)
    >>> rig.acts[0].action.name, round(rig.acts[0].time, 9), rig.acts[0].target_1
    ('CROSSING', 4.493428076, 18.5)
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
    force: float = 0.0

    @classmethod
    def of(cls, row: tuple[Any, ...]) -> Self:
        """Return a row that the loop has written, with the fields of `ActRow`, as an act."""
        time, *numbers, action = row
        return cls(time, Action(action), *numbers)

    @property
    def act(self) -> str:
        """Name of the action, the `frame_id` of its message on the topic `gap_control`."""
        return self.action.name.lower()

    @property
    def numbers(self) -> tuple[tuple[float, float, float], ...]:
        """Positions, velocities and efforts of `CONTROL_JOINTS`."""
        return (
            (self.target_1, self.target_2, self.amplitude),
            (self.velocity_1, self.velocity_2, self.x_rate),
            (self.energy_1, self.energy_2, self.force),
        )
