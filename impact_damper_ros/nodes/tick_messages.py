"""What the rig does up to a tick, as messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from impact_damper_ros.control import Action, ControlRecord
from impact_damper_ros.nodes.messages import ControlTemplate, ImpactTemplate, StateTemplate
from impact_damper_ros.nodes.outlets import Outlet, Outlets
from impact_damper_ros.rig import Event, EventKind, Sample
from impact_damper_ros.rig.published import PAUSED_FRAME

__all__ = ['Happening', 'TickMessages']


class Happening(NamedTuple):
    """A message that is ready to go out."""

    outlet: Outlet
    data: bytes
    stamp_ns: int


class TickMessages:
    """
    Make messages of what happens between two ticks, and count.

    Parameters
    ----------
    outlets : Outlets
        Where they go.

    Attributes
    ----------
    impacts, commands : int
        How many so far.
    last_act : ControlRecord or None
        The last thing that the gap control did.
    """

    def __init__(self, outlets: Outlets) -> None:
        """Build the templates."""
        self.impacts = 0
        self.commands = 0
        self.last_act: ControlRecord | None = None
        self._outlets = outlets
        self._states = StateTemplate()
        self._paused = StateTemplate(PAUSED_FRAME)
        self._impacts_at = {1: ImpactTemplate(1), 2: ImpactTemplate(2)}
        self._acts = {action: ControlTemplate(action) for action in Action}

    def states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a sample, given the static deflection of the rig then, m."""
        return self._states.of(stamp_ns, sample, deflection)

    def paused_states(self, stamp_ns: int, sample: Sample, deflection: float) -> bytes:
        """Return the joint states of a rig that is held; they are no sample of its motion."""
        return self._paused.of(stamp_ns, sample, deflection)

    def happenings(
        self,
        events: Sequence[Event],
        records: Sequence[ControlRecord],
        offset_ns: int,
        deflection: float,
    ) -> list[Happening]:
        """
        Return the messages of impacts, then of what the gap control did.

        Parameters
        ----------
        events, records : sequence of Event and of ControlRecord
            What happened.
        offset_ns : int
            Stamp of rig time 0.
        deflection : float
            Static deflection of the rig then, m.
        """
        out = []
        for event in events:
            if event.kind is EventKind.IMPACT:
                stamp_ns = offset_ns + round(event.time * 1e9)
                data = self._impacts_at[event.stop].of(stamp_ns, event, deflection)
                out.append(Happening(self._outlets.impacts, data, stamp_ns))
                self.impacts += 1
        for record in records:
            stamp_ns = offset_ns + round(record.time * 1e9)
            data = self._acts[record.action].of(stamp_ns, record)
            out.append(Happening(self._outlets.gap_control, data, stamp_ns))
            self.commands += record.action is Action.COMMAND
            self.last_act = record
        return out
