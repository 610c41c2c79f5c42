"""
Parameters of the rig: names, units, ranges, defaults and derived quantities.

A frozen dataclass declares its parameters with the field makers of this module and calls
`check_fields` in its `__post_init__`; `specs_of` then gives the table from which ROS descriptors,
parameters files, error messages and the documentation are made.

The phases come from SplitMix64 (Steele, Lea and Flood, 2014, OOPSLA, "Fast splittable pseudorandom
number generators"), which is a few lines in any language: the same seed gives the same force on
every machine and with every version.

The field names are the ROS parameter names. `PARAMETER_SPECS` and `INITIAL_SPECS` are the only
place where descriptions, units and ranges stand; ROS descriptors, the parameters-file reader and
the documentation take them from here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from itertools import islice
from math import isfinite, sqrt, tau
from typing import Any, Literal, NamedTuple, TypeAlias, cast

from .shown import shown

__all__ = [
    'INITIAL_SPECS',
    'MAX_HARMONICS',
    'MOST_STEPS',
    'NUMBER_KINDS',
    'PARAMETER_SPECS',
    'SWEEP_MODES',
    'InitialConditions',
    'ParameterError',
    'ParameterSpec',
    'RigParameters',
    'Value',
    'array_field',
    'bool_field',
    'check_fields',
    'double_field',
    'integer_field',
    'multisine',
    'specs_of',
    'split_mix',
    'string_field',
]


Value: TypeAlias = float | bool | int | str | tuple[float, ...]
Kind: TypeAlias = Literal['double', 'bool', 'double_array', 'integer', 'string']

#: Kinds whose values are numbers, with a range.
NUMBER_KINDS = ('double', 'double_array', 'integer')
#: Most harmonics the force may have.
MAX_HARMONICS = 1024


class ParameterError(ValueError):
    """
    A parameter value that the rig cannot take.

    Attributes
    ----------
    name : str
        Name of the offending parameter.
    """

    def __init__(self, name: str, message: str) -> None:
        """Keep the name apart, so that callers can point at the parameter."""
        super().__init__(message)
        self.name = name


class ParameterSpec(NamedTuple):
    """
    What a parameter is: its meaning, unit and closed range.

    `low` and `high` are finite for a number, and None for a bool or a text; for an array they hold
    for each entry. `choices` are the texts that a string may be; without any it may be every text
    but an empty one.
    """

    name: str
    description: str
    unit: str
    low: float | None
    high: float | None
    kind: Kind
    default: Value
    choices: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name with unit, for messages, tables and plots."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name

    @property
    def span(self) -> str:
        """What values it may have, in words."""
        if self.kind == 'bool':
            return 'true, false'
        if self.kind == 'string':
            return ', '.join(self.choices) or 'a text'
        if self.kind == 'integer' and self.low is not None and self.high is not None:
            return f'{int(self.low)} to {int(self.high)}'
        return f'{self.low:g} to {self.high:g}'

    def checked(self, value: Any) -> Value:
        """
        Return the value as the kind asks: a float, a bool, an int, a text or a tuple of floats.

        Parameters
        ----------
        value : Any
            A number, a bool, a text or a sequence of numbers. Integers become floats for a
            double, and whole floats integers for an integer.

        Returns
        -------
        Value
            The value, of the type that the kind names.

        Raises
        ------
        ParameterError
            If the type is wrong, or a number is outside the range, NaN or infinite.
        """
        if self.kind == 'bool':
            if not isinstance(value, bool):
                raise ParameterError(
                    self.name, f'{self.name} is {shown(value)}: give true or false'
                )
            return value
        if self.kind == 'string':
            return self._text(value)
        if self.kind == 'integer':
            number = self._number(value, self.name)
            if number != int(number):
                raise ParameterError(self.name, f'{self.name} is {number!r}: {self._remedy}')
            return int(number)
        if self.kind == 'double':
            return self._number(value, self.name)
        if isinstance(value, int | float) and not isinstance(value, bool):
            value = (value,)
        if isinstance(value, str | bytes) or not hasattr(value, '__iter__'):
            raise ParameterError(
                self.name, f'{self.name} is {shown(value)}: give a list of numbers, such as [1.0]'
            )
        entries = tuple(value)
        if not 1 <= len(entries) <= MAX_HARMONICS:
            raise ParameterError(
                self.name,
                f'{self.name} has {len(entries)} entries: give 1 to {MAX_HARMONICS}, one for each '
                'harmonic (amplitude 0 switches the force off)',
            )
        return tuple(self._number(v, f'{self.name}[{i}]') for i, v in enumerate(entries))

    @property
    def _remedy(self) -> str:
        unit = f' {self.unit}' if self.unit else ''
        number = 'a whole number' if self.kind == 'integer' else 'a number'
        degrees = ' (10° = 0.1745 rad)' if self.unit == 'rad' else ''
        return f'give {number} from {self.span}{unit}{degrees}'

    def _text(self, value: Any) -> str:
        if isinstance(value, bool):
            # YAML 1.1 takes an unquoted off for false.
            value = {False: 'off', True: 'on'}[value] if self.choices else value
        if not isinstance(value, str) or not value.strip():
            remedy = f'give one of {self.span}' if self.choices else 'give a text'
            raise ParameterError(self.name, f'{self.name} is {shown(value)}: {remedy}')
        if self.choices and value not in self.choices:
            raise ParameterError(
                self.name, f'{self.name} is {shown(value)}: give one of {", ".join(self.choices)}'
            )
        return value

    def _number(self, value: Any, where: str) -> float:
        assert self.low is not None
        assert self.high is not None
        unit = f' {self.unit}' if self.unit else ''
        if isinstance(value, bool) or not hasattr(value, '__float__'):
            raise ParameterError(self.name, f'{where} is {shown(value)}: {self._remedy}')
        try:
            number = float(value)
        except (TypeError, ValueError, OverflowError):
            raise ParameterError(self.name, f'{where} is {shown(value)}: {self._remedy}') from None
        if not isfinite(number) or not self.low <= number <= self.high:
            raise ParameterError(self.name, f'{where} is {number!r}{unit}: {self._remedy}')
        return number


def double_field(default: float, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a number."""
    return field(
        default=default,
        metadata={'spec': (description, unit, low, high, 'double', default)},
    )


def integer_field(default: int, low: int, high: int, unit: str, description: str) -> Any:
    """Declare a whole number."""
    return field(
        default=default,
        metadata={'spec': (description, unit, low, high, 'integer', default)},
    )


def bool_field(default: bool, description: str) -> Any:
    """Declare a yes or no."""
    return field(
        default=default, metadata={'spec': (description, '', None, None, 'bool', default)}
    )


def string_field(default: str, choices: tuple[str, ...], description: str) -> Any:
    """Declare a choice between texts."""
    return field(
        default=default,
        metadata={'spec': (description, '', None, None, 'string', default, choices)},
    )


def array_field(default: float, low: float, high: float, unit: str, description: str) -> Any:
    """Declare a list of numbers; by default it has one."""
    return field(
        default=(default,),
        metadata={'spec': (description, unit, low, high, 'double_array', (default,))},
    )


def specs_of(cls: type) -> dict[str, ParameterSpec]:
    """Return the parameters that a dataclass declares, by name."""
    return {f.name: ParameterSpec(f.name, *f.metadata['spec']) for f in fields(cls)}


def check_fields(instance: Any, specs: dict[str, ParameterSpec]) -> None:
    """
    Replace every field of a frozen dataclass by its checked value, in its `__post_init__`.

    Raises
    ------
    ParameterError
        If a value is not admissible.
    """
    for name, spec in specs.items():
        object.__setattr__(instance, name, spec.checked(getattr(instance, name)))


_MASK = (1 << 64) - 1


def split_mix(seed: int) -> Iterator[int]:
    """Yield the endless sequence of SplitMix64, whole numbers of 64 bits."""
    state = seed & _MASK
    while True:
        state = (state + 0x9E3779B97F4A7C15) & _MASK
        mixed = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
        mixed = ((mixed ^ (mixed >> 27)) * 0x94D049BB133111EB) & _MASK
        yield mixed ^ (mixed >> 31)


@lru_cache(maxsize=64)
def multisine(
    level: float, low: float, high: float, lines: int, seed: int
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """Return the harmonics of a random-phase multisine."""
    amplitude = level * sqrt(2.0 / lines)
    if lines == 1:
        frequencies: tuple[float, ...] = (0.5 * (low + high),)
    else:
        spacing = (high - low) / (lines - 1)
        frequencies = (*(low + j * spacing for j in range(lines - 1)), high)
    phases = tuple(tau * ((bits >> 11) * 2.0**-53) for bits in islice(split_mix(seed), lines))
    return (amplitude,) * lines, frequencies, phases


SWEEP_MODES = ('off', 'up', 'down', 'up_down')
#: Most steps that a sweep may have from one end to the other.
MOST_STEPS = 100_000


@dataclass(frozen=True, kw_only=True, slots=True)
class RigParameters:
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

    primary_mass: float = double_field(1.0, 1e-6, 1e9, 'kg', 'Primary mass M.')
    stiffness: float = double_field(1.0, 1e-6, 1e15, 'N/m', 'Stiffness K of the spring under M.')
    damping: float = double_field(
        0.01, 0.0, 1e12, 'N s/m', 'Damping C of the dashpot; below 2 sqrt(K M).'
    )
    damper_mass: float = double_field(0.042, 1e-9, 1e9, 'kg', 'Loose damper mass m.')
    gap: float = double_field(
        37.0, 1e-9, 1e9, 'm', 'Total gap d; stop 1 is at +d/2 from the middle, stop 2 at -d/2.'
    )
    restitution_1: float = double_field(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R1 at stop 1 (the lower one).'
    )
    restitution_2: float = double_field(
        0.75, 0.0, 1.0, '', 'Coefficient of restitution R2 at stop 2 (the upper one).'
    )
    # 1.5708 is what people type for 90 degrees.
    angle: float = double_field(
        0.0, -1.5708, 1.5708, 'rad', 'Inclination of the axis, positive downwards.'
    )
    friction: float = double_field(
        0.0, 0.0, 100.0, '', 'Coulomb friction coefficient between m and M.'
    )
    gravity: float = double_field(9.81, 0.0, 1e4, 'm/s^2', 'Gravitational acceleration g.')
    air_force: float = double_field(
        0.0,
        0.0,
        1e9,
        'N',
        'Compressed-air force on m, away from the stop it hit last; zero until the first impact.',
    )
    one_sided: bool = bool_field(False, 'True removes stop 2, so that m can hit stop 1 only.')
    force_amplitudes: tuple[float, ...] = array_field(
        1.0, -1e12, 1e12, 'N', 'Amplitudes of the harmonics of the force on M.'
    )
    force_frequencies: tuple[float, ...] = array_field(
        1.0, 0.0, 1e6, 'rad/s', 'Circular frequencies of the harmonics of the force on M.'
    )
    force_phases: tuple[float, ...] = array_field(
        0.0, -1e6, 1e6, 'rad', 'Phases of the harmonics of the force on M.'
    )
    multisine_level: float = double_field(
        0.0,
        0.0,
        1e12,
        'N',
        'Effective (rms) force of a random-phase multisine, added to the harmonics; 0 for none.',
    )
    multisine_low: float = double_field(
        0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the multisine.'
    )
    multisine_high: float = double_field(
        1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the multisine.'
    )
    multisine_lines: int = integer_field(
        64, 1, 512, '', 'Number of lines of the multisine, evenly spaced in its band.'
    )
    multisine_seed: int = integer_field(
        1, 0, 2**31 - 1, '', 'Seed of the random phases of the multisine.'
    )
    sweep_mode: str = string_field(
        'off',
        SWEEP_MODES,
        'Stepped sine: the way in which the first harmonic goes through the frequencies of the '
        'sweep, in place of its own one.',
    )
    sweep_low: float = double_field(
        0.5, 1e-6, 1e6, 'rad/s', 'Lowest circular frequency of the sweep.'
    )
    sweep_high: float = double_field(
        1.5, 1e-6, 1e6, 'rad/s', 'Highest circular frequency of the sweep.'
    )
    sweep_step: float = double_field(
        0.01, 1e-9, 1e6, 'rad/s', 'Step of the circular frequency in the sweep.'
    )
    sweep_dwell: float = double_field(
        100.0, 1e-3, 1e9, 's', 'Time for which the sweep stays at each frequency.'
    )

    def __post_init__(self) -> None:
        """Promote and check every field, then what holds between them."""
        check_fields(self, PARAMETER_SPECS)
        count = len(self.force_amplitudes)
        for name in ('force_frequencies', 'force_phases'):
            length = len(getattr(self, name))
            if length != count:
                raise ParameterError(
                    name,
                    f'{name} has {length} entries but force_amplitudes has {count}: give all '
                    'three force arrays the same length',
                )
        critical = 2.0 * math.sqrt(self.stiffness * self.primary_mass)
        if not self.damping <= 0.9999 * critical:
            raise ParameterError(
                'damping',
                f'damping is {self.damping!r} N s/m, a damping ratio of '
                f'{self.damping / critical:.4g}: the rig must be underdamped, give at most '
                f'{0.9999 * critical:.6g} (0.9999 of 2 sqrt(stiffness primary_mass))',
            )
        if self.multisine_level > 0.0:
            self._check_band('multisine')
        if self.sweep_mode != 'off':
            self._check_band('sweep')
            steps = (self.sweep_high - self.sweep_low) / self.sweep_step
            if steps > MOST_STEPS:
                least = (self.sweep_high - self.sweep_low) / MOST_STEPS
                raise ParameterError(
                    'sweep_step',
                    f'sweep_step is {self.sweep_step!r} rad/s, {steps:.4g} steps from sweep_low '
                    f'to sweep_high: give at least {least:.3g} rad/s ({MOST_STEPS} steps)',
                )

    def _check_band(self, name: str) -> None:
        low, high = getattr(self, f'{name}_low'), getattr(self, f'{name}_high')
        if not low < high:
            raise ParameterError(
                f'{name}_high',
                f'{name}_low is {low!r} rad/s and {name}_high {high!r} rad/s: give {name}_high '
                f'more than {low:g} rad/s or {name}_low less than {high:g} rad/s, or both at once',
            )

    def replace(self, **changes: Any) -> RigParameters:
        """
        Return the rig with some parameters changed, all at once.

        Raises
        ------
        ParameterError
            If a name is unknown or the changed rig is not admissible.
        """
        for name in changes:
            if name not in PARAMETER_SPECS:
                raise ParameterError(name, f'{name} is not a parameter of the rig')
        return replace(self, **changes)

    def as_dict(self) -> dict[str, Value]:
        """Return name and value of every parameter."""
        return {name: cast(Value, getattr(self, name)) for name in PARAMETER_SPECS}

    @property
    def harmonics(self) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
        """
        All harmonics of the force: amplitudes (N), circular frequencies (rad/s) and phases (rad).

        Those of the force arrays come first, then the lines of the multisine. A sweep is left out:
        it changes the first frequency on the way.
        """
        own = self.force_amplitudes, self.force_frequencies, self.force_phases
        if self.multisine_level == 0.0:
            return own
        lines = multisine(
            self.multisine_level,
            self.multisine_low,
            self.multisine_high,
            self.multisine_lines,
            self.multisine_seed,
        )
        return own[0] + lines[0], own[1] + lines[1], own[2] + lines[2]

    @property
    def periodic_force(self) -> bool:
        """Whether the force is one lasting harmonic, as the theory of periodic motion assumes."""
        return (
            self.force_amplitudes[0] != 0.0
            and self.force_frequencies[0] != 0.0
            and not any(self.force_amplitudes[1:])
            and self.multisine_level == 0.0
            and self.sweep_mode == 'off'
        )

    @property
    def omega(self) -> float:
        """Natural circular frequency sqrt(K/M) of M alone, rad/s."""
        return math.sqrt(self.stiffness / self.primary_mass)

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
        return self.force_frequencies[0] / self.omega

    @property
    def response_amplitude(self) -> float:
        """
        Amplitude A of M without impacts under the first harmonic, m.

        Infinite for an undamped rig driven at resonance.
        """
        r = self.frequency_ratio
        denominator = math.hypot((1.0 - r) * (1.0 + r), 2.0 * self.zeta * r)
        static = abs(self.force_amplitudes[0]) / self.stiffness
        if denominator == 0.0:
            return math.inf if static else 0.0
        return static / denominator

    @property
    def response_phase(self) -> float:
        """Phase lag psi of M behind the first harmonic without impacts, rad."""
        r = self.frequency_ratio
        return math.atan2(2.0 * self.zeta * r, (1.0 - r) * (1.0 + r))

    @property
    def static_deflection(self) -> float:
        """Deflection M g sin(angle)/K of M by its own weight along the axis, m."""
        return self.primary_mass * self.gravity * math.sin(self.angle) / self.stiffness


@dataclass(frozen=True, kw_only=True, slots=True)
class InitialConditions:
    """
    Where the rig starts, and where a reset puts it.

    Raises
    ------
    ParameterError
        If a value is out of range; `INITIAL_SPECS` has the ranges.
    """

    initial_primary_position: float = double_field(
        0.0, -1e9, 1e9, 'm', 'Initial displacement X of M from its static equilibrium.'
    )
    initial_primary_velocity: float = double_field(0.0, -1e9, 1e9, 'm/s', 'Initial velocity of M.')
    initial_damper_offset: float = double_field(
        0.0, -1e9, 1e9, 'm', 'Initial position Y of m relative to M, within the gap.'
    )
    initial_damper_velocity: float = double_field(
        0.0, -1e9, 1e9, 'm/s', 'Initial absolute velocity of m.'
    )

    def __post_init__(self) -> None:
        """Promote and check every field."""
        check_fields(self, INITIAL_SPECS)

    def check_within(self, parameters: RigParameters) -> None:
        """
        Check that m starts between the stops.

        Raises
        ------
        ParameterError
            If it does not.
        """
        offset, half = self.initial_damper_offset, parameters.gap / 2.0
        low = -1e9 if parameters.one_sided else -half
        if not low <= offset <= half:
            raise ParameterError(
                'initial_damper_offset',
                f'initial_damper_offset is {offset!r} m: m must start between the stops, give a '
                f'number from {low:g} to {half:g} m (half the gap of {parameters.gap:g} m)',
            )

    def as_dict(self) -> dict[str, float]:
        """Return name and value of every initial condition."""
        return {name: cast(float, getattr(self, name)) for name in INITIAL_SPECS}


PARAMETER_SPECS: dict[str, ParameterSpec] = specs_of(RigParameters)
INITIAL_SPECS: dict[str, ParameterSpec] = specs_of(InitialConditions)
