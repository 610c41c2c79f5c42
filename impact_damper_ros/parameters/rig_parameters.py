# SPDX-License-Identifier: Apache-2.0
"""
All parameters: of the rig, where it starts, its gap control, and the node that runs it.

This is the only place that says their names, units, ranges, defaults and descriptions; the field
names are the ROS parameter names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, Self

from .base_motion import QUANTITIES, BaseMotion, quantity_of
from .forcing import multisine
from .parameter_spec import (
    ParameterError,
    ParameterSpec,
    ParameterTable,
    flag,
    number,
    specs_of,
    text,
)
from .quoting import shown
from .structure import STRUCTURE_SPECS, resolved

SWEEP_MODES = ('off', 'up', 'down', 'up_down')
#: Most steps that a sweep may have from one end to the other.
MOST_STEPS = 100_000
#: Largest amplitude of a harmonic of the force, N.
_MOST_FORCE = 1e12


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class RigParameters(ParameterTable):
    """
    One rig: a primary mass on spring and dashpot, a loose mass in its gap, and the force.

    The defaults are the basic rig of Bapat (1995), section 3: K = M = F = 1, mass ratio 0.042,
    C = 0.01, d = 37, R1 = R2 = 0.75. Integers are taken for floats and lists for tuples.

    Raises
    ------
    ParameterError
        If a value is out of range, the force arrays differ in length, or the rig is not
        underdamped. `PARAMETER_SPECS` has the ranges.
    """

    _owner = 'the rig'
    _remedies = dict.fromkeys(STRUCTURE_SPECS, 'give it to RigParameters.of_structure or replace')

    primary_mass: float = number(1.0, 1e-6, 1e9, 'kg', 'Primary mass M.')
    stiffness: float = number(1.0, 1e-6, 1e15, 'N/m', 'Stiffness K of the spring under M.')
    damping: float = number(
        0.01, 0.0, 1e12, 'N s/m', 'Damping C of the dashpot; below 2 sqrt(K M).'
    )
    damper_mass: float = number(0.042, 1e-9, 1e9, 'kg', 'Loose damper mass m.')
    gap: float = number(
        37.0, 1e-9, 1e9, 'm', 'Total gap d; stop 1 is at +d/2 from the middle, stop 2 at -d/2.'
    )
    restitution_1: float = number(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R1 at stop 1 (the lower one).'
    )
    restitution_2: float = number(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R2 at stop 2 (the upper one).'
    )
    # 1.5708 is what people type for 90 degrees.
    angle: float = number(
        0.0, -1.5708, 1.5708, 'rad', 'Inclination of the axis, positive downwards.'
    )
    friction: float = number(0.0, 0.0, 100.0, '', 'Coulomb friction coefficient between m and M.')
    gravity: float = number(9.81, 0.0, 1e4, 'm/s^2', 'Gravitational acceleration g.')
    air_force: float = number(
        0.0,
        0.0,
        1e9,
        'N',
        'Compressed-air force on m, away from the stop it hit last; zero until the first impact.',
    )
    one_sided: bool = flag(False, 'True removes stop 2, so that m can hit stop 1 only.')
    force_amplitudes: tuple[float, ...] = number(
        (1.0,),
        -_MOST_FORCE,
        _MOST_FORCE,
        'N',
        'Amplitudes of the harmonics of the force on M.',
    )
    force_frequencies: tuple[float, ...] = number(
        (1.0,), 0.0, 1e6, 'rad/s', 'Circular frequencies of the harmonics of the force on M.'
    )
    force_phases: tuple[float, ...] = number(
        (0.0,), -1e6, 1e6, 'rad', 'Phases of the harmonics of the force on M.'
    )
    base_amplitudes: tuple[float, ...] = number(
        (0.0,),
        -1e9,
        1e9,
        'm, m/s or m/s^2',
        'Amplitudes of the lines of the motion of the base along the axis, in the unit of '
        'base_quantity; 0 for a base at rest.',
    )
    base_frequencies: tuple[float, ...] = number(
        (1.0,), 0.0, 1e6, 'rad/s', 'Circular frequencies of the lines of the motion of the base.'
    )
    base_phases: tuple[float, ...] = number(
        (0.0,), -1e6, 1e6, 'rad', 'Phases of the lines of the motion of the base.'
    )
    base_quantity: str = text(
        'acceleration',
        tuple(QUANTITIES),
        'What base_amplitudes are amplitudes of: the displacement (m), the velocity (m/s) or the '
        'acceleration (m/s^2) of the base.',
    )
    multisine_level: float = number(
        0.0,
        0.0,
        1e12,
        'N',
        'Effective (rms) force of a random-phase multisine, added to the harmonics; 0 for none.',
    )
    multisine_low: float = number(
        0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the multisine.'
    )
    multisine_high: float = number(
        1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the multisine.'
    )
    multisine_lines: int = number(
        64, 1, 512, '', 'Number of lines of the multisine, evenly spaced in its band.'
    )
    multisine_seed: int = number(
        1, 0, 2**31 - 1, '', 'Seed of the random phases of the multisine.'
    )
    sweep_mode: str = text(
        'off',
        SWEEP_MODES,
        'Stepped sine: the way in which the first harmonic goes through the frequencies of the '
        'sweep, in place of its own one.',
    )
    sweep_low: float = number(0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the sweep.')
    sweep_high: float = number(1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the sweep.')
    sweep_step: float = number(
        0.01, 1e-9, 1e6, 'rad/s', 'Step of the circular frequency in the sweep.'
    )
    sweep_dwell: float = number(
        100.0, 1e-3, 1e9, 's', 'Time for which the sweep stays at each frequency.'
    )
    sweep_spacing: str = text(
        'linear',
        ('linear', 'logarithmic'),
        'Spacing of the frequencies of the sweep: equal steps, or equal ratios; the first '
        'step from sweep_low is sweep_step.',
    )
    sweep_rate: float = number(
        0.0,
        0.0,
        1e6,
        'octaves/min',
        'Rate of a logarithmic sweep; sets the time at each frequency in place of sweep_dwell. 0 '
        'for sweep_dwell.',
    )
    sweep_notch_frequencies: tuple[float, ...] = number(
        (1.0,),
        1e-6,
        1e6,
        'rad/s',
        'Circular frequencies, rising, at which sweep_notch_factors holds.',
    )
    sweep_notch_factors: tuple[float, ...] = number(
        (1.0,),
        1e-9,
        1e9,
        '',
        'Factors of the amplitude that is swept, over frequency: straight lines on logarithmic '
        'axes, constant beyond the ends; 1 for a constant level.',
    )

    def __post_init__(self) -> None:
        """Take the quantity from the unit of base amplitudes, and check all values."""
        if quantity := base_quantity_of(self.base_amplitudes):
            object.__setattr__(self, 'base_quantity', quantity)
        ParameterTable.__post_init__(self)

    def _check(self) -> None:
        for what in ('force', 'base'):
            count = len(getattr(self, f'{what}_amplitudes'))
            for name in (f'{what}_frequencies', f'{what}_phases'):
                length = len(getattr(self, name))
                if length != count:
                    raise ParameterError(
                        name,
                        f'{name} has {length} entries but {what}_amplitudes has {count}: give all '
                        f'three {what} arrays the same length',
                    )
        critical = 2.0 * math.sqrt(self.stiffness * self.primary_mass)
        if not self.damping <= 0.9999 * critical:
            raise ParameterError(
                'damping',
                f'damping is {self.damping!r} N s/m, a damping ratio of '
                f'{self.damping / critical:.4g}: the rig must be underdamped, give at most '
                f'{0.9999 * critical:.6g} (0.9999 of 2 sqrt(stiffness primary_mass))',
            )
        if any(self.base_amplitudes):
            self._check_base(self.base_amplitudes, self.base_frequencies)
        if self.multisine_level > 0.0:
            self._check_band('multisine')
        if self.sweep_mode != 'off':
            self._check_band('sweep')
            self._check_sweep()

    @classmethod
    def of_structure(cls, **values: Any) -> RigParameters:
        """
        Return the rig of a structure as people know it.

        Parameters
        ----------
        **values
            Parameters of the rig, and `natural_frequency` (Hz), `damping_ratio` (or `loss_factor`,
            `quality_factor`, `logarithmic_decrement`) and `mass_ratio` in place of stiffness,
            damping and damper_mass.

        Raises
        ------
        ParameterError
            If a value is not admissible, or two contradict each other.

        Examples
        --------
        >>> rig = RigParameters.of_structure(
        ...     primary_mass=5.0, natural_frequency=10.0, damping_ratio='2 %', mass_ratio=0.05
        ... )
        >>> round(rig.omega / math.tau, 9), round(rig.zeta, 9), rig.damper_mass
        (10.0, 0.02, 0.25)
        """
        return cls().replace(**values)

    def replace(self, **changes: Any) -> Self:
        """
        Return the rig with some parameters changed, all at once.

        Names of the structure are taken, too; see `of_structure`. Another mass leaves the
        stiffness as it is, unless the natural frequency is given with it.

        Raises
        ------
        ParameterError
            If a name is unknown, two contradict each other, or the changed rig is not admissible.
        """
        plain = resolved(changes, checked_number, self.primary_mass, self.stiffness)
        if 'base_amplitudes' in plain and (quantity := base_quantity_of(plain['base_amplitudes'])):
            plain['base_quantity'] = quantity
        return ParameterTable.replace(self, **plain)

    def _check_base(self, amplitudes: tuple[float, ...], frequencies: tuple[float, ...]) -> None:
        base = BaseMotion.of(amplitudes, frequencies, self.base_phases, self.base_quantity)
        for index, (size, frequency) in enumerate(zip(base.amplitudes, frequencies, strict=True)):
            if math.isinf(size):
                name = f'base_frequencies[{index}]'
                raise ParameterError(
                    'base_frequencies',
                    f'{name} is {frequency!r} rad/s: a base of such a {self.base_quantity} goes '
                    f'away, give a higher {name}, or base_quantity displacement',
                )
        forces, _, _ = base.force(self.stiffness, self.damping)
        for index, (force, frequency) in enumerate(zip(forces, frequencies, strict=True)):
            if not abs(force) <= _MOST_FORCE:
                raise ParameterError(
                    'base_amplitudes',
                    f'base_amplitudes[{index}] is {amplitudes[index]!r} '
                    f'({self.base_quantity}) at {frequency!r} rad/s, which pulls M by '
                    f'{abs(force):.4g} N: give an amplitude that pulls by at most '
                    f'{_MOST_FORCE:g} N, {abs(_MOST_FORCE / force):.3g} of it',
                )

    def _check_sweep(self) -> None:
        logarithmic = self.sweep_spacing == 'logarithmic'
        if self.sweep_rate and not logarithmic:
            raise ParameterError(
                'sweep_rate',
                f'sweep_rate is {self.sweep_rate!r} octaves a minute and sweep_spacing linear: '
                'give sweep_spacing logarithmic, or sweep_rate 0 and the time sweep_dwell at each '
                'frequency',
            )
        low, high = self.sweep_low, self.sweep_high
        steps = (high - low) / self.sweep_step
        least = (high - low) / MOST_STEPS
        if logarithmic:
            steps = math.log(high / low) / math.log1p(self.sweep_step / low)
            least = low * math.expm1(math.log(high / low) / MOST_STEPS)
        if steps > MOST_STEPS:
            raise ParameterError(
                'sweep_step',
                f'sweep_step is {self.sweep_step!r} rad/s, {steps:.4g} steps from sweep_low '
                f'to sweep_high: give at least {least:.3g} rad/s ({MOST_STEPS} steps)',
            )
        places, factors = self.sweep_notch_frequencies, self.sweep_notch_factors
        if len(places) != len(factors):
            raise ParameterError(
                'sweep_notch_factors',
                f'sweep_notch_frequencies has {len(places)} entries and sweep_notch_factors '
                f'{len(factors)}: give both together, with the same length',
            )
        for k, (one, other) in enumerate(pairwise(places)):
            if not one < other:
                raise ParameterError(
                    'sweep_notch_frequencies',
                    f'sweep_notch_frequencies[{k + 1}] is {other!r} rad/s, after {one!r} rad/s: '
                    'give rising frequencies',
                )
        if self.swept == 'base':
            # The lowest frequency has the largest displacement.
            self._check_base(
                (self.base_amplitudes[0] * max(factors), *self.base_amplitudes[1:]),
                (low, *self.base_frequencies[1:]),
            )

    def _check_band(self, name: str) -> None:
        low, high = getattr(self, f'{name}_low'), getattr(self, f'{name}_high')
        if not low < high:
            raise ParameterError(
                f'{name}_high',
                f'{name}_low is {low:.9g} rad/s ({low / math.tau:.6g} Hz) and {name}_high '
                f'{high:.9g} rad/s ({high / math.tau:.6g} Hz): give {name}_high more than '
                f'{low:g} rad/s or {name}_low less than {high:g} rad/s, or both at once',
            )

    @property
    def base_motion(self) -> BaseMotion:
        """Displacement of the base, as lines; what base_amplitudes are does not matter here."""
        return BaseMotion.of(
            self.base_amplitudes, self.base_frequencies, self.base_phases, self.base_quantity
        )

    @property
    def harmonic_groups(self) -> dict[str, tuple[tuple[float, ...], ...]]:
        """
        Harmonics of the force on M by where they come from, in the order of `harmonics`.

        Those of the force arrays come first, then those that stand for the motion of the base,
        then the lines of the multisine. Where the force is off, the base comes first. Groups
        without harmonics are left out, but for one: a rig that nothing shakes has its force.
        """
        groups: dict[str, tuple[tuple[float, ...], ...]]
        groups = {'force': (self.force_amplitudes, self.force_frequencies, self.force_phases)}
        if any(self.base_amplitudes):
            base = {'base': self.base_motion.force(self.stiffness, self.damping)}
            groups = groups | base if any(self.force_amplitudes) else base | groups
        if self.multisine_level > 0.0:
            groups['multisine'] = multisine(
                self.multisine_level,
                self.multisine_low,
                self.multisine_high,
                self.multisine_lines,
                self.multisine_seed,
            )
        return groups

    @property
    def harmonics(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """
        All harmonics of the force on M: amplitudes (N), frequencies (rad/s) and phases (rad).

        See `harmonic_groups`. A sweep is left out: it changes the first frequency on the way.
        """
        amplitudes, frequencies, phases = zip(*self.harmonic_groups.values(), strict=True)
        return sum(amplitudes, ()), sum(frequencies, ()), sum(phases, ())

    @property
    def base_rows(self) -> slice:
        """Where the lines of the base are among the harmonics; empty for a base at rest."""
        first = 0
        for name, (amplitudes, _, _) in self.harmonic_groups.items():
            if name == 'base':
                return slice(first, first + len(amplitudes))
            first += len(amplitudes)
        return slice(0, 0)

    @property
    def first_harmonic(self) -> tuple[float, float, float]:
        """Amplitude (N), circular frequency (rad/s) and phase (rad) of the first harmonic."""
        amplitudes, frequencies, phases = next(iter(self.harmonic_groups.values()))
        return amplitudes[0], frequencies[0], phases[0]

    @property
    def swept(self) -> str:
        """Where the first harmonic comes from, `force` or `base`: it is what a sweep changes."""
        return next(iter(self.harmonic_groups))

    @property
    def first_line(self) -> tuple[float, float, float]:
        """Amplitude (N, or m of a base), frequency and phase of the first line of `swept`."""
        if self.swept == 'force':
            return self.first_harmonic
        amplitudes, frequencies, phases = self.base_motion
        return amplitudes[0], frequencies[0], phases[0]

    def with_first_frequency(self, frequency: float, factor: float = 1.0) -> RigParameters:
        """
        Return the rig with another circular frequency of the first harmonic, rad/s.

        Its amplitude is taken times a factor.
        """
        frequencies, amplitudes = f'{self.swept}_frequencies', f'{self.swept}_amplitudes'
        changes = {frequencies: (frequency, *getattr(self, frequencies)[1:])}
        if factor != 1.0:
            first, *others = getattr(self, amplitudes)
            changes[amplitudes] = (first * factor, *others)
        return self.replace(**changes)

    @property
    def periodic_force(self) -> bool:
        """Whether the force is one lasting harmonic, as the theory of periodic motion assumes."""
        amplitude, frequency, _ = self.first_harmonic
        return (
            amplitude != 0.0
            and frequency != 0.0
            and not any(self.harmonics[0][1:])
            and self.sweep_mode == 'off'
        )

    @property
    def omega(self) -> float:
        """Natural circular frequency sqrt(K/M) of M alone, rad/s."""
        return math.sqrt(self.stiffness / self.primary_mass)

    @property
    def fastest(self) -> float:
        """Circular frequency of the fastest of spring and acting harmonics, rad/s."""
        amplitudes, frequencies, _ = self.harmonics
        acting = [w for f, w in zip(amplitudes, frequencies, strict=True) if f != 0.0]
        return max([self.omega, *acting])

    @property
    def zeta(self) -> float:
        """Damping ratio C/(2 sqrt(K M)) of M alone."""
        return self.damping / (2.0 * math.sqrt(self.stiffness * self.primary_mass))

    @property
    def eta(self) -> float:
        """Ratio sqrt(1 - zeta^2) of damped to undamped natural frequency."""
        zeta = self.zeta
        return math.sqrt((1.0 - zeta) * (1.0 + zeta))

    @property
    def mass_ratio(self) -> float:
        """Mass ratio m/M."""
        return self.damper_mass / self.primary_mass

    @property
    def frequency_ratio(self) -> float:
        """Ratio r of the first harmonic's frequency to the natural one."""
        return self.first_harmonic[1] / self.omega

    @property
    def response_amplitude(self) -> float:
        """
        Amplitude A of M without impacts under the first harmonic, m.

        Infinite for an undamped rig driven at resonance.
        """
        r = self.frequency_ratio
        denominator = math.hypot((1.0 - r) * (1.0 + r), 2.0 * self.zeta * r)
        static = abs(self.first_harmonic[0]) / self.stiffness
        if denominator == 0.0:
            return math.inf if static else 0.0
        return static / denominator

    def x_max_ratio(self, x_max: float) -> float:
        """Return a largest |X|, m, over the amplitude A; NaN where A is zero or infinite."""
        amplitude = self.response_amplitude
        return x_max / amplitude if 0.0 < amplitude < math.inf else math.nan

    @property
    def static_deflection(self) -> float:
        """Deflection M g sin(angle)/K of M by its own weight along the axis, m."""
        return self.primary_mass * self.gravity * math.sin(self.angle) / self.stiffness


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class InitialConditions(ParameterTable):
    """
    Where the rig starts, and where a reset puts it.

    Raises
    ------
    ParameterError
        If a value is out of range; `INITIAL_SPECS` has the ranges.
    """

    _owner = 'the initial conditions'

    initial_primary_position: float = number(
        0.0,
        -1e9,
        1e9,
        'm',
        'Initial displacement X of M from its static equilibrium.',
        effect='next reset',
    )
    initial_primary_velocity: float = number(
        0.0, -1e9, 1e9, 'm/s', 'Initial velocity of M.', effect='next reset'
    )
    initial_damper_offset: float = number(
        0.0,
        -1e9,
        1e9,
        'm',
        'Initial position Y of m relative to M, within the gap.',
        effect='next reset',
    )
    initial_damper_velocity: float = number(
        0.0, -1e9, 1e9, 'm/s', 'Initial absolute velocity of m.', effect='next reset'
    )

    def check_within(self, parameters: RigParameters) -> None:
        """Check that m starts between the stops."""
        offset, half = self.initial_damper_offset, parameters.gap / 2.0
        low = -1e9 if parameters.one_sided else -half
        if not low <= offset <= half:
            raise ParameterError(
                'initial_damper_offset',
                f'initial_damper_offset is {offset!r} m: m must start between the stops, give a '
                f'number from {low:g} to {half:g} m (half the gap of {parameters.gap:g} m)',
            )


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class GapControlParameters(ParameterTable):
    """
    How the stops are moved, or that they are not.

    Raises
    ------
    ParameterError
        If a value is out of range, or `gap_min` is not below `gap_max`.
    """

    _owner = 'the gap control'

    gap_control: str = text(
        'off',
        ('off', 'amplitude', 'timed', 'external'),
        'Law that moves the stops: off holds them at the gap, amplitude follows the vibration, '
        'timed closes a stop on m where M is fastest, external does what a controller outside of '
        'the rig commands.',
    )
    gap_control_stops: str = text(
        'independent',
        ('symmetric', 'independent'),
        'Stops placed symmetrically by the amplitude alone, or each by what is measured at it.',
    )
    gap_control_gain: float = number(
        0.8,
        1e-3,
        1e3,
        '',
        'Gap of the amplitude law with symmetric stops, over the best gap of that amplitude.',
    )
    gap_control_park: float = number(
        1.5,
        1e-3,
        1e3,
        '',
        'Gap at which the timed law parks the stops, over the best gap of that amplitude.',
    )
    gap_control_lead: float = number(
        0.05,
        0.0,
        0.5,
        '',
        'How early before the passage of X through zero the amplitude law with independent stops '
        'wants each impact, in half cycles.',
    )
    gap_control_timing_gain: float = number(
        0.1,
        0.0,
        2.0,
        '',
        'Share of the way to the wanted instant by which a stop is moved at each impact.',
    )
    gap_control_smoothing: float = number(
        0.3, 1e-3, 1.0, '', 'Weight of the last half cycle in the estimate of the amplitude of X.'
    )
    gap_control_threshold: float = number(
        0.0, 0.0, 1e9, 'm', 'Amplitude of X up to which the stops stay at the gap.'
    )
    gap_min: float = number(
        1e-3, 1e-9, 1e9, 'm', 'Smallest gap to which the control moves the stops.'
    )
    gap_max: float = number(
        1e3, 1e-9, 1e9, 'm', 'Largest gap; no stop moves farther from the middle than half of it.'
    )
    gap_control_rate: float = number(
        100.0, 1e-3, 1e5, 'Hz', 'Rate at which the control samples X, Y and their velocities.'
    )
    gap_control_noise_position: float = number(
        0.0, 0.0, 1e9, 'm', 'Standard deviation of the noise on the sampled X and Y.'
    )
    gap_control_noise_velocity: float = number(
        0.0, 0.0, 1e9, 'm/s', 'Standard deviation of the noise on their sampled velocities.'
    )
    gap_control_seed: int = number(0, 0, 2**31 - 1, '', 'Seed of that noise.')
    gap_control_resolution_position: float = number(
        0.0, 0.0, 1e9, 'm', 'Step to which the sampled X and Y are rounded; 0 for none.'
    )
    gap_control_resolution_velocity: float = number(
        0.0, 0.0, 1e9, 'm/s', 'Step to which their sampled velocities are rounded; 0 for none.'
    )
    sensor_fault: str = text(
        'none',
        ('none', 'frozen', 'dropout', 'bias', 'spike'),
        'Fault of the sensors of X and Y: they repeat the last sample, give none, are off by '
        'sensor_fault_size, or about one sample in ten is.',
    )
    sensor_fault_size: float = number(
        0.0, -1e9, 1e9, 'm', 'By how much X and Y are off under a bias or in a spike.'
    )
    actuator_delay: float = number(
        0.0, 0.0, 1e6, 's', 'Time from a command to the start of the stop.'
    )
    actuator_speed: float = number(
        0.0,
        0.0,
        1e9,
        'm/s',
        'Speed of a moving stop relative to M; 0 moves it at once.',
        least=1e-6,
        zero='at once',
    )
    actuator_mass: float = number(
        0.01, 0.0, 1e9, 'kg', 'Moving mass of one stop, for the account of the energy spent on it.'
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


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
class NodeSettings(ParameterTable):
    """How the node runs a rig, publishes and records it."""

    _owner = 'the node'

    state_rate: float = number(
        200.0, 1.0, 2000.0, 'Hz', 'Joint states per second of rig time.', effect='start'
    )
    real_time_factor: float = number(
        1.0,
        0.0,
        1000.0,
        '',
        'Rig seconds per wall second; 0 runs as fast as possible.',
        least=1e-3,
        zero='as fast as possible',
    )
    publish_clock: bool = flag(
        False,
        'Publish /clock, and count stamps from 0 instead of from the system time. This '
        'also happens if real_time_factor is not 1 at the start.',
        effect='start',
    )
    real_time_priority: int = number(
        0,
        0,
        99,
        '',
        'Real-time priority of the thread that moves the rig, where the system permits it; '
        'the other threads have one less. 0 for ordinary scheduling.',
        effect='start',
    )
    measurement_rate: float = number(
        0.0,
        0.0,
        10000.0,
        'Hz',
        'Messages of the topic measurements per second of rig time; 0 for none.',
        least=1e-3,
        zero='none',
        effect='start',
    )
    measurement_latency: float = number(
        0.0, 0.0, 1e3, 's', 'Rig time from a measurement to its publication.'
    )
    measurement_jitter: float = number(
        0.0, 0.0, 1e3, 's', 'Largest additional latency, uniform at random.'
    )
    measurement_loss: float = number(
        0.0, 0.0, 1.0, '', 'Share of the measurements that get lost, at random.'
    )
    control_law: str = text(
        'none',
        (),
        'A law of your own in place of that which gap_control names, unless that is off: '
        'MODULE:FUNCTION, of the directory in which the node starts; or none.',
        effect='start',
    )
    force_record: str = text(
        'none',
        (),
        'Measured force that acts on M from the start on, and anew from each reset: the path of a '
        'table with t [s] and force [N]; or none.',
        effect='start',
    )
    base_record: str = text(
        'none',
        (),
        'Measured acceleration that moves the base in the same way: the path of a table with t '
        '[s] and acceleration [m/s^2], or [g]; or none.',
        effect='start',
    )
    lock_step: str = text(
        'off',
        ('off', 'stop_commands', 'force_command', 'both'),
        'Topics whose command, with the stamp of the measurement, an externally controlled rig '
        'waits for at each measurement; stamps count from 0 then, and /clock is published.',
        effect='start',
    )
    lock_step_timeout: float = number(
        10.0,
        1e-3,
        1e6,
        's',
        'Wall time after which the rig in lock-step goes on without a command, until one comes.',
    )
    command_timeout: float = number(
        1.0,
        0.0,
        1e6,
        's',
        'Rig time without a command after which the stops of an external control are parked at '
        'the gap, and its force ends; 0 for never.',
    )
    force_limit: float = number(
        0.0,
        0.0,
        1e12,
        'N',
        'Largest force of an external control; a larger one is limited to it. 0 for no limit.',
    )
    predict_motion: bool = flag(
        True, 'Predict the periodic motion, in a process of its own, for the diagnostics.'
    )
    record: bool = flag(False, 'Record the run to MCAP.')
    bag_directory: str = text(
        'runs',
        (),
        'Directory in which every recording makes its own; ~ is the home directory.',
        effect='next recording',
    )
    # Each file begins with a description of its topics.
    max_bag_size: int = number(
        0,
        0,
        10**15,
        'B',
        'Size of a file at which a recording goes on to the next one; 0 for no limit.',
        least=100_000,
        zero='no limit',
        effect='next recording',
    )
    max_bag_duration: float = number(
        0.0,
        0.0,
        1e9,
        's',
        'Time after which a recording goes on to the next file; 0 for no limit.',
        least=1.0,
        zero='no limit',
        effect='next recording',
    )


PARAMETER_SPECS: dict[str, ParameterSpec] = specs_of(RigParameters)


def check_rig(name: str, value: object) -> None:
    """Raise a TypeError if an argument is no rig."""
    if not isinstance(value, RigParameters):
        raise TypeError(
            f'{name} is {shown(value)}: give RigParameters, such as '
            "load_parameters('bench_rig')[0]"
        )


def checked_number(name: str, value: Any) -> float:
    """Return the checked number of a parameter of the rig."""
    return float(PARAMETER_SPECS[name].checked(value))  # type: ignore[arg-type]


def base_quantity_of(amplitudes: object) -> str:
    """
    Return the quantity that the unit of base amplitudes means; empty if they have none.

    0.2 g is an acceleration, whatever base_quantity is.
    """
    spec = specs_of(RigParameters)['base_amplitudes']
    quantities = {quantity_of(unit) for unit in spec.units_of(amplitudes)}
    if len(quantities) > 1:
        raise ParameterError(
            spec.name,
            f'{spec.name} is {shown(amplitudes)}, {" and ".join(sorted(quantities))}: give all '
            'lines of the base as one quantity',
        )
    return quantities.pop() if quantities else ''


INITIAL_SPECS: dict[str, ParameterSpec] = specs_of(InitialConditions)
GAP_CONTROL_SPECS: dict[str, ParameterSpec] = specs_of(GapControlParameters)
SETTING_SPECS: dict[str, ParameterSpec] = specs_of(NodeSettings)
#: What a rig may be described by: its parameters, and a structure as people know it.
RIG_SPECS = {**PARAMETER_SPECS, **STRUCTURE_SPECS}
#: All parameters that a parameters file may hold, in this order in documents and lists.
ALL_SPECS = {**PARAMETER_SPECS, **INITIAL_SPECS, **GAP_CONTROL_SPECS, **SETTING_SPECS}


def unit_of(name: str, values: Mapping[str, Any]) -> str:
    """Return the unit of a parameter of a rig with these values, if it has one."""
    if name == 'base_amplitudes':
        return QUANTITIES[values['base_quantity']]
    return ALL_SPECS[name].unit if name in ALL_SPECS else ''
