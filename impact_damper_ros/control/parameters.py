"""
Parameters of the gap control, its sensors and its actuators.

As with the rig, the field names are the ROS parameter names, and `GAP_CONTROL_SPECS` is the only
place where descriptions, units and ranges stand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, cast

from impact_damper_ros.rig import ParameterError, ParameterSpec
from impact_damper_ros.rig.parameters import (
    Value,
    check_fields,
    double_field,
    integer_field,
    specs_of,
    string_field,
)

__all__ = ['GAP_CONTROL_SPECS', 'GapControlParameters']


_SLOWEST_STOP = 1e-6


@dataclass(frozen=True, kw_only=True, slots=True)
class GapControlParameters:
    """
    How the stops are moved, or that they are not.

    Raises
    ------
    ParameterError
        If a value is out of range, or `gap_min` is not below `gap_max`.
    """

    gap_control: str = string_field(
        'off',
        ('off', 'amplitude', 'timed'),
        'Law that moves the stops: off holds them at the gap, amplitude follows the vibration, '
        'timed closes a stop on m where M is fastest.',
    )
    gap_control_stops: str = string_field(
        'independent',
        ('symmetric', 'independent'),
        'Stops placed symmetrically by the amplitude alone, or each by what is measured at it.',
    )
    gap_control_gain: float = double_field(
        0.8,
        1e-3,
        1e3,
        '',
        'Gap of the amplitude law with symmetric stops, over the optimal gap of that amplitude.',
    )
    gap_control_park: float = double_field(
        1.5,
        1e-3,
        1e3,
        '',
        'Gap at which the timed law parks the stops, over the optimal gap of that amplitude.',
    )
    gap_control_lead: float = double_field(
        0.05,
        0.0,
        0.5,
        '',
        'How early before the passage of X through zero the amplitude law with independent stops '
        'wants each impact, in half cycles.',
    )
    gap_control_timing_gain: float = double_field(
        0.1,
        0.0,
        2.0,
        '',
        'Part of the way to that instant by which a stop is moved at each impact.',
    )
    gap_control_smoothing: float = double_field(
        0.3, 1e-3, 1.0, '', 'Weight of the last half cycle in the estimate of the amplitude of X.'
    )
    gap_control_threshold: float = double_field(
        0.0, 0.0, 1e9, 'm', 'Amplitude of X up to which the stops stay at the gap.'
    )
    gap_min: float = double_field(
        1e-3, 1e-9, 1e9, 'm', 'Smallest gap to which the control moves the stops.'
    )
    gap_max: float = double_field(
        1e3, 1e-9, 1e9, 'm', 'Largest gap; no stop moves farther from the middle than half of it.'
    )
    gap_control_rate: float = double_field(
        100.0, 1e-3, 1e5, 'Hz', 'Rate at which the control samples X, Y and their velocities.'
    )
    gap_control_noise_position: float = double_field(
        0.0, 0.0, 1e9, 'm', 'Standard deviation of the noise on the sampled X and Y.'
    )
    gap_control_noise_velocity: float = double_field(
        0.0, 0.0, 1e9, 'm/s', 'Standard deviation of the noise on their sampled velocities.'
    )
    gap_control_seed: int = integer_field(0, 0, 2**31 - 1, '', 'Seed of that noise.')
    actuator_delay: float = double_field(
        0.0, 0.0, 1e6, 's', 'Time from a command to the start of the stop.'
    )
    actuator_speed: float = double_field(
        0.0, 0.0, 1e9, 'm/s', 'Speed of a moving stop relative to M; 0 moves it at once.'
    )
    actuator_mass: float = double_field(
        0.01, 0.0, 1e9, 'kg', 'Moving mass of one stop, for the account of the energy spent on it.'
    )

    def __post_init__(self) -> None:
        """Promote and check every field, then what holds between them."""
        check_fields(self, GAP_CONTROL_SPECS)
        if not self.gap_min < self.gap_max:
            raise ParameterError(
                'gap_min',
                f'gap_min is {self.gap_min!r} m and gap_max {self.gap_max!r} m: give a gap_min '
                'below gap_max (set both at once to move the range)',
            )
        if 0.0 < self.actuator_speed < _SLOWEST_STOP:
            raise ParameterError(
                'actuator_speed',
                f'actuator_speed is {self.actuator_speed!r} m/s: give 0 (at once) or a number '
                f'from {_SLOWEST_STOP:g} to 1e+09 m/s',
            )

    def replace(self, **changes: Any) -> GapControlParameters:
        """
        Return the parameters with some changed, all at once.

        Raises
        ------
        ParameterError
            If a name is unknown or the changed parameters are not admissible.
        """
        for name in changes:
            if name not in GAP_CONTROL_SPECS:
                raise ParameterError(name, f'{name} is not a parameter of the gap control')
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Value]:
        """Return name and value of every parameter."""
        return {name: cast(Value, getattr(self, name)) for name in GAP_CONTROL_SPECS}

    @property
    def active(self) -> bool:
        """Whether a law moves the stops."""
        return self.gap_control != 'off'

    @property
    def widest_gap(self) -> float:
        """Largest gap to which a law may open the stops, m; 0 if none moves them."""
        return self.gap_max if self.active else 0.0

    @property
    def independent(self) -> bool:
        """Whether each stop has a place of its own."""
        return self.gap_control_stops == 'independent'


GAP_CONTROL_SPECS: dict[str, ParameterSpec] = specs_of(GapControlParameters)
