# SPDX-License-Identifier: Apache-2.0
"""A recorded run beside its what-if: what both amount to, as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.compare import Overall
from impact_damper_ros.compare.result import Array
from impact_damper_ros.compare.stretches import RecordedStretch, builder_at
from impact_damper_ros.parameters.quoting import counted, shown
from impact_damper_ros.parameters.rig_parameters import ALL_SPECS, InitialConditions, RigParameters
from impact_damper_ros.replay import Part, Replay, Setting
from impact_damper_ros.replay.replay import Step
from impact_damper_ros.replay.rows import Events, Samples
from impact_damper_ros.replay.what_if import Ending, RecordedValues, WhatIf
from impact_damper_ros.rig.rig import Rig
from impact_damper_ros.rig.runaway import MOST_IN_PERIOD

from .formatting import setting, unit_for
from .run_figures import Motion, Side, draw_what_if

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Changes of a held parameter that the table and the title of a figure list.
_MOST_IN_TABLE, _MOST_IN_FIGURE = 20, 3
_CLOSEUP_CYCLES, _CLOSEUP_POINTS = 4, 2400


class RunTotals:
    """Largest and rms X, impacts and their energies, over a run; it begins with a state."""

    def __init__(self, state: Mapping[str, Any]) -> None:
        self._done: list[Overall] = []
        self._pieces: list[Array] = []
        self._builder = builder_at(state)

    def look(self, samples: Samples, events: Events) -> None:
        """Take the next samples, and the events up to the last of them."""
        self._builder.take(samples, events)

    def begin(self, state: Mapping[str, Any]) -> None:
        """Go on from another state."""
        stretch = self._builder.finish(float(state['time']))
        self._done.append(stretch.overall)
        self._pieces.append(stretch.envelope)
        self._builder = builder_at(state)

    @cached_property
    def overall(self) -> Overall:
        """The numbers, once all was taken."""
        return Overall.joined([*self._done, self._last.overall])

    @cached_property
    def _last(self) -> RecordedStretch:
        return self._builder.finish()

    def envelope(self) -> Array:
        """Return the range of X in consecutive pieces of the run."""
        return np.hstack([*self._pieces, self._last.envelope])

    def as_json(self) -> dict[str, Any]:
        """Return the totals in SI units; None where there is none."""
        return {
            name: None if math.isnan(value) else value
            for name, value in (
                ('largest_x', self.overall.x_max),
                ('rms_x', self.overall.x_rms),
                ('impacts', self.overall.impacts),
                ('energy_lost_in_impacts', self.overall.impact_loss),
                ('energy_taken_from_primary_by_impacts', self.overall.impact_energy),
            )
        }

    def text(self) -> str:
        """Return the totals in a line, for a figure."""
        overall = self.overall
        unit = unit_for('m', overall.x_max)
        return (
            f'{counted(overall.impacts, "impact")}, '
            f'largest |X| {unit.factor * overall.x_max:.4g} {unit.name}, '
            f'rms {unit.factor * overall.x_rms:.4g} {unit.name}'
        )


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
    most_in_period : float, optional
        Most events of the rig of the what-if within a period, see `Rig.advance`.

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
        most_in_period: float = MOST_IN_PERIOD,
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
        self.other = WhatIf(start, held, held_initial, most_in_period)
        self.recorded = RunTotals(start.state)
        self.what_if = RunTotals(self.other.rig.snapshot())
        cycle = max(_longest_cycle(logged.rig), _longest_cycle(self.other.rig.parameters))
        self._drawn = drawn
        self._endings = [Ending(_CLOSEUP_CYCLES * cycle) for _ in range(2)]
        self._was_at = Rig.restore(start.state, start.law)
        self._changes: list[tuple[float, str]] = []
        self._last = logged

    def look(self, part: Part) -> tuple[Samples, Events]:
        """Take the next part of the replay; return samples and events of the what-if."""
        if self._drawn:
            for ending, rig in zip(self._endings, (self._was_at, self.other.rig), strict=True):
                ending.look(rig, part)
            self._was_at = Rig.restore(self._replay.rig.snapshot(), self._replay.start.law)
        samples, events = self.other.follow(part)
        command = part.command
        until = math.inf if command is None else command.time
        for totals, rows, found in (
            (self.recorded, part.samples, part.events),
            (self.what_if, samples, events),
        ):
            totals.look(rows, found[found['time'] < until])
            if command is not None:
                state = self.other.rig.snapshot()
                totals.begin(command.state if totals is self.recorded else state)
                totals.look(rows[:0], found[found['time'] >= until])
        for time_ns, step in part.steps:
            for name, value in step.as_dict().items():
                if name in self._was:
                    self._was[name].take(time_ns / 1e9, value)
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
            ('largest |X| [m]', 'x_max'),
            ('rms X [m]', 'x_rms'),
            ('impacts', 'impacts'),
            ('energy lost in impacts [J]', 'impact_loss'),
            ('taken from M by impacts [J]', 'impact_energy'),
        ):
            totals = self.recorded.overall, self.what_if.overall
            was, now = (getattr(overall, quantity) for overall in totals)
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
                totals.envelope(),
                Motion(*trace),
            )
            for head, totals, trace in zip(
                (f'recorded: {was}', f'what if {now}'),
                (self.recorded, self.what_if),
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
