# SPDX-License-Identifier: Apache-2.0
"""
The document that describes the theory of a rig, for viewers.

A node publishes it as JSON on its topic ``theory`` while someone listens; the page gets the same
of a recording from a worker of its own. It has four entries; the last three are None until they
are known:

``time``
    Rig time of the snapshot that it is for, s. A document with another time than the last snapshot
    that began a course (a start, a change or a reset) is out of date.
``orbit``
    The expected motion: ``type`` ('orbit'), ``found``, ``text`` (why there is none, or a
    limitation), ``kind`` (that of the motion the rig comes to when it is run ahead, as 'chaotic';
    may be empty), ``complete`` and ``others`` (the other motions that are known). If found, also
    ``label``, ``stable``, ``viable``, ``reason``, ``x_max`` (m), ``x_max_ratio`` (Xmax/A),
    ``multipliers`` (real and imaginary part each), as the others have; and ``cycles``, ``stops``,
    ``period`` (s), ``basis`` ('measured', 'run ahead' or 'listed') and ``impacts`` (``phase`` in
    cycles of the force, ``x``, ``stop``, ``velocity_after``, ``damper_velocity_after``). If the
    rig can move so, also one period as columns: ``t`` (s from ``t_zero``, a rig time at which the
    force's angle is zero), ``phase``, ``x``, ``z``, ``y`` and ``relative_velocity``.
``gap_curve``
    Xmax/A over the gap: ``type`` ('gap_curve'), ``gap`` and ``x_max_ratio`` of the rig,
    ``branches`` (``label`` and the columns ``gap``, ``x_max_ratio``, ``stable``, ``viable``),
    ``special`` (bifurcations and other special points: ``gap``, ``x_max_ratio``, ``kind``,
    ``stable``), ``optimum`` (``gap``, ``x_max_ratio`` and ``bound``: 'at least' or 'at most' if
    the best gap is beyond what was followed), ``done``, ``text`` (why there is no curve).
``theory_failed``
    ``type`` ('theory_failed') and ``text``: why there is no theory.
"""

from __future__ import annotations

import json
import time
import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.rig.rig import Rig

from .expected_motion import predictions, zero_of_force
from .gap_curve import MOST_POINTS, PREVIEW_POINTS, GapCurve, name_of
from .motion_curve import orbit_curve
from .prediction import ObservedMotion, Prediction, failed_document

#: Delay of the work, s: turning a knob makes a request at each step, and only the last counts.
_QUIET_S = 0.04


def theory(
    state: Mapping[str, Any], measured: ObservedMotion | None = None, *, document: bool = True
) -> Iterator[Prediction | dict[str, Any]]:
    """
    Compute what theory says of a rig, in answers of increasing quality.

    Parameters
    ----------
    state : mapping
        State of a snapshot.
    measured : ObservedMotion or None, optional
        The motion measured on the rig since.
    document : bool, optional
        Whether to make documents for viewers, with the curve over the gap.

    Yields
    ------
    Prediction or dict
        Predictions, and documents as the module describes them.
    """
    rig = Rig.restore(dict(state))
    if not document:
        yield from predictions(rig, measured)
        return
    last = Prediction()
    shown: dict[str, Any] = {'time': state['time'], 'orbit': None, 'gap_curve': None}
    shown['theory_failed'] = None
    curve = GapCurve(rig.parameters)
    # Theory applies only to a rig whose last prediction is to come.
    followed = not rig.parameters.one_sided
    for number, last in enumerate(predictions(rig, measured)):
        yield last
        shown['orbit'] = orbit_message(rig, last)
        yield dict(shown)
        start = curve.here = last.expected
        if followed and start is not None and not last.complete:
            # The first answer may be replaced by another motion.
            curve.follow(start, MOST_POINTS if number else PREVIEW_POINTS)
            shown['gap_curve'] = curve.message()
            yield dict(shown)
    if not last.applies:
        yield failed_document(state['time'], last.reason) | {'orbit': shown['orbit']}
        return
    for start in [*curve.starts, *last.orbits] if followed else ():
        if curve.follow(start):
            yield {**shown, 'gap_curve': curve.message()}
    text = '' if followed else 'a one-sided rig has no gap'
    yield {**shown, 'gap_curve': curve.message(done=True, text=text)}


def answers(
    state: Mapping[str, Any], measured: ObservedMotion | None, document: bool
) -> Iterator[Prediction | str | None]:
    """Yield the answers to a request, documents as JSON, and None as the last."""
    warnings.simplefilter('ignore')
    time.sleep(_QUIET_S)
    try:
        for answer in theory(state, measured, document=document):
            if isinstance(answer, Prediction):
                yield answer
            else:
                yield json.dumps(answer, allow_nan=False)
    except Exception as error:
        yield Prediction(error=f'{type(error).__name__}: {error}')
    yield None


def orbit_message(rig: Rig, prediction: Prediction) -> dict[str, Any]:
    """Return the entry of the expected motion, with one period of it."""
    expected = prediction.expected
    message: dict[str, Any] = {
        'type': 'orbit',
        'found': expected is not None,
        'text': prediction.reason,
        'kind': prediction.kind,
        'complete': prediction.complete,
        'others': [_summary(other) for other in prediction.orbits if other is not expected],
    }
    if expected is None:
        return message
    drawn = orbit_curve(expected)
    message |= _summary(expected) | {
        'cycles': expected.cycles,
        'stops': list(expected.stops),
        'period': expected.period,
        'basis': prediction.basis,
        'impacts': [
            {
                'phase': phase,
                'x': x,
                'stop': stop,
                'velocity_after': velocity,
                'damper_velocity_after': damper,
            }
            for phase, x, stop, velocity, damper in zip(
                expected.phases,
                expected.x,
                expected.stops,
                expected.primary_velocity_after,
                expected.damper_velocity_after,
                strict=True,
            )
        ],
    }
    if drawn is not None:
        # From the zero of the force on, as the period is repeated. A sort by the phase would
        # exchange the states before and after an impact, which have the same one.
        rows = drawn[:-1]
        turn = int(np.searchsorted(rows[:, 0], expected.cycles))
        rows = np.concatenate([rows[turn:], rows[:turn]])
        over = np.where(np.arange(len(rows)) < len(rows) - turn, expected.cycles, 0)
        phase = np.maximum.accumulate(rows[:, 0] - over)
        message |= {
            't_zero': zero_of_force(rig),
            't': (phase * expected.cycle).tolist(),
            'phase': phase.tolist(),
            'x': rows[:, 1].tolist(),
            'z': (rows[:, 1] + rows[:, 3]).tolist(),
            'y': rows[:, 3].tolist(),
            'relative_velocity': rows[:, 4].tolist(),
        }
    return message


def _summary(orbit: PeriodicOrbit) -> dict[str, Any]:
    names = 'stable', 'viable', 'reason', 'x_max', 'x_max_ratio', 'multipliers'
    plain: dict[str, Any] = as_plain({name: getattr(orbit, name) for name in names})
    return plain | {'label': name_of(orbit)}
