"""How long m chatters, from the events of a run."""

from __future__ import annotations

import numpy as np

from impact_damper_ros.rig import EventKind
from impact_damper_ros.rig.long_run import Events

__all__ = ['chatter_time']

#: Events in the midst of which m may chatter.
_PASSED_OVER = (EventKind.REVERSAL, EventKind.CROSSING, EventKind.STOP_ARRIVED)


def chatter_time(events: Events, start: float, end: float) -> float:
    """
    Add up the time that m spends in complete chatters.

    Parameters
    ----------
    events : ndarray of EVENT_TYPE
        Events in a row. They should begin before the stretch and reach beyond it, so that a
        chatter under way at either end is recognised.
    start, end : float
        The stretch, s.

    Returns
    -------
    float
        Time within the stretch, s, from the first of the impacts on one stop that follow one
        another ever faster to the rest in which they end.
    """
    total = 0.0
    faster: list[float] = []
    struck = 0
    telling = events[~np.isin(events['kind'], _PASSED_OVER)]
    rows = (telling[name].tolist() for name in ('time', 'kind', 'stop'))
    for time, kind, stop in zip(*rows, strict=True):
        if kind == EventKind.IMPACT:
            if stop != struck:
                faster = []
            elif len(faster) > 1 and time - faster[-1] >= faster[-1] - faster[-2]:
                faster = faster[-1:]
            faster.append(time)
            struck = stop
            continue
        if kind == EventKind.REST and faster:
            total += max(0.0, min(time, end) - max(faster[0], start))
        faster = []
    return float(np.clip(total, 0.0, end - start))
