"""The settings of one rig of a sweep: what takes which value, put into its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.rig import InitialConditions, RigParameters

from .sweep_axes import Target

__all__ = ['varied', 'varied_control']


def varied(
    parameters: RigParameters,
    initial: InitialConditions,
    settings: Sequence[tuple[Target, float]],
) -> tuple[RigParameters, InitialConditions]:
    """
    Return a rig with other values, all at once; those of the gap control are left out.

    Parameters
    ----------
    parameters, initial : RigParameters, InitialConditions
        The rig as it is.
    settings : sequence of (Target, float)
        What takes which value.

    Raises
    ------
    ParameterError
        If the rig is not admissible with them. Whether m then starts between the stops is left
        to whoever starts it.
    """
    changes: dict[str, Any] = {}
    start: dict[str, Any] = {}
    for target, value in settings:
        if target.control:
            continue
        if target.initial:
            start[target.name] = value
        elif target.index is None and target.spec.kind != 'double_array':
            changes[target.name] = int(value) if target.spec.kind == 'integer' else value
        else:
            entries = list(changes.get(target.name, getattr(parameters, target.name)))
            entries[target.index or 0] = value
            changes[target.name] = tuple(entries)
    rig = parameters.replace(**changes)
    begun = InitialConditions(**{**initial.as_dict(), **start})
    return rig, begun


def varied_control(
    control: GapControlParameters, settings: Sequence[tuple[Target, float]]
) -> GapControlParameters:
    """
    Return a gap control with other values, all at once; those of the rig are left out.

    Raises
    ------
    ParameterError
        If the control is not admissible with them.
    """
    return control.replace(
        **{
            target.name: int(value) if target.spec.kind == 'integer' else value
            for target, value in settings
            if target.control
        }
    )
