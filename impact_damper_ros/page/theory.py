"""The messages of the theory for the page, one for each part that has changed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from impact_damper_ros import theory as rig_theory


def theory(state: Mapping[str, Any], *, orbit: bool, curve: bool) -> Iterator[dict[str, Any]]:
    """Yield the messages for the rig of a snapshot's state."""
    wanted = {'orbit': orbit, 'gap_curve': curve, 'theory_failed': orbit or curve}
    known: dict[str, Any] = {}
    for document in rig_theory.theory(state) if orbit or curve else ():
        if not isinstance(document, dict):
            continue
        for name in filter(wanted.get, wanted):
            message = document[name]
            if message is not None and message != known.get(name):
                known[name] = message
                yield message
        if not curve and document['orbit']['found'] and document['orbit']['complete']:
            break
