"""
Periodic motions of the rig: found, followed, judged for stability and viability.

Importable without ROS. A module is imported when one of its names is first used, so that the
node, which only recognises periodic motion, does not wait for the solvers.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .continuation import (
        Branch,
        SpecialKind,
        SpecialPoint,
        continue_orbit,
        switch_branch,
        value_of,
    )
    from .equations import ImpactEquations, OrbitError, plausible_stops
    from .optimum import OptimalGap, optimal_gap
    from .orbit import OrbitEvent, PeriodicOrbit
    from .search import OrbitSearch, StartReport, find_orbits
    from .shooting import Section, orbit_near, section_on, shoot

__all__ = [
    'Branch',
    'ImpactEquations',
    'OptimalGap',
    'OrbitError',
    'OrbitEvent',
    'OrbitSearch',
    'PeriodicOrbit',
    'Section',
    'SpecialKind',
    'SpecialPoint',
    'StartReport',
    'continue_orbit',
    'find_orbits',
    'optimal_gap',
    'orbit_near',
    'plausible_stops',
    'section_on',
    'shoot',
    'switch_branch',
    'value_of',
]

_MODULES = (
    'equations',
    'orbit',
    'shooting',
    'search',
    'continuation',
    'optimum',
)


def __getattr__(name: str) -> Any:
    """Import the module that defines a public name."""
    if name in __all__:
        for module in _MODULES:
            found = import_module(f'{__name__}.{module}')
            if name in found.__all__:
                globals()[name] = getattr(found, name)
                return globals()[name]
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
