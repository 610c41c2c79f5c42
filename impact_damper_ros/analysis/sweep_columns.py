"""The columns of a sweep's table: name, unit, type and meaning of each, once for all."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from impact_damper_ros.rig import RigParameters

from .steady_state import SteadyState
from .sweep_plan import Point, SweepPlan

__all__ = ['MEASURES', 'Column', 'Row', 'columns_of', 'failed_row', 'place_of', 'row_of']

Kind = Literal['double', 'integer', 'bool', 'text', 'doubles', 'integers']
#: One row: a value, or None, for each column that has one.
Row = dict[str, Any]


class Column(NamedTuple):
    """
    One column.

    Attributes
    ----------
    name : str
        Its name.
    kind : str
        Type of its values; 'doubles' and 'integers' are lists.
    unit : str
        SI unit; empty for a pure number or a text.
    description : str
        What it means.
    """

    name: str
    kind: Kind
    unit: str
    description: str

    @property
    def label(self) -> str:
        """Name with unit."""
        return f'{self.name} [{self.unit}]' if self.unit else self.name


_PLACE = (
    Column('point', 'integer', '', 'Number of the rig in the sweep, from 0.'),
    Column(
        'direction',
        'text',
        '',
        'up or down: the rig started from the last state of the one before in this direction; '
        'null: from its initial conditions.',
    ),
)
_VERDICT = (
    Column('ok', 'bool', '', 'Whether the rig could be simulated.'),
    Column('reason', 'text', '', 'If not, why not.'),
    Column(
        'motion',
        'text',
        '',
        'What it settled into: periodic, without impacts, at rest, quasi-periodic, chaotic, '
        'undecided, or not periodically driven, by the force or by a control whose samples fall '
        'elsewhere in each cycle.',
    ),
    Column('settled', 'bool', '', 'Whether the motion repeats, to the tolerance of the sweep.'),
    Column('settling_cycles', 'integer', '', 'Cycles of the force before it was measured.'),
    Column('measured_cycles', 'integer', '', 'Cycles of the force over which it was measured.'),
)
_NUMBERS = (
    Column('cycle', 'double', 's', 'Cycle of the force; of the spring, if there is no force.'),
    Column('period', 'integer', '', 'Period k in cycles of the force; null if none was found.'),
    Column(
        'impacts',
        'integer',
        '',
        'Impacts N in a period, those of a chatter up to its cut; null if it does not repeat.',
    ),
    Column(
        'stops',
        'text',
        '',
        'Stops hit in a period, in order; 1~ stands for a whole chatter on stop 1 to rest.',
    ),
    Column('x_max', 'double', 'm', 'Largest |X|.'),
    Column(
        'x_max_ratio',
        'double',
        '',
        'Largest |X| over the amplitude A without impacts; null without one force.',
    ),
    Column('x_rms', 'double', 'm', 'Root mean square of X.'),
    Column('x_mean', 'double', 'm', 'Mean of X.'),
    Column('impacts_per_cycle', 'double', '', 'Impacts per cycle of the force.'),
    Column(
        'lyapunov_exponent',
        'double',
        '1/s',
        'Largest Lyapunov exponent: of a motion that repeats ln|largest multiplier| over its '
        'period; else the mean growth of a deviation over the time measured. Under gap control '
        'by two neighbouring rigs; null if their controls decide differently too often.',
    ),
    Column(
        'lyapunov_uncertainty',
        'double',
        '1/s',
        'Half of its 95 % interval, from the growths in 20 parts of the time measured; of a '
        'motion that repeats the difference between two periods.',
    ),
    Column(
        'largest_multiplier',
        'double',
        '',
        'Modulus of the largest multiplier of a period; null if the motion does not repeat, or '
        'as the exponent.',
    ),
    Column('stick_share', 'double', '', 'Share of the time that friction holds m in the gap.'),
    Column('rest_share', 'double', '', 'Share of the time that m rests on a stop.'),
    Column(
        'chatter_share',
        'double',
        '',
        'Share of the time in complete chatters: from the first of the impacts on one stop that '
        'follow one another ever faster to the rest in which they end.',
    ),
    Column('events', 'integer', '', 'Events of the whole run.'),
)
_ATTRACTOR = (
    Column(
        'attractor',
        'integer',
        '',
        'Number of the motion among those that the same rig settled into, from 0, the most '
        'frequent first.',
    ),
)
_SECTION = (
    Column('section_x', 'doubles', 'm', 'X at the ends of cycles: of a period, or the last ones.'),
    Column('section_velocity', 'doubles', 'm/s', "X' there."),
    Column('section_offset', 'doubles', 'm', 'Y there.'),
    Column('section_relative_velocity', 'doubles', 'm/s', "Y' there."),
    Column('impact_stop', 'integers', '', 'Stop of each impact in the same cycles.'),
    Column('impact_phase', 'doubles', '', 'Its phase in cycles of the force, from 0 to 1.'),
    Column('impact_speed', 'doubles', 'm/s', 'Speed of approach of m and the stop.'),
)
_CONTROLLED = (
    Column(
        'state',
        'text',
        '',
        'State of rig and control at the end, as ControlledRig.snapshot gives it, in JSON.',
    ),
)
#: Measures that can be drawn and made least or greatest.
MEASURES: dict[str, Column] = {
    column.name: column
    for column in _NUMBERS
    if (column.kind == 'double' and column.name != 'cycle') or column.name in ('period', 'impacts')
}


def columns_of(plan: SweepPlan) -> list[Column]:
    """Return all columns of a sweep's table, in order."""
    varied = [
        Column(
            str(target),
            'bool' if target.spec.kind == 'bool' else 'double',
            target.spec.unit,
            target.spec.description,
        )
        for axis in plan.axes
        for target in axis.targets
    ]
    controlled = _CONTROLLED if plan.control.active else ()
    return [*_PLACE, *varied, *_VERDICT, *_NUMBERS, *_ATTRACTOR, *_SECTION, *controlled]


def place_of(plan: SweepPlan, point: Point) -> Row:
    """Return the columns that say which rig it is."""
    return {
        'point': point.index,
        'direction': point.direction or None,
        **{str(target): value for target, value in plan.settings(point)},
    }


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def row_of(state: SteadyState, parameters: RigParameters) -> Row:
    """Return the columns that say what a rig does."""
    amplitude = parameters.response_amplitude if parameters.periodic_force else math.inf
    ratio = state.x_max / amplitude if math.isfinite(amplitude) else math.nan
    return {
        'ok': True,
        'reason': None,
        'motion': state.kind.value,
        'settled': state.period > 0,
        'settling_cycles': state.settling_cycles,
        'measured_cycles': state.measured_cycles,
        'cycle': state.cycle,
        'period': state.period or None,
        'impacts': state.impacts if state.period else None,
        'stops': ','.join(state.stops) if state.period else None,
        'x_max': state.x_max,
        'x_max_ratio': _known(ratio),
        'x_rms': state.x_rms,
        'x_mean': state.x_mean,
        'impacts_per_cycle': state.impacts_per_cycle,
        'lyapunov_exponent': _known(state.exponent.value),
        'lyapunov_uncertainty': _known(state.exponent.uncertainty),
        'largest_multiplier': _known(state.multiplier),
        'stick_share': state.shares.stick,
        'rest_share': state.shares.rest,
        'chatter_share': state.shares.chatter,
        'events': state.events,
        **_lists(
            ('section_x', 'section_velocity', 'section_offset', 'section_relative_velocity'),
            state.section.T.tolist(),
        ),
        'impact_stop': [int(stop) for stop in state.hits[:, 0]],
        'impact_phase': state.hits[:, 1].tolist(),
        'impact_speed': state.hits[:, 2].tolist(),
    }


def _lists(names: Sequence[str], values: Sequence[list[float]]) -> Row:
    return dict(zip(names, values, strict=True))


def failed_row(reason: str) -> Row:
    """Return the columns of a rig that could not be simulated."""
    return {'ok': False, 'reason': reason}
