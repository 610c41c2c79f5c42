"""The settings of a rig: its parameters and those of its gap control, as commands change them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.rig import PARAMETER_SPECS, RigParameters


class Setting(NamedTuple):
    """All parameters of a rig and of its gap control."""

    rig: RigParameters
    control: GapControlParameters

    def replaced(self, values: Mapping[str, Any]) -> Setting:
        """
        Return the setting with other values of those parameters that it has.

        Raises
        ------
        ParameterError
            If that is not admissible.
        """
        return Setting(
            self.rig.replace(**{n: v for n, v in values.items() if n in PARAMETER_SPECS}),
            self.control.replace(**{n: v for n, v in values.items() if n in GAP_CONTROL_SPECS}),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return name and value of every parameter."""
        return {**self.rig.as_dict(), **self.control.as_dict()}


def setting_of(state: Mapping[str, Any]) -> Setting:
    """Return the parameters that a snapshot holds."""
    return Setting(
        RigParameters(**state['parameters']),
        GapControlParameters(**state['gap_control']['parameters']),
    )
