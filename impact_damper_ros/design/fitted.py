# SPDX-License-Identifier: Apache-2.0
"""
A fitted rig and how sure its parameters are, as `fit_rig` writes them.

Two forms are read: a parameters file with the intervals as comments,
``restitution_1: 0.612  # 95 %: 0.598 to 0.626``, and JSON with ``parameters``, by name, of which
each has a ``value`` and an ``interval``.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

from impact_damper_ros.parameters.parameters_file import load_parameters
from impact_damper_ros.parameters.quoting import named
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS

#: Parameters on which the best gap depends, and which a fit leaves uncertain.
UNCERTAIN = ('restitution_1', 'restitution_2', 'friction', 'stiffness', 'damping')
_NUMBER = r'([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)'
_INTERVAL = re.compile(
    rf'^\s*(\w+)\s*:[^#\n]*#.*?95\s*%[^:\n]*:\s*{_NUMBER}\s*to\s*{_NUMBER}', re.MULTILINE
)


class FittedRig(NamedTuple):
    """
    The values of a fitted rig and their intervals.

    Attributes
    ----------
    values : dict
        Parameters by name, SI: of a parameters file all, of JSON those that were fitted.
    ranges : dict
        95 % interval of each uncertain parameter, within its range.
    """

    values: dict[str, Any]
    ranges: dict[str, tuple[float, float]]


def _within(name: str, low: float, high: float) -> tuple[float, float]:
    """Return an interval, without what a parameter cannot be."""
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
        A parameters file with intervals as comments, or JSON, as `fit_rig` writes them.

    Raises
    ------
    ValueError
        If it cannot be read, or has no interval.
    """
    if path.suffix.lower() == '.json':
        values, found = _of_json(path)
    else:
        rig, _, _ = load_parameters(path)
        values = rig.as_dict()
        text = path.read_text(encoding='utf-8') if path.is_file() else ''
        found = {name: (float(low), float(high)) for name, low, high in _INTERVAL.findall(text)}
    ranges = {n: _within(n, *sorted(found[n])) for n in UNCERTAIN if n in found}
    if not ranges:
        raise ValueError(
            f'{path}: has no 95 % interval of {", ".join(UNCERTAIN[:-1])} or {UNCERTAIN[-1]}: '
            'give what fit_rig writes with --rig-out or --json, or --restitution LOW:HIGH'
        )
    return FittedRig(values, ranges)


def _of_json(path: Path) -> tuple[dict[str, Any], dict[str, tuple[float, float]]]:
    """Return values and intervals of a result in JSON."""
    try:
        known = json.loads(path.read_text(encoding='utf-8'))['parameters']
        values = {n: float(one['value']) for n, one in known.items() if n in PARAMETER_SPECS}
        ends = {n: (*map(float, known[n]['interval']),) for n in values if n in UNCERTAIN}
        intervals = {n: (low, high) for n, (low, high) in ends.items()}
    except OSError as error:
        raise ValueError(f'{path}: cannot be read ({error.strerror or error})') from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(
            f'{path}: is not the result of a fit ({named(error)}): give JSON with "parameters", '
            'of which each has a "value" and an "interval"'
        ) from error
    return values, intervals
