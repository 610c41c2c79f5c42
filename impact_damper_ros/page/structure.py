# SPDX-License-Identifier: Apache-2.0
"""A user's structure: its typed values, its best damper, and the rig of both."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from impact_damper_ros.design.damper_design import best_design
from impact_damper_ros.design.mass_damper import den_hartog, mass_damper_response
from impact_damper_ros.motion.kernels import has_numba
from impact_damper_ros.parameters.all_parameters import RIG_SPECS
from impact_damper_ros.parameters.gap_control_parameters import GapControlParameters
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.rig_parameters import InitialConditions, RigParameters

from .presets import scaled_to

#: Parameter of each field, and the unit of a number without one.
_FIELDS = {
    'mass': ('primary_mass', 'kg'),
    'frequency': ('natural_frequency', 'Hz'),
    'damping': ('damping_ratio', '%'),
    'mass_ratio': ('mass_ratio', '%'),
    'restitution': ('restitution_1', ''),
}
#: Quantities of the size of the excitation, and their units; the frequency is the natural one.
_SIZES = {
    'acceleration': ('base_amplitudes', 'g'),
    'displacement': ('base_amplitudes', 'mm'),
    'force': ('force_amplitudes', 'N'),
    'amplitude': ('gap', 'mm'),
}
#: Stops under control, over the gap; samples of a control in a cycle, and its delay in cycles.
_NARROWEST, _WIDEST, _SAMPLES, _DELAY = 1.0 / 6.0, 12.0, 40.0, 0.02
#: Fewest samples of a cycle that a trace needs.
_FEWEST_SAMPLES = 10.0


class FieldError(Exception):
    """A text in a field is not admissible."""

    def __init__(self, field: str, reason: str) -> None:
        super().__init__(reason)
        self.field = field


def _read(field: str, name: str, unit: str, typed: Mapping[str, Any]) -> float:
    text = str(typed.get(field, '')).strip()
    try:
        value = RIG_SPECS[name].read(text, unit if _is_bare(text) else '')
    except ParameterError as error:
        raise FieldError(field, str(error)) from None
    number = float(value[0] if isinstance(value, tuple) else value)
    if number == 0.0 and name != 'restitution_1':
        raise FieldError(field, 'It is 0: give a number above 0.')
    return number


def _is_bare(text: str) -> bool:
    """Return whether a text is a number without a unit."""
    try:
        float(text.replace(',', '.'))
    except ValueError:
        return False
    return True


def structure_of(typed: Mapping[str, Any]) -> RigParameters:
    """
    Return the rig of the typed values, with the widest gap that M alone swings across.

    Parameters
    ----------
    typed : mapping of str
        Texts by field: `mass`, `frequency`, `damping`, `mass_ratio` and `restitution`, `size`, and
        in `shaken` its quantity: `acceleration` or `displacement` of the base, `force`, or the
        `amplitude` of the structure itself.

    Raises
    ------
    FieldError
        If a text is no admissible value.
    """
    found = {name: _read(field, name, unit, typed) for field, (name, unit) in _FIELDS.items()}
    shaken = str(typed.get('shaken', ''))
    if shaken not in _SIZES:
        raise FieldError('shaken', f'It is none of {", ".join(_SIZES)}.')
    size = _read('size', *_SIZES[shaken], typed)
    rate = math.tau * found['natural_frequency']
    found['restitution_2'] = found['restitution_1']
    still = {'force_amplitudes': 0.0, 'force_frequencies': rate, 'base_frequencies': rate}
    if shaken in ('acceleration', 'displacement'):
        moved = {'base_amplitudes': size, 'base_quantity': shaken}
    else:
        stiffness = found['primary_mass'] * rate**2
        pushed = size if shaken == 'force' else 2.0 * found['damping_ratio'] * stiffness * size
        moved = {'force_amplitudes': pushed}
    try:
        rig = RigParameters.of_structure(**found, **{**still, **moved})
        return rig.replace(gap=2.0 * rig.response_amplitude)
    except ParameterError as error:
        raise FieldError('size', str(error)) from None


def command_of(typed: Mapping[str, Any], rig: RigParameters) -> str:
    """Return the command that designs the damper of a rig from `structure_of`."""

    def text(field: str, unit: str) -> str:
        plain = ''.join(str(typed[field]).split()).replace(',', '.')
        return plain + unit if _is_bare(plain) else plain

    if any(rig.base_amplitudes):
        shaken = f'--base {text("size", _SIZES[typed["shaken"]][1])}'
    else:
        shaken = f'--force {rig.force_amplitudes[0]:.4g}'
    options = ('mass', 'frequency', 'damping-ratio', 'mass-ratio', 'restitution')
    fields = zip(options, _FIELDS.items(), strict=True)
    given = (f'--{option} {text(field, unit)}' for option, (field, (_, unit)) in fields)
    return ' '.join(['design_damper', *given, shaken])


def design_of(rig: RigParameters) -> dict[str, float]:
    """Return the numbers of the best damper of a rig, SI units; or raise a FieldError."""
    if not has_numba():
        raise FieldError('mass', 'A design runs many rigs, compiled: pip install "numba>=0.59".')
    design = best_design(rig)
    if design is None:
        raise FieldError(
            'mass_ratio',
            'No stable motion of two impacts per cycle was found: give another mass, or a lower '
            'restitution.',
        )
    other = mass_damper_response(rig, den_hartog(rig), np.array([rig.first_harmonic[1]]))
    return {
        # The best gap from rest, and the largest |X| with it
        'gap': design.gap,
        'x_max': design.x_max,
        # The best gap of all, the largest |X| once m hits both stops, and whether a rig from rest
        # reaches that
        'best_gap': design.rig.gap,
        'best_x_max': design.orbit.x_max,
        'reached': design.reached_from_rest,
        # Amplitude without a damper, and with the same mass as a tuned mass damper
        'without': design.bare,
        'mass_damper': float(other[0]),
        'damper_mass': rig.damper_mass,
        # Levels within which the motion of the best gap lasts, as factors; speed of approach
        'level_low': design.level_range.low,
        'level_high': design.level_range.high,
        'impact_speed': design.impact_speed,
    }


def rig_settings_of(rig: RigParameters, gap: float) -> dict[str, Any]:
    """Return the parameters of a rig with a gap, of a control and of a start that suit it."""
    rounded = {name: float(f'{getattr(rig, name):.7g}') for name in ('stiffness', 'damping')}
    there = rig.replace(gap=float(f'{gap:.4g}'), **rounded)
    values = there.as_dict()
    about = {**scaled_to(there.omega), 'base_frequencies': values['base_frequencies']}
    hertz = there.omega / math.tau
    control = GapControlParameters().replace(
        gap_min=float(f'{_NARROWEST * gap:.3g}'),
        gap_max=float(f'{_WIDEST * gap:.3g}'),
        gap_control_rate=float(f'{min(_SAMPLES * hertz, 1e4):.3g}'),
        actuator_delay=float(f'{min(_DELAY / hertz, 0.1):.3g}'),
    )
    return {**values, **about, **control.as_dict(), **InitialConditions().as_dict()}


def note_on(rig: RigParameters, state_rate: float) -> str:
    """Return a remedy where the samples of the node are too few for a rig; else an empty text."""
    hertz = rig.first_harmonic[1] / math.tau
    if state_rate >= _FEWEST_SAMPLES * hertz:
        return ''
    rate = min(2000.0, float(f'{2.0 * _FEWEST_SAMPLES * hertz:.1g}'))
    return (
        f'The node sends {state_rate:g} samples a second, too few for the traces of '
        f'{hertz:.3g} Hz: start it with -p state_rate:={rate:.1f}'
    )
