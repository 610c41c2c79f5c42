# SPDX-License-Identifier: Apache-2.0
"""
Parameters of the rig and of where it starts.

Names, units, ranges, defaults and descriptions stand here only; the field names are the ROS
parameter names.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any, Self

from .base_motion import QUANTITIES, BaseMotion, quantity_of
from .forcing import multisine
from .parameter_spec import (
    ParameterError,
    ParameterSpec,
    ParameterTable,
    check_kind,
    flag,
    numeric,
    specs_of,
    text,
)
from .quoting import quote
from .structure import STRUCTURE_SPECS, resolve_structure

SWEEP_MODES = ('off', 'up', 'down', 'up_down')
#: Most steps that a sweep may have from one end to the other.
MOST_STEPS = 100_000
#: Largest amplitude of a harmonic of the force, N.
_MOST_FORCE = 1e12


@dataclass(frozen=True, kw_only=True, repr=False)
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

    Examples
    --------
    >>> rig = RigParameters(gravity=0.0, damping=0.02)
    >>> rig.zeta, rig.replace(gap='24 mm').gap
    (0.01, 0.024)
    """

    _owner = 'the rig'
    _remedies = dict.fromkeys(STRUCTURE_SPECS, 'give it to RigParameters.of_structure or replace')

    primary_mass: float = numeric(1.0, 1e-6, 1e9, 'kg', 'Primary mass M.')
    stiffness: float = numeric(1.0, 1e-6, 1e15, 'N/m', 'Stiffness K of the spring under M.')
    damping: float = numeric(
        0.01, 0.0, 1e12, 'N s/m', 'Damping C of the dashpot; below 2 sqrt(K M).'
    )
    damper_mass: float = numeric(0.042, 1e-9, 1e9, 'kg', 'Loose damper mass m.')
    gap: float = numeric(
        37.0, 1e-9, 1e9, 'm', 'Total gap d; stop 1 is at +d/2 from the middle, stop 2 at -d/2.'
    )
    restitution_1: float = numeric(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R1 at stop 1 (the lower one).'
    )
    restitution_2: float = numeric(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R2 at stop 2 (the upper one).'
    )
    restitution_speed: float = numeric(
        0.0,
        0.0,
        1e9,
        'm/s',
        'Scale v_c of the fall of restitution with the approach speed v of m at an impact: '
        'R(v) = R (1 + v/v_c)^-p, R being restitution_1 or restitution_2; 0 for a constant R.',
        least=1e-6,
        zero='constant R',
    )
    restitution_exponent: float = numeric(
        0.25, 0.0, 0.999, '', 'Exponent p of that fall; 1/4 for plastic contact.'
    )
    # 1.5708 is what people type for 90 degrees.
    angle: float = numeric(
        0.0, -1.5708, 1.5708, 'rad', 'Inclination of the axis, positive downwards.'
    )
    friction: float = numeric(0.0, 0.0, 100.0, '', 'Coulomb friction coefficient between m and M.')
    gravity: float = numeric(9.81, 0.0, 1e4, 'm/s^2', 'Gravitational acceleration g.')
    air_force: float = numeric(
        0.0,
        0.0,
        1e9,
        'N',
        'Compressed-air force on m, away from the stop it hit last; zero until the first impact.',
    )
    one_sided: bool = flag(False, 'True removes stop 2, so that m can hit stop 1 only.')
    force_amplitudes: tuple[float, ...] = numeric(
        (1.0,),
        -_MOST_FORCE,
        _MOST_FORCE,
        'N',
        'Amplitudes of the harmonics of the force on M.',
    )
    force_frequencies: tuple[float, ...] = numeric(
        (1.0,), 0.0, 1e6, 'rad/s', 'Circular frequencies of the harmonics of the force on M.'
    )
    force_phases: tuple[float, ...] = numeric(
        (0.0,), -1e6, 1e6, 'rad', 'Phases of the harmonics of the force on M.'
    )
    base_amplitudes: tuple[float, ...] = numeric(
        (0.0,),
        -1e9,
        1e9,
        'm, m/s or m/s^2',
        'Amplitudes of the lines of the motion of the base along the axis, in the unit of '
        'base_quantity; 0 for a base at rest.',
    )
    base_frequencies: tuple[float, ...] = numeric(
        (1.0,), 0.0, 1e6, 'rad/s', 'Circular frequencies of the lines of the motion of the base.'
    )
    base_phases: tuple[float, ...] = numeric(
        (0.0,), -1e6, 1e6, 'rad', 'Phases of the lines of the motion of the base.'
    )
    base_quantity: str = text(
        'acceleration',
        tuple(QUANTITIES),
        'Quantity of base_amplitudes: displacement (m), velocity (m/s) or acceleration (m/s^2) of '
        'the base.',
    )
    multisine_level: float = numeric(
        0.0,
        0.0,
        1e12,
        'N',
        'Effective (rms) force of a random-phase multisine, added to the harmonics; 0 for none.',
    )
    multisine_low: float = numeric(
        0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the multisine.'
    )
    multisine_high: float = numeric(
        1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the multisine.'
    )
    multisine_lines: int = numeric(
        64, 1, 512, '', 'Number of lines of the multisine, evenly spaced in its band.'
    )
    multisine_seed: int = numeric(
        1, 0, 2**31 - 1, '', 'Seed of the random phases of the multisine.'
    )
    sweep_mode: str = text(
        'off',
        SWEEP_MODES,
        'Stepped sine: direction in which the first harmonic goes through the frequencies of the '
        'sweep; off keeps its own frequency.',
    )
    sweep_low: float = numeric(0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the sweep.')
    sweep_high: float = numeric(
        1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the sweep.'
    )
    sweep_step: float = numeric(
        0.01, 1e-9, 1e6, 'rad/s', 'Step of the circular frequency in the sweep.'
    )
    sweep_dwell: float = numeric(
        100.0, 1e-3, 1e9, 's', 'Time for which the sweep stays at each frequency.'
    )
    sweep_spacing: str = text(
        'linear',
        ('linear', 'logarithmic'),
        'Spacing of the frequencies of the sweep: equal steps, or equal ratios; the first '
        'step from sweep_low is sweep_step.',
    )
    sweep_rate: float = numeric(
        0.0,
        0.0,
        1e6,
        'octaves/min',
        'Rate of a logarithmic sweep; sets the time at each frequency in place of sweep_dwell. 0 '
        'for sweep_dwell.',
    )
    sweep_notch_frequencies: tuple[float, ...] = numeric(
        (1.0,),
        1e-6,
        1e6,
        'rad/s',
        'Circular frequencies, rising, at which sweep_notch_factors holds.',
    )
    sweep_notch_factors: tuple[float, ...] = numeric(
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
        Return the rig of a structure given by natural frequency, damping and mass ratio.

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
        plain = resolve_structure(changes, checked_number, self.primary_mass, self.stiffness)
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
                    f'{name} is {frequency!r} rad/s: a base with this {self.base_quantity} moves '
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

    @cached_property
    def base_motion(self) -> BaseMotion:
        """Displacement of the base, as lines, whatever quantity base_amplitudes give."""
        return BaseMotion.of(
            self.base_amplitudes, self.base_frequencies, self.base_phases, self.base_quantity
        )

    @cached_property
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

    @cached_property
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

    @cached_property
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

        Its amplitude is multiplied by `factor`.
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
    def restitution_slowness(self) -> float:
        """Slowness 1/v_c, s/m, by which restitution falls with the speed; 0 for a constant R."""
        value: float = slowness(self.restitution_speed)
        return value

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


@dataclass(frozen=True, kw_only=True, repr=False)
class InitialConditions(ParameterTable):
    """
    Where the rig starts, and where a reset puts it.

    Raises
    ------
    ParameterError
        If a value is out of range; `INITIAL_SPECS` has the ranges.

    Examples
    --------
    >>> InitialConditions(initial_primary_position='2 mm').initial_primary_position
    0.002
    """

    _owner = 'the initial conditions'

    initial_primary_position: float = numeric(
        0.0,
        -1e9,
        1e9,
        'm',
        'Initial displacement X of M from its static equilibrium.',
        effect='next reset',
    )
    initial_primary_velocity: float = numeric(
        0.0, -1e9, 1e9, 'm/s', 'Initial velocity of M.', effect='next reset'
    )
    initial_damper_offset: float = numeric(
        0.0,
        -1e9,
        1e9,
        'm',
        'Initial position Y of m relative to M, within the gap.',
        effect='next reset',
    )
    initial_damper_velocity: float = numeric(
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


def slowness(speed: Any) -> Any:
    """Return 1/v of a speed, or of many as an array; 0 of 0, which stands for no speed."""
    return (speed > 0.0) / (speed + (speed == 0.0))


PARAMETER_SPECS: dict[str, ParameterSpec] = specs_of(RigParameters)


def check_rig(name: str, value: object) -> None:
    """Raise a TypeError if an argument is no rig."""
    wanted = "RigParameters, such as load_parameters('bench_rig')[0]"
    check_kind(name, value, RigParameters, wanted)


def checked_number(name: str, value: Any) -> float:
    """Return the checked number of a parameter of the rig."""
    return float(PARAMETER_SPECS[name].check(value))  # type: ignore[arg-type]


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
            f'{spec.name} is {quote(amplitudes)}, {" and ".join(sorted(quantities))}: give all '
            'lines of the base as one quantity',
        )
    return quantities.pop() if quantities else ''


INITIAL_SPECS: dict[str, ParameterSpec] = specs_of(InitialConditions)
