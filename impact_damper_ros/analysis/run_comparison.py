"""
The outcome of holding a recorded run against the periodic theory.

A run is cut where its parameters change, it is reset or it is resumed; each stretch between two
cuts is measured, classified and compared on its own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from typing import Any

import numpy as np

from impact_damper_ros.orbits import PeriodicOrbit
from impact_damper_ros.rig import RigParameters

from .motion_kind import MotionKind
from .run_curves import StretchCurves
from .stretch_measures import Decay, EnergyBalance, Finding, MeasuredMotion, Overall

__all__ = [
    'Beginning',
    'LogCheck',
    'MotionKind',
    'RunComparison',
    'StretchComparison',
    'Verdict',
]


class Beginning(Enum):
    """Why a stretch begins."""

    START = 'start'
    CHANGE = 'change'
    RESET = 'reset'
    RESUME = 'resume'
    #: Messages are missing before it.
    GAP = 'gap'


class Verdict(Enum):
    """How a stretch compares with theory."""

    AGREES = 'agrees'
    NOT_SETTLED = 'not settled yet'
    DIFFERS = 'differs'
    #: The motion that theory has here is not stable, so that the rig leaves it.
    PREDICTED_UNSTABLE = 'predicted unstable'
    NO_PREDICTION = 'no prediction'
    #: Too little was recorded.
    TOO_SHORT = 'too short'


@dataclass(frozen=True, kw_only=True)
class StretchComparison:
    """
    One stretch of a run, with constant parameters, held against theory.

    Attributes
    ----------
    number : int
        Counted from 1.
    start, end : float
        Rig time, s.
    begins : Beginning
        Why it begins.
    cause : str
        The same in words: ``'gap = 0.012 m (was 0.01 m)'``.
    parameters : RigParameters
        As logged.
    control : mapping of str to value
        Gap-control parameters as logged; empty if the bag has none.
    samples, impacts, missing_samples : int
        What was recorded of it.
    kind : MotionKind
        What the motion is.
    evidence : str
        The numbers on which that rests, as a sentence.
    measures : mapping of str to float
        The same numbers by name.
    cycles : int
        Period k in cycles of the force; 0 if the motion is not periodic.
    settled_at : float or None
        Rig time from which the motion is steady, s; None if it does not become so.
    overall : Overall or None
        Swing, impacts and energy over the whole stretch.
    measured : MeasuredMotion or None
        The steady part.
    predicted : PeriodicOrbit or None
        The periodic motion that theory has for the logged parameters, nearest to the measured one,
        begun at the same impact as `measured.last_period`.
    predicted_impulse : tuple of float
        Its impulses, N s.
    solver : str
        What found it, or why there is no prediction.
    energy : EnergyBalance or None
        Over whole periods.
    decay : Decay or None
        Into the steady state.
    verdict : Verdict
        How it compares.
    sentence : str
        The verdict in words, with numbers.
    findings : tuple of Finding
        What is not as it should be, the earliest first.
    curves : StretchCurves
        For plots.
    """

    number: int
    start: float
    end: float
    begins: Beginning
    cause: str
    parameters: RigParameters
    control: Mapping[str, Any] = field(default_factory=dict)
    samples: int
    impacts: int
    missing_samples: int = 0
    kind: MotionKind
    evidence: str
    measures: Mapping[str, float] = field(default_factory=dict)
    cycles: int = 0
    settled_at: float | None = None
    overall: Overall | None = None
    measured: MeasuredMotion | None = None
    predicted: PeriodicOrbit | None = None
    predicted_impulse: tuple[float, ...] = ()
    solver: str = ''
    energy: EnergyBalance | None = None
    decay: Decay | None = None
    verdict: Verdict
    sentence: str
    findings: tuple[Finding, ...] = ()
    curves: StretchCurves = field(default_factory=StretchCurves)

    @property
    def stops(self) -> tuple[int, ...]:
        """Stops hit in a measured period; empty if the motion is not periodic."""
        if self.measured is None or self.measured.last_period is None:
            return ()
        return self.measured.last_period.stops

    @property
    def impacts_per_period(self) -> int:
        """Number N of impacts in a measured period."""
        return len(self.stops)


@dataclass(frozen=True)
class LogCheck:
    """
    How the numbers of a log were checked.

    Attributes
    ----------
    replayed : bool
        Whether the log was replayed from its first snapshot, and every number compared bit for
        bit. Otherwise the motion was checked from sample to sample, to round-off.
    text : str
        What was checked, in words.
    differences : int
        Numbers and messages that differ from the replay.
    unchecked : tuple of str
        Topics, and what else, that was not checked.
    """

    replayed: bool
    text: str
    differences: int = 0
    unchecked: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class RunComparison:
    """
    A recorded run held against theory.

    Attributes
    ----------
    bag, node : str
        The recording, and the node that it is of.
    version : str
        Of this package.
    complete : bool
        Whether the bag was finished and is all there.
    stamps : str
        What the log times are: ``'rig time'``, or ``'times of arrival'``.
    start, end : float
        Rig times of the first and last sample, s.
    samples, impacts : int
        How many there are.
    stretches : tuple of StretchComparison
        In order.
    log : LogCheck
        How the numbers were checked.
    faults : tuple of str
        Why the bag could be used in part only.
    remarks : tuple of str
        What else is to be known.
    """

    bag: str
    node: str
    version: str
    complete: bool
    stamps: str
    start: float
    end: float
    samples: int
    impacts: int
    stretches: tuple[StretchComparison, ...]
    log: LogCheck = field(default_factory=lambda: LogCheck(False, 'the log was not checked'))
    faults: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    @property
    def exit_code(self) -> int:
        """0: nothing differs; 1: something does; 3: nothing does, but the bag is not whole."""
        if any(stretch.verdict is Verdict.DIFFERS for stretch in self.stretches):
            return 1
        return 3 if self.faults else 0

    @property
    def overall(self) -> Overall | None:
        """Swing, impacts and energy over all stretches; None if they are known of none."""
        parts = [s.overall for s in self.stretches if s.overall is not None]
        return Overall.joined(parts) if parts else None

    def as_dict(self, *, curves: bool = False) -> dict[str, Any]:
        """
        Return all as what JSON can hold; what is not a finite number becomes None.

        Parameters
        ----------
        curves : bool, optional
            Whether to include the arrays for plots, as lists.
        """
        plain = _plain(self, curves=curves)
        assert isinstance(plain, dict)
        overall = _plain(self.overall, curves=curves)
        return {**plain, 'overall': overall, 'exit_code': self.exit_code}


def _plain(value: Any, *, curves: bool) -> Any:
    """Return a value as numbers, texts, lists and dictionaries."""
    if isinstance(value, PeriodicOrbit | RigParameters):
        return _plain(value.as_dict(), curves=curves)
    if is_dataclass(value) and not isinstance(value, type):
        names = [f.name for f in fields(value) if curves or f.name != 'curves']
        plain = {name: _plain(getattr(value, name), curves=curves) for name in names}
        if isinstance(value, Finding):
            plain['difference'] = _plain(value.difference, curves=curves)
        return plain
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(name): _plain(entry, curves=curves) for name, entry in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist(), curves=curves)
    if isinstance(value, tuple | list):
        return [_plain(entry, curves=curves) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
