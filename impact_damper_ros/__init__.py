# SPDX-License-Identifier: Apache-2.0
"""
A digital rig of an inclined impact damper with friction, for ROS 2.

The names below are what users import, ``from impact_damper_ros import Rig, RigParameters``; none
of them needs ROS. Each is imported at its first use. Sweeps, bags, replays, comparisons and
reports are in the folders of these names.
"""

from .lazy_names import lazy_names

# `typing`, too, would take longer than all else.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from .control.act import Action as Action, ControlAct as ControlAct
    from .control.own_law import LawError as LawError, LawInput as LawInput, OwnLaw as OwnLaw
    from .design.damper_design import Design as Design, best_design as best_design
    from .fit.estimate import Estimate as Estimate
    from .fit.measured_motion import (
        MeasuredMotion as MeasuredMotion,
        ReadingOptions as ReadingOptions,
    )
    from .fit.recorded_motion import read_motion as read_motion
    from .fit.rig_fit import RigFit as RigFit, fit_rig as fit_rig
    from .fit.structure import StructureFit as StructureFit, fit_structure as fit_structure
    from .motion.event import (
        EVENT_TYPE as EVENT_TYPE,
        SAMPLE_TYPE as SAMPLE_TYPE,
        Event as Event,
        EventKind as EventKind,
        Sample as Sample,
    )
    from .motion.state import Mode as Mode
    from .motion.swing import Swing as Swing
    from .orbits.arguments import OrbitError as OrbitError, plausible_stops as plausible_stops
    from .orbits.branch import (
        Branch as Branch,
        BranchPoint as BranchPoint,
        SpecialKind as SpecialKind,
        SpecialPoint as SpecialPoint,
    )
    from .orbits.continuation import follow as follow, switch_branch as switch_branch
    from .orbits.flight_arrays import Flights as Flights, run_flights as run_flights
    from .orbits.orbit import (
        OrbitEvent as OrbitEvent,
        PeriodicOrbit as PeriodicOrbit,
        Rhythm as Rhythm,
    )
    from .orbits.recurrence import (
        MotionKind as MotionKind,
        Period as Period,
        Section as Section,
        find_period as find_period,
    )
    from .orbits.ring_down import RingDown as RingDown, ring_down as ring_down
    from .orbits.search import (
        OrbitSearch as OrbitSearch,
        StartReport as StartReport,
        find_orbits as find_orbits,
    )
    from .orbits.settled_motion import SettledMotion as SettledMotion, settle as settle
    from .orbits.solved_orbits import (
        orbit_near as orbit_near,
        transmissibility as transmissibility,
    )
    from .orbits.starts import ImpactEquations as ImpactEquations
    from .orbits.transmissibility import Transmissibility as Transmissibility
    from .orbits.varied_parameter import value_of as value_of, with_value as with_value
    from .parameters.gap_control_parameters import GapControlParameters as GapControlParameters
    from .parameters.parameter_spec import (
        ParameterError as ParameterError,
        ParameterSpec as ParameterSpec,
    )
    from .parameters.parameters_file import (
        ParametersFileError as ParametersFileError,
        load_parameters as load_parameters,
    )
    from .parameters.rig_parameters import (
        InitialConditions as InitialConditions,
        RigParameters as RigParameters,
    )
    from .rig.ensemble import EnsembleResult as EnsembleResult, run_ensemble as run_ensemble
    from .rig.observed_run import Observer as Observer, TimedChange as TimedChange, run as run
    from .rig.order import Order as Order
    from .rig.rig import Rig as Rig
    from .rig.run_result import Outcome as Outcome, RunResult as RunResult
    from .rig.runaway import RunawayError as RunawayError
    from .version import VERSION

    __version__ = VERSION

_NAMES, _find, __dir__ = lazy_names(__name__, __file__)
__all__ = ['__version__', *_NAMES]


def __getattr__(name: str) -> object:
    if name != '__version__':
        return _find(name)
    from .version import VERSION

    return VERSION
