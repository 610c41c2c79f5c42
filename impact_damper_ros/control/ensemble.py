"""Many rigs without control at once: constants by numpy, one compiled loop over all of them."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from impact_damper_ros.rig import PARAMETER_SPECS, InitialConditions, RigParameters
from impact_damper_ros.rig.compiled import compiled, dtype_of, kernel, packed, rows_of
from impact_damper_ros.rig.event import SAMPLE_TYPE, EventRow, Sample
from impact_damper_ros.rig.flight import Lines, Waves
from impact_damper_ros.rig.oscillator import oscillators
from impact_damper_ros.rig.parameter_spec import ParameterError
from impact_damper_ros.rig.run import ALL_STEPS, count_modes
from impact_damper_ros.rig.state import (
    Mode,
    RigConstants,
    Run,
    Wave,
    incline,
    rig_fields,
    starting_fields,
)
from impact_damper_ros.rig.transition import begin_from

from .loop import run_through
from .rig import later_time, most_of, times_between

#: Rigs between two moments at which a run can be interrupted.
_BLOCK = 64
#: Parameters that are arrays, or that change the form of the force.
_SHARED = ('force_', 'multisine_', 'sweep_')
_NO_ROWS: Any = np.empty(0, dtype_of(EventRow))


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
        Motion at the requested instants; NaN at those that were not reached.
    event_counts : ndarray of int, shape (n,)
        Number of transitions.
    time_in_mode : ndarray of float, shape (n, 8)
        Time spent in each `Mode`, s.
    """

    outcomes: npt.NDArray[np.int64]
    times: npt.NDArray[np.float64]
    samples: npt.NDArray[np.void]
    event_counts: npt.NDArray[np.int64]
    time_in_mode: npt.NDArray[np.float64]


@kernel
def run_each(
    rigs: Sequence[RigConstants],
    lines: Sequence[Lines],
    runs: Sequence[Run],
    waves: Sequence[Waves],
    log: Sequence[EventRow],
    in_mode: Any,
    outcomes: Any,
    end: float,
    instants: Any,
    samples: Any,
) -> int:
    """Let each rig run from its start to a time, without a table of events."""
    for k in range(len(rigs)):
        begin_from(rigs[k], lines[k], runs[k], waves[k], log)
        outcomes[k], _ = run_through(
            rigs[k],
            lines[k],
            runs[k],
            waves[k],
            log,
            in_mode[k],
            None,
            None,
            end,
            instants,
            0,
            samples[k],
        )
        count_modes(runs[k], in_mode[k])
    return len(rigs)


#: Parameters that are numbers of each rig.
_NUMBERS = [
    name
    for name, spec in PARAMETER_SPECS.items()
    if isinstance(spec.default, float) and not name.startswith(_SHARED)
]


def _constants(parameters: RigParameters, p: Any, count: int) -> tuple[Any, Any]:
    """Return the constants of all rigs, and their harmonics: of M alone, then of both masses."""
    force = [np.array(values) for values in parameters.harmonics]
    harmonics = len(force[0])
    both, lines = oscillators(
        np.concatenate([p.primary_mass, p.primary_mass + p.damper_mass]),
        np.tile(p.stiffness, 2),
        np.tile(p.damping, 2),
        *(np.broadcast_to(values, (2 * count, harmonics)) for values in force),
    )
    # The sine of Python, not that of numpy, which has other last bits
    sine, cosine = np.array([incline(angle) for angle in p.angle.tolist()]).T
    rigs = rows_of(
        RigConstants,
        count,
        free=both[:count],
        joint=both[count:],
        harmonics=harmonics,
        **rig_fields(p, sine, cosine, sum(map(abs, parameters.harmonics[0]))),
    )
    return rigs, np.concatenate([lines[:count], lines[count:]], axis=1)


def _columns(values: Mapping[str, npt.ArrayLike]) -> dict[str, npt.NDArray[np.float64]]:
    """Return the values as arrays of one length, checked."""
    columns = {name: np.array(value, dtype=float) for name, value in values.items()}
    if not columns:
        raise ValueError('values is empty: give the values of at least one parameter')
    count = {len(column) if column.ndim == 1 else 0 for column in columns.values()}
    if len(count) != 1 or 0 in count:
        shapes = ', '.join(f'{name} {column.shape}' for name, column in columns.items())
        raise ValueError(f'the shapes of the values are {shapes}: give lists of one length')
    for name, column in columns.items():
        if name not in _NUMBERS:
            raise ParameterError(
                name, f'{name} does not vary in an ensemble: give some of {", ".join(_NUMBERS)}'
            )
        for extreme in (column.min(), column.max()):
            PARAMETER_SPECS[name].checked(float(extreme))
    return columns


def run_ensemble(
    parameters: RigParameters,
    values: Mapping[str, npt.ArrayLike],
    time: float,
    instants: npt.ArrayLike = (),
    *,
    initial: InitialConditions | None = None,
    most_events: float = float('inf'),
    threads: int | None = None,
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
    time : float
        Time to which all run from 0, s.
    instants : array_like of float, shape (k,), optional
        Times of samples, in order, s.
    initial : InitialConditions, optional
        Where they start; at rest with m in the middle of the gap, if not given.
    most_events : float, optional
        Most events of a rig.
    threads : int, optional
        Number of threads; as many as there are processors, if not given.

    Returns
    -------
    EnsembleResult
        What has become of each rig.

    Raises
    ------
    ParameterError
        If a value is out of range, or varies something that all share.
    ValueError
        If values have different lengths, or a time is out of range or order.
    ImportError
        Without numba (extra ``compiled``).

    Examples
    --------
    >>> import numpy as np
    >>> found = run_ensemble(RigParameters(), {'gap': np.linspace(10.0, 60.0, 5)}, 500.0, [500.0])
    >>> found.samples.shape, int(found.outcomes.max())
    ((5, 1), 0)
    """
    if parameters.sweep_mode != 'off':
        raise ParameterError(
            'sweep_mode',
            f'sweep_mode is {parameters.sweep_mode!r}: an ensemble has no stepped sine, give off',
        )
    columns = _columns(values)
    end, most = later_time(time, 0.0), most_of(most_events)
    when = times_between(0.0, end, instants)
    count = len(next(iter(columns.values())))
    p = SimpleNamespace(
        **{name: np.full(count, getattr(parameters, name)) for name in _NUMBERS},
        one_sided=parameters.one_sided,
    )
    vars(p).update(columns)
    # What holds between parameters: the rig next to critical damping, and the narrowest gap
    closest = int(np.argmax(p.damping / np.sqrt(p.stiffness * p.primary_mass)))
    narrowest = int(np.argmin(p.gap))
    start = initial or InitialConditions()
    for k in (closest, narrowest):
        one = parameters.replace(**{name: float(column[k]) for name, column in columns.items()})
        start.check_within(one)

    rigs, lines = _constants(parameters, p, count)
    runs = np.full(count, packed(Run(room=0, steps=ALL_STEPS, most=most)))
    for name, column in starting_fields(start, rigs['half_gap'], p.one_sided).items():
        runs[name] = column
    waves = np.full((count, lines.shape[1] // 2), packed(Wave()))
    in_mode = np.zeros((count, len(Mode)))
    outcomes = np.zeros(count, np.int64)
    samples = np.full((count, len(when), len(Sample._fields)), np.nan)

    def run_block(first: int) -> None:
        rows = slice(first, first + _BLOCK)
        own = rigs[rows], lines[rows], runs[rows], waves[rows]
        arguments = (*own, _NO_ROWS, in_mode[rows], outcomes[rows], end, when, samples[rows])
        compiled(run_each.__name__, '', arguments)(*arguments)

    blocks = range(0, count, _BLOCK)
    run_block(0)
    workers = min(threads or len(os.sched_getaffinity(0)), len(blocks))
    if workers == 1:
        for first in blocks[1:]:
            run_block(first)
    elif workers:
        with ThreadPoolExecutor(workers) as pool:
            try:
                for done in [pool.submit(run_block, first) for first in blocks[1:]]:
                    done.result()
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    return EnsembleResult(
        outcomes,
        runs['now'].copy(),
        samples.view(SAMPLE_TYPE).reshape(count, len(when)),
        runs['happened'].copy(),
        in_mode,
    )
