# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs compared with the periodic theory.

`compare_bag` divides a bag into stretches with constant parameters, checks the log of each,
measures its motion, finds the motion that theory predicts, and gives a verdict. Importable without
ROS; needs numpy.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .comparison import compare_bag as compare_bag
    from .result import (
        Beginning as Beginning,
        Decay as Decay,
        EnergyBalance as EnergyBalance,
        ImpactStates as ImpactStates,
        LogCheck as LogCheck,
        LogVerdict as LogVerdict,
        Overall as Overall,
        RunComparison as RunComparison,
        SteadyPart as SteadyPart,
        StretchComparison as StretchComparison,
        Verdict as Verdict,
    )
    from .stretches import LoggedRig as LoggedRig

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
