# SPDX-License-Identifier: Apache-2.0
"""
Periodic motions of the rig: search, continuation, stability and viability.

Importable without ROS. A module is imported when one of its names is first used, so that the
node, which only recognises periodic motion, does not wait for the solvers.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .arguments import OrbitError, plausible_stops
    from .branch import BestPoint, Branch, BranchPoint, Limit, SpecialKind, SpecialPoint
    from .continuation import follow, switch_branch
    from .flight_arrays import Flights, run_flights
    from .orbit import OrbitEvent, PeriodicOrbit, Rhythm
    from .recurrence import MotionKind, Period, Section, find_period
    from .search import OrbitSearch, StartReport, find_orbits
    from .settled_motion import SettledMotion, settle
    from .solution_curve import value_of, with_value
    from .solved_orbits import orbit_near
    from .starts import ImpactEquations

__all__ = [
    'BestPoint',
    'Branch',
    'BranchPoint',
    'Flights',
    'ImpactEquations',
    'Limit',
    'MotionKind',
    'OrbitError',
    'OrbitEvent',
    'OrbitSearch',
    'Period',
    'PeriodicOrbit',
    'Rhythm',
    'Section',
    'SettledMotion',
    'SpecialKind',
    'SpecialPoint',
    'StartReport',
    'find_orbits',
    'find_period',
    'follow',
    'orbit_near',
    'plausible_stops',
    'run_flights',
    'settle',
    'switch_branch',
    'value_of',
    'with_value',
]

__getattr__ = lazy_names(
    __name__,
    {
        'arguments': ('OrbitError', 'plausible_stops'),
        'branch': ('BestPoint', 'Branch', 'BranchPoint', 'Limit', 'SpecialKind', 'SpecialPoint'),
        'continuation': ('follow', 'switch_branch'),
        'flight_arrays': ('Flights', 'run_flights'),
        'orbit': ('OrbitEvent', 'PeriodicOrbit', 'Rhythm'),
        'recurrence': ('MotionKind', 'Period', 'Section', 'find_period'),
        'search': ('OrbitSearch', 'StartReport', 'find_orbits'),
        'settled_motion': ('SettledMotion', 'settle'),
        'solution_curve': ('value_of', 'with_value'),
        'solved_orbits': ('orbit_near',),
        'starts': ('ImpactEquations',),
    },
)
