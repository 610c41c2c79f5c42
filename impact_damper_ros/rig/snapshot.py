"""Snapshots: all that a rig's future depends on, in a form that goes through JSON without loss."""

from __future__ import annotations

from math import inf
from typing import Any, NamedTuple

from .event import Event, EventKind
from .origin import Origin
from .parameters import RigParameters
from .sweep import Sweep

__all__ = ['ARITHMETIC', 'FORMATS', 'Snapshot', 'upgraded']

_FORMAT = 2
#: Formats that can be read. The first knew neither stops that move nor sweeps.
FORMATS = (1, 2)
#: Counts up when the same motion gets other last bits: older runs then go on alike to round-off
#: only. The first polished roots by certified steps alone, the second by the closed form.
ARITHMETIC = 3


class Snapshot(NamedTuple):
    """
    A rig at one instant.

    Attributes
    ----------
    parameters : RigParameters
        The rig.
    origin : Origin
        Origin of the present flight, after the event that began it.
    time : float
        Time reached, s; the flight's origin may be earlier.
    unreported : tuple of Event
        Events of the very start that have not been reported yet.
    sweep : Sweep
        How far the sweep has come.
    """

    parameters: RigParameters
    origin: Origin
    time: float
    unreported: tuple[Event, ...]
    sweep: Sweep

    def as_dict(self) -> dict[str, Any]:
        """Return the snapshot as numbers, texts, lists and dictionaries."""
        origin = {
            name: None if value in (inf, -inf) else value
            for name, value in self.origin._asdict().items()
        }
        return {
            'format': _FORMAT,
            'arithmetic': ARITHMETIC,
            'time': self.time,
            'origin': {**origin, 'angles': list(self.origin.angles)},
            'unreported': [list(event) for event in self.unreported],
            'sweep': self.sweep._asdict(),
            'parameters': {
                name: list(value) if isinstance(value, tuple) else value
                for name, value in self.parameters.as_dict().items()
            },
        }

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Snapshot:
        """
        Read what `as_dict` has written.

        Raises
        ------
        ValueError
            If the snapshot is of another format or lacks something.
        """
        version = stored.get('format')
        if version not in FORMATS:
            known = ' and '.join(map(str, FORMATS))
            raise ValueError(f'snapshot of format {version!r}: this version reads {known}')
        try:
            parameters = RigParameters(**stored['parameters'])
            values: dict[str, Any] = {
                name: inf if value is None else value for name, value in stored['origin'].items()
            }
            if version == 1:
                half = 0.5 * parameters.gap
                values = {**values, 'target_1': half, 'target_2': -half}
            return cls(
                parameters=parameters,
                origin=Origin(**{**values, 'angles': tuple(values['angles'])}),
                time=float(stored['time']),
                unreported=tuple(
                    Event(event[0], EventKind(event[1]), *event[2:])
                    for event in stored.get('unreported', [])
                ),
                # The first format knew no sweep; nor does one that is off begin anywhere.
                sweep=Sweep(**stored.get('sweep', {'start': 0.0})),
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f'snapshot is not complete: {error}') from error


def upgraded(stored: dict[str, Any]) -> dict[str, Any]:
    """
    Return a stored snapshot as this version would have written it, and what else it holds.

    Raises
    ------
    ValueError
        If it is of another format or lacks something.
    """
    return {**stored, **Snapshot.from_dict(stored).as_dict()}
