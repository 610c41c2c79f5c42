"""How a search for periodic motions went."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

__all__ = ['StartReport']


@dataclass(frozen=True, kw_only=True)
class StartReport:
    """
    How the search for motions of one stop sequence went.

    Attributes
    ----------
    stops : tuple of int
        The sequence.
    method : str
        'scan': every motion of the impact equations was found, whatever it starts from; there
        are no starts to count. 'starts': the impact equations were solved from systematic
        starts. 'shooting': the event map was solved from motions of a simpler rig, without
        friction or with one harmonic.
    starts, converged : int
        Systematic starts, or motions of the simpler rig, and how many led to a motion.
    simulated, simulated_converged : int
        Starts taken from simulated motion, and how many converged.
    distinct : int
        Different motions found.
    """

    stops: tuple[int, ...]
    method: Literal['scan', 'starts', 'shooting']
    starts: int = 0
    converged: int = 0
    simulated: int = 0
    simulated_converged: int = 0
    distinct: int = 0

    @property
    def complete(self) -> bool:
        """Whether all motions are certain to be found, but for roots closer than the scan."""
        return self.method == 'scan'

    @property
    def text(self) -> str:
        """The report in one line."""
        line = f'stops {",".join(map(str, self.stops))}: '
        if self.complete:
            return f'{line}all solutions, {self.distinct} found'
        line += f'{self.distinct} found; '
        if self.method == 'starts':
            share = self.converged / self.starts if self.starts else 0.0
            line += f'{self.converged} of {self.starts} ({share:.0%}) systematic starts'
        else:
            line += f'{self.converged} of {self.starts} motions of a simpler rig carried over'
        return f'{line}, {self.simulated_converged} of {self.simulated} from simulation converged'
