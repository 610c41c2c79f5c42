# SPDX-License-Identifier: Apache-2.0
"""A fitted rig and the intervals of its parameters, in the JSON that `fit_rig` writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros.measured.formats import content_of
from impact_damper_ros.parameters.quoting import as_name
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS

#: Parameters on which the best gap depends, and which a fit leaves uncertain.
UNCERTAIN = ('restitution_1', 'restitution_2', 'friction', 'stiffness', 'damping')
#: Largest file that is read, bytes.
_MOST_BYTES = 10_000_000


class FittedRig(NamedTuple):
    """
    The values of a fitted rig and their intervals.

    Attributes
    ----------
    values : dict
        Parameters by name, SI: those of the fitted rig or, without one, those that were fitted.
    ranges : dict
        95 % interval of each uncertain parameter, within its range.
    """

    values: dict[str, Any]
    ranges: dict[str, tuple[float, float]]


def _within(name: str, low: float, high: float) -> tuple[float, float]:
    """Return an interval, cut to the range of its parameter."""
    spec = PARAMETER_SPECS[name]
    assert spec.low is not None
    assert spec.high is not None
    return max(low, spec.low), min(high, spec.high)


def load_fitted(path: Path) -> FittedRig:
    """
    Read a fitted rig with its intervals.

    Parameters
    ----------
    path : Path
        JSON as `fit_rig` writes it: `parameters` by name, of which each has a `value` and an
        `interval`, and `rig`, all parameters of the rig.

    Raises
    ------
    ValueError
        If the file cannot be read, or has no interval.
    """
    content = content_of(path, _MOST_BYTES)
    try:
        found = json.loads(content)
        known = {n: one for n, one in found['parameters'].items() if n in PARAMETER_SPECS}
        values = {n: float(one['value']) for n, one in known.items()}
        ends = {n: (*map(float, known[n]['interval']),) for n in UNCERTAIN if n in known}
        ranges = {n: _within(n, *sorted((low, high))) for n, (low, high) in ends.items()}
        values = dict(found.get('rig') or values)
    # Any content that is no result of a fit
    except Exception as error:
        raise ValueError(
            f'{path}: is not the result of a fit ({as_name(error)}): give JSON as fit_rig --json '
            'writes it, with "parameters", of which each has a "value" and an "interval"'
        ) from error
    if not ranges:
        raise ValueError(
            f'{path}: has no 95 % interval of {", ".join(UNCERTAIN[:-1])} or {UNCERTAIN[-1]}: '
            'give what fit_rig writes with --json, or --restitution LOW:HIGH'
        )
    return FittedRig(values, ranges)
