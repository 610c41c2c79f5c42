# SPDX-License-Identifier: Apache-2.0
"""The runs to record on a bench, in words and as a table."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence

from impact_damper_ros.design.bench_plan import PlannedRun
from impact_damper_ros.parameters.rig_parameters import RigParameters

from .formatting import percent, quantity
from .table import Table

#: Cycles of a recorded run, and samples in a cycle.
_CYCLES, _PER_CYCLE = 100, 100
#: A sweep: its ends over the frequency, number of steps, and the least duration of a step in
#: cycles and in time constants of M.
_SWEPT, _STEPS, _DWELL_CYCLES, _DWELL_CONSTANTS = (0.8, 1.2), 40, 60, 8.0


def _deviation_text(deviation: float, *, share: bool = False) -> str:
    if not math.isfinite(deviation):
        return 'not known'
    return f'± {percent(deviation, 2) if share else f"{deviation:.2g}"}'


def _plan_table(runs: Sequence[PlannedRun]) -> Table:
    """Return the runs of a plan, and how well each determines the parameters."""
    rows = [
        (
            'settled motion alone' if run.settled_only else 'from rest',
            f'{run.level:g}',
            quantity(run.gap, 'm', 3),
            str(run.flights),
            'yes' if run.repeats else 'no',
            *map(_deviation_text, run.standard_deviations[:2]),
            _deviation_text(run.standard_deviations.relative_gap, share=True),
        )
        for run in runs
    ]
    head = ('run', 'level', 'gap', 'flights', 'repeats', 'R', 'friction', 'gap known to')
    return Table.of_rows(head, rows)


def _sweep_options(rig: RigParameters) -> str:
    """Return the options with which `simulate_rig` computes a slow sweep there and back."""
    hertz = rig.first_harmonic[1] / math.tau
    low, high = (share * hertz for share in _SWEPT)
    constant = 1.0 / (rig.zeta * rig.omega) if rig.zeta else 0.0
    dwell = float(f'{max(_DWELL_CYCLES / hertz, _DWELL_CONSTANTS * constant):.2g}')
    values = {
        'sweep_mode': 'up_down',
        'sweep_low': f'{low:.4g}Hz',
        'sweep_high': f'{high:.4g}Hz',
        'sweep_step': f'{(high - low) / _STEPS:.4g}Hz',
        'sweep_dwell': f'{dwell:g}',
    }
    changes = ' '.join(f'--set {name}={value}' for name, value in values.items())
    return f'--duration {(2 * _STEPS + 1) * dwell:.4g} {changes} --response sweep.csv'


def _note(runs: Sequence[PlannedRun]) -> str:
    settled, *others = runs
    if not any(math.isfinite(run.standard_deviations.restitution) for run in others):
        return 'm is not hit from rest, or too rarely, to distinguish R, friction and gap: push m.'
    note = (
        '(Standard deviations if frequency and damping are known, and the speeds at the impacts '
        'and the places of m to 1 % of the approach speed and of the gap.)'
    )
    if math.isfinite(settled.standard_deviations.restitution):
        return note
    return (
        'In the settled motion alone R, friction and gap cannot be distinguished: its flights are '
        f'all alike. Record the start. {note}'
    )


def plan_text(rig: RigParameters, runs: Sequence[PlannedRun]) -> str:
    """Return the runs to record on a bench, so that the rig can be fitted to them."""
    hertz = rig.first_harmonic[1] / math.tau
    seconds = float(f'{_CYCLES / hertz:.2g}')
    rate = float(f'{_PER_CYCLE * hertz:.1g}')
    low, high = (share * hertz for share in _SWEPT)

    def fill(text: str, indent: str) -> str:
        return textwrap.fill(
            text, 95, initial_indent=indent, subsequent_indent='     ', break_on_hyphens=False
        )

    steps = [
        'Weigh m, and know the modal mass M or the force. Record X, the force or the motion of '
        'the base, and the instants of the impacts (an accelerometer on M, or a microphone).',
        'Without m, or with m clamped: let M ring down. fit_rig FREE.csv --structure gives its '
        'frequency and damping.',
        f'With m, from rest, the shaker switched on at once at {hertz:.4g} Hz: {seconds:g} s at '
        f'{rate:g} samples a second. Then again at another level and with other gaps:',
        f'Swept slowly from {low:.4g} to {high:.4g} Hz and back at constant level. simulate_rig '
        f'RIG.yaml {_sweep_options(rig)} predicts the result: where the two differ, the model '
        'fails.',
        'fit_rig START.csv --impacts HITS.csv --rig RIG.yaml --json fit.json fits R, friction and '
        'gap to a start; design_damper --fitted fit.json goes on from there.',
    ]
    lines = [fill(f'{k}. {text}', '  ') for k, text in enumerate(steps, 1)]
    table = [_plan_table(runs).text('       '), fill(_note(runs), '     ')]
    return '\n'.join(['Test plan:', *lines[:3], *table, *lines[3:]])
