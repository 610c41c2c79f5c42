"""Theory for the page, from a process of its own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

__all__ = ['Theorist']


class Theorist:
    """What theory says of the present rig; asked anew at each change."""

    def __init__(self, tell: Callable[[dict[str, Any]], None]) -> None:
        self._tell = tell
        self.predicted: float | None = None
        self.optimum: float | None = None

    def ask(self, state: dict[str, Any]) -> None:
        """Begin to work on a rig."""

    def forget(self) -> None:
        """Forget what is known."""

    def want(self, orbit: bool, curve: bool) -> None:
        """Say what is wanted."""

    def known(self) -> list[dict[str, Any]]:
        """Return the last messages."""
        return []

    def close(self) -> None:
        """End the process."""
