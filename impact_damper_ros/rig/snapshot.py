# SPDX-License-Identifier: Apache-2.0
"""Snapshots: all that the future of a rig depends on, as numbers, texts, lists and mappings."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf, tau
from sys import float_info
from typing import Any, NamedTuple

from impact_damper_ros.motion.event import Event, EventKind
from impact_damper_ros.motion.state import (
    RECORDED,
    RECORDED_TYPES,
    STORED,
    STORED_TYPES,
    Mode,
    Run,
)
from impact_damper_ros.parameters.parameter_spec import number_between, whole_number
from impact_damper_ros.parameters.quoting import quote
from impact_damper_ros.parameters.rig_parameters import RigParameters
from impact_damper_ros.parameters.upgrades import (
    CONSTANT_RESTITUTION,
    Document,
    FormatError,
    Upgrade,
    newest,
    upgrade,
)

from .playback import Playback
from .stepped_sine import SteppedSine, rig_at, step_count, step_duration


def upgraded_from_1(document: Document) -> Document:
    """Return a document of format 1 in format 2, in which restitution may fall with the speed."""
    state = document['state']
    parameters = {**CONSTANT_RESTITUTION, **state['parameters']}
    return {**document, 'state': {**state, 'parameters': parameters}}


#: Steps from the format of version 1.0 to the present one, see `parameters.upgrades`. The format
#: is that of all that is kept of a rig: its state, and the messages of a bag, which its snapshots
#: describe. A document is the message of a snapshot, or {'state': state} of one that was taken in
#: Python.
UPGRADES: tuple[Upgrade, ...] = (upgraded_from_1,)
#: Raised when the same motion gets other last bits: older runs then agree to round-off only.
#: Another order of operations does that, another root finder or bound, and another function of a
#: library; `test/rig/test_arithmetic.py` notices it. Each number gets a line here that says what
#: moved the bits: 1 is that of version 1.0.
ARITHMETIC = 1
#: Latest time that a rig can reach, s; there the floats are 2 ms apart.
LATEST = 1e13
#: Rounding error that is allowed between the times in a state, s.
SAME_TIME = 1e-6
#: Largest number of a motion; the products of larger ones are not finite.
_LARGEST = 1e100
#: Ranges of the fields of a run that are not just any number.
_RANGES: dict[str, tuple[float, float]] = {
    'time': (-LATEST, LATEST),
    'time_low': (-1.0, 1.0),
    'mode': (0, max(Mode)),
    'last_stop': (0, 2),
    'side': (-1, 1),
    'crossing_side': (-1, 1),
    'released': (0, 1),
    'searched': (0.0, float_info.max),
    **dict.fromkeys(
        ('clearance_1', 'clearance_2', 'chatter_left', 'speed_1', 'speed_2', 'watched'),
        (0.0, _LARGEST),
    ),
}
#: Fields that are infinite where there is no such stop or instant; JSON has no number for that.
_MAY_BE_INFINITE = ('clearance_2', 'crossing', 'speed_1', 'speed_2')


def check_number(name: str, value: object, low: float = -_LARGEST, high: float = _LARGEST) -> None:
    """Check that a value is a number in a range, by default one that is not too large."""
    number_between(name, value, low, high)


def check_numbers(name: str, values: Iterable[object]) -> None:
    """Check that every value is a number of allowed size."""
    for value in values:
        check_number(f'an entry of {name}', value)


def _check_state(state: Mapping[str, Any], time: float, harmonics: int) -> None:
    """Check the stored state of a rig at a time, s, with so many harmonics."""
    for name in STORED:
        value = state[name]
        low, high = _RANGES.get(name, (-_LARGEST, _LARGEST))
        if STORED_TYPES[name] is bool and isinstance(value, bool):
            continue
        if STORED_TYPES[name] is not float:
            whole_number(f'origin.{name}', value, int(low), int(high))
        elif not (value is None and name in _MAY_BE_INFINITE):
            check_number(f'origin.{name}', value, low, high)
    if state['time'] > time + SAME_TIME:
        raise ValueError(f'origin.time is {state["time"]!r} s, after time, {time!r} s')
    check_numbers('origin.angles', state['angles'])
    if len(state['angles']) != harmonics:
        raise ValueError(
            f'origin.angles has {len(state["angles"])} entries, the force has {harmonics} '
            'harmonics: give one each'
        )


def _check_sweep(sweep: SteppedSine, parameters: RigParameters, time: float) -> None:
    """Check a stored sweep of a rig at a time, s: the steps due by then, and no more, are done."""
    check_number('sweep.start', sweep.start, -LATEST, LATEST)
    steps = step_count(parameters)
    whole_number('sweep.step', sweep.step, 0, steps)
    if (sweep.due == inf) != (sweep.step == steps):
        raise ValueError(f'sweep.due is {sweep.due!r} s at step {sweep.step} of {steps}')
    if parameters.sweep_mode == 'off':
        return
    dwell = step_duration(parameters)
    done = sweep.start + sweep.step * dwell
    due = sweep.due
    if not done - SAME_TIME <= time <= due + SAME_TIME:
        raise ValueError(
            f'sweep.step is {sweep.step}, from {done!r} s to {due!r} s: it must be the one at '
            f'time, {time!r} s'
        )
    # A step waits for an upward zero, and for one more if it would be at once.
    latest = max(done + dwell, time)
    latest += 2.0 * tau / rig_at(parameters, sweep.step).first_line[1]
    if due < inf and due > latest + SAME_TIME:
        raise ValueError(f'sweep.due is {due!r} s: it must be at most {latest!r} s')


def present(document: Document) -> Document:
    """
    Return the document of a snapshot in the present format.

    Raises
    ------
    FormatError
        If it is of no format that this version reads.
    """
    document = upgrade(document, document['state'].get('format'), UPGRADES)
    return {**document, 'state': {**document['state'], 'format': newest(UPGRADES)}}


class Snapshot(NamedTuple):
    """
    A rig at one instant.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    run : Run
        Its state.
    angles : tuple of float
        Angle turned by each harmonic at the origin of the present flight, rad.
    unreported : tuple of Event
        Events at the start that have not been reported yet.
    sweep : SteppedSine
        State of its stepped sine.
    playbacks : tuple of Playback
        The measured records that act, or have ended.
    """

    parameters: RigParameters
    run: Run
    angles: tuple[float, ...]
    unreported: tuple[Event, ...]
    sweep: SteppedSine
    playbacks: tuple[Playback, ...] = ()

    @property
    def time(self) -> float:
        """Time reached, s; the flight's origin may be earlier."""
        return self.run.now

    def as_dict(self) -> dict[str, Any]:
        """Return the snapshot as numbers, texts, lists and dictionaries."""
        state = {name: getattr(self.run, name) for name in STORED}
        return {
            'format': newest(UPGRADES),
            'arithmetic': ARITHMETIC,
            'time': self.run.now,
            'origin': {
                **{name: None if value == inf else value for name, value in state.items()},
                'angles': list(self.angles),
            },
            'unreported': [list(event) for event in self.unreported],
            'sweep': self.sweep.as_dict(),
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
            **self._of_records(),
        }

    def _of_records(self) -> dict[str, Any]:
        """Return the entries of a snapshot of a rig with measured records."""
        if not self.playbacks:
            return {}
        moved = {name: getattr(self.run, name) for name in RECORDED}
        return {'records': [p.as_dict() for p in self.playbacks], 'recorded': moved}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Snapshot:
        """
        Read a snapshot written by `as_dict`.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something, or no rig can be in that
            state.
        """
        if not isinstance(stored, dict):
            raise ValueError(f'snapshot is {quote(stored)}: give a dictionary, as it was taken')
        try:
            stored = present({'state': stored})['state']
        except FormatError as error:
            raise FormatError(f'snapshot {error}') from None
        try:
            parameters = RigParameters(**stored['parameters'])
            time, origin = stored['time'], stored['origin']
            check_number('time', time, -LATEST, LATEST)
            _check_state(origin, time, len(parameters.harmonics[0]))
            sweep = SteppedSine.of_dict(stored['sweep'])
            _check_sweep(sweep, parameters, time)
            values: dict[str, Any] = {
                name: inf if origin[name] is None else STORED_TYPES[name](origin[name])
                for name in STORED
            }
            playbacks = tuple(Playback.of_dict(r, time) for r in stored.get('records', ()))
            if playbacks:
                moved = stored['recorded']
                check_numbers('recorded', (moved[n] for n in RECORDED if n != 'carried'))
                values |= {n: kind(moved[n]) for n, kind in RECORDED_TYPES.items()}
                for playback in playbacks:
                    values[f'{playback.record.quantity}_step'] = playback.step_at(time)
            return cls(
                parameters,
                Run(**values, now=float(time)),
                tuple(map(float, origin['angles'])),
                tuple(
                    Event(event[0], EventKind(event[1]), *event[2:])
                    for event in stored['unreported']
                ),
                sweep,
                playbacks,
            )
        except (AttributeError, IndexError, KeyError, TypeError) as error:
            raise ValueError(f'snapshot is not complete: {error}') from error
