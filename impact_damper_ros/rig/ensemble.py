# SPDX-License-Identifier: Apache-2.0
"""Many rigs at once: constants by numpy, one compiled loop over all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from impact_damper_ros.control.controller import begin_sampling, control_of, packed_control
from impact_damper_ros.control.own_law import Law, LawError, OwnLaw
from impact_damper_ros.control.sensors import mixed_seed
from impact_damper_ros.control.state import (
    Actuators,
    Control,
    ControlSettings,
    Refusal,
    settings_fields,
)
from impact_damper_ros.motion.event import SAMPLE_TYPE, EventRow, Sample
from impact_damper_ros.motion.kernels import on_threads
from impact_damper_ros.motion.next_event import ALL_STEPS, COMMANDS_FULL, LAW_FAILED
from impact_damper_ros.motion.oscillator import oscillators
from impact_damper_ros.motion.records import dtype_of, pack, rows_of
from impact_damper_ros.motion.state import (
    Mode,
    RigConstants,
    Run,
    Wave,
    incline,
    rig_fields,
    starting_fields,
)
from impact_damper_ros.parameters.gap_control_parameters import (
    GAP_CONTROL_SPECS,
    GapControlParameters,
)
from impact_damper_ros.parameters.parameter_spec import ParameterError
from impact_damper_ros.parameters.quoting import plural
from impact_damper_ros.parameters.rig_parameters import (
    PARAMETER_SPECS,
    InitialConditions,
    RigParameters,
    check_rig,
)

from .compiled_run import run_compiled
from .rig_state import own_law_of
from .run_arguments import later_time, most_of, times_between
from .run_result import Outcome
from .runaway import MOST_IN_PERIOD

#: What is kept of the samples of some rigs.
Reduction = Callable[[npt.NDArray[np.void]], npt.NDArray[Any]]
#: Most rigs between two moments at which a run can be interrupted, and number of blocks of fewer.
_BLOCK, _BLOCKS = 64, 8
#: Parameters that are arrays, or that change the form of the force.
_SHARED = ('force_', 'multisine_', 'sweep_')
#: Rows of events, in which the control finds the motion of the stops.
_LOG_ROWS = 64
#: Factor by which the room for commands grows where it was too small.
_MORE = 8


class EnsembleResult(NamedTuple):
    """
    Result of a run of many rigs.

    Attributes
    ----------
    outcomes : ndarray of int, shape (n,)
        An `Outcome` for each rig.
    times : ndarray of float, shape (n,)
        Time reached, s.
    samples : ndarray of SAMPLE_TYPE, shape (n, k)
        Motion at the requested instants; NaN at those that were not reached. What `reduce` has
        made of it instead, if that was given: (n, ...).
    event_counts : ndarray of int, shape (n,)
        Number of transitions.
    time_in_mode : ndarray of float, shape (n, 8)
        Time spent in each `Mode`, s.
    actuator_energies : ndarray of float, shape (n, 2)
        Energy spent by the actuator of each stop, J.

    Examples
    --------
    >>> result = run_ensemble(RigParameters(gravity=0.0), {'gap': [37.0, 74.0]}, 60.0)
    >>> result.event_counts.tolist(), result.times.tolist()
    ([7, 0], [60.0, 60.0])
    """

    outcomes: npt.NDArray[np.int64]
    times: npt.NDArray[np.float64]
    samples: npt.NDArray[Any]
    event_counts: npt.NDArray[np.int64]
    time_in_mode: npt.NDArray[np.float64]
    actuator_energies: npt.NDArray[np.float64]

    def __repr__(self) -> str:
        """Return a summary in one line."""
        whole = int((self.outcomes == Outcome.COMPLETE).sum())
        return (
            f'<EnsembleResult: {plural(len(self.times), "rig")}, {whole} complete, '
            f'{plural(self.samples.shape[-1], "sample")} each>'
        )


#: Parameters that may differ from rig to rig.
_NUMBERS = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if isinstance(spec.default, float) and not name.startswith(_SHARED)
]
#: Parameters of the control that may differ.
_CONTROL_NUMBERS = [
    name for name, spec in GAP_CONTROL_SPECS.items() if isinstance(spec.default, int | float)
]
_SPECS = {**PARAMETER_SPECS, **GAP_CONTROL_SPECS}


def _of_springs(of: Callable[[float, float], Any], p: Any) -> npt.NDArray[np.float64]:
    """Return what belongs to spring and dashpot of each rig, once for rigs with the same ones."""
    springs, which = np.unique([p.stiffness, p.damping], axis=1, return_inverse=True)
    return np.array([of(*spring) for spring in springs.T.tolist()])[which.ravel()]


def _forces(parameters: RigParameters, p: Any, count: int) -> list[Any]:
    """Return amplitudes, frequencies and phases of the harmonics of each rig."""
    groups = [
        [np.tile(values, (count, 1)) for values in group]
        if name != 'base'
        else _of_springs(parameters.base_motion.force, p).swapaxes(0, 1)
        for name, group in parameters.harmonic_groups.items()
    ]
    return [np.concatenate(parts, axis=1) for parts in zip(*groups, strict=True)]


def _constants(parameters: RigParameters, p: Any, count: int) -> tuple[Any, Any]:
    """Return the constants of all rigs, and their harmonics: of M alone, then of both masses."""
    base = parameters.base_rows
    force = _forces(parameters, p, count)
    harmonics = force[0].shape[1]
    both, lines = oscillators(
        np.concatenate([p.primary_mass, p.primary_mass + p.damper_mass]),
        np.tile(p.stiffness, 2),
        np.tile(p.damping, 2),
        *(np.concatenate([values, values]) for values in force),
    )
    # The sine of Python, not that of numpy, which has other last bits
    sine, cosine = np.array([incline(angle) for angle in p.angle.tolist()]).T
    constants = rows_of(
        RigConstants,
        count,
        free=both[:count],
        joint=both[count:],
        harmonics=harmonics,
        **rig_fields(p, sine, cosine, sum(map(abs, force[0].T)), base),
    )
    if base.stop:
        columns = _of_springs(parameters.base_motion.columns, p)
        for k, name in enumerate(('base_sine', 'base_cosine')):
            lines[name][:count, base] = columns[:, k]
    return constants, np.concatenate([lines[:count], lines[count:]], axis=1)


def _controls(control: Control, p: Any, count: int) -> Control:
    """Return the control of each rig, like a given one but for its parameters."""
    one: Any = packed_control(control)
    parts = {name: part for name, part in one._asdict().items() if name != 'law'}
    arrays: dict[str, Any] = {name: np.repeat(part, count, axis=0) for name, part in parts.items()}
    for name, column in settings_fields(p, p).items():
        arrays['settings'][name] = column
    arrays['settings']['speed'] = np.where(p.actuator_speed == 0.0, np.inf, p.actuator_speed)
    arrays['settings']['seed'] = [mixed_seed(int(seed)) for seed in p.gap_control_seed]
    places = arrays['settings']['half_gap'][:, np.newaxis] * [1.0, -1.0]
    for name in ('target', 'commanded'):
        for stop in (1, 2):
            arrays['actuators'][f'{name}_{stop}'] = places[:, stop - 1]
    return Control(**arrays, law=one.law)


def _some(controls: Any, rows: Any) -> Control:
    """Return the controls in some rows."""
    parts: list[Any] = [part if part is controls.law else part[rows] for part in controls]
    return Control(*parts)


def _columns(
    values: Mapping[str, npt.ArrayLike], names: Sequence[str]
) -> dict[str, npt.NDArray[np.float64]]:
    """Return the values of some of the parameters as arrays of one length, checked."""
    columns = {name: np.array(value, dtype=float) for name, value in values.items()}
    if not columns:
        raise ValueError('values is empty: give the values of at least one parameter')
    count = {len(column) if column.ndim == 1 else 0 for column in columns.values()}
    if len(count) != 1 or 0 in count:
        shapes = ', '.join(f'{name} {column.shape}' for name, column in columns.items())
        raise ValueError(f'the shapes of the values are {shapes}: give lists of one length')
    for name, column in columns.items():
        if name not in names:
            raise ParameterError(
                name, f'{name} does not vary in this ensemble: give some of {", ".join(names)}'
            )
        spec = _SPECS[name]
        assert spec.low is not None
        assert spec.high is not None
        wrong = ~((spec.low <= column) & (column <= spec.high))
        wrong |= (column > 0.0) & (column < spec.least)
        if spec.kind == 'integer':
            wrong |= column != np.floor(column)
        if wrong.any():
            spec.check(float(column[np.argmax(wrong)]))
        # Never -0.0
        columns[name] = column + 0.0
    return columns


def run_ensemble(
    parameters: RigParameters,
    values: Mapping[str, npt.ArrayLike],
    time: float,
    instants: npt.ArrayLike = (),
    *,
    initial: InitialConditions | None = None,
    control: GapControlParameters | None = None,
    law: Law | None = None,
    most_events: float = float('inf'),
    threads: int | None = None,
    reduce: Reduction | None = None,
) -> EnsembleResult:
    """
    Run many rigs that differ in some parameters, in compiled code.

    Each runs as `Rig.run` does, to the last bit.

    Parameters
    ----------
    parameters : RigParameters
        What the rigs have in common; without a stepped sine.
    values : mapping of str to array_like of float, shape (n,)
        Parameters in which they differ, in the units of `RigParameters`; not those of the force.
        Under control also numbers of `GapControlParameters`.
    time : float
        Time to which all run from 0, s.
    instants : array_like of float, shape (k,), optional
        Times of samples, in order, s.
    initial : InitialConditions, optional
        Where they start; at rest with m in the middle of the gap, if not given.
    control : GapControlParameters, optional
        What their control has in common; off, if not given.
    law : callable, optional
        A law of your own that moves the stops, as in `Rig`, compiled by ``numba.njit``.
    most_events : float, optional
        Most events of a rig.
    threads : int, optional
        Number of threads; as many as there are processors, if not given.
    reduce : callable, optional
        Called with the samples of some of the rigs at a time, shape (m, k), in any thread: returns
        what is kept of them, an array with m rows, so that not all samples are in memory at once.

    Returns
    -------
    EnsembleResult
        What has become of each rig.

    Raises
    ------
    TypeError
        If `parameters` is no `RigParameters`.
    ParameterError
        If a value is out of range, or varies something that all share.
    ValueError
        If values have different lengths, or a time is out of range or order.
    LawError
        If a law of the user's own fails, or numba cannot compile it.
    ImportError
        Without numba.

    Examples
    --------
    >>> import numpy as np
    >>> result = run_ensemble(RigParameters(), {'gap': np.linspace(10.0, 60.0, 5)}, 500.0, [500.0])
    >>> result.samples.shape, int(result.outcomes.max())
    ((5, 1), 0)
    >>> gaps, late = {'gap': np.linspace(10.0, 60.0, 5)}, np.linspace(400.0, 500.0, 1001)
    >>> largest = lambda samples: np.abs(samples['x']).max(axis=1)
    >>> run_ensemble(RigParameters(), gaps, 500.0, late, reduce=largest).samples.shape
    (5,)
    """
    check_rig('parameters', parameters)
    if parameters.sweep_mode != 'off':
        raise ParameterError(
            'sweep_mode',
            f'sweep_mode is {parameters.sweep_mode!r}: an ensemble has no stepped sine, give off',
        )
    own = own_law_of(law)
    settings = control or GapControlParameters(gap_control='off' if own is None else 'timed')
    controlled = settings.active
    columns = _columns(values, _NUMBERS + _CONTROL_NUMBERS if controlled else _NUMBERS)
    end, most = later_time(time, 0.0), most_of(most_events)
    when = times_between(0.0, end, instants)
    count = len(next(iter(columns.values())))
    p = SimpleNamespace(
        **{name: np.full(count, getattr(parameters, name)) for name in _NUMBERS},
        **{name: np.full(count, getattr(settings, name)) for name in _CONTROL_NUMBERS},
        one_sided=parameters.one_sided,
    )
    vars(p).update(columns)
    # Conditions between parameters are checked for the extreme rigs only: next to critical
    # damping, with the narrowest gap, with the least range of the gap control, with the slowest
    # actuator.
    closest = int(np.argmax(p.damping / np.sqrt(p.stiffness * p.primary_mass)))
    start = initial or InitialConditions()
    least = p.gap, p.gap_max - p.gap_min, p.actuator_speed
    for k in (closest, *(int(np.argmin(column)) for column in least)):
        numbers = {name: float(column[k]) for name, column in columns.items()}
        start.check_within(parameters.replace(**{n: numbers[n] for n in numbers if n in _NUMBERS}))
        settings.replace(**{n: numbers[n] for n in numbers if n in _CONTROL_NUMBERS})

    constants, lines = _constants(parameters, p, count)
    runs = np.full(count, pack(Run()))
    for name, column in starting_fields(start, constants['half_gap'], p.one_sided).items():
        runs[name] = column
    waves = np.full((count, lines.shape[1] // 2), pack(Wave()))
    runs['room'], runs['steps'], runs['most'] = _LOG_ROWS if controlled else 0, ALL_STEPS, most
    runs['most_in_period'] = MOST_IN_PERIOD
    controls = None
    if controlled:
        one = control_of(settings, parameters, own)
        begin_sampling(one, 0.0)
        controls = _controls(one, p, count)
    result: EnsembleResult | None = None
    pending = np.arange(count)
    while result is None or len(pending):
        arrays = constants[pending], lines[pending], runs[pending], waves[pending]
        acting = None if controls is None else _some(controls, pending)
        latest = _run_all(arrays, acting, end, when, threads, reduce)
        if acting is not None and (latest.outcomes == LAW_FAILED).any():
            assert own is not None
            k = int(np.argmax(latest.outcomes == LAW_FAILED))
            raise LawError(f'rig {pending[k]} of the ensemble: {_law_error(own, acting, k)}')
        if result is None:
            result = latest
        else:
            for whole, part in zip(result, latest, strict=True):
                whole[pending] = part
        pending = np.flatnonzero(result.outcomes == COMMANDS_FULL)
        if controls is not None:
            more = np.repeat(controls.commands, _MORE, axis=1)
            controls = controls._replace(commands=more)
    return result


def _law_error(law: OwnLaw, controls: Any, k: int) -> LawError:
    """Return the error of a law that failed with one of the controls."""
    control = controls._replace(
        actuators=Actuators(*controls.actuators[k].item()),
        refusal=Refusal(*controls.refusal[k].item()),
        settings=ControlSettings(*controls.settings[k].item()),
    )
    return law.refusal(control)


def _run_all(
    arrays: tuple[Any, Any, Any, Any],
    controls: Control | None,
    end: float,
    when: npt.NDArray[np.float64],
    threads: int | None,
    reduce: Reduction | None,
) -> EnsembleResult:
    """Let all rigs run, block by block, in threads."""
    constants, lines, runs, waves = arrays
    outcomes, in_mode = np.zeros(len(runs), np.int64), np.zeros((len(runs), len(Mode)))
    size = min(_BLOCK, 1 + len(runs) // _BLOCKS)

    def run_block(first: int) -> npt.NDArray[Any]:
        rows = slice(first, first + size)
        samples = np.full((len(outcomes[rows]), len(when), len(Sample._fields)), np.nan)
        run_compiled(
            (constants[rows], lines[rows], runs[rows]),
            waves[rows],
            np.empty(0 if controls is None else _LOG_ROWS, dtype_of(EventRow)),
            in_mode[rows],
            None if controls is None else _some(controls, rows),
            end,
            when,
            outcomes[rows],
            samples,
            anew=True,
        )
        states = samples.view(SAMPLE_TYPE).reshape(samples.shape[:2])
        return states if reduce is None else reduce(states)

    kept = on_threads(run_block, range(0, len(runs), size), threads)
    energies = np.zeros((len(runs), 2))
    if controls is not None:
        actuators: Any = controls.actuators
        for stop in (1, 2):
            energies[:, stop - 1] = actuators[f'energy_{stop}']
    return EnsembleResult(
        outcomes,
        runs['now'].copy(),
        np.concatenate(kept),
        runs['happened'].copy(),
        in_mode,
        energies,
    )
