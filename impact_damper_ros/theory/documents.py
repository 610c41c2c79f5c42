# SPDX-License-Identifier: Apache-2.0
"""
The document that describes the theory of a rig, for viewers.

A node publishes it as JSON on its topic ``theory`` while someone listens; the page makes the same
of a recording. After a change it publishes two documents: one with the predicted motion and its
curve, and some hundredths of a second later one with all motions. The last three of its four
entries may be None:

``time``
    Rig time of its snapshot, s. Ignore a document whose time is not that of the last snapshot of a
    start, a change or a reset.
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
    the best gap is beyond what was followed), ``text`` (why there is no curve).
``theory_failed``
    ``type`` ('theory_failed') and ``text``: why there is no theory.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from impact_damper_ros.orbits.flight_arrays import FlightStart
from impact_damper_ros.orbits.orbit import PeriodicOrbit
from impact_damper_ros.parameters.plain import as_plain
from impact_damper_ros.rig.rig import Rig

from .expected_motion import predictions
from .gap_curve import GapCurve, name_of
from .motion_curve import orbit_curve
from .prediction import ObservedMotion, Prediction, failed_document


def theory(
    state: Mapping[str, Any], measured: ObservedMotion | None = None
) -> Iterator[tuple[Prediction, dict[str, Any]]]:
    """
    Compute the theory of a rig: its motion and the curve of that, then the other motions.

    Parameters
    ----------
    state : mapping
        State of a snapshot.
    measured : ObservedMotion or None, optional
        The motion measured on the rig since that snapshot.

    Yields
    ------
    prediction : Prediction
        A prediction of `expected_motion.predictions`.
    document : dict
        The document that the module describes.
    """
    rig = Rig.restore(dict(state), compiled=None)
    curve = GapCurve(rig.parameters)
    why = '' if not rig.parameters.one_sided else 'a one-sided rig has no gap'
    for prediction in predictions(rig, measured):
        document: dict[str, Any] = {'time': state['time'], **dict.fromkeys(_ENTRIES)}
        document['orbit'] = orbit_message(rig, prediction)
        expected = prediction.expected
        if not prediction.applies:
            document['theory_failed'] = {'type': 'theory_failed', 'text': prediction.reason}
        elif expected is not None or prediction.complete:
            others = prediction.orbits if prediction.complete else ()
            for orbit in filter(None, (expected, *others)) if not why else ():
                curve.follow(orbit)
            document['gap_curve'] = curve.message(expected, why)
        yield prediction, document


_ENTRIES = 'orbit', 'gap_curve', 'theory_failed'


def answers(
    state: Mapping[str, Any], measured: ObservedMotion | None, documented: bool
) -> Iterator[tuple[Prediction, str]]:
    """Yield the answers to a request: predictions, and documents as JSON where wanted."""
    try:
        with np.errstate(all='ignore'):
            if documented:
                for prediction, document in theory(state, measured):
                    yield prediction, _in_pieces(document)
            else:
                rig = Rig.restore(dict(state), compiled=None)
                for prediction in predictions(rig, measured):
                    yield prediction, ''
    except Exception as error:
        text = f'{type(error).__name__}: {error}'
        yield Prediction(error=text, complete=True), failed_document(state.get('time'), text)


def _in_pieces(value: Any) -> str:
    """Return a value as JSON, encoded in pieces: the encoder holds the lock of the interpreter."""
    if isinstance(value, dict):
        return f'{{{", ".join(f"{json.dumps(k)}: {_in_pieces(v)}" for k, v in value.items())}}}'
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return f'[{", ".join(map(_in_pieces, value))}]'
    return json.dumps(value, allow_nan=False)


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
        # The period begins at the zero of the force. A sort by the phase would exchange the states
        # before and after an impact, which have the same phase.
        rows = drawn[:-1]
        turn = int(np.searchsorted(rows[:, 0], expected.cycles))
        rows = np.concatenate([rows[turn:], rows[:turn]])
        over = np.where(np.arange(len(rows)) < len(rows) - turn, expected.cycles, 0)
        phase = np.maximum.accumulate(rows[:, 0] - over)
        message |= {
            't_zero': FlightStart.of(rig).drive.zero,
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
