# SPDX-License-Identifier: Apache-2.0
"""The rig of a command: a parameters file, ``--set`` and ``--change``."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Mapping, Sequence
from itertools import groupby
from json import dumps
from operator import itemgetter
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from impact_damper_ros.control.own_law import LawError, OwnLaw
from impact_damper_ros.parameters.all_parameters import RIG_SPECS
from impact_damper_ros.parameters.description import describe_rig, frequency_hint
from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.node_settings import SETTING_SPECS
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.parameters_file import (
    YamlError,
    load_parameters,
    presets,
    rig_yaml,
    yaml_value,
)
from impact_damper_ros.parameters.quoting import as_name, quote, similar_names
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    InitialConditions,
    RigParameters,
)
from impact_damper_ros.parameters.units import si_value
from impact_damper_ros.rig.observed_run import TimedChange

from .command_line import path_of, say

#: Parameters of a node that name the measured records of its rig.
RECORDS = ('force_record', 'base_record')


class GivenRig(NamedTuple):
    """A rig, where it starts, and its gap control."""

    parameters: RigParameters
    initial: InitialConditions
    control: GapControlParameters
    #: Texts by name of the law and the records, as ``control_law``, if the rig has them
    texts: Mapping[str, str] = MappingProxyType({})

    def with_changes(self, values: Mapping[str, Any]) -> GivenRig:
        """Return the rig with some of its parameters changed, all at once."""
        return self._replace(
            parameters=self.parameters.replace(**_among(values, RIG_SPECS)),
            initial=self.initial.replace(**_among(values, INITIAL_SPECS)),
            control=self.control.replace(**_among(values, GAP_CONTROL_SPECS)),
        )

    def as_dict(self) -> dict[str, Any]:
        """Return all parameters by name, but for the texts."""
        parts = self.parameters, self.initial, self.control
        return {name: value for part in parts for name, value in part.as_dict().items()}

    def yaml(self) -> str:
        """Return the rig as a parameters file."""
        title = rig_line(self.parameters)
        text = rig_yaml(self.parameters, title, self.initial, self.control)
        # Relative paths are made absolute: the file may be read in another directory.
        texts = {
            name: str(Path(text).expanduser().resolve()) if name in RECORDS else text
            for name, text in self.texts.items()
        }
        return text + ''.join(f'    {name}: {dumps(text)}\n' for name, text in texts.items())


def add_params_argument(parser: argparse.ArgumentParser) -> argparse.Action:
    """Let a command take the parameters file of a rig."""
    params = parser.add_argument(
        'params',
        type=path_of,
        metavar='PARAMS',
        help=f'ROS 2 parameters file of the rig, or a preset: {", ".join(presets())}',
    )
    parser.add_argument(
        '--node',
        default='',
        metavar='NAME',
        help='full name of the node whose rig it is, if the file describes several',
    )
    return params


def add_set_option(parser: argparse.ArgumentParser) -> None:
    """Let a command that takes a parameters file also take ``--set``."""
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='override a parameter of the file, for example --set gap=0.03; may be repeated',
    )


def add_law_option(parser: argparse.ArgumentParser) -> None:
    """Let a command with gap control take a law of the user's own."""
    parser.add_argument(
        '--law',
        metavar='MODULE:FUNCTION',
        help='move the stops by a Python function law(seen, memory) -> (stop_1, stop_2) in place '
        'of the law that gap_control names (timed, if that is off); modules in the current '
        'directory are found',
    )


def add_recorded_law_option(parser: argparse.ArgumentParser) -> None:
    """Let a command that replays a bag take the user's own law that moved the stops."""
    parser.add_argument(
        '--law',
        type=_law,
        metavar='MODULE:FUNCTION',
        help='your control law with which the run was recorded, since a bag has only its name; '
        'modules in the current directory are found',
    )


def _law(text: str) -> OwnLaw:
    try:
        return OwnLaw.from_text(text)
    except LawError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def given_law(text: str | None, given: GivenRig) -> tuple[OwnLaw | None, GivenRig]:
    """Return the law of ``--law`` or of the file, or None, and the rig with this law."""
    if text is not None:
        control = given.control
        on = control if control.active else control.replace(gap_control='timed')
        given = given._replace(control=on, texts={**given.texts, 'control_law': text})
    name = given.texts.get('control_law')
    return None if name is None else OwnLaw.from_text(name), given


def given_rig(
    params: Path,
    settings: Sequence[str] = (),
    node: str = '',
    *,
    with_control: bool = True,
    with_records: bool = False,
) -> GivenRig:
    """
    Read the rig of a command from a parameters file or preset, and from ``--set`` options.

    `node` names the rig of a file that describes several.

    A command without gap control refuses a rig under control, and its parameters in the file and
    in ``--set``; a command without records refuses records.
    """
    parameters, initial, other = load_parameters(params, node)
    control = GapControlParameters(**_among(other, GAP_CONTROL_SPECS))
    texts = {
        name: text
        for name in ('control_law', *RECORDS)
        if name in other and (text := str(SETTING_SPECS[name].check(other[name]))) != 'none'
    }
    given = overridden(
        settings, GivenRig(parameters, initial, control, texts), with_control=with_control
    )
    if not with_control and given.control.active:
        raise ValueError(
            f'gap_control is {given.control.gap_control}: this command is for stops that do not '
            'move: give gap_control=off'
        )
    for name in RECORDS:
        if name in texts and not with_records:
            raise ValueError(
                f'{params}: {name} is {as_name(texts[name])}: this command is for rigs without '
                'records: leave it out of the file'
            )
    return given


def overridden(settings: Sequence[str], given: GivenRig, *, with_control: bool = True) -> GivenRig:
    """Apply ``--set`` options to a rig, all at once."""
    control = GAP_CONTROL_SPECS if with_control else ('gap_control',)
    names = [*RIG_SPECS, *INITIAL_SPECS, *control]
    changed = given.with_changes(values_of(settings, names))
    changed.initial.check_within(changed.parameters)
    return changed


def values_of(
    settings: Sequence[str],
    names: Collection[str],
    option: str = '--set ',
    listing: str = 'simulate_rig --parameters',
) -> dict[str, Any]:
    """Read ``NAME=VALUE`` settings of the parameters in `names`, which `listing` lists."""
    values: dict[str, Any] = {}
    for setting in settings:
        name, _, text = setting.partition('=')
        name = name.strip()
        if not text.strip():
            raise ValueError(f'{option}{as_name(setting)}: give NAME=VALUE')
        if name.removesuffix(':') in names and name.endswith(':'):
            raise ValueError(f'{option}{as_name(setting)}: write {name[:-1]}={as_name(text)}')
        if name not in names:
            close = similar_names(name, names)
            remedy = f'did you mean {close}?' if close else f'{listing} lists all parameters'
            raise ValueError(
                f'{option}{as_name(setting)}: there is no parameter {as_name(name)} to set: '
                f'{remedy}'
            )
        if name in values:
            raise ValueError(f'{option}{as_name(setting)}: {name} is given twice: give it once')
        try:
            values[name] = yaml_value(text)
        except YamlError as error:
            # The error would name a line of a file.
            reason = str(error).removeprefix('line 1: ')
            raise ValueError(
                f'{option}{as_name(setting)}: {quote(text)} is not a value: {reason}'
            ) from error
    return values


def setting_value(name: str) -> Callable[[str], Any]:
    """Return a function that reads a setting of the node, for `argparse`."""

    def read(text: str) -> Any:
        try:
            return SETTING_SPECS[name].check(yaml_value(text))
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return read


def _among(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name in names}


def timed_changes(settings: Sequence[str], given: GivenRig, duration: float) -> list[TimedChange]:
    """Read ``--change`` options, in the order of their instants."""
    timed = []
    for setting in settings:
        text, colon, change = setting.partition(':')
        try:
            time = si_value(text, 's')
        except ValueError:
            time = -1.0
        if not colon or not 0.0 < time <= duration:
            raise ValueError(
                f'--change {as_name(setting)}: give TIME:NAME=VALUE with a time above 0 s and up '
                f'to the {duration:g} s of the run'
            )
        timed.append((round(time * 1e9), change))
    changes = []
    for time_ns, group in groupby(sorted(timed, key=itemgetter(0)), key=itemgetter(0)):
        option = f'--change at {time_ns / 1e9:.9g} s: '
        values = values_of([c for _, c in group], [*RIG_SPECS, *GAP_CONTROL_SPECS], option)
        try:
            given = given.with_changes(values)
        except ParameterError as error:
            raise ValueError(f'{option}{error}') from error
        every = {**given.parameters.as_dict(), **given.control.as_dict()}
        values = {name: every[name] for name in values}
        changes.append(TimedChange(time_ns, values, given.parameters, given.control))
    return changes


def rig_line(
    rig: RigParameters, control: GapControlParameters | None = None, law: str = ''
) -> str:
    """Return the rig of a command in a line, with its gap control."""
    text = describe_rig(rig)
    if control is not None and control.active:
        text += f'; gap control {law or control.gap_control}'
    return text


def announce(
    command: str,
    rig: RigParameters,
    control: GapControlParameters | None = None,
    *,
    law: str = '',
) -> None:
    """Print the rig of a command before the work, with a hint if a frequency may be in Hz."""
    say(command, rig_line(rig, control, law))
    hint(command, rig)


def hint(command: str, rig: RigParameters) -> None:
    """Print the hint of `announce` if a frequency may be in Hz."""
    if note := frequency_hint(rig):
        say(command, f'note: {note}')
