"""
Periodic motions of the rig: found, followed, judged for stability and viability.

Importable without ROS; needs numpy.
"""

from .continuation import Branch, SpecialKind, SpecialPoint, continue_orbit, switch_branch
from .equations import ImpactEquations, OrbitError, plausible_stops
from .impact_solver import StartReport
from .optimum import OptimalGap, optimal_gap
from .orbit import Node, PeriodicOrbit
from .search import OrbitSearch, find_orbits
from .shooting import Section, orbit_near, section_on, shoot

__all__ = [
    'Branch',
    'ImpactEquations',
    'Node',
    'OptimalGap',
    'OrbitError',
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
]
