# SPDX-License-Identifier: Apache-2.0
"""Parameters of the gap control."""

from __future__ import annotations

from dataclasses import dataclass

from .parameter_spec import ParameterError, ParameterSpec, ParameterTable, numeric, specs_of, text


@dataclass(frozen=True, kw_only=True, repr=False)
class GapControlParameters(ParameterTable):
    """
    Parameters of the gap control: the law that moves the stops, its sensors and its actuators.

    Raises
    ------
    ParameterError
        If a value is out of range, or `gap_min` is not below `gap_max`.

    Examples
    --------
    >>> control = GapControlParameters(gap_control='timed', gap_max=50.0)
    >>> control.active, control.gap_control_gain
    (True, 0.8)
    """

    _owner = 'the gap control'

    gap_control: str = text(
        'off',
        ('off', 'amplitude', 'timed', 'external'),
        'Law that moves the stops: off holds them at the gap, amplitude follows the vibration, '
        'timed closes a stop on m where M is fastest, external obeys a controller outside of the '
        'rig.',
    )
    gap_control_stops: str = text(
        'independent',
        ('symmetric', 'independent'),
        'Stops placed symmetrically by the amplitude alone, or independently of each other.',
    )
    gap_control_gain: float = numeric(
        0.8,
        1e-3,
        1e3,
        '',
        'Gap of the amplitude law with symmetric stops, over the best gap of that amplitude.',
    )
    gap_control_park: float = numeric(
        1.5,
        1e-3,
        1e3,
        '',
        'Gap at which the timed law parks the stops, over the best gap of that amplitude.',
    )
    gap_control_lead: float = numeric(
        0.05,
        0.0,
        0.5,
        '',
        'How early before the passage of X through zero the amplitude law with independent stops '
        'wants each impact, in half cycles.',
    )
    gap_control_timing_gain: float = numeric(
        0.1,
        0.0,
        2.0,
        '',
        'Share of the way to the wanted instant by which a stop is moved at each impact.',
    )
    gap_control_smoothing: float = numeric(
        0.3, 1e-3, 1.0, '', 'Weight of the last half cycle in the estimate of the amplitude of X.'
    )
    gap_control_threshold: float = numeric(
        0.0, 0.0, 1e9, 'm', 'Amplitude of X up to which the stops stay at the gap.'
    )
    gap_min: float = numeric(
        1e-3, 1e-9, 1e9, 'm', 'Smallest gap to which the control moves the stops.'
    )
    gap_max: float = numeric(
        1e3, 1e-9, 1e9, 'm', 'Largest gap; no stop moves farther from the middle than half of it.'
    )
    gap_control_rate: float = numeric(
        100.0, 1e-3, 1e5, 'Hz', 'Rate at which the control samples X, Y and their velocities.'
    )
    gap_control_noise_position: float = numeric(
        0.0, 0.0, 1e9, 'm', 'Standard deviation of the noise on the sampled X and Y.'
    )
    gap_control_noise_velocity: float = numeric(
        0.0,
        0.0,
        1e9,
        'm/s',
        'Standard deviation of the noise on the sampled velocities of X and Y.',
    )
    gap_control_seed: int = numeric(0, 0, 2**31 - 1, '', 'Seed of the noise of the sensors.')
    gap_control_resolution_position: float = numeric(
        0.0, 0.0, 1e9, 'm', 'Step to which the sampled X and Y are rounded; 0 for none.'
    )
    gap_control_resolution_velocity: float = numeric(
        0.0,
        0.0,
        1e9,
        'm/s',
        'Step to which the sampled velocities of X and Y are rounded; 0 for none.',
    )
    sensor_fault: str = text(
        'none',
        ('none', 'frozen', 'dropout', 'bias', 'spike'),
        'Fault of the sensors of X and Y: they repeat the last sample, give no sample, have an '
        'error of sensor_fault_size, or have it in about one sample of ten.',
    )
    sensor_fault_size: float = numeric(
        0.0, -1e9, 1e9, 'm', 'Error of X and Y under a bias or in a spike.'
    )
    actuator_delay: float = numeric(
        0.0, 0.0, 1e6, 's', 'Time from a command to the start of the stop.'
    )
    actuator_speed: float = numeric(
        0.0,
        0.0,
        1e9,
        'm/s',
        'Speed of a moving stop relative to M; 0 moves it at once.',
        least=1e-6,
        zero='at once',
    )
    actuator_mass: float = numeric(
        0.01,
        0.0,
        1e9,
        'kg',
        'Moving mass of one stop, from which the energy of its actuator is computed.',
    )

    actuator_fault: str = text(
        'none',
        ('none', 'stuck', 'slow', 'stop_1_only', 'stop_2_only'),
        'Fault of the actuators: they start no movement, have a tenth of actuator_speed, or only '
        'one of them moves its stop.',
    )

    def _check(self) -> None:
        if self.actuator_fault == 'slow' and not self.actuator_speed:
            raise ParameterError(
                'actuator_fault',
                'actuator_fault is slow but the stops move at once: give an actuator_speed',
            )
        if not self.gap_min < self.gap_max:
            raise ParameterError(
                'gap_min',
                f'gap_min is {self.gap_min!r} m and gap_max {self.gap_max!r} m: give a gap_min '
                'below gap_max (set both at once to move the range)',
            )

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
