"""What the predicting process tells the node."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

from impact_damper_ros.analysis.rhythm import Apart, Rhythm

__all__ = ['Answer', 'PredictedMotion']


@dataclass(frozen=True)
class PredictedMotion:
    """
    A periodic motion of the theory.

    Attributes
    ----------
    rhythm : Rhythm
        Stops, period, phases, X.
    amplitude_ratio : float
        Largest |X| as a share of the amplitude A without impacts.
    largest_multiplier : float
        Largest modulus of the stability multipliers.
    stable, viable : bool
        Whether it is.
    reason : str
        Why it is not viable.
    """

    rhythm: Rhythm
    amplitude_ratio: float
    largest_multiplier: float
    stable: bool
    viable: bool
    reason: str

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> PredictedMotion:
        """Read what the worker has written."""
        names = ('amplitude_ratio', 'largest_multiplier', 'stable', 'viable', 'reason')
        return cls(Rhythm.from_dict(stored), *(stored[name] for name in names))


@dataclass(frozen=True)
class Answer:
    """
    What the worker has found for a request.

    Attributes
    ----------
    request : int
        Number of the request; 0 before the first answer.
    motions : tuple of PredictedMotion
        Stable and viable ones first.
    expected : PredictedMotion or None
        The one of them that is predicted.
    basis, reason : str
        Why that one, or why none.
    complete : bool
        Whether no better answer is to come.
    seconds : float
        Time since the worker took the request, s.
    error : str
        What went wrong.
    applies : bool
        Whether the theory is for such a rig at all.
    """

    request: int = 0
    motions: tuple[PredictedMotion, ...] = ()
    expected: PredictedMotion | None = None
    basis: str = ''
    reason: str = ''
    complete: bool = False
    seconds: float = 0.0
    error: str = ''
    applies: bool = True

    @classmethod
    def from_line(cls, line: bytes) -> Answer:
        """Read what the worker has written."""
        stored = json.loads(line)
        motions = tuple(PredictedMotion.from_dict(orbit) for orbit in stored.get('orbits', ()))
        index = stored.get('expected')
        return cls(
            stored['request'],
            motions,
            None if index is None else motions[index],
            stored.get('basis', ''),
            stored.get('reason', ''),
            stored['complete'],
            stored['seconds'],
            stored.get('error', ''),
            stored.get('applies', True),
        )

    def nearest(self, measured: Rhythm) -> tuple[PredictedMotion, Apart] | None:
        """Return the motion nearest to a measured one, counted as it is, and how far it is."""
        found = []
        for motion in self.motions:
            turned = motion.rhythm.turned_to(measured)
            if turned is not None:
                found.append((replace(motion, rhythm=turned[0]), turned[1]))
        return min(found, key=lambda pair: max(pair[1]), default=None)
