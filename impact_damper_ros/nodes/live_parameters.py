"""Parameters while the node runs: a request is understood, judged and taken over as a whole."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.parameter import Parameter

from impact_damper_ros.nodes.rig_parameters import (
    ALL_SPECS,
    READ_ONLY,
    NodeParameters,
    nearest_name,
    promoted,
    resized_force,
)
from impact_damper_ros.rig import ParameterError
from impact_damper_ros.rig.shown import named, shown

__all__ = ['LiveParameters']


class LiveParameters:
    """
    The parameters while the node runs: callbacks for rclpy that never raise.

    Parameters
    ----------
    start : NodeParameters
        As declared.
    prepare : callable
        Called with a valid request as a whole before it is accepted; what it raises rejects it.
    apply : callable
        Called with the accepted parameters before and after, and what was set.
    """

    def __init__(
        self,
        start: NodeParameters,
        *,
        prepare: Callable[[NodeParameters, NodeParameters], None],
        apply: Callable[[NodeParameters, NodeParameters, Sequence[Parameter]], None],
    ) -> None:
        """Hold the parameters; `attach` connects them."""
        self.now = start
        self._prepare = prepare
        self._apply = apply

    def attach(self, node: Any) -> None:
        """Register the callbacks; all parameters must be declared already."""
        node.add_pre_set_parameters_callback(self.promote)
        node.add_on_set_parameters_callback(self.validate)
        node.add_post_set_parameters_callback(self.accept)

    def promote(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        """Read values as they are meant, and resize the force arrays that were not given."""
        meant = [promoted(parameter) for parameter in parameters]
        values = {p.name: p.value for p in meant if p.type_ is Parameter.Type.DOUBLE_ARRAY}
        resized = resized_force(values, self.now.rig)
        return meant + [
            Parameter(name, Parameter.Type.DOUBLE_ARRAY, value) for name, value in resized.items()
        ]

    def objection(self, parameters: Sequence[Parameter], has: Callable[[str], bool]) -> str:
        """
        Say why a request cannot be met, or return an empty text.

        rclpy checks names, types and ranges itself, but its reasons do not name the remedy.
        """
        values = {}
        for parameter in self.promote(parameters):
            name = parameter.name
            if not has(name):
                near = nearest_name(name)
                hint = f'did you mean {near}?' if near else 'see: ros2 param list'
                return f'{named(name)} is not a parameter of this node: {hint}'
            if name not in ALL_SPECS:
                continue
            if name in READ_ONLY:
                return (
                    f'{name} is fixed while the node runs: start it with '
                    f'--ros-args -p {name}:={shown(parameter.value)}'
                )
            values[name] = parameter.value
        try:
            self.now.changed(values)
        except ParameterError as error:
            return str(error)
        return ''

    def validate(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        """Accept or reject a request as a whole."""
        try:
            self._prepare(self.now, self.now.changed(_known_values(parameters)))
        except Exception as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def accept(self, parameters: Sequence[Parameter]) -> None:
        """Take over what has been set."""
        before = self.now
        self.now = before.changed(_known_values(parameters))
        self._apply(before, self.now, parameters)


def _known_values(parameters: Iterable[Parameter]) -> dict[str, Any]:
    return {p.name: p.value for p in parameters if p.name in ALL_SPECS}
