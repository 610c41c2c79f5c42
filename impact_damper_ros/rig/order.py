# SPDX-License-Identifier: Apache-2.0
"""
Orders: commands of a controller outside the rig.

Under ``gap_control: external`` no law acts. Orders move the stops, by the actuators, and push M.
An order is an act like those of a law: it has an exact instant and is reported as an `ORDER`, so
that a replay carries it out again.
"""

from __future__ import annotations

from math import inf, isnan, nan
from typing import TYPE_CHECKING, NamedTuple

from impact_damper_ros.control.act import Action, ControlAct
from impact_damper_ros.control.actuator import order_stops
from impact_damper_ros.control.own_law import too_close
from impact_damper_ros.parameters.parameter_spec import ParameterError

if TYPE_CHECKING:
    from impact_damper_ros.control.state import Control

#: Ranges of the speeds, m/s, and of the forces, N.
SPEEDS, FORCES = (1e-6, 1e9), (-1e12, 1e12)


class Order(NamedTuple):
    """
    A command of a controller outside the rig; NaN leaves a quantity as it is.

    Attributes
    ----------
    stop_1, stop_2 : float
        Where each stop is to go, Y in m.
    speed_1, speed_2 : float
        How fast, m/s; NaN for the speed of the actuators, which is the limit.
    force : float
        Active force on M from now on, N.

    Examples
    --------
    >>> from impact_damper_ros import GapControlParameters, Rig, RigParameters
    >>> control = GapControlParameters(gap_control='external')
    >>> rig = Rig(RigParameters(gravity=0.0), control=control)
    >>> _ = rig.order(Order(stop_1=15.0, force=0.5))
    >>> rig.stops, rig.force
    ((15.0, -18.5), 0.5)
    """

    stop_1: float = nan
    stop_2: float = nan
    speed_1: float = nan
    speed_2: float = nan
    force: float = nan

    @property
    def stops(self) -> bool:
        """Whether the order moves a stop."""
        return self.stop_1 == self.stop_1 or self.stop_2 == self.stop_2

    def check(self, control: Control) -> None:
        """Raise a ParameterError if the order is not admissible under a control."""
        p = control.settings
        largest = 0.5 * p.gap_max
        for name in ('stop_1', 'stop_2'):
            place = getattr(self, name)
            if abs(place) > largest:
                raise ParameterError(
                    name,
                    f'{name} is {place!r} m: give a place Y within half of gap_max, {largest:g} m',
                )
        if p.one_sided and self.stop_2 == self.stop_2:
            raise ParameterError('stop_2', 'there is no stop_2: the rig is one-sided')
        if too_close(control, self.stop_1, self.stop_2):
            a, b = control.actuators.commanded_1, control.actuators.commanded_2
            sent_1 = self.stop_1 if self.stop_1 == self.stop_1 else a
            sent_2 = self.stop_2 if self.stop_2 == self.stop_2 else b
            raise ParameterError(
                'stop_1',
                f'stop_1 at {sent_1:g} m and stop_2 at {sent_2:g} m: stop_1 must be above stop_2 '
                f'by at least gap_min, {p.gap_min:g} m',
            )
        for name in ('speed_1', 'speed_2'):
            speed = getattr(self, name)
            if not (speed != speed or SPEEDS[0] <= speed <= SPEEDS[1]):
                raise ParameterError(
                    name,
                    f'{name} is {speed!r} m/s: give a number from {SPEEDS[0]:g} to {SPEEDS[1]:g}',
                )
        if self.force == self.force and not FORCES[0] <= self.force <= FORCES[1]:
            raise ParameterError('force', f'force is {self.force!r} N: give at most 1e12 N')

    def issue(self, control: Control, time: float) -> None:
        """Give the commands to the actuators."""
        if self.speed_1 == self.speed_2 or (isnan(self.speed_1) and isnan(self.speed_2)):
            if self.stops:
                order_stops(control, time, self.stop_1, self.stop_2, self.speed_1)
            return
        if self.stop_1 == self.stop_1:
            order_stops(control, time, self.stop_1, nan, self.speed_1)
        if self.stop_2 == self.stop_2:
            order_stops(control, time, nan, self.stop_2, self.speed_2)

    def as_act(self, control: Control, time: float) -> ControlAct:
        """Return the order as the topic `gap_control` has it."""
        actuators, estimates = control.actuators, control.estimates
        x_rate = estimates.x_rate if abs(estimates.x_rate) < inf else 0.0
        return ControlAct(
            time,
            Action.ORDER,
            self.stop_1,
            self.stop_2,
            estimates.amplitude,
            self.speed_1,
            self.speed_2,
            x_rate,
            actuators.energy_1,
            actuators.energy_2,
            self.force,
        )
