# SPDX-License-Identifier: Apache-2.0
"""
A replay where the last bits cannot agree: on another C library, processor or version.

Differences of round-off grow from impact to impact, in chaotic motions without bound. The replay
therefore shadows the recorded motion: at each recorded impact it takes the numbers after it, and
is compared with the recording up to the next impact only. The effect of round-off is
measured with a second rig, which starts `_NUDGE` (relative) and `_STAMP_S` away. A recorded number
may be several times as far from the replay as the second rig is. Where the two rigs have different
events, as at a grazing impact or at the end of a chatter, the flight is counted as undecided.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.bag.messages import message_row
from impact_damper_ros.bag.snapshots import without_search
from impact_damper_ros.control.act import ControlAct
from impact_damper_ros.motion.event import EventKind
from impact_damper_ros.rig.observed_run import TimedOrder
from impact_damper_ros.rig.rig import Rig

from .findings import IMPACT, Findings
from .matching import QUANTITIES, STAMP_NS, Matcher, NearMatcher, differing_states, expected_states
from .rows import (
    NO_EVENTS,
    NO_SAMPLES,
    Advance,
    Events,
    Messages,
    Numbers,
    Samples,
    impacts_of,
    published_acts,
    published_impacts,
    published_states,
)
from .run_samples import RunSamples


class Replayed(Protocol):
    """The replay of a run, as far as its second rig needs it."""

    rig: Rig
    findings: Findings

    def run_on(
        self, rig: Rig, instants: Numbers, until: float, orders: deque[TimedOrder]
    ) -> RunSamples:
        """Let a rig run on through instants to a later one, with the orders on the way."""

    def to_event(self, rig: Rig, time: float) -> Events:
        """Let a rig run on to an instant, or to the next event."""

    def note_refusals(self, run: RunSamples) -> None:
        """Note the orders that a rig could not carry out."""


#: Relative shift of the second rig, and tolerance of the recording in multiples of its distance.
_NUDGE, _TIMES = 1e-12, 10.0
#: Stamps are whole nanoseconds; the second rig is late by as much.
_STAMP_S = 1e-9
#: Least tolerance of a number, as a share of the largest of its kind; the motion in 2 ns adds to
#: it.
_FLOOR = 1e-9
#: Time after a recorded impact within which the replay must have it, s.
_LATE_S = 1e-6
#: Tolerance of a snapshot: share of each number, and of the largest of its origin.
_OF_SNAPSHOT = 1e-6
_MOVING = (0, 1, 2)  # modes in which m moves freely


def _nudge(rig: Rig, later: float = 0.0) -> Rig:
    """Return a rig with a motion slightly different from that of another one, and later, s."""
    state = rig.snapshot()
    origin = state['origin']
    for name in ('x', 'velocity', 'relative_velocity'):
        origin[name] *= 1.0 + _NUDGE
    state = _shift(state, rig, later) if later else state
    return Rig.restore(without_search(state), rig.own_law)


def _shift(state: dict[str, Any], rig: Rig, later: float) -> dict[str, Any]:
    """Return the state of a rig at the origin of its flight, in the same place at another time."""
    time = state['origin']['time'] + later
    frequencies = [rig.force_frequency, *rig.parameters.harmonics[1][1:]]
    turned = [a + w * later for a, w in zip(state['origin']['angles'], frequencies, strict=True)]
    origin = {**state['origin'], 'time': time, 'time_low': 0.0, 'angles': turned}
    return {**state, 'time': time, 'origin': origin}


def near(recorded: Any, replayed: Any, size: float = 0.0) -> bool:
    """Return whether two snapshots are equal within round-off, whatever their arithmetic."""
    if isinstance(replayed, dict) and isinstance(recorded, dict):
        numbers = [abs(v) for v in replayed.values() if isinstance(v, float)]
        size = max(numbers, default=0.0)
        keys = (recorded.keys() | replayed.keys()) - {'arithmetic'}
        return all(near(recorded.get(k), replayed.get(k), size) for k in keys)
    if isinstance(replayed, list) and isinstance(recorded, list):
        pairs = zip(recorded, replayed, strict=False)
        return len(recorded) == len(replayed) and all(near(a, b, size) for a, b in pairs)
    if isinstance(replayed, float) and isinstance(recorded, float):
        return abs(recorded - replayed) <= _OF_SNAPSHOT * (abs(replayed) + size)
    return bool(recorded == replayed)


class Shadowing:
    """Compares the rows of a run with its replay, from impact to impact."""

    def __init__(self, replay: Replayed, matcher: Matcher, acts: NearMatcher) -> None:
        self._replay, self._matcher, self._acts = replay, matcher, acts
        self._near = _nudge(replay.rig)
        self._waiting = np.empty(0, message_row(6))
        # Impacts that a change has caused, and that are not joined yet
        self._caused = self._waiting
        self._orders: tuple[deque[TimedOrder], deque[TimedOrder]] = deque(), deque()
        self._sizes = np.zeros(2)  # largest position and velocity so far

    def restart(self, stamp_ns: int) -> None:
        """Start the second rig at the present state of the replay, at a stamp."""
        self._near = _nudge(self._replay.rig)
        self._acts.recover(stamp_ns)

    def expect(self, impacts: Messages) -> None:
        """Take recorded impacts."""
        self._waiting = np.concatenate([self._waiting, impacts])

    def take_consequences(self, events: Events, acts: list[ControlAct]) -> None:
        """Take the events and acts that a change of the rig causes at once."""
        rig, offset_ns = self._replay.rig, self._replay.findings.offset_ns
        impacts = published_impacts(events, rig.parameters, offset_ns)
        self._caused = np.concatenate([self._caused, impacts])
        self._expect_acts(rig.time, acts, acts, alike=True)

    def follow(
        self, states: Messages, instants: Numbers, until: float, orders: list[TimedOrder]
    ) -> Advance:
        """Let the rig run on through joint states to an instant, s, from impact to impact."""
        replay, offset_ns = self._replay, self._replay.findings.offset_ns
        self._orders = deque(orders), deque(orders)
        self._grow(states['numbers'][:, :4], states['numbers'][:, 7:11])
        waiting = self._waiting
        times = (waiting['stamp_ns'] - offset_ns) / 1e9
        # A message with the last stamp of a part may be caused by the command that follows.
        end = until if len(states) else until - STAMP_NS * 1e-9
        due = int(np.searchsorted(times, end, side='right'))
        self._waiting = waiting[due:]
        found = []
        begin = 0
        for i in range(due):
            if self._is_caused(waiting[i : i + 1]):
                continue
            end = int(np.searchsorted(instants, times[i], side='left'))
            if end > begin:
                last = float(instants[end - 1])
                found.append(self._flights(states[begin:end], instants[begin:end], last))
            found.append(self._impact(waiting[i : i + 1], float(times[i])))
            begin = end
        for row in self._caused:
            self._matcher.differ_wholly(row, recorded=False)
        self._caused = self._caused[:0]
        found.append(self._flights(states[begin:], instants[begin:], until))
        samples, events, numbers, differs = (np.concatenate(c) for c in zip(*found, strict=True))
        replay.findings.impacts += due
        # Texts are compared with the replay exactly.
        differs |= differing_states(states, expected_states(states, states['numbers']))
        return Advance(samples, events, expected_states(states, numbers), differs)

    def _is_caused(self, recorded: Messages) -> bool:
        """Return whether an impact is one that a change has caused, and join it."""
        off = np.abs(self._caused['stamp_ns'] - recorded['stamp_ns'])
        same = (off <= STAMP_NS) & (self._caused['frame'] == recorded['frame'])
        places = np.flatnonzero(same)
        if not len(places):
            return False
        mine = self._caused[places[0]]
        self._caused = np.delete(self._caused, places[0])
        wrong = np.abs(mine['numbers'] - recorded['numbers'][0]) > self._impact_floors()
        self._differ_at(np.flatnonzero(wrong), recorded[0], mine)
        return True

    def _impact_floors(self) -> Numbers:
        """Return the least tolerance of each number of an impact."""
        length, speed = self._floors()
        floors = [length, speed, self._replay.rig.parameters.damper_mass * speed]
        return np.repeat(floors, 2)

    def _differ_at(self, wrong: NDArray[np.int64], recorded: np.void, replayed: np.void) -> None:
        """Note the first of the numbers in which an impact differs."""
        if len(wrong):
            numbers = (float(row['numbers'][wrong[0]]) for row in (recorded, replayed))
            quantity = QUANTITIES['impacts'][2 + wrong[0]]
            self._matcher.differ(recorded['stamp_ns'], *quantity, *numbers)

    def _expect_acts(
        self,
        since: float,
        acts: list[ControlAct],
        others: list[ControlAct],
        *,
        alike: bool,
    ) -> None:
        """Expect the acts of the replay and of the second rig since an instant, s."""
        offset_ns = self._replay.findings.offset_ns
        here, there = (published_acts(some, offset_ns) for some in (acts, others))
        if not alike or here['frame'].tolist() != there['frame'].tolist():
            self._acts.lose(offset_ns + round(since * 1e9))
            return
        length, speed = self._floors()
        allowed = here.copy()
        doubt = np.nan_to_num(np.abs(there['numbers'] - here['numbers']))
        floors = np.tile(np.repeat([length, speed, 0.0], 3), (len(here), 1))
        floors[:, 6:] = _FLOOR * np.nan_to_num(np.abs(here['numbers'][:, 6:]))
        allowed['numbers'] = _TIMES * doubt + floors
        allowed['stamp_ns'] = _TIMES * np.abs(there['stamp_ns'] - here['stamp_ns'])
        self._acts.expect_near(here, allowed)

    def _grow(self, positions: Numbers, velocities: Numbers) -> None:
        with np.errstate(invalid='ignore'):
            for i, part in enumerate((positions, velocities)):
                sizes = np.abs(part[np.isfinite(part)])
                # A wrong number must not determine the tolerance of the others.
                size = float(np.quantile(sizes, 0.99)) if len(sizes) else 0.0
                self._sizes[i] = max(self._sizes[i], size)

    def _floors(self) -> tuple[float, float]:
        """Return the least tolerance of a position and of a velocity."""
        rig, (length, speed) = self._replay.rig.parameters, self._sizes
        force = rig.stiffness * length + rig.damping * speed + sum(map(abs, rig.harmonics[0]))
        acceleration = force / rig.primary_mass + rig.gravity
        return (
            float(_FLOOR * length + 2.0 * _STAMP_S * speed),
            float(_FLOOR * speed + 2.0 * _STAMP_S * acceleration),
        )

    def state_floors(self) -> Numbers:
        """Return the least tolerance of each number of joint states."""
        length, speed = self._floors()
        sizes = [length, _FLOOR, length, speed, _FLOOR, speed]
        return np.repeat(sizes, [4, 1, 2, 4, 1, 2])

    def _flights(
        self, states: Messages, instants: Numbers, until: float
    ) -> tuple[Samples, Events, Numbers, NDArray[np.bool_]]:
        """Run on through joint states, and to an instant, s, without an impact."""
        replay, rig = self._replay, self._replay.rig
        since = rig.time
        mine, other = (
            replay.run_on(one, instants, until, orders)
            for one, orders in zip((rig, self._near), self._orders, strict=True)
        )
        replay.note_refusals(mine)
        events = mine.events
        numbers = published_states(mine.samples, rig.parameters)
        doubt = np.abs(published_states(other.samples, rig.parameters) - numbers)
        floor = self.state_floors()
        near = np.abs(states['numbers'] - numbers) <= _TIMES * doubt + floor
        differs = np.logical_not(near.all(axis=1), dtype=np.bool_)
        alike = np.array_equal(events['kind'], other.events['kind'])
        if not alike:
            replay.findings.undecided += 1
            differs[:] = False
        self._expect_acts(since, mine.acts, other.acts, alike=alike)
        for hit in impacts_of(events) if alike else ():
            stamp_ns = replay.findings.offset_ns + round(float(hit['time']) * 1e9)
            self._matcher.differ(stamp_ns, IMPACT, '', None, f'stop_{hit["stop"]}')
        return mine.samples, events, numbers, differs

    def _to_impact(
        self, rig: Rig, until: float, orders: deque[TimedOrder]
    ) -> tuple[Events, list[ControlAct]]:
        """Run on to the next impact, or for some time beyond it."""
        found, acts = [NO_EVENTS], []
        while rig.time < until:
            if orders and orders[0].time <= rig.time:
                done = self._replay.run_on(rig, np.empty(0), rig.time, orders)
                found.append(done.events)
                acts += done.acts
            stop = min(until, orders[0].time) if orders else until
            found.append(self._replay.to_event(rig, stop))
            acts += rig.acts
            if (found[-1]['kind'] == EventKind.IMPACT).any():
                break
        return np.concatenate(found), acts

    def _impact(
        self, recorded: Messages, time: float
    ) -> tuple[Samples, Events, Numbers, NDArray[np.bool_]]:
        """Run on to a recorded impact, and begin anew there."""
        replay, rig = self._replay, self._replay.rig
        since = rig.time
        (events, acts), (others, other_acts) = (
            self._to_impact(one, time + _LATE_S, orders)
            for one, orders in zip((rig, self._near), self._orders, strict=True)
        )
        offset_ns = replay.findings.offset_ns
        here, there = (published_impacts(e, rig.parameters, offset_ns) for e in (events, others))
        stamp_ns, frame = int(recorded['stamp_ns'][0]), str(recorded['frame'][0])
        alike = len(here) == len(there) and np.array_equal(events['kind'], others['kind'])
        self._expect_acts(since, acts, other_acts, alike=alike)
        if not alike:
            replay.findings.undecided += 1
        elif not len(here):
            self._matcher.differ_wholly(recorded[0], recorded=True)
        else:
            doubt_ns = abs(float(events['time'][-1] - others['time'][-1])) * 1e9
            ours: Numbers = here['numbers'][0]
            doubt, off = (np.abs(ours - rows['numbers'][0]) for rows in (there, recorded))
            wrong = np.flatnonzero(~(off <= _TIMES * doubt + self._impact_floors()))
            if abs(stamp_ns - int(here['stamp_ns'][0])) > STAMP_NS + _TIMES * doubt_ns:
                self._matcher.differ(stamp_ns, 'stamp', 'ns', stamp_ns, int(here['stamp_ns'][0]))
            elif frame != str(here['frame'][0]):
                self._matcher.differ(stamp_ns, 'frame_id', '', frame, str(here['frame'][0]))
            else:
                self._differ_at(wrong, recorded[0], here[0])
        if len(here):
            self._begin(recorded['numbers'][0], time, float(events['time'][-1]))
            self._orders = self._orders[0], self._orders[0].copy()
        nothing = published_states(NO_SAMPLES, rig.parameters)
        return NO_SAMPLES, events, nothing, np.empty(0, np.bool_)

    def _begin(self, numbers: Numbers, time: float, here: float) -> None:
        """Go on from the numbers recorded after an impact, which the replay had at `here`."""
        replay, rig = self._replay, self._replay.rig
        state = rig.snapshot()
        origin, velocity = state['origin'], float(numbers[2])
        if origin['time'] != here or not np.isfinite(numbers).all():
            return
        origin |= {'x': float(numbers[0]) - rig.parameters.static_deflection, 'velocity': velocity}
        if origin['mode'] in _MOVING:
            origin['relative_velocity'] = float(numbers[3]) - velocity
        # The stamp is rounded, so that the replay's own instant is kept where it may be.
        late = here - time
        late -= math.copysign(min(abs(late), 0.5 * _STAMP_S), late)
        state = _shift(state, rig, -late)
        replay.rig = Rig.restore(without_search(state), rig.own_law)
        self._near = _nudge(replay.rig, _STAMP_S)
