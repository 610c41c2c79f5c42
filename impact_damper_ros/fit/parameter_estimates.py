# SPDX-License-Identifier: Apache-2.0
"""Estimates by the names of the ROS parameters, with their intervals and correlations."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .estimate import Estimate
from .unknowns import Unknowns
from .vibration import Array

_UNITS = {
    'stiffness': 'N/m',
    'damping': 'N s/m',
    'gap': 'm',
    'force_delay': 's',
    'restitution_speed': 'm/s',
    'damper_mass': 'kg',
    'primary_mass': 'kg',
    'force_amplitudes': 'N',
}
#: Correlation of each two parameters, by their names.
Correlations = dict[str, dict[str, float]]


def estimates_of(
    unknowns: Unknowns, shared: Array, covariance: Array, constants: Sequence[str]
) -> tuple[dict[str, Estimate], Correlations]:
    """
    Return estimates by the names of the ROS parameters, and their correlations.

    The covariance is that of the shared unknowns and then of relative changes of constants.
    """
    first, second = unknowns.alpha_columns()
    rows = []
    for name in unknowns.names:
        column = unknowns.column(name)
        value = float(shared[column])
        if name.startswith('alpha'):
            restitution = unknowns.restitution(value)
            rows.append(
                (f'restitution_{name[-1]}', column, restitution, -(1 + restitution) / value)
            )
        elif name == 'grip':
            rows.append(('friction', column, value / unknowns.normal, 1.0 / unknowns.normal))
        elif name == 'slowness':
            rows.append(('restitution_speed', column, 1.0 / value, -1.0 / value**2))
        else:
            rows.append((name, column, value, 1.0))
    if first == second:
        at = next(k for k, row in enumerate(rows) if row[0] == 'restitution_1')
        rows.insert(at + 1, ('restitution_2', *rows[at][1:]))
    for k, name in enumerate(constants):
        value = float(np.ravel(getattr(unknowns.rig, name))[0])
        rows.append((name, len(shared) + k, value, value))
    names = [row[0] for row in rows]
    jacobian = np.zeros((len(rows), len(shared) + len(constants)))
    for k, (name, column, value, rate) in enumerate(rows):
        jacobian[k, column] = rate
        if name.startswith('restitution'):
            # R of an alpha depends on m/(M + m)
            by_mass = (1.0 + value) * (1.0 - unknowns.share)
            for constant, sign in (('damper_mass', -1.0), ('primary_mass', 1.0)):
                if constant in constants:
                    jacobian[k, len(shared) + constants.index(constant)] = sign * by_mass
    matrix = jacobian @ covariance @ jacobian.T
    deviations = np.sqrt(np.maximum(np.diag(matrix), 0.0))
    with np.errstate(invalid='ignore', divide='ignore'):
        correlations = matrix / np.outer(deviations, deviations)
    started = {'stiffness': unknowns.rig.stiffness, 'damping': unknowns.rig.damping}
    parameters = {
        name: Estimate.normal(value, float(deviation), _UNITS.get(name, ''), started.get(name))
        for (name, _, value, _), deviation in zip(rows, deviations, strict=True)
    }
    if 'restitution_speed' in parameters:
        parameters['restitution_speed'] = parameters['restitution_speed'].of_inverse
    table = {
        a: {b: float(correlations[i, j]) for j, b in enumerate(names)} for i, a in enumerate(names)
    }
    return parameters, table
