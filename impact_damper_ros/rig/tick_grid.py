# SPDX-License-Identifier: Apache-2.0
"""The instants at which a rig is sampled."""

_NS_PER_S = 1_000_000_000


class TickGrid:
    """Instants of the ticks in whole nanoseconds, each rounded from its exact value k / rate."""

    def __init__(self, rate: float) -> None:
        """Store the rate as the exact fraction of its float."""
        self._numerator, self._denominator = float(rate).as_integer_ratio()

    def instant(self, tick: int) -> int:
        """Return the instant of a tick in nanoseconds; tick 0 is at 0."""
        scaled = 2 * tick * _NS_PER_S * self._denominator
        return (scaled + self._numerator) // (2 * self._numerator)
