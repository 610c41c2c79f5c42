# SPDX-License-Identifier: Apache-2.0
"""What is known of the constants by the record and the file together: value and deviation."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from impact_damper_ros.parameters.rig_parameters import RigParameters

from .candidates import Evidence
from .gauss_newton import FitSolution, System
from .revision import Revised
from .shooting import Shooting
from .unknowns import scaled_constant
from .vibration import Array

#: Part of a standard deviation at which steps of the constants end.
_SMALL = 0.05


class ConstantEstimates(NamedTuple):
    """
    Values and covariance of the uncertain constants, one step from a solution.

    Attributes
    ----------
    names : list of str
        The constants with an uncertainty.
    covariance : ndarray
        Covariance of the shared unknowns and then of relative changes of the constants.
    steps : dict
        Relative change of each constant.
    moves : bool
        Whether a change is more than a small part of its deviation.
    rig : RigParameters
        The rig with the changes.
    unknowns : ndarray
        All unknowns with the changes.
    """

    names: list[str]
    covariance: Array
    steps: dict[str, float]
    moves: bool
    rig: RigParameters
    unknowns: Array

    @classmethod
    def of(
        cls, found: Revised, scale: float, moved: Mapping[str, float], *, doubted: bool = False
    ) -> ConstantEstimates:
        """
        Return the estimates, given the relative changes of the constants from the file.

        If they are `doubted`, all are wrong in the file that may be.
        """
        shooting, solution = found.shooting, found.solution
        own = own_covariance(shooting, solution, scale)
        evidence = Evidence.of(shooting, solution, scale, laws=False)
        evidence = evidence.if_wrong() if doubted else evidence
        free = evidence.uncertain()
        rig, names = shooting.unknowns.rig, [evidence.columns[k].name for k in free]
        since = np.array([moved.get(one.name, 0.0) for one in evidence.columns])
        step, covariance = evidence.step(free, since)
        for name, part in zip(names, step.tolist(), strict=True):
            rig = scaled_constant(rig, name, part) or rig
        return cls(
            names,
            evidence.joint(free, own, covariance),
            dict(zip(names, step.tolist(), strict=True)),
            bool((np.abs(step) > _SMALL * np.sqrt(np.diag(covariance))).any()),
            rig,
            solution.unknowns + evidence.changes[:, free] @ step,
        )


def own_covariance(shooting: Shooting, solution: FitSolution, scale: float) -> Array:
    """Return the covariance of the shared unknowns where friction is not held at zero."""
    free = copy.copy(shooting)
    free.frictionless = False
    own = free.equations(solution.unknowns) if shooting.frictionless else solution.equations
    return System(own, 1e-11).covariance(np.arange(shooting.count)) * scale**2
