# SPDX-License-Identifier: Apache-2.0
"""Two runs side by side, a recorded one and its what-if: as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np

from impact_damper_ros.compare.measures import motion_curve
from impact_damper_ros.compare.result import Array, LoggedStretch, Overall
from impact_damper_ros.compare.stretches import RecordedStretch, Stretches
from impact_damper_ros.motion.event import SAMPLE_TYPE
from impact_damper_ros.orbits.settled_motion import cycle_of
from impact_damper_ros.parameters.all_parameters import unit_of
from impact_damper_ros.parameters.quoting import plural, setting
from impact_damper_ros.replay.command import Command, Setting
from impact_damper_ros.replay.replay import RunPart
from impact_damper_ros.replay.rows import NO_EVENTS, NO_SAMPLES, Samples
from impact_damper_ros.replay.what_if import WhatIf

from .formatting import unit_for
from .run_figures import RunRows, Side, draw_runs
from .table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Most values of an overridden parameter that are listed in the text, and in a figure.
_MOST_IN_TABLE, _MOST_IN_FIGURE = 20, 3
_CLOSEUP_CYCLES = 4
#: Quantities by which the runs are compared: name in the table, and in `Overall` and JSON.
_QUANTITIES = (
    ('largest |X| [m]', 'x_max'),
    ('rms X [m]', 'x_rms'),
    ('impacts', 'impacts'),
    ('energy lost in impacts [J]', 'impact_loss'),
    ('taken from M by impacts [J]', 'impact_energy'),
)


class _Run:
    """The measures of a whole run, and the states of its last periods."""

    def __init__(self, state: Mapping[str, Any], span: float) -> None:
        self._parts, self._span = Stretches(state), span
        self._overall: list[Overall] = []
        self._envelopes = [np.empty((3, 0))]
        self.stretches: list[LoggedStretch] = []
        self.end = RunRows(NO_SAMPLES, NO_EVENTS)

    def take(self, part: RunPart | None) -> None:
        """Take the next part of the run, or None after the last one."""
        for stretch in self._parts.finish() if part is None else self._parts.take(part):
            self.stretches.append(stretch.recorded_part)
            self._overall.append(stretch.overall)
            self._envelopes.append(stretch.envelope)
            if self._span:
                start = stretch.end - self._span
                rows = _motion_from(stretch, start), stretch.flights.impacts
                joined = map(np.concatenate, zip(self.end, rows, strict=True))
                self.end = RunRows(*(one[one['time'] >= start] for one in joined))

    def envelope(self) -> Array:
        """Return the range of X in consecutive pieces: time, least and greatest X."""
        return np.hstack(self._envelopes)

    @property
    def overall(self) -> Overall | None:
        """Largest |X|, impacts and energy; None if the run holds no motion."""
        return Overall.join(self._overall) if self._overall else None


def _motion_from(stretch: RecordedStretch, start: float) -> Samples:
    """Return the motion of a stretch from an instant on, s, as samples."""
    curve = motion_curve(stretch, max(stretch.start, start), cycle_of(stretch.parameters))
    samples = np.zeros(0 if curve is None else len(curve.time), SAMPLE_TYPE)
    if curve is not None:
        places = {'z': curve.y, 'stop_1': curve.stop_1, 'stop_2': curve.stop_2}
        samples['time'], samples['x'] = curve.time, curve.x
        for name, place in places.items():
            samples[name] = curve.x + place
    return samples


class RunPair:
    """
    A recorded run and its what-if, whose parts are taken one after the other.

    Parameters
    ----------
    start : Command
        Where the recorded run begins.
    what_if : WhatIf
        The run of the other rig.
    overrides : mapping
        Overridden parameters and initial conditions, and their values.
    drawn : bool, optional
        Whether to keep the states for the figure.
    """

    def __init__(
        self, start: Command, what_if: WhatIf, overrides: Mapping[str, Any], *, drawn: bool = False
    ) -> None:
        rigs = Setting.of(start.state).rig, what_if.rig.parameters
        span = _CLOSEUP_CYCLES * max(map(cycle_of, rigs)) if drawn else 0.0
        self._overrides, self._initial = dict(overrides), start.initial.as_dict()
        self._from_initial = what_if.from_initial
        self._recorded = _Run(start.state, span)
        self._other = _Run(what_if.rig.snapshot(), span)

    def take(self, recorded: RunPart, other: RunPart) -> None:
        """Take the next part of both runs."""
        self._recorded.take(recorded)
        self._other.take(other)

    def finish(self) -> None:
        """Note that both runs have ended."""
        self._recorded.take(None)
        self._other.take(None)

    def _recorded_values(self, name: str) -> list[Any]:
        """Return the values of an overridden parameter in the recorded run, in order."""
        if name in self._initial:
            return [self._initial[name]]
        found: list[Any] = []
        for stretch in self._recorded.stretches:
            value = stretch.values[name]
            found += [] if found and found[-1] == value else [value]
        return found

    def text(self) -> str:
        """Return both runs side by side, as a table."""
        parts = []
        for name, value in self._overrides.items():
            was = self._recorded_values(name)
            listed = ', '.join(map(repr, was[:_MOST_IN_TABLE])) or 'not known'
            more = len(was) - _MOST_IN_TABLE
            listed += f' and {more} more' if more > 0 else ''
            parts.append(f'{name} = {value!r} (recorded: {listed})')
        how = 'with the recorded state, to which the rig was changed as a live one would be'
        if self._from_initial:
            how = 'from the initial conditions, as the recorded run did'
        return '\n'.join(
            [
                textwrap.fill(f'what if     {", ".join(parts)}', 99, subsequent_indent=' ' * 12),
                f'start       {how}',
                self.table().text(),
            ]
        )

    def table(self) -> Table:
        """Return the table of the measures of both runs."""
        both = self._recorded.overall, self._other.overall
        rows = []
        for title, name in _QUANTITIES:
            was, now = (math.nan if one is None else getattr(one, name) for one in both)
            ratio = f'{now / was:.4f}' if was else '-'
            rows.append([title, f'{was:.7g}', f'{now:.7g}', ratio])
        return Table.of_rows(['', 'recorded', 'what if', 'ratio'], rows)

    def as_json(self) -> dict[str, Any]:
        """Return both runs for JSON, in SI units; unknown values are None."""
        return {
            'set': self._overrides,
            'recorded_values': {name: self._recorded_values(name) for name in self._overrides},
            'from_initial': self._from_initial,
            'recorded': _totals(self._recorded.overall),
            'what_if': _totals(self._other.overall),
        }

    def figure(self) -> Figure:
        """Return the figure of both runs; needs `drawn`."""
        values = {**self._other.stretches[0].values, **self._overrides}
        now = ', '.join(f'{name} = {_with_unit(name, values)}' for name in self._overrides)
        was = []
        for name in self._overrides:
            rigs = [{**self._initial, **one.values} for one in self._recorded.stretches]
            texts = [text for text, _ in groupby(_with_unit(name, rig) for rig in rigs)]
            listed = ', '.join(texts[:_MOST_IN_FIGURE])
            more = len(texts) - _MOST_IN_FIGURE
            was.append(f'{name} = {listed}' + (f' and {more} more' if more > 0 else ''))
        recorded, other = (
            Side(f'{textwrap.fill(head, 66)}\n{_in_a_line(run)}', run.envelope(), run.end)
            for head, run in (
                (f'recorded: {", ".join(was)}', self._recorded),
                (f'what if {now}', self._other),
            )
        )
        title = f'The recorded run, and the same history with {now}'
        return draw_runs((recorded, other), list(self._changes()), title)

    def _changes(self) -> Iterator[tuple[float, str]]:
        """Yield the instants of changes of the recorded run, s, and the changes in words."""
        before: dict[str, Any] = {}
        for stretch in self._recorded.stretches:
            values = stretch.values
            texts = [
                f'{name} {_with_unit(name, values)}'
                + (' (overridden)' if name in self._overrides else '')
                for name, value in values.items()
                if before and before[name] != value
            ]
            if before:
                yield stretch.start, ', '.join(texts) or stretch.begins.value
            before = values


def _totals(overall: Overall | None) -> dict[str, Any]:
    values = {name: getattr(overall, name, math.nan) for _, name in _QUANTITIES}
    return {name: None if math.isnan(value) else value for name, value in values.items()}


def _in_a_line(run: _Run) -> str:
    overall = run.overall
    if overall is None:
        return 'no motion'
    unit = unit_for('m', overall.x_max)
    return (
        f'{plural(overall.impacts, "impact")}, '
        f'largest |X| {unit.factor * overall.x_max:.4g} {unit.name}, '
        f'rms {unit.factor * overall.x_rms:.4g} {unit.name}'
    )


def _with_unit(name: str, values: Mapping[str, Any]) -> str:
    return f'{setting(values[name])} {unit_of(name, values)}'.rstrip()
