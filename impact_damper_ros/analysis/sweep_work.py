"""The work of a sweep: rigs in a row, in whatever process or machine they are run."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import impact_damper_ros
from impact_damper_ros.control import GapControlParameters
from impact_damper_ros.control.controlled_run import ControlledRun
from impact_damper_ros.rig import InitialConditions, ParameterError, RigParameters
from impact_damper_ros.rig.long_run import LongRun

from .settling_rig import EndlessEventsError, Settling
from .steady_state import steady_state
from .sweep_axes import Target
from .sweep_columns import Row, failed_row, row_of
from .sweep_settings import varied, varied_control

__all__ = ['Block', 'Done', 'WrongVersionError', 'rig_row', 'run_block']

Snapshot = dict[str, Any]
Settings = tuple[tuple[Target, float], ...]


class WrongVersionError(RuntimeError):
    """The work is done by another version of the package than the one that planned it."""


@dataclass(frozen=True)
class Block:
    """
    Rigs that one worker runs in a row.

    Attributes
    ----------
    version : str
        Version of the package that planned it.
    parameters, initial : RigParameters, InitialConditions
        The rig, but for what is varied.
    settling : Settling
        How it is watched.
    control : GapControlParameters
        The gap control, but for what is varied.
    points : tuple of (int, Settings)
        Rows, and what takes which value there.
    followed : bool
        Whether each rig starts from the last state of the one before.
    state : dict or None
        The last state of the rig before the first one, if there was one.
    seconds : float
        After this time no further rig is begun.
    """

    version: str
    parameters: RigParameters
    initial: InitialConditions
    settling: Settling
    control: GapControlParameters
    points: tuple[tuple[int, Settings], ...]
    followed: bool
    state: Snapshot | None
    seconds: float


class Done(NamedTuple):
    """
    One rig that has been run.

    Attributes
    ----------
    point : int
        Its row.
    row : Row
        What it does.
    state : dict or None
        The state from which the next rig starts, if that is followed.
    """

    point: int
    row: Row
    state: Snapshot | None


def _continued(state: Snapshot, parameters: RigParameters) -> LongRun:
    """Return a rig that takes over the state of another one; its time begins anew."""
    run = LongRun.restore(state)
    run.change(parameters)
    snapshot = run.snapshot()
    origin = dict(snapshot['origin'])
    # A flight begins at the change, since the rig is another one
    origin['time'] -= snapshot['time']
    return LongRun.restore({**snapshot, 'time': 0.0, 'origin': origin})


def _controlled(
    parameters: RigParameters,
    initial: InitialConditions,
    control: GapControlParameters,
    state: Snapshot | None,
) -> ControlledRun:
    """Return a rig under control; one that takes over a state goes on in its time."""
    if state is None:
        return ControlledRun(parameters, initial, control)
    run = ControlledRun.restore(state)
    run.change(parameters, control)
    return run


def rig_row(
    parameters: RigParameters,
    initial: InitialConditions,
    settings: Sequence[tuple[Target, float]],
    settling: Settling,
    state: Snapshot | None = None,
    control: GapControlParameters | None = None,
) -> tuple[Row, Snapshot | None]:
    """
    Run one rig of a sweep.

    Parameters
    ----------
    parameters, initial : RigParameters, InitialConditions
        The rig, but for what is varied.
    settings : sequence of (Target, float)
        What takes which value.
    settling : Settling
        How it is watched.
    state : dict, optional
        State of another rig to start from.
    control : GapControlParameters, optional
        The gap control, but for what is varied; off, if not given.

    Returns
    -------
    row : Row
        What it does, or why it cannot be run.
    state : dict or None
        Its last state; None if there is none.
    """
    try:
        rig, begun = varied(parameters, initial, settings)
        run: LongRun | ControlledRun
        if control is not None and control.active:
            run = _controlled(rig, begun, varied_control(control, settings), state)
        else:
            run = LongRun(rig, begun) if state is None else _continued(state, rig)
        row, last = row_of(steady_state(run, settling), rig), run.snapshot()
        if isinstance(run, ControlledRun):
            # The section does not tell what the control knows
            row['state'] = json.dumps(last, separators=(',', ':'))
        return row, last
    except (ParameterError, EndlessEventsError) as error:
        return failed_row(str(error)), None
    except (ArithmeticError, ValueError, RuntimeError, AssertionError) as error:
        # One rig that meets a fault must not be the end of all the others
        return failed_row(f'{type(error).__name__}: {error}'), None


def run_block(block: Block) -> list[Done]:
    """
    Run rigs until all are done or the time is up; at least one.

    Raises
    ------
    WrongVersionError
        If this is another version of the package than planned the work.
    """
    if block.version != impact_damper_ros.__version__:
        raise WrongVersionError(
            f'a worker has version {impact_damper_ros.__version__} of impact_damper_ros, the '
            f'sweep is of version {block.version}: install the same version everywhere'
        )
    until = time.monotonic() + block.seconds
    done: list[Done] = []
    state = block.state
    for point, settings in block.points:
        row, last = rig_row(
            *(block.parameters, block.initial, settings, block.settling, state, block.control)
        )
        if block.followed and last is not None:
            state = last
        done.append(Done(point, row, state if block.followed else None))
        if time.monotonic() >= until:
            break
    return done
