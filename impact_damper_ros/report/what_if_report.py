"""A recorded run beside its what-if: what both amount to, as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.compare.measured_motion import cubic_swing, energies_of_impacts
from impact_damper_ros.compare.recorded_stretch import RecordedImpacts
from impact_damper_ros.control import Rig
from impact_damper_ros.replay import Part, Replay, Setting
from impact_damper_ros.replay.replay import Step
from impact_damper_ros.replay.rows import Events, Samples, impacts_of
from impact_damper_ros.replay.what_if import Ending, RecordedValues, WhatIf
from impact_damper_ros.rig import ALL_SPECS, InitialConditions, RigParameters
from impact_damper_ros.rig.event_budget import EventBudget
from impact_damper_ros.rig.quoting import counted, shown

from .formatting import setting, unit_for
from .run_figures import SampledMotion, Side, draw_what_if

if TYPE_CHECKING:
    from matplotlib.figure import Figure


Array = NDArray[np.float64]

#: Changes of a held parameter that the table and the title of a figure list.
_MOST_IN_TABLE, _MOST_IN_FIGURE = 20, 3
_CLOSEUP_CYCLES, _CLOSEUP_POINTS = 4, 2400
#: Pieces in which a run is drawn. Of many cycles only their extremes can be seen.
_MOST_PIECES, _FEW_CYCLES = 2000, 60


class RunTotals:
    """Largest and rms X, impacts and their energies, over the parts of a run; SI units."""

    def __init__(self) -> None:
        self.impacts = 0
        self.energy = self.taken = 0.0
        self._squares = self._covered = self.largest = 0.0
        # The last instant, X and X' just after it
        self._last = np.empty((0, 4))

    def look(self, samples: Samples, events: Events, rig: RigParameters) -> None:
        """Take the next samples, and the events up to the end of their part."""
        hits = impacts_of(events)
        self.impacts += len(hits)
        lost = energies_of_impacts(RecordedImpacts.of_rows(hits), rig)
        self.energy += lost.both
        self.taken += lost.primary
        time = np.concatenate([samples['time'], events['time']])
        x = np.concatenate([samples['x'], events['x']])
        before, after = (
            np.concatenate([samples['primary_velocity'], events[f'primary_velocity_{side}']])
            for side in ('before', 'after')
        )
        # A sample shows the motion after an event at its instant.
        order = np.lexsort((np.arange(len(time)) < len(samples), time))
        knots = np.concatenate([self._last, np.column_stack([time, x, before, after])[order]])
        if not len(knots):
            return
        self._last = knots[-1:]
        start, x0, _, v0 = knots[:-1].T
        end, x1, v1, _ = knots[1:].T
        step = end - start
        swing = cubic_swing(step, x0, x1, v0 * step, v1 * step)
        self.largest = max(self.largest, float(np.abs(knots[:, 1]).max()), swing.largest)
        self._squares += swing.squares
        self._covered += float(step.sum())

    @property
    def rms(self) -> float:
        """Root mean square of X over time, m, also between the samples; NaN without any."""
        return math.sqrt(self._squares / self._covered) if self._covered > 0.0 else math.nan

    def as_json(self) -> dict[str, Any]:
        """Return the totals in SI units; None where there is none."""
        return {
            'largest_x': self.largest,
            'rms_x': None if math.isnan(self.rms) else self.rms,
            'impacts': self.impacts,
            'energy_lost_in_impacts': self.energy,
            'energy_taken_from_primary_by_impacts': self.taken,
        }

    def text(self) -> str:
        """Return the totals in a line, for a figure."""
        unit = unit_for('m', self.largest)
        return (
            f'{counted(self.impacts, "impact")}, '
            f'largest |X| {unit.factor * self.largest:.4g} {unit.name}, '
            f'rms {unit.factor * self.rms:.4g} {unit.name}'
        )


class _Envelope:
    """Least and greatest values of a long signal, in pieces of `size` samples."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._rest = np.empty((2, 0))
        self._pieces: list[Array] = []

    def look(self, time: Array, value: Array) -> None:
        self._rest = np.concatenate([self._rest, [time, value]], axis=1)
        self._put(self._rest.shape[1] // self._size * self._size)

    def _put(self, count: int) -> None:
        if count:
            starts = np.arange(0, count, self._size)
            times, values = self._rest[:, :count]
            low, high = (f.reduceat(values, starts) for f in (np.minimum, np.maximum))
            self._pieces.append(np.stack([times[starts], low, high]))
            self._rest = self._rest[:, count:]

    def arrays(self) -> tuple[Array, Array, Array]:
        self._put(self._rest.shape[1])
        time, low, high = np.concatenate(self._pieces or [np.empty((3, 0))], axis=1)
        return time, low, high


def _longest_cycle(rig: RigParameters) -> float:
    """Return the longest period of the force, or the natural one of a rig without force, s."""
    harmonics = zip(rig.force_amplitudes, rig.force_frequencies, strict=True)
    return math.tau / min((w for amplitude, w in harmonics if amplitude and w), default=rig.omega)


class WhatIfReport:
    """
    The recorded run and its what-if, which runs along with the replay.

    Parameters
    ----------
    replay : Replay
        The replay, at its first sample.
    held, held_initial : mapping of str to value
        Parameters and initial conditions that are held, and their values.
    drawn : bool
        Whether to keep what the figure needs.
    budget : EventBudget, optional
        The most events that the rig of the what-if may have.

    Attributes
    ----------
    other : WhatIf
        The rig of the what-if.
    recorded, what_if : RunTotals
        What both amount to so far.

    Raises
    ------
    ValueError
        If the values are not admissible.
    """

    def __init__(
        self,
        replay: Replay,
        held: Mapping[str, Any],
        held_initial: Mapping[str, Any],
        *,
        drawn: bool,
        budget: EventBudget | None = None,
    ) -> None:
        start = replay.start
        self._replay = replay
        logged = Setting.of(start.state)
        values = logged.as_dict()
        for name in held:
            if name not in values:
                raise ValueError(f'held has {shown(name)}, which is no parameter of the rig')
        self._was = {
            **{n: RecordedValues(values[n]) for n in held},
            **{n: RecordedValues(getattr(start.initial, n, None)) for n in held_initial},
        }
        self._now = {**held, **held_initial}
        self.other = WhatIf(start, held, held_initial, budget)
        self.recorded, self.what_if = RunTotals(), RunTotals()
        cycle = max(_longest_cycle(logged.rig), _longest_cycle(self.other.rig.parameters))
        reader = replay.recorded.reader
        total = reader.topics[replay.recorded.topics.joint_states].message_count
        cycles = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9 / cycle
        pieces = int(_MOST_PIECES if cycles < _FEW_CYCLES else min(cycles, _MOST_PIECES))
        size = max(1, math.ceil(total / pieces))
        self._envelopes = _Envelope(size), _Envelope(size)
        self._drawn = drawn
        self._endings = [Ending(_CLOSEUP_CYCLES * cycle) for _ in range(2)]
        self._was_at = Rig.restore(start.state)
        self._changes: list[tuple[float, str]] = []
        self._last = logged

    def look(self, part: Part) -> tuple[Samples, Events]:
        """Take the next part of the replay; return samples and events of the what-if."""
        if self._drawn:
            for ending, rig in zip(self._endings, (self._was_at, self.other.rig), strict=True):
                ending.look(rig, part)
            self._was_at = Rig.restore(self._replay.rig.snapshot())
        rigs = self._last.rig, self.other.rig.parameters
        samples, events = self.other.follow(part)
        self.recorded.look(part.samples, part.events, rigs[0])
        self.what_if.look(samples, events, rigs[1])
        for time_ns, step in part.steps:
            for name, value in step.as_dict().items():
                if name in self._was:
                    self._was[name].take(time_ns / 1e9, value)
        if self._drawn:
            for envelope, rows in zip(self._envelopes, (part.samples, samples), strict=True):
                envelope.look(part.samples['time'], rows['x'])
        for time_ns, step in part.steps:
            self._changes.append((time_ns / 1e9, self._label(step)))
        return samples, events

    def _label(self, step: Step) -> str:
        if isinstance(step, InitialConditions):
            return 'reset'
        before, self._last = self._last.as_dict(), step
        return ', '.join(
            f'{name} {_with_unit(value, name)}' + (' (held)' if name in self._now else '')
            for name, value in step.as_dict().items()
            if value != before[name]
        )

    def text(self) -> str:
        """Return both runs side by side, as a table."""
        parts = [
            f'{name} = {now!r} (recorded: {self._was[name].described(repr, _MOST_IN_TABLE)})'
            for name, now in self._now.items()
        ]
        how = 'with the recorded state, to which the rig was changed as a live one would be'
        if self.other.from_initial:
            how = 'from the initial conditions, as the recorded run did'
        lines = [
            textwrap.fill(f'what if     {", ".join(parts)}', 99, subsequent_indent=' ' * 12),
            f'start       {how}',
            f'{"":<28}{"recorded":>14}{"what if":>14}{"ratio":>10}',
        ]
        for name, quantity in (
            ('largest |X| [m]', 'largest'),
            ('rms X [m]', 'rms'),
            ('impacts', 'impacts'),
            ('energy lost in impacts [J]', 'energy'),
            ('taken from M by impacts [J]', 'taken'),
        ):
            was, now = getattr(self.recorded, quantity), getattr(self.what_if, quantity)
            ratio = f'{now / was:.4f}' if was else '-'
            lines.append(f'{name:<28}{was:>14.7g}{now:>14.7g}{ratio:>10}')
        return '\n'.join(lines)

    def as_json(self) -> dict[str, Any]:
        """Return both for JSON, in SI units."""
        return {
            'set': self._now,
            'recorded_values': {name: was.as_json() for name, was in self._was.items()},
            'from_initial': self.other.from_initial,
            'recorded': self.recorded.as_json(),
            'what_if': self.what_if.as_json(),
        }

    def figure(self) -> Figure:
        """Return the figure of both; needs `drawn`."""
        assert self._drawn
        now = ', '.join(f'{name} = {_with_unit(v, name)}' for name, v in self._now.items())
        was = ', '.join(
            f'{name} = {values.described(partial(_with_unit, name=name), _MOST_IN_FIGURE)}'
            for name, values in self._was.items()
            if values.value is not None
        )
        recorded, what_if = (
            Side(
                f'{textwrap.fill(head, 66)}\n{totals.text()}',
                *envelope.arrays(),
                _motion(*trace),
            )
            for head, totals, envelope, trace in zip(
                (f'recorded: {was}', f'what if {now}'),
                (self.recorded, self.what_if),
                self._envelopes,
                [
                    ending.trace(other, _CLOSEUP_POINTS)
                    for ending, other in zip(self._endings, (None, self.other), strict=True)
                ],
                strict=True,
            )
        )
        title = f'The recorded run, and the same history with {now}'
        return draw_what_if(recorded, what_if, self._changes, title)


def _with_unit(value: Any, name: str) -> str:
    return f'{setting(value)} {ALL_SPECS[name].unit}'.rstrip()


def _motion(samples: Samples, impacts: Events) -> SampledMotion:
    return SampledMotion(
        samples['time'],
        samples['x'],
        samples['z'],
        samples['stop_1'],
        samples['stop_2'],
        impacts['time'],
        impacts['x'] + impacts['y'],
        impacts['stop'].astype(np.int64),
    )
