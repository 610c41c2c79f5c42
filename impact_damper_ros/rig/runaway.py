# SPDX-License-Identifier: Apache-2.0
"""
Rigs whose events have no end.

Elastic stops to which weight or compressed air presses m make impacts ever faster: 1e8 per second
and more. A caller that advances a rig limits the events in a period.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from impact_damper_ros.motion.event import Event

#: Most events within a period of the fastest of spring and force, unless others are given.
MOST_IN_PERIOD = 50_000
REMEDY = 'make the stops less elastic or the gap wider'


class RunawayError(RuntimeError):
    """
    A rig has more events than allowed.

    Attributes
    ----------
    events : sequence of Event
        Events of the call that raises the error.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> rig = Rig(RigParameters(gravity=0.0))
    >>> try:
    ...     rig.advance(100.0, most_in_period=2)
    ... except RunawayError as error:
    ...     print(len(error.events), 'events, the last one at', round(error.events[-1].time, 6))
    2 events, the last one at 45.407186
    """

    def __init__(self, reason: str, events: Sequence[Event] = ()) -> None:
        super().__init__(reason)
        self.events = events
