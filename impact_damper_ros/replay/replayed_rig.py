"""
The rig of a replay: its changes and resets are reconstructed and checked against the snapshots.

The requests that the node carried out at one tick end with one snapshot. Parameter events are
logged one by one, but a reset is seen in the snapshot only; so the place of a reset among them is
found by trying: the right one leads to the recorded state, bit for bit.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from impact_damper_ros.control import (
    GAP_CONTROL_SPECS,
    ControlRecord,
    GapControlParameters,
    Rig,
)
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    Event,
    InitialConditions,
    ParameterError,
    RigParameters,
)

from .recorded_run import RecordedChange
from .recorded_snapshot import RecordedSnapshot, motion_of


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


#: A change to parameters, or a reset to initial conditions.
Step = Setting | InitialConditions

#: Longest batch in which a reset is tried at every place.
_LONGEST_SEARCH = 50


class Effect(NamedTuple):
    """The immediate effects of a change."""

    change: RecordedChange | None  # the parameter event, if there is one
    events: list[Event]  # impacts, among others
    records: list[ControlRecord]  # acts of the gap control
    parameters: RigParameters  # the rig after it


@dataclass
class Batch:
    """The changes and resets of one instant."""

    steps: list[Step] = field(default_factory=list)  # the changes and resets, in order
    effects: list[Effect] = field(default_factory=list)  # the immediate effects of each change
    agrees: bool = True  # whether they lead to the state of the snapshot, if there is one
    #: Parameters that changed in the snapshot without a parameter event.
    unlogged: dict[str, Any] = field(default_factory=dict)
    #: Parameters whose last parameter event contradicts the snapshot: name, value of the event
    #: and value of the snapshot.
    contradicted: list[tuple[str, Any, Any]] = field(default_factory=list)
    adopted: bool = False  # whether a reset's initial conditions had to be taken from the snapshot
    #: Differences between snapshot and replay: name, recorded and replayed value.
    differences: list[tuple[str, Any, Any]] = field(default_factory=list)
    used: int = 0  # how many of the changes were carried out

    @property
    def resets(self) -> int:
        """Number of resets among the steps."""
        return sum(isinstance(step, InitialConditions) for step in self.steps)


def _canonical(state: Mapping[str, Any]) -> str:
    # As text, because -0.0 == 0.0.
    return json.dumps(motion_of(state), sort_keys=True)


def state_differences(
    recorded: Mapping[str, Any], replayed: Mapping[str, Any], path: str = ''
) -> list[tuple[str, Any, Any]]:
    """Return the differences between two snapshots: name, recorded and replayed value."""
    found: list[tuple[str, Any, Any]] = []
    for name in [*replayed, *(n for n in recorded if n not in replayed)]:
        there, here = recorded.get(name), replayed.get(name)
        if isinstance(there, dict) and isinstance(here, dict):
            found += state_differences(there, here, f'{path}{name}.')
        elif json.dumps(there) != json.dumps(here):
            found.append((f'{path}{name}', there, here))
    return found


def initial_of(snapshot: RecordedSnapshot) -> InitialConditions:
    """
    Read initial conditions back from the snapshot of a reset.

    They are exact except for the last digit of a sum or difference.
    """
    return _initial(snapshot.state['origin'])


def _initial(origin: Mapping[str, Any]) -> InitialConditions:
    gap_1, gap_2 = origin['clearance_1'], origin['clearance_2']
    if gap_2 is None or gap_1 <= gap_2:
        offset = origin['stop_1'] - gap_1
    else:
        offset = origin['stop_2'] + gap_2
    return InitialConditions(
        initial_primary_position=origin['x'],
        initial_primary_velocity=origin['velocity'],
        initial_damper_offset=offset,
        initial_damper_velocity=origin['velocity'] + origin['relative_velocity'],
    )


class ReplayedRig:
    """A rig to which a recorded run is repeated."""

    def __init__(self, start: RecordedSnapshot) -> None:
        self.rig = Rig.restore(start.state)
        #: Initial conditions of the next reset, and of the first one; None if not known yet
        self.initial: InitialConditions | None = None
        self.first_initial: InitialConditions | None = None

    def take_dump(self, values: Mapping[str, Any]) -> list[tuple[str, Any, Any]]:
        """Take the initial conditions from a list of all parameters; return its contradictions."""
        found = _contradictions(values, _setting(self.rig).as_dict())
        state = self.rig.snapshot()
        if state['time'] == state['origin']['time'] == 0.0 and not state['unreported']:
            # They are sums and differences of entries of the snapshot.
            small = 1e-12 * self.rig.parameters.gap
            found += [
                (name, values[name], here)
                for name, here in _initial(state['origin']).as_dict().items()
                if not math.isclose(values.get(name, here), here, rel_tol=1e-12, abs_tol=small)
            ]
        if values.keys() >= INITIAL_SPECS.keys():
            self.initial = InitialConditions(**{n: values[n] for n in INITIAL_SPECS})
            self.first_initial = self.first_initial or self.initial
        return found

    def adopt(self, snapshot: RecordedSnapshot) -> None:
        """Go on from a snapshot."""
        self.rig = Rig.restore(snapshot.state)

    def carry_out(
        self, changes: Sequence[RecordedChange], snapshot: RecordedSnapshot | None
    ) -> Batch:
        """Repeat the changes and resets of the present instant."""
        if snapshot is None:
            self.rig, self.initial, batch = self._tried(changes)
            return batch
        before = _setting(self.rig).as_dict()
        wanted = _canonical(snapshot.state)
        best = None
        for attempt in self._attempts(changes, snapshot):
            if _canonical(attempt[0].snapshot()) == wanted:
                self.rig, self.initial, batch = attempt
                break
            best = best or attempt
        else:
            assert best is not None
            self.rig, self.initial, batch = best
            self._disagree(batch, snapshot)
        named = {name for change in changes for name in change.values}
        after = _setting(self.rig).as_dict()
        batch.unlogged = {n: v for n, v in after.items() if v != before[n] and n not in named}
        stated = {name: v for change in changes[: batch.used] for name, v in change.values.items()}
        batch.contradicted = _contradictions(stated, after)
        return batch

    def _disagree(self, batch: Batch, snapshot: RecordedSnapshot) -> None:
        """Note how the snapshot differs, and take over its parameters or its reset."""
        batch.agrees = False
        here = motion_of(self.rig.snapshot())
        batch.differences = state_differences(motion_of(snapshot.state), here)
        if _is_reset(snapshot):
            batch.adopted = True
            batch.steps.append(initial_of(snapshot))
            self.adopt(snapshot)
            return
        _change(self.rig, setting_of(snapshot.state), None, batch)

    def _attempts(
        self, changes: Sequence[RecordedChange], snapshot: RecordedSnapshot
    ) -> Iterator[_Attempt]:
        """Yield rigs after possible orders of changes and a reset, the likely ones first."""
        count = len(changes)
        # Some of the changes may belong to later batches.
        places = range(count, -1, -1) if count <= _LONGEST_SEARCH else (count,)
        target = setting_of(snapshot.state)
        exact = sum(change.exact for change in changes)
        if exact and all(change.exact for change in changes[:exact]):
            yield self._tried(changes)
            # The events may contradict the snapshot.
            rig, initial, batch = self._tried((), last=target)
            batch.used = exact
            yield rig, initial, batch
        for last in (None, target):
            for used in places:
                yield self._tried(changes[:used], last=last)
            for used in places if _is_reset(snapshot) else ():
                for place in places:
                    if place <= used:
                        yield self._tried(changes[:used], reset_at=place, last=last)

    def _tried(
        self,
        changes: Sequence[RecordedChange],
        *,
        reset_at: int | None = None,
        last: Setting | None = None,
    ) -> _Attempt:
        """Carry out changes, a reset before that of a number, and a last change, on a copy."""
        rig = Rig.restore(self.rig.snapshot())
        initial, batch = self.initial, Batch(used=len(changes))
        for number in range(len(changes) + 1):
            if number == reset_at and initial is not None:
                # What the rig refuses, the node has refused, too.
                with suppress(ParameterError):
                    rig.reset(initial)
                    batch.steps.append(initial)
            if number < len(changes):
                values = changes[number].values
                _change(rig, _setting(rig).replaced(values), changes[number], batch)
                initial = _updated(initial, values)
        if last is not None:
            _change(rig, last, None, batch)
        return rig, initial, batch


_Attempt = tuple[Rig, InitialConditions | None, Batch]


def _setting(rig: Rig) -> Setting:
    return Setting(rig.parameters, rig.control)


def _change(rig: Rig, setting: Setting, change: RecordedChange | None, batch: Batch) -> None:
    if setting != _setting(rig):
        events = rig.change(*setting)
        batch.effects.append(Effect(change, events, rig.records, rig.parameters))
        batch.steps.append(setting)


def _updated(
    initial: InitialConditions | None, values: Mapping[str, Any]
) -> InitialConditions | None:
    given = {name: value for name, value in values.items() if name in INITIAL_SPECS}
    if not given or (initial is None and given.keys() < INITIAL_SPECS.keys()):
        return initial
    known = initial.as_dict() if initial is not None else {}
    return InitialConditions(**{**known, **given})


def _is_reset(snapshot: RecordedSnapshot) -> bool:
    """Return whether the snapshot may be that of a reset: motion and force have just begun."""
    if snapshot.reason in ('reset', 'start', 'record'):
        # The last two announce an unchanged rig.
        return snapshot.reason == 'reset'
    # A reset and a resumption at the same tick are announced as a resumption.
    origin = snapshot.state['origin']
    return origin['time'] == snapshot.state['time'] and not any(origin['angles'])


def _contradictions(
    stated: Mapping[str, Any], here: Mapping[str, Any]
) -> list[tuple[str, Any, Any]]:
    """Return the parameters that disagree: name, stated value and value of the rig."""
    return [
        (name, value, here[name])
        for name, value in stated.items()
        if name in here and value != here[name]
    ]
