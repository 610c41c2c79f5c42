"""
Periodic motions of the rig: found, followed, judged for stability and viability.

Importable without ROS; needs numpy.
"""

from .continuation import Branch, continue_orbit, switch_branch
from .equations import ImpactEquations
from .error import OrbitError, plausible_stops
from .nearby import orbit_near
from .optimum import OptimalGap, optimal_gap
from .orbit import Node, PeriodicOrbit
from .report import StartReport
from .search import OrbitSearch, find_orbits
from .shooting import Section, section_on, shoot
from .special_points import SpecialKind, SpecialPoint

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
