"""`--set NAME=VALUE`: changes to the rig of a parameters file, the same in every command."""

from __future__ import annotations

import argparse
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from itertools import groupby
from math import isfinite
from typing import Any, NamedTuple

from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    ParameterError,
    RigParameters,
)
from impact_damper_ros.rig.parameters_file import YamlError, guarded_yaml_text
from impact_damper_ros.rig.quoting import named, shown

__all__ = ['TimedChange', 'add_set_option', 'overridden', 'overridden_control', 'timed_changes']


class TimedChange(NamedTuple):
    """
    A change of parameters at an instant.

    Attributes
    ----------
    time_ns : int
        The instant, ns.
    values : dict of str to value
        The new values by name.
    parameters : RigParameters
        The rig from then on.
    control : GapControlParameters
        Its gap control from then on.
    """

    time_ns: int
    values: dict[str, Any]
    parameters: RigParameters
    control: GapControlParameters


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """Let a command that takes a parameters file also take ``--set``."""
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='override a parameter of the file, for example --set gap=30; may be repeated',
    )


def _values(
    settings: Sequence[str], names: Sequence[str], option: str = '--set'
) -> dict[str, object]:
    """Read the settings; their names must be among some."""
    changes: dict[str, object] = {}
    for setting in settings:
        name, equals, text = setting.partition('=')
        if not equals or name not in names:
            raise ValueError(
                f'{option} {named(setting)}: give NAME=VALUE with one of the names '
                f'{", ".join(names)}'
            )
        try:
            changes[name] = guarded_yaml_text(text)
        except YamlError as error:
            # The place would be that in a file
            reason = str(error).removeprefix('line 1: ')
            raise ValueError(
                f'{option} {named(setting)}: {shown(text)} is not a value: {reason}'
            ) from error
        if isinstance(changes[name], str):
            # YAML 1.1 takes 1e-3 for a text
            with suppress(ValueError):
                changes[name] = float(text)
    return changes


def overridden(
    settings: Sequence[str], parameters: RigParameters, initial: InitialConditions
) -> tuple[RigParameters, InitialConditions]:
    """Apply ``--set`` options to a rig, all at once."""
    changes = _values(settings, [*PARAMETER_SPECS, *INITIAL_SPECS])
    parameters = parameters.replace(**{k: v for k, v in changes.items() if k in PARAMETER_SPECS})
    start = {k: v for k, v in changes.items() if k in INITIAL_SPECS}
    initial = initial.replace(**start)
    initial.check_within(parameters)
    return parameters, initial


def overridden_control(
    settings: Sequence[str], control: GapControlParameters
) -> tuple[list[str], GapControlParameters]:
    """Apply those ``--set`` options that are of the gap control."""
    # An unknown name is told with all that may stand there.
    changes = _values(settings, [*PARAMETER_SPECS, *INITIAL_SPECS, *GAP_CONTROL_SPECS])
    own = {name: value for name, value in changes.items() if name in GAP_CONTROL_SPECS}
    others = [s for s in settings if s.partition('=')[0] not in own]
    return others, control.replace(**own)


def timed_changes(
    settings: Sequence[str],
    parameters: RigParameters,
    control: GapControlParameters,
    duration: float,
) -> list[TimedChange]:
    """Read ``--change`` options, in the order of their instants."""
    timed = []
    for setting in settings:
        text, colon, change = setting.partition(':')
        try:
            time = float(text)
        except ValueError:
            time = -1.0
        if not colon or not isfinite(time) or not 0.0 < time <= duration:
            raise ValueError(
                f'--change {setting}: give TIME:NAME=VALUE with a time above 0 s and up to the '
                f'{duration:g} s of the run'
            )
        timed.append((round(time * 1e9), change))
    changes = []
    for time_ns, group in groupby(sorted(timed, key=lambda t: t[0]), key=lambda t: t[0]):
        option = f'--change at {time_ns / 1e9:.9g} s:'
        given = _values([c for _, c in group], [*PARAMETER_SPECS, *GAP_CONTROL_SPECS], option)
        try:
            parameters = parameters.replace(**_among(given, PARAMETER_SPECS))
            control = control.replace(**_among(given, GAP_CONTROL_SPECS))
        except ParameterError as error:
            raise ValueError(f'--change at {time_ns / 1e9:.9g} s: {error}') from error
        every = {**parameters.as_dict(), **control.as_dict()}
        values = {name: every[name] for name in given}
        changes.append(TimedChange(time_ns, values, parameters, control))
    return changes


def _among(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}
