# SPDX-License-Identifier: Apache-2.0
"""
A structure given by natural frequency, damping and mass ratio.

Each of these stands for a parameter of the rig: the natural frequency for the stiffness, a measure
of damping for the damping, the mass ratio for the mass of the damper. They are accepted wherever a
rig is described, and replaced by the parameters of the rig.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from .parameter_spec import ParameterError, ParameterSpec
from .quoting import quote

_DAMPED = 0.9999


def _spec(name: str, low: float, high: float, unit: str, text: str) -> ParameterSpec:
    return ParameterSpec(name, text, unit, low, high, 'double', low)


_LOGARITHMIC = 2.0 * math.pi * _DAMPED / math.sqrt(1.0 - _DAMPED**2)
#: What may be given in place of stiffness, damping and damper_mass.
STRUCTURE_SPECS: dict[str, ParameterSpec] = {
    spec.name: spec
    for spec in (
        _spec(
            'natural_frequency',
            1e-6,
            1e6,
            'Hz',
            'Natural frequency of M alone, in place of stiffness: K = M (2 pi f)^2.',
        ),
        _spec(
            'damping_ratio',
            0.0,
            _DAMPED,
            '',
            'Damping ratio zeta of M alone, in place of damping: C = 2 zeta sqrt(K M).',
        ),
        _spec(
            'loss_factor',
            0.0,
            2.0 * _DAMPED,
            '',
            'Loss factor 2 zeta at resonance, as damping_ratio.',
        ),
        _spec(
            'quality_factor',
            0.5 / _DAMPED,
            1e12,
            '',
            'Quality factor 1/(2 zeta), as damping_ratio.',
        ),
        _spec(
            'logarithmic_decrement',
            0.0,
            _LOGARITHMIC,
            '',
            'Logarithmic decrement 2 pi zeta/sqrt(1 - zeta^2), as damping_ratio.',
        ),
        _spec('mass_ratio', 1e-9, 1e6, '', 'Mass ratio m/M, in place of damper_mass.'),
    )
}
_ZETA: dict[str, Callable[[float], float]] = {
    'damping_ratio': lambda zeta: zeta,
    'loss_factor': lambda factor: 0.5 * factor,
    'quality_factor': lambda q: 0.5 / q,
    'logarithmic_decrement': lambda d: d / math.hypot(2.0 * math.pi, d),
}
#: Values that mean the same parameter agree to this part.
_SAME = 1e-6


def _common_value(
    target: str, unit: str, meant: Mapping[str, float], given: Mapping[str, Any], own: float | None
) -> float:
    """Return the one value that several names mean; raise `ParameterError` if they differ."""
    values = {**meant, **({target: own} if own is not None else {})}
    (first, value), *others = values.items()
    for name, other in others:
        if not math.isclose(value, other, rel_tol=_SAME, abs_tol=0.0):
            raise ParameterError(
                name,
                f'{first} {quote(given[first])} means a {target} of {value:.9g}{unit}, and {name} '
                f'{quote(given[name])} one of {other:.9g}{unit}: give one of them',
            )
    # A parameter that is given itself keeps its last bit.
    return values.get(target, value)


def resolve_structure(
    values: Mapping[str, Any], number: Callable[[str, Any], float], mass: float, stiffness: float
) -> dict[str, Any]:
    """
    Return values with names of the structure replaced by parameters of the rig.

    Parameters
    ----------
    values : mapping
        Values by name, among them names of `STRUCTURE_SPECS`.
    number : callable
        Returns the checked number of a parameter of the rig.
    mass, stiffness : float
        Mass and stiffness of the rig, where they are not among the values, kg and N/m.

    Raises
    ------
    ParameterError
        If a value is not admissible, or two contradict each other.
    """
    known = {n: spec.check(values[n]) for n, spec in STRUCTURE_SPECS.items() if n in values}
    if not known:
        return dict(values)
    plain = {name: value for name, value in values.items() if name not in STRUCTURE_SPECS}

    def own(name: str) -> float | None:
        return number(name, plain[name]) if name in plain else None

    mass = number('primary_mass', plain['primary_mass']) if 'primary_mass' in plain else mass
    if 'natural_frequency' in known:
        rate = 2.0 * math.pi * float(known['natural_frequency'])  # type: ignore[arg-type]
        meant = {'natural_frequency': mass * rate**2}
        plain['stiffness'] = _common_value('stiffness', ' N/m', meant, values, own('stiffness'))
    stiffness = number('stiffness', plain['stiffness']) if 'stiffness' in plain else stiffness
    scale = 2.0 * math.sqrt(stiffness * mass)
    ratios = {
        n: scale * zeta_of(float(known[n]))  # type: ignore[arg-type]
        for n, zeta_of in _ZETA.items()
        if n in known
    }
    if ratios:
        plain['damping'] = _common_value('damping', ' N s/m', ratios, values, own('damping'))
    if 'mass_ratio' in known:
        meant = {'mass_ratio': mass * float(known['mass_ratio'])}  # type: ignore[arg-type]
        plain['damper_mass'] = _common_value(
            'damper_mass', ' kg', meant, values, own('damper_mass')
        )
    return plain
