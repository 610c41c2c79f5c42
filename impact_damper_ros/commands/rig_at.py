"""The logged rig between two cuts of a run: parameters, force, and what a change makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from impact_damper_ros.analysis.force_clock import ForceClock
from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.rig import PARAMETER_SPECS, RigParameters
from impact_damper_ros.rig.snapshot import Snapshot

__all__ = ['RigAt', 'changed_names', 'told_change']

_OFF = 'off'
_NO_CONTROL = {'gap_control': _OFF}


@dataclass(frozen=True)
class RigAt:
    """
    A rig as logged.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    clock : ForceClock or None
        The force; None if its phase is not known.
    last_stop : int
        Stop hit last, 0 for none.
    control : mapping of str to value
        Gap-control parameters.
    stops_move : bool
        Whether stops are on their way, moved by a control or back from there.
    """

    parameters: RigParameters
    clock: ForceClock | None = None
    last_stop: int = 0
    control: Mapping[str, Any] = field(default_factory=lambda: dict(_NO_CONTROL))
    stops_move: bool = False

    @classmethod
    def of_parameters(cls, parameters: RigParameters) -> Self:
        """Return a rig of which nothing else is known."""
        return cls(parameters)

    @classmethod
    def of_dump(cls, values: Mapping[str, Any]) -> Self | None:
        """Return the rig that a list of all parameters tells; None if it lacks some."""
        if not values.keys() >= PARAMETER_SPECS.keys():
            return None
        rig = RigParameters(**{n: values[n] for n in PARAMETER_SPECS})
        return cls(rig, control=_control_of(values))

    @classmethod
    def of_snapshot(cls, state: Mapping[str, Any]) -> Self:
        """
        Return the rig of a snapshot.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        snapshot = Snapshot.from_dict(dict(state))
        origin = snapshot.origin
        time = origin.time + origin.time_low
        clock = None
        if snapshot.parameters.sweep_mode == 'off':
            clock = ForceClock(snapshot.parameters, time, tuple(origin.angles))
        stored = state.get('gap_control', {})
        control = _control_of(stored.get('parameters', {}))
        moving = _active(control) or bool(stored.get('state', {}).get('returning'))
        return cls(snapshot.parameters, clock, origin.last_stop, control, moving)

    def changed(self, values: Mapping[str, Any], time: float) -> RigAt:
        """
        Return the rig after a change at an instant, s; the harmonics keep their angles.

        Raises
        ------
        ParameterError
            If the rig cannot be changed so.
        """
        named = {name: value for name, value in values.items() if name in PARAMETER_SPECS}
        parameters = self.parameters.replace(**named)
        clock = self.clock
        if clock is not None:
            turned = clock.angles_at(np.array([time]))[:, 0] - clock.parameters.force_phases
            count = len(parameters.force_phases)
            angles = (*(float(angle) for angle in turned), *(0.0,) * count)[:count]
            clock = ForceClock(parameters, time, angles)
        return replace(self, parameters=parameters, clock=clock)

    def differences(self, other: RigAt) -> str:
        """Return in words what another rig has that this one has not."""
        parts = []
        for name in sorted(changed_names(self, other)):
            if name in PARAMETER_SPECS:
                unit = PARAMETER_SPECS[name].unit
                was, now = getattr(self.parameters, name), getattr(other.parameters, name)
            else:
                unit, was, now = '', self.control.get(name), other.control.get(name)
            unit = f' {unit}' if unit else ''
            parts.append(f'{name} = {_shown(now)}{unit} (was {_shown(was)}{unit})')
        return ', '.join(parts)


def _control_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the gap-control parameters among some; off, if there are none."""
    return {**_NO_CONTROL, **{n: values[n] for n in GAP_CONTROL_SPECS if n in values}}


def _active(control: Mapping[str, Any]) -> bool:
    return bool(control['gap_control'] != _OFF)


def _shown(value: Any) -> str:
    if isinstance(value, tuple):
        return f'[{", ".join(_shown(entry) for entry in value)}]'
    return f'{value:.9g}' if isinstance(value, float) else str(value).lower()


def changed_names(one: RigAt, other: RigAt) -> set[str]:
    """Return the names of the parameters in which two rigs differ."""
    before, after = one.parameters.as_dict(), other.parameters.as_dict()
    names = {name for name in before if before[name] != after[name]}
    if not (_active(one.control) or _active(other.control)):
        # What the laws are set to does not matter then.
        return names
    # A list of all parameters of an older version knows no control.
    known = one.control.keys() & other.control.keys()
    return names | {n for n in known if one.control[n] != other.control[n]}


def told_change(values: Mapping[str, Any]) -> bool:
    """Return whether a parameter event changes the rig."""
    return any(name in PARAMETER_SPECS for name in values)
