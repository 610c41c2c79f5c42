"""The run loop of one rig, compiled or plain: the same results, to the last bit."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from typing import Any, Self

import numpy as np

from .kernel_cache import compiling_alone
from .kernels import compiled as compile_kernels
from .kernels import stamp
from .mode import Machine
from .origin import Origin
from .run_loop import Progress, run_through
from .stretch import EVENT_TYPE, Events

__all__ = ['Loop', 'has_numba']


@cache
def has_numba() -> bool:
    """Return whether there is a compiler."""
    return find_spec('numba') is not None


@cache
def _compiled_loop() -> Any:
    """Return the compiled run loop."""
    return compile_kernels(cached=('run_through',))['run_through']


#: Kinds of rigs, with arrays or without, for which the loop is compiled in this process.
_READY: set[bool] = set()


class Loop:
    """
    The run loop.

    Parameters
    ----------
    machine : Machine
        The rig.
    damper_mass : float
        Mass m, kg.
    compiled : bool
        Whether to run compiled code.

    Raises
    ------
    ImportError
        If compiled code is asked for without numba.
    """

    def __init__(self, machine: Machine, damper_mass: float, *, compiled: bool) -> None:
        self.machine = machine
        self.compiled = compiled
        self._damper_mass = damper_mass
        self._loop = _compiled_loop() if compiled else run_through
        # One harmonic is compiled as such; any other number of them as arrays, once for all.
        self._arrays = compiled and len(machine.phases) != 1
        self._packed_machine = _with_arrays(machine) if self._arrays else machine

    def turned_to(self, machine: Machine) -> Self:
        """Return the loop of the same rig at other frequencies."""
        return type(self)(machine, self._damper_mass, compiled=self.compiled)

    def packed(self, origin: Origin) -> Any:
        """Return an origin as the loop takes it."""
        angles: Any = np.array(origin.angles)
        return origin._replace(angles=angles) if self._arrays else origin

    @staticmethod
    def unpacked(origin: Any) -> Origin:
        """Return an origin that the loop has returned as anything else takes it."""
        plain: Origin = origin._replace(angles=tuple(map(float, origin.angles)))
        return plain

    def run(
        self,
        progress: Progress,
        end: float,
        instants: Any,
        samples: Any,
        table: Events,
        most: int,
        in_mode: Any,
    ) -> Progress:
        """
        Go on until the end, or until something stops the loop; see `run_through`.

        Parameters
        ----------
        progress : Progress
            Origin and time to go on from, and how many samples are taken.
        end : float
            Time to reach, s.
        instants, samples, table : ndarray
            When to sample; rows for the samples, and for the events.
        most : int
            How many transitions may be made.
        in_mode : ndarray of float, shape (8,)
            Time spent in each mode is added to it, s.
        """
        shape = len(table), len(EVENT_TYPE.names or ())
        arguments = (
            self._packed_machine,
            self._damper_mass,
            progress.origin,
            progress.time,
            end,
            instants,
            progress.sampled,
            samples,
            table.view('f8').reshape(shape),
            table.view('i8').reshape(shape),
            most,
            in_mode,
        )
        if not self.compiled or self._arrays in _READY:
            reached = self._loop(*arguments)
        else:
            with compiling_alone(stamp()):
                reached = self._loop(*arguments)
            _READY.add(self._arrays)
        status, origin, *others = reached
        return Progress(status, Origin(*origin), *others)


def _with_arrays(values: Any) -> Any:
    """Return a named tuple with arrays in place of tuples, within it too."""
    arrays = {}
    for name, value in values._asdict().items():
        if hasattr(value, '_asdict'):
            arrays[name] = _with_arrays(value)
        elif isinstance(value, tuple):
            arrays[name] = np.array(value)
    return values._replace(**arrays)
