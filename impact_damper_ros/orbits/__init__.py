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

_MODULES = {
    'continuation': (
        *('Branch', 'SpecialKind', 'SpecialPoint'),
        *('continue_orbit', 'switch_branch', 'value_of'),
    ),
    'equations': ('ImpactEquations', 'OrbitError', 'plausible_stops'),
    'optimum': ('OptimalGap', 'optimal_gap'),
    'orbit': ('OrbitEvent', 'PeriodicOrbit'),
    'search': ('OrbitSearch', 'StartReport', 'find_orbits'),
    'shooting': ('Section', 'orbit_near', 'section_on', 'shoot'),
}
_HOME = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Import the module that defines a public name."""
    if name not in _HOME:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    globals()[name] = getattr(import_module(f'{__name__}.{_HOME[name]}'), name)
    return globals()[name]
