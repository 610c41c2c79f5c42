# SPDX-License-Identifier: Apache-2.0
"""
Commands: what was done to a recorded rig, and its state after that, by its snapshots.

A snapshot is checked before a rig is restored from it: a state that no rig can have would
otherwise show much later, as an error of arithmetic.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from math import inf, nextafter
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

from impact_damper_ros.bag import RecordedMessage, RecordingError, String
from impact_damper_ros.bag.messages import STRING, decode
from impact_damper_ros.bag.snapshots import RATES, without_search
from impact_damper_ros.control.own_law import LawError, OwnLaw
from impact_damper_ros.motion.event import Event
from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.parameter_spec import number_between
from impact_damper_ros.parameters.quoting import as_line, quote
from impact_damper_ros.parameters.rig_parameters import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
)
from impact_damper_ros.parameters.upgrades import FormatError
from impact_damper_ros.rig.observed_run import TimedOrder
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import RunawayError
from impact_damper_ros.rig.snapshot import LATEST, SAME_TIME, check_number, check_numbers, present

#: Stamps of ROS have 32 bits of seconds, with a sign.
_LATEST_NS = 2**31 * 10**9
#: Most interruptions of the search for the end of the first flight, which take a few seconds.
_MOST_LOOKS = 30_000


_T = TypeVar('_T')


def _refuse(name: str) -> float:
    raise ValueError(f'{name} is no number of JSON')


class Setting(NamedTuple):
    """All parameters of a rig and of its gap control, as commands change them."""

    rig: RigParameters
    control: GapControlParameters

    @classmethod
    def of(cls, state: Mapping[str, Any]) -> Self:
        """Return the parameters that a snapshot holds."""
        return cls(
            RigParameters(**state['parameters']),
            GapControlParameters(**state['gap_control']['parameters']),
        )

    @classmethod
    def at(cls, rig: Rig) -> Self:
        """Return the present parameters of a rig."""
        return cls(rig.parameters, rig.control)

    def replace_values(self, values: Mapping[str, Any]) -> Setting:
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


class Head(NamedTuple):
    """The run and the number of a snapshot, and its time."""

    run: str
    number: int
    offset_ns: int
    time_ns: int

    @property
    def stamp_ns(self) -> int:
        """Stamp of the snapshot."""
        return self.offset_ns + self.time_ns


#: An entry of `done`: parameters that change together, a reset, or stamps that move.
Deed = Mapping[str, Any] | InitialConditions | int


class Command(NamedTuple):
    """
    What was done to a rig at one instant, and the rig after it.

    Attributes
    ----------
    stamp_ns, offset_ns, time_ns : int
        Stamp, stamp of rig time 0 after it, and rig time.
    reason : str
        Why the snapshot was published.
    number : int
        Number of the snapshot, among those of this rig.
    run : str
        Identity of the run.
    node : str
        Full name of the node.
    topics : mapping of str to str
        Full names of its topics.
    rate : float
        Joint states per second of rig time.
    done : tuple
        Entries in order: a mapping of parameters to the values that they took together, the
        initial conditions of a reset, or the new stamp of rig time 0.
    initial : InitialConditions
        Where a reset would put the rig.
    state : dict
        Everything that the future of the rig depends on; see `Rig.restore`.
    arithmetic, mathematics : int
        Numbers of the arithmetic of the version that recorded the run, see
        `rig.snapshot.ARITHMETIC`, and of its machine, see `bag.snapshots.mathematics`.
    law : OwnLaw or None
        The law of the user's own that moves its stops, which the snapshot only names.
    orders : list of TimedOrder
        Orders of a controller outside the rig with its stamp. The first of them may precede the
        snapshot: its state shows which.
    recorded_before : int
        Number of these orders that the node recorded before the snapshot.
    """

    stamp_ns: int
    offset_ns: int
    time_ns: int
    reason: str
    number: int
    run: str
    node: str
    topics: Mapping[str, str]
    rate: float
    done: tuple[Deed, ...]
    initial: InitialConditions
    state: dict[str, Any]
    arithmetic: int
    mathematics: int
    law: OwnLaw | None = None
    orders: Sequence[TimedOrder] = ()
    recorded_before: int = 0

    @property
    def time(self) -> float:
        """Rig time, s."""
        return self.time_ns / 1e9

    @property
    def resets(self) -> bool:
        """Whether the rig was reset."""
        return any(isinstance(entry, InitialConditions) for entry in self.done)


def parameters_of(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters, read from JSON, with tuples in place of lists."""
    return {n: tuple(value) if isinstance(value, list) else value for n, value in values.items()}


def _act_text(name: object, value: Any) -> Deed:
    if name == 'change':
        strange = sorted(value.keys() - {*PARAMETER_SPECS, *GAP_CONTROL_SPECS, *INITIAL_SPECS})
        if strange:
            raise ValueError(f'{quote(strange[0])} is no parameter of a rig')
        return parameters_of(value)
    if name == 'reset':
        return InitialConditions(**value)
    if name == 'stamp_offset_ns' and type(value) is int:
        return value
    raise ValueError(f'{quote(name)} with {quote(value)} cannot be done to a rig')


def read_head(recorded: RecordedMessage, path: Path, purpose: str) -> Head:
    """Decode the head of a snapshot of the bag at `path`; errors name the purpose."""
    return _read(recorded, path, purpose, _head)


def read_command(
    recorded: RecordedMessage, path: Path, purpose: str, law: OwnLaw | None = None
) -> Command:
    """Decode and check a snapshot of the bag at `path`; errors name the purpose."""
    return _read(recorded, path, purpose, lambda stored: _command_of(stored, law))


def _read(
    recorded: RecordedMessage, path: Path, purpose: str, take: Callable[[dict[str, Any]], _T]
) -> _T:
    """Decode a snapshot, and return the part of it that `take` reads."""
    where = f'the snapshot of {recorded.topic} at {recorded.stamp_ns} ns'
    try:
        message = decode(STRING, recorded.content)
        assert isinstance(message, String)
        stored = parse_snapshot(message.data)
    except ValueError as error:
        raise RecordingError(purpose, path, f'{where} cannot be read: {error}') from error
    try:
        return take(present(stored))
    except FormatError as error:
        remedy = 'use the version of impact_damper_ros that recorded the bag, or a later one'
        raise RecordingError(purpose, path, f'{where} is {error}', remedy) from None
    except LawError as error:
        remedy = 'compare_run and replay_run take it as --law MODULE:FUNCTION'
        raise RecordingError(purpose, path, f'{where} cannot be used: {error}', remedy) from error
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        text = str(error) if isinstance(error, ValueError) else repr(error)
        what = 'cannot be used' if isinstance(error, ValueError) else 'is not complete'
        raise RecordingError(purpose, path, f'{where} {what}: {text}') from error


def _text(name: str, value: Any) -> str:
    """Return a text that a snapshot holds."""
    if not isinstance(value, str):
        raise ValueError(f'{name} is {quote(value)}: it must be a text')
    return value


def _head(stored: dict[str, Any]) -> Head:
    offset_ns, time_ns = stored['stamp_offset_ns'], stored['time_ns']
    text = f'stamp_offset_ns is {quote(offset_ns)} and time_ns {quote(time_ns)}'
    if type(offset_ns) is not int or type(time_ns) is not int or time_ns < 0:
        raise ValueError(f'{text}: both must be whole numbers of nanoseconds')
    if abs(offset_ns) + time_ns >= _LATEST_NS:
        raise ValueError(f'{text}: stamps of ROS end at {_LATEST_NS} ns')
    if type(stored['number']) is not int:
        raise ValueError(f'number is {quote(stored["number"])}: it must be a whole number')
    return Head(_text('run', stored['run']), stored['number'], offset_ns, time_ns)


def _command_of(stored: dict[str, Any], law: OwnLaw | None) -> Command:
    # Other rigs of the bag may have no law of the user's own.
    law = law if 'law' in stored['state']['gap_control'] else None
    head = _head(stored)
    _check_time(stored['state'], head.time_ns / 1e9)
    numbers = {'mathematics': stored['mathematics'], 'arithmetic': stored['state']['arithmetic']}
    for name, number in numbers.items():
        if type(number) is not int:
            raise ValueError(f'{name} is {quote(number)}: it must be a whole number')
    number_between('rate', stored['rate'], *RATES)
    return Command(
        head.stamp_ns,
        head.offset_ns,
        head.time_ns,
        as_line(_text('reason', stored['reason'])),
        head.number,
        run=head.run,
        node=_text('node', stored['node']),
        topics={str(key): _text('topics', name) for key, name in stored['topics'].items()},
        rate=stored['rate'],
        done=tuple(_act_text(name, value) for name, value in stored['done']),
        initial=InitialConditions(**stored['initial']),
        state=_checked_state(stored['state'], law),
        **numbers,
        law=law,
    )


def parse_snapshot(text: str) -> dict[str, Any]:
    """Parse the text of a snapshot."""
    try:
        stored = json.loads(text, parse_constant=_refuse)
    except RecursionError as error:
        raise ValueError('it is nested too deep') from error
    if not isinstance(stored, dict):
        raise ValueError(f'it is {quote(stored)}, not an object')
    return stored


def _check_time(state: Mapping[str, Any], time: float) -> None:
    """Check that a state is of the rig time of its message, s."""
    check_number('time', state['time'])
    if abs(state['time'] - time) > SAME_TIME:
        raise ValueError(
            f'its state is of rig time {state["time"]!r} s, the message of {time!r} s'
        )


def _checked_state(state: dict[str, Any], law: OwnLaw | None) -> dict[str, Any]:
    """Check that a rig can be restored from a state, and return the state."""
    try:
        check_numbers('sample', Rig.restore(state, law).sample())
        return state
    except (ArithmeticError, AttributeError, LookupError, TypeError) as error:
        raise ValueError(f'{type(error).__name__}: {error}') from error


def restore_rig(command: Command, path: Path) -> Rig:
    """
    Return the rig after a command of the bag at a path.

    The present flight must last up to the snapshot, and its search must not take too long.
    """
    looks, now = iter(range(_MOST_LOOKS)), command.state['time']
    # An advance to the present instant could not be interrupted.
    then, fault = min(nextafter(now, inf), LATEST), ''
    rig = Rig.restore(without_search(command.state), command.law)
    try:
        events: Sequence[Event] = rig.advance(then, 2, lambda: next(looks, None) is None)
    except RunawayError as error:
        events = error.events
    if events and events[0].time < now - SAME_TIME:
        fault = f'ends at {events[0].time!r} s, before time, {now!r} s'
    if next(looks, None) is None:
        fault = 'takes too long'
    if fault:
        cause = f'the flight from origin.time in the snapshot at {command.stamp_ns} ns {fault}'
        raise RecordingError('replay', path, cause)
    return Rig.restore(command.state, command.law)
