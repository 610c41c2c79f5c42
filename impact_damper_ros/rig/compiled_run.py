# SPDX-License-Identifier: Apache-2.0
"""Runs of one rig or many in compiled code."""

from __future__ import annotations

from typing import Any

import numpy as np

from impact_damper_ros.control.act import ActRow
from impact_damper_ros.control.state import Control
from impact_damper_ros.motion.kernels import compiled_kernel, kernel, only_row
from impact_damper_ros.motion.next_event import DONE, FULL, count_modes
from impact_damper_ros.motion.records import dtype_of
from impact_damper_ros.motion.state import Moving
from impact_damper_ros.motion.transition import begin_from

from .acts import NO_TIMES, Schedule
from .loop import run_to
from .strobe import Strobe, goes_on, next_look

#: Times and values of the measured records of a rig, as arrays.
Records = tuple[Any, ...]
NO_RECORDS: Records = (np.array(NO_TIMES), np.empty(0), np.array(NO_TIMES), np.empty(0))
#: A table of acts without rows.
NO_ACTS: Any = np.empty(0, dtype_of(ActRow))
NO_STROBES: Any = np.empty(0, dtype_of(Strobe))


@kernel
def run_each(
    waves: Any,
    controls: Any,
    acts: Any,
    rigs: Any,
    log: Any,
    in_mode: Any,
    end: float,
    outcomes: Any,
    instants: Any,
    samples: Any,
    records: Any,
    anew: bool,
    strobes: Any,
) -> int:
    """
    Let each rig run as `run_to` does, and write into `outcomes` why it stopped.

    A rig runs from its start if `anew`, and until its motion comes back if there are strobes. Its
    events are not kept then: only its control reads them, in `log`. Rigs with one harmonic have a
    row of waves each, not an array, and their code has no loop over harmonics.
    """
    constants, lines, runs = rigs
    for k in range(len(waves)):
        run = runs[k]
        if waves.ndim == 1:
            wave = only_row(waves, k)
        else:
            wave = waves[k]
        if controls is None:
            control = None
        else:
            # The table is made here, since no compiled function can return one.
            control = Control(
                controls[0][k],
                controls[1][k],
                controls[2][k],
                controls[3][k],
                controls[4][k],
                controls[5][k],
                controls[6][k],
                controls[7][k],
                controls[8][k],
                controls[9][k],
                controls[10],
            )
        moving = Moving(constants[k], lines[k], run, wave, log)
        schedule = Schedule(instants, samples[k], records[0], records[1], records[2], records[3])
        if anew:
            begin_from(moving)
        status = FULL
        while status == FULL:
            run.written = 0
            until = end
            if len(strobes) > 0:
                until = next_look(run, schedule, strobes[k])
            status = run_to(moving, in_mode[k], control, acts, schedule, until)
            if len(strobes) > 0:
                if status == DONE and goes_on(run, schedule, strobes[k]):
                    status = FULL
            elif not anew:
                break
        if anew:
            count_modes(run, in_mode[k])
        outcomes[k] = status
    return len(waves)


def run_compiled(
    rigs: tuple[Any, Any, Any],
    waves: Any,
    log: Any,
    in_mode: Any,
    controls: Control | None,
    end: float,
    instants: Any,
    outcomes: Any,
    samples: Any,
    *,
    acts: Any = NO_ACTS,
    records: Records = NO_RECORDS,
    anew: bool = False,
    strobes: Any = NO_STROBES,
) -> None:
    """Run arrays of rigs as `run_each` does, compiled."""
    alone = waves.shape[1] == 1 and controls is None
    arguments = (
        # For a named tuple numba would determine the type at each call.
        *(waves[:, 0] if alone else waves, None if controls is None else tuple(controls)),
        *(None if controls is None else acts, rigs),
        *(log, in_mode, end, outcomes, instants, samples, records, anew, strobes),
    )
    form = 'one harmonic' if alone else 'harmonics'
    if controls is not None:
        form = 'control' if controls.law is None else 'own law'
    try:
        compiled_kernel(run_each.__name__, arguments, form=form)(*arguments)
    except SystemError as error:
        # An error that a signal raises just as compiled code returns
        if isinstance(error.__cause__, KeyboardInterrupt):
            raise error.__cause__ from None
        raise
