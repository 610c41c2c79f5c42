# SPDX-License-Identifier: Apache-2.0
"""What theory predicts for a rig: the periodic motions that it can have, and the expected one."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Literal, TypeAlias

from impact_damper_ros.motion.event import Event
from impact_damper_ros.orbits.orbit import Apart, PeriodicOrbit, Rhythm

#: Why a motion is the predicted one: it is near the measured one, the rig reaches it when it is
#: run ahead, or it is the first of those that exist.
Basis: TypeAlias = Literal['measured', 'run ahead', 'listed', '']


@dataclass(frozen=True)
class ObservedMotion:
    """
    The motion of a rig as measured.

    Attributes
    ----------
    rhythm : Rhythm
        The period of its impacts.
    impact : Event
        The last impact.
    phase : float
        Instant of that impact in cycles of the force since its zero angle.
    """

    rhythm: Rhythm
    impact: Event
    phase: float


@dataclass(frozen=True)
class Prediction:
    """
    The periodic motions of a rig, as far as they are known.

    Attributes
    ----------
    orbits : tuple of PeriodicOrbit
        Different motions; stable and viable ones first, then viable, then the others.
    expected : PeriodicOrbit or None
        The predicted motion among them.
    basis : str
        Why that motion is the predicted one.
    reason : str
        Why there is no predicted motion, or a limitation of the choice.
    complete : bool
        Whether this is the last answer.
    kind : str
        Kind of the motion that the rig reaches when it is run ahead (`MotionKind`); empty without
        such a run, or if the predicted motion is the measured one.
    applies : bool
        Whether the theory covers such a rig.
    error : str
        Why the search failed; empty if it did not.
    """

    orbits: tuple[PeriodicOrbit, ...] = ()
    expected: PeriodicOrbit | None = None
    basis: Basis = ''
    reason: str = ''
    complete: bool = False
    kind: str = ''
    applies: bool = True
    error: str = ''

    def nearest(self, measured: Rhythm) -> tuple[PeriodicOrbit, Apart] | None:
        """Return the nearest motion, beginning at the same impact, and its distance."""
        turned = filter(None, (orbit.nearest_turn(measured) for orbit in self.orbits))
        return min(turned, key=lambda pair: max(pair[1]), default=None)


def failed_document(time: float | None, text: str) -> str:
    """Return the document of a rig for which there is no theory, or none yet, as JSON."""
    reason = {'type': 'theory_failed', 'text': text} if text else None
    document = {'time': time, 'orbit': None, 'gap_curve': None, 'theory_failed': reason}
    return json.dumps(document)
