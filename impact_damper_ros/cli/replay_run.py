"""`replay_run`: prove that a recorded run comes out again, or ask what would have been."""

from __future__ import annotations

import argparse
import json
import math
import sys
import textwrap
from collections.abc import Sequence
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.entry_points import run
from impact_damper_ros.replay.recorded_run import RecordedRun
from impact_damper_ros.replay.replay import Replay, Tick
from impact_damper_ros.replay.replayed_rig import Setting, Step, setting_of
from impact_damper_ros.replay.what_if import Ending, RecordedValues, Trace, WhatIf
from impact_damper_ros.report.replay_report import (
    Envelope,
    Response,
    as_json,
    comparison_text,
    findings_text,
)
from impact_damper_ros.report.run_figures import Motion, Side, draw_what_if
from impact_damper_ros.rig import (
    INITIAL_SPECS,
    PARAMETER_SPECS,
    Event,
    InitialConditions,
    RigParameters,
    Sample,
)
from impact_damper_ros.rig.shown import printable

from .command_line import (
    add_version_option,
    announce,
    check_figure,
    check_file,
    outcome,
    whole,
    write_text,
)
from .csv_tables import IMPACT_COLUMNS, impact_rows, open_table, row
from .overrides import overridden, overridden_control

__all__ = ['Comparison', 'held_values', 'main']


_CLOSEUP_CYCLES = 4
_CLOSEUP_POINTS = 2400
_FEW_CYCLES = 60
_MOST_STRETCHES = 2000
#: Changes of a held parameter that the title of a picture lists.
_MOST_IN_FIGURE = 3


def held_values(settings: Sequence[str], logged: Setting) -> tuple[dict[str, Any], dict[str, Any]]:
    """Read ``--set`` options."""
    others, control = overridden_control(settings, logged.control)
    rig, initial = overridden(others, logged.rig, InitialConditions())
    changed = Setting(rig, control).as_dict()
    names = [setting.partition('=')[0] for setting in settings]
    return (
        {n: changed[n] for n in names if n in changed},
        {n: getattr(initial, n) for n in names if n in INITIAL_SPECS},
    )


def _cycle(parameters: RigParameters) -> float:
    """Return the longest period of the force, or the natural one of a rig without force."""
    harmonics = zip(parameters.force_amplitudes, parameters.force_frequencies, strict=True)
    frequencies = [w for amplitude, w in harmonics if amplitude and w]
    return math.tau / min([*frequencies, 1e9 if frequencies else parameters.omega])


class Comparison:
    """
    The recorded run and the what-if, side by side.

    Parameters
    ----------
    replay : Replay
        The replay, at its first sample.
    settings : sequence of str
        What is held, each NAME=VALUE.
    drawn : bool
        Whether what a picture needs is to be kept.

    Attributes
    ----------
    other : WhatIf
        The rig of the what-if.
    recorded, what_if : Response
        What both amount to, so far.

    Raises
    ------
    ValueError
        If the settings are not admissible.
    """

    def __init__(self, replay: Replay, settings: Sequence[str], *, drawn: bool) -> None:
        start = replay.recorded.start
        logged = setting_of(start.state)
        values = logged.as_dict()
        held, held_initial = held_values(settings, logged)
        initial = replay.replayed.first_initial
        self._was = {
            **{n: RecordedValues(values[n]) for n in held},
            **{n: RecordedValues(getattr(initial, n, None)) for n in held_initial},
        }
        self._now = {**held, **held_initial}
        self.other = WhatIf(start, initial, held, held_initial)
        self.recorded, self.what_if = Response(), Response()
        cycle = max(_cycle(logged.rig), _cycle(self.other.rig.parameters))
        reader = replay.recorded.reader
        total = reader.topics[replay.recorded.topics.joint_states].message_count
        cycles = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9 / cycle
        # Of many cycles, only how far each goes can be seen.
        stretches = _MOST_STRETCHES if cycles < _FEW_CYCLES else min(cycles, _MOST_STRETCHES)
        self._envelopes = Envelope(total, int(stretches)), Envelope(total, int(stretches))
        self._ending = Ending(replay, self.other, _CLOSEUP_CYCLES * cycle) if drawn else None
        self._changes: list[tuple[float, str]] = []
        self._last = logged

    def look(self, tick: Tick) -> tuple[Sample, list[Event]]:
        """Take the next sample of the replay; return that of the what-if, and its events."""
        sample, events = self.other.follow(tick)
        # As recorded; the velocity serves to find the largest displacement between samples.
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
        parts = []
        for name, value in step.as_dict().items():
            if value != before[name]:
                shown = f'{value:g}' if isinstance(value, float) else str(value)
                parts.append(f'{name} {shown}' + (' (held)' if name in self._now else ''))
        return ', '.join(parts)

    def text(self) -> str:
        """Return both as a table."""
        how = 'with the recorded state, to which the rig was changed as a live one would be'
        if self.other.from_initial:
            how = 'from the initial conditions, as the recorded run did'
        held = {name: (self._was[name], now) for name, now in self._now.items()}
        return comparison_text(held, self.recorded, self.what_if, how)

    def as_json(self) -> dict[str, Any]:
        """Return both as what JSON can hold, in SI units."""
        sides = {
            name: {
                'largest_x': response.largest,
                'rms_x': None if math.isnan(response.rms) else response.rms,
                'impacts': response.impacts,
                'energy_lost_in_impacts': response.energy,
            }
            for name, response in (('recorded', self.recorded), ('what_if', self.what_if))
        }
        return {
            'set': self._now,
            'recorded_values': {name: was.as_json() for name, was in self._was.items()},
            'from_initial': self.other.from_initial,
            **sides,
        }

    def draw(self, path: Path) -> None:
        """Draw both."""
        assert self._ending is not None
        traces = self._ending.traces(_CLOSEUP_POINTS)
        texts = [f'{n} = {_shown(v, n)}' for n, v in self._now.items()]
        was = [
            f'{name} = {values.described(partial(_shown, name=name), _MOST_IN_FIGURE)}'
            for name, values in self._was.items()
            if values.value is not None
        ]
        heads = (f'recorded: {", ".join(was)}', f'what if {", ".join(texts)}')
        sides = [
            Side(f'{textwrap.fill(head, 66)}\n{_brief(response)}', envelope, _motion(trace))
            for head, response, envelope, trace in zip(
                heads,
                (self.recorded, self.what_if),
                self._envelopes,
                traces,
                strict=True,
            )
        ]
        title = f'The recorded run, and the same history with {", ".join(texts)}'
        draw_what_if(sides[0], sides[1], self._changes, title).savefig(path, dpi=150)


def _shown(value: Any, name: str) -> str:
    spec = {**PARAMETER_SPECS, **GAP_CONTROL_SPECS, **INITIAL_SPECS}[name]
    if isinstance(value, tuple):
        shown = f'[{", ".join(f"{v:g}" for v in value)}]'
    else:
        shown = f'{value:g}' if isinstance(value, float) else str(value).lower()
    return f'{shown} {spec.unit}'.rstrip()


def _brief(response: Response) -> str:
    factor, unit = (1.0, 'm') if response.largest >= 0.5 else (1e3, 'mm')
    return (
        f'{response.impacts} impacts, largest |X| {factor * response.largest:.4g} {unit}, '
        f'rms {factor * response.rms:.4g} {unit}'
    )


def _motion(trace: Trace) -> Motion:
    samples = np.array(trace.samples).reshape(-1, len(Sample._fields))
    impacts = np.array(
        [(e.time, e.x + e.y, e.stop, e.impulse) for e in trace.impacts], dtype=float
    ).reshape(-1, 4)
    time, x, _, z, _, stop_1, stop_2, *_ = samples.T
    hit, where, stop, impulse = impacts.T
    return Motion(time, x, z, stop_1, stop_2, hit, where, stop.astype(np.int64), impulse)


#: Samples between two updates of the progress bar.
_STRIDE = 256

_DESCRIPTION = """\
Replay a recorded run from its own log. Without --set, every recorded sample and impact is computed
anew from the first snapshot and the logged parameter changes and resets, and compared bit for bit.
With --set, the same history is also run with parameters held at other values, and both are
compared. Works without ROS, on a bag directory or a single .mcap file, also a recovered one.
"""
_EPILOG = """\
Exit status: 0 if all is reproduced bit for bit; 1 if something differs (or a file cannot be
written); 2 if the bag or an argument cannot be used; 3 if all that can be compared is reproduced,
but the bag is cut, damaged, lacks messages, or holds some twice or out of order; 130 on Ctrl-C.
Example: replay_run runs/run_20250131_120000 --set gap=0.03 --figure what_if.png
"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        'replay_run',
        description=_DESCRIPTION,
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('bag', type=Path, metavar='BAG', help='bag directory or .mcap file')
    parser.add_argument(
        '--set',
        action='append',
        default=[],
        metavar='NAME=VALUE',
        help='what if: hold a parameter at a value throughout, for example --set gap=0.03; may '
        'be repeated',
    )
    parser.add_argument(
        '--node', metavar='NAME', help='which node, by name or namespace, if the bag has several'
    )
    parser.add_argument(
        '--json', type=Path, metavar='FILE', help='write the result as JSON (- : stdout)'
    )
    parser.add_argument(
        '--figure', type=Path, metavar='FILE.png', help='draw the recorded run and the what-if'
    )
    parser.add_argument(
        '--states',
        type=Path,
        metavar='FILE.csv',
        help='write the replayed states (with --set, those of the what-if) as CSV',
    )
    parser.add_argument(
        '--impacts', type=Path, metavar='FILE.csv', help='write its impacts as CSV, likewise'
    )
    parser.add_argument('--quiet', action='store_true', help='no progress bar and no report')
    add_version_option(parser)
    return parser


class _Table:
    """The states and impacts of the rig, as CSV files like those of `simulate_rig`."""

    def __init__(self, states: Path | None, impacts: Path | None, stack: ExitStack) -> None:
        self._states = open_table(states, Sample._fields, stack) if states else None
        self._impacts = open_table(impacts, IMPACT_COLUMNS, stack) if impacts else None

    def write(self, sample: Sample, events: Sequence[Event]) -> None:
        """Write a sample, and the impacts among the events before it."""
        if self._states is not None:
            self._states.write(row(sample))
        if self._impacts is not None:
            self._impacts.write(impact_rows(events))


def _run(arguments: argparse.Namespace, replay: Replay) -> Comparison | None:
    """Replay and write the tables; return the what-if, if one was asked for."""
    comparison = None
    reader = replay.recorded.reader
    span = ((reader.end_ns or 0) - (reader.start_ns or 0)) / 1e9
    count = max(1, reader.topics[replay.recorded.topics.joint_states].message_count)
    with ExitStack() as stack:
        table = _Table(arguments.states, arguments.impacts, stack)
        bar = stack.enter_context(
            tqdm(
                total=span,
                desc='replayed',
                delay=1.0,
                leave=False,
                disable=True if arguments.quiet else None,
                bar_format='{l_bar}{bar}| {n:.0f}/{total:.0f} s [{elapsed}<{remaining}]',
            )
        )
        if not (arguments.set or arguments.states or arguments.impacts):
            start = replay.recorded.start.time_ns / 1e9
            replay.run(lambda time: bar.update(max(0.0, min(span, time - start) - bar.n)))
            return None
        for number, tick in enumerate(replay.ticks()):
            if arguments.set:
                if comparison is None:
                    drawn = arguments.figure is not None
                    comparison = Comparison(replay, arguments.set, drawn=drawn)
                table.write(*comparison.look(tick))
            else:
                table.write(tick.sample, tick.events)
            if number % _STRIDE == 0:
                bar.update(min(span, span * number / count) - bar.n)
    return comparison


def _report(arguments: argparse.Namespace, replay: Replay, comparison: Comparison | None) -> int:
    findings, recorded = replay.findings, replay.recorded
    result = as_json(findings, recorded)
    text = findings_text(findings, recorded)
    if comparison is not None:
        result['what_if'] = comparison.as_json()
        text += '\n' + comparison.text()
        if findings.difference_count:
            text += '\ncaution     the run is not reproduced from its log: see above'
        if arguments.figure is not None:
            with whole(arguments.figure) as draft:
                comparison.draw(draft)
    to_stdout = arguments.json is not None and str(arguments.json) == '-'
    if arguments.json is not None:
        content = json.dumps(result, indent=2) + '\n'
        write_text(arguments.json, content)
    if not arguments.quiet:
        print(printable(text), file=sys.stderr if to_stdout else sys.stdout)
    return findings.verdict.value if findings.samples else 2


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = _parser()
    arguments = parser.parse_args(argv)
    if arguments.figure is not None and not arguments.set:
        parser.error('--figure draws a what-if beside the recorded run: give --set NAME=VALUE too')

    def work() -> int:
        # Before the work, not after it
        if arguments.json is not None:
            check_file(arguments.json)
        if arguments.figure is not None:
            check_figure(arguments.figure)
        replay = Replay(RecordedRun(arguments.bag, arguments.node))
        if arguments.set:
            # A slip of the pen is told at once.
            logged = setting_of(replay.recorded.start.state)
            held, _ = held_values(arguments.set, logged)
            if not arguments.quiet:
                rig = {n: value for n, value in held.items() if n in PARAMETER_SPECS}
                announce('replay_run', logged.rig.replace(**rig))
        return _report(arguments, replay, _run(arguments, replay))

    return outcome('replay_run', work)


if __name__ == '__main__':
    sys.exit(run('replay_run', main))
