"""A recorded run beside its what-if: what both amount to, as a table, as JSON and as a figure."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from impact_damper_ros.replay.replay import Replay, Tick
from impact_damper_ros.replay.replayed_rig import Step, setting_of
from impact_damper_ros.replay.what_if import Ending, RecordedValues, Trace, WhatIf
from impact_damper_ros.rig import (
    ALL_SPECS,
    Event,
    EventKind,
    InitialConditions,
    RigParameters,
    Sample,
)
from impact_damper_ros.rig.event_budget import EventBudget
from impact_damper_ros.rig.quoting import counted, shown
from impact_damper_ros.rig.swing import Swing

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
    """Largest and rms X, impacts and the energy lost in them, from samples in a row; SI units."""

    def __init__(self) -> None:
        self.impacts = 0
        self.energy = 0.0
        self._squares = self._covered = 0.0
        # The last instant, X and X' just after it
        self._last: tuple[float, float, float] | None = None
        self._swing = Swing()

    def look(self, sample: Sample, events: Sequence[Event]) -> None:
        """Take the next sample, and the events since the one before."""
        self._swing.look(sample, events)
        for event in events:
            self._reach(event.time, event.x, event.primary_velocity_before)
            self._last = event.time, event.x, event.primary_velocity_after
            if event.kind is EventKind.IMPACT:
                self.impacts += 1
                self.energy += lost_energy(event)
        self._reach(sample.time, sample.x, sample.primary_velocity)
        self._last = sample.time, sample.x, sample.primary_velocity

    def _reach(self, time: float, x: float, velocity: float) -> None:
        """Add the integral of X squared along the cubic from the last instant to this one."""
        if self._last is None or time <= self._last[0]:
            return
        start, x0, velocity0 = self._last
        step = time - start
        u, v = velocity0 * step, velocity * step
        squares = 156.0 * (x0 * x0 + x * x) + 4.0 * (u * u + v * v) + 108.0 * x0 * x
        squares += 44.0 * (x0 * u - x * v) + 26.0 * (x * u - x0 * v) - 6.0 * u * v
        self._squares += squares * step / 420.0
        self._covered += step

    @property
    def largest(self) -> float:
        """Largest |X|, m; also between the samples."""
        return self._swing.largest

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
        }

    def text(self) -> str:
        """Return the totals in a line, for a figure."""
        unit = unit_for('m', self.largest)
        return (
            f'{counted(self.impacts, "impact")}, '
            f'largest |X| {unit.factor * self.largest:.4g} {unit.name}, '
            f'rms {unit.factor * self.rms:.4g} {unit.name}'
        )


def lost_energy(event: Event) -> float:
    """
    Return the kinetic energy that an impact takes, J.

    It is half the impulse times the difference between the speeds of approach and separation.
    """
    approach = abs(event.damper_velocity_before - event.primary_velocity_before)
    separation = abs(event.damper_velocity_after - event.primary_velocity_after)
    return 0.5 * event.impulse * (approach - separation)


class _Envelope:
    """Least and greatest values of a long signal, in pieces of `size` samples."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._count = 0
        self.time: list[float] = []
        self.low: list[float] = []
        self.high: list[float] = []

    def look(self, time: float, value: float) -> None:
        if self._count % self._size == 0:
            self.time.append(time)
            self.low.append(value)
            self.high.append(value)
        elif value < self.low[-1]:
            self.low[-1] = value
        elif value > self.high[-1]:
            self.high[-1] = value
        self._count += 1

    def arrays(self) -> tuple[Array, Array, Array]:
        return np.array(self.time), np.array(self.low), np.array(self.high)


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
        start = replay.recorded.start
        logged = setting_of(start.state)
        values = logged.as_dict()
        for name in held:
            if name not in values:
                raise ValueError(f'held has {shown(name)}, which is no parameter of the rig')
        initial = replay.replayed.first_initial
        self._was = {
            **{n: RecordedValues(values[n]) for n in held},
            **{n: RecordedValues(getattr(initial, n, None)) for n in held_initial},
        }
        self._now = {**held, **held_initial}
        self.other = WhatIf(start, initial, held, held_initial, budget)
        self.recorded, self.what_if = RunTotals(), RunTotals()
        cycle = max(_longest_cycle(logged.rig), _longest_cycle(self.other.rig.parameters))
        reader = replay.recorded.reader
        total = reader.topics[replay.recorded.topics.joint_states].message_count
        cycles = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9 / cycle
        pieces = int(_MOST_PIECES if cycles < _FEW_CYCLES else min(cycles, _MOST_PIECES))
        size = max(1, math.ceil(total / pieces))
        self._envelopes = _Envelope(size), _Envelope(size)
        self._ending = Ending(replay, self.other, _CLOSEUP_CYCLES * cycle) if drawn else None
        self._changes: list[tuple[float, str]] = []
        self._last = logged

    def look(self, tick: Tick) -> tuple[Sample, list[Event]]:
        """Take the next sample of the replay; return that of the what-if, and its events."""
        sample, events = self.other.follow(tick)
        # X as recorded; the velocity serves to find the largest |X| between samples
        recorded = tick.sample._replace(x=tick.x, primary_velocity=tick.primary_velocity)
        self.recorded.look(recorded, tick.events)
        self.what_if.look(sample, events)
        for time_ns, step in tick.steps:
            for name, value in step.as_dict().items():
                if name in self._was:
                    self._was[name].take(time_ns / 1e9, value)
        if self._ending is not None:
            for envelope, x in zip(self._envelopes, (tick.x, sample.x), strict=True):
                envelope.look(tick.sample.time, x)
            self._ending.look(tick)
            for time_ns, step in tick.steps:
                self._changes.append((time_ns / 1e9, self._label(step)))
        return sample, events

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
        assert self._ending is not None
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
                _motion(trace),
            )
            for head, totals, envelope, trace in zip(
                (f'recorded: {was}', f'what if {now}'),
                (self.recorded, self.what_if),
                self._envelopes,
                self._ending.traces(_CLOSEUP_POINTS),
                strict=True,
            )
        )
        title = f'The recorded run, and the same history with {now}'
        return draw_what_if(recorded, what_if, self._changes, title)


def _with_unit(value: Any, name: str) -> str:
    return f'{setting(value)} {ALL_SPECS[name].unit}'.rstrip()


def _motion(trace: Trace) -> SampledMotion:
    samples = np.array(trace.samples).reshape(-1, len(Sample._fields))
    impacts = np.array([(e.time, e.x + e.y, e.stop) for e in trace.impacts], dtype=float)
    time, x, _, z, _, stop_1, stop_2, *_ = samples.T
    hit, where, stop = impacts.reshape(-1, 3).T
    return SampledMotion(time, x, z, stop_1, stop_2, hit, where, stop.astype(np.int64))
