"""
Periodic motions of the rig: found, followed, judged for stability and viability.

Importable without ROS; needs numpy.
"""

from .equations import ImpactEquations
from .error import OrbitError, plausible_stops
from .orbit import Node, PeriodicOrbit
from .report import StartReport
from .search import OrbitSearch, find_orbits

__all__ = [
    'ImpactEquations',
    'Node',
    'OrbitError',
    'OrbitSearch',
    'PeriodicOrbit',
    'StartReport',
    'find_orbits',
    'plausible_stops',
]
