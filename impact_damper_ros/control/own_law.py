# SPDX-License-Identifier: Apache-2.0
"""
A law of the user's own: a Python function, or one compiled by numba, in place of a built-in law.

It is called as `law(seen, memory)` at each sample of the grid and at each passage of X through
zero, once the amplitude is known and above the threshold, and returns where the two stops are to
be. The same sensors, noise and actuators act as for the built-in laws.
"""

from __future__ import annotations

import inspect
import sys
from collections.abc import Callable
from functools import cache
from hashlib import sha256
from importlib import import_module
from math import inf, nan
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from impact_damper_ros.motion.kernels import kernel
from impact_damper_ros.parameters.quoting import as_name, quote

from .law import place_stops
from .state import MEMORY, Actuators, Control, ControlSettings, Estimates, Measurement, Refusal

_SUM_ERROR = 4e-16


class LawInput(NamedTuple):
    """
    Input of a law of the user's own, in SI units.

    Attributes
    ----------
    time : float
        The instant, s.
    x, x_rate, y, y_rate : float
        X, X', Y and Y' from the sensors.
    stop_1, stop_2 : float
        Positions Y of the stops.
    crossing : int
        0 at a sample of the grid; 1 where X passes through zero rising, -1 where it falls.
    amplitude : float
        Estimate of the amplitude of X, m.
    half_cycle : float
        Estimate of the time from one passage of X through zero to the next, s.
    hit_time_1, hit_time_2 : float
        Instant of the last impact seen on each stop since the last passage, s; NaN for none.
    hit_speed_1, hit_speed_2 : float
        Approach speed of that impact, m/s.
    mass_ratio, restitution : float
        m/M, and the mean R of both stops.
    gap_min, gap_max : float
        Range of the gap, m.

    Examples
    --------
    >>> from math import nan
    >>> from impact_damper_ros import Rig, RigParameters
    >>> def law(seen, memory):
    ...     return (seen.gap_min, -seen.gap_min) if seen.crossing else (nan, nan)
    >>> rig = Rig(RigParameters(gravity=0.0), law=law)
    >>> _ = rig.advance(20.0)
    >>> rig.stops
    (0.001, -0.001)
    """

    time: float
    x: float
    x_rate: float
    y: float
    y_rate: float
    stop_1: float
    stop_2: float
    crossing: int
    amplitude: float
    half_cycle: float
    hit_time_1: float
    hit_time_2: float
    hit_speed_1: float
    hit_speed_2: float
    mass_ratio: float
    restitution: float
    gap_min: float
    gap_max: float


#: A law: positions of both stops, Y in m, from its input and the numbers that it keeps.
Law: TypeAlias = Callable[[LawInput, Any], tuple[float, float]]


class LawError(ValueError):
    """
    A law of the user's own cannot be used, or has failed.

    Examples
    --------
    >>> from impact_damper_ros import Rig, RigParameters
    >>> try:
    ...     Rig(RigParameters(), law=lambda seen: (0.0, 0.0))
    ... except LawError as error:
    ...     print(str(error).partition(': ')[2])
    define it as law(seen, memory) (too many positional arguments)
    """


def _in_words(error: BaseException) -> str:
    """Return kind and text of an error of the user's code, shortened."""
    return f'{type(error).__name__}: {as_name(error, 400)}'


def _digest(law: Callable[..., Any]) -> str:
    """Return a digest of the source of a law's module, or of its code if there is no source."""
    try:
        source = inspect.getsource(sys.modules[law.__module__]).encode()
    except (AttributeError, KeyError, OSError, TypeError):
        source = getattr(getattr(law, '__code__', None), 'co_code', b'')
    return sha256(source).hexdigest()[:16]


class OwnLaw:
    """
    A law of the user's own, with its name.

    Parameters
    ----------
    law : callable
        The function.
    name : str, optional
        Its name in errors and snapshots; module and name of the function, if not given.

    Raises
    ------
    LawError
        If it does not take two arguments.

    Examples
    --------
    >>> def parted(seen, memory):
    ...     return seen.gap_max / 2.0, -seen.gap_max / 2.0
    >>> OwnLaw(parted).compiles
    False
    """

    def __init__(self, law: Law, name: str = '') -> None:
        self.function = law
        self._plain: Law = getattr(law, 'py_func', law)
        plain = self._plain
        #: The digest of the code that is loaded now
        self.digest = _digest(plain)
        own = getattr(plain, '__qualname__', type(plain).__name__)
        self.name = name or f'{getattr(plain, "__module__", "?")}:{own}'
        try:
            inspect.signature(plain).bind(None, None)
        except (TypeError, ValueError) as error:
            raise LawError(
                f'the law {self.name} cannot be called with two arguments: define it as '
                f'law(seen, memory) ({error})'
            ) from error

    @classmethod
    def from_text(cls, text: str) -> OwnLaw:
        """
        Return the law that a text MODULE:FUNCTION names; modules of this directory are found.

        Raises
        ------
        LawError
            If there is no such module or function.
        """
        module, colon, name = text.partition(':')
        if not (module and colon and name):
            raise LawError(f'the law {text!r}: give MODULE:FUNCTION, for example my_laws:follow')
        directory = str(Path.cwd())
        sys.path.insert(0, directory)
        try:
            imported = import_module(module)
        except (Exception, SystemExit) as error:
            raise LawError(f'the law {as_name(text)}: {_in_words(error)}') from error
        finally:
            sys.path.remove(directory)
        if not hasattr(imported, name):
            raise LawError(f'the law {as_name(text)}: the module has no {as_name(name)}')
        law = getattr(imported, name)
        if not callable(law):
            raise LawError(f'the law {text} is {quote(law)}: give the name of a function')
        return cls(law, text)

    @property
    def compiles(self) -> bool:
        """Whether numba compiles the function: the decorator ``numba.njit`` marks it."""
        return hasattr(self.function, 'py_func')

    def __call__(self, seen: LawInput, memory: list[float]) -> tuple[float, float]:
        """Return where the stops are to be."""
        try:
            result = self._plain(seen, memory)
        except (Exception, SystemExit) as error:
            raise LawError(
                f'the law {self.name} failed at {seen.time:.9g} s: {_in_words(error)}'
            ) from error
        try:
            stop_1, stop_2 = map(float, result)
        except Exception as error:
            raise self.astray(seen.time, result, seen) from error
        if len(memory) != MEMORY or not all(isinstance(v, int | float) for v in memory):
            raise LawError(
                f'the law {self.name} left {quote(memory)} in its memory at {seen.time:.9g} s: '
                f'keep a list of {MEMORY} numbers there'
            )
        return stop_1, stop_2

    def astray(
        self, time: float, result: object, p: LawInput | ControlSettings, sent: str = ''
    ) -> LawError:
        """Return the error of invalid positions of stops."""
        return LawError(
            f'the law {self.name} returned {quote(result)} at {time:.9g} s{sent}: return two '
            f'places Y within half of gap_max, {0.5 * p.gap_max:g} m, the first at least gap_min, '
            f'{p.gap_min:g} m, above the second, or NaN to leave a stop alone'
        )

    def refusal(self, control: Control) -> LawError:
        """Return the error of a result that the loop refused."""
        refusal, actuators = control.refusal, control.actuators
        if refusal.stop_1 == inf and refusal.stop_2 != refusal.stop_2:
            return LawError(
                f'the law {self.name} failed at {refusal.time:.9g} s: it raised an error, which '
                'is shown in plain Python (compiled=False, or simulate_rig)'
            )
        result = refusal.stop_1, refusal.stop_2
        sent = f', the stops sent to {actuators.commanded_1:.9g} and {actuators.commanded_2:.9g} m'
        return self.astray(refusal.time, result, control.settings, sent)


@kernel
def too_close(control: Control, stop_1: float, stop_2: float) -> bool:
    """Return whether a command leaves less than the smallest gap; NaN leaves a stop alone."""
    actuators: Actuators = control.actuators
    if control.settings.one_sided or (stop_1 != stop_1 and stop_2 != stop_2):
        return False
    sent_1 = stop_1 if stop_1 == stop_1 else actuators.commanded_1
    sent_2 = stop_2 if stop_2 == stop_2 else actuators.commanded_2
    # A law that keeps the smallest gap about some place may miss it by round-off.
    gap = sent_1 - sent_2 + _SUM_ERROR * (abs(sent_1) + abs(sent_2))
    return gap < control.settings.gap_min


@kernel
def places_of(law: Any, seen: LawInput, memory: Any) -> tuple[float, float]:
    """Return where a law wants the stops; a rig without a law is compiled by itself."""
    if law is None:
        return nan, nan
    places: tuple[float, float] = law(seen, memory)
    return places


@kernel
def own_law_acts(control: Control, seen: Measurement, crossing: int) -> None:
    """Let the law act on a sample of the grid, or on one at a passage of X through zero."""
    p = control.settings
    estimates: Estimates = control.estimates
    refusal: Refusal = control.refusal
    given = LawInput(
        seen.time,
        seen.x,
        seen.x_rate,
        seen.y,
        seen.y_rate,
        seen.stop_1,
        seen.stop_2,
        crossing,
        estimates.amplitude,
        estimates.half_cycle,
        estimates.hit_time_1,
        estimates.hit_time_2,
        estimates.hit_speed_1,
        estimates.hit_speed_2,
        p.mass_ratio,
        p.restitution,
        p.gap_min,
        p.gap_max,
    )
    stop_1, stop_2 = places_of(control.law, given, control.memory)
    largest = 0.5 * p.gap_max
    if abs(stop_1) > largest or abs(stop_2) > largest or too_close(control, stop_1, stop_2):
        refusal.time = seen.time
        refusal.stop_1 = stop_1
        refusal.stop_2 = stop_2
        return
    place_stops(control, seen.time, stop_1, stop_2, 0.0)


@kernel(inline=True)
def law_failed(control: Control) -> bool:
    """Return whether a law has returned invalid positions of stops."""
    return control.refusal.time == control.refusal.time


@cache
def _signature() -> Any:
    """Return the numba type of a law: places from a `LawInput` and the memory."""
    from numba import types as nb

    kinds = [nb.int64 if name == 'crossing' else nb.float64 for name in LawInput._fields]
    seen = nb.NamedTuple(tuple(kinds), LawInput)
    return nb.UniTuple(nb.float64, 2)(seen, nb.float64[::1])


def _by_address(function: Any) -> Any:
    """Return a compiled function as numba calls any of its type, by address."""
    from numba.core.types import CompileResultWAP

    return CompileResultWAP(function.get_compile_result(_signature()))


@cache
def compiled_law(law: OwnLaw | None) -> Any:
    """
    Return a law that numba has compiled as an argument of the compiled loop; None without one.

    The law is compiled by itself, and the loop is the same for all laws.

    Raises
    ------
    LawError
        If numba cannot compile the law for its arguments.
    """
    if law is None:
        return None
    import numba
    from numba.core.errors import NumbaError

    function = law.function
    if not law.compiles:
        raise LawError(
            f'the law {law.name} is plain Python, which compiled code cannot call: decorate it '
            'with numba.njit, or run it without compiled code'
        )

    def guard(seen: Any, memory: Any) -> tuple[float, float]:
        try:
            stop_1, stop_2 = function(seen, memory)
        except Exception:
            # A function that is called by address cannot raise. The loop refuses this result.
            stop_1, stop_2 = inf, nan
        return float(stop_1), float(stop_2)

    try:
        return _by_address(numba.njit(_signature())(guard))
    except NumbaError as error:
        # The lines about numba itself are the first and the last ones.
        lines = [line for line in str(error).splitlines() if line and 'pipeline' not in line]
        raise LawError(
            f'numba cannot compile the law {law.name}: {lines[0] if lines else error}. It has to '
            'return two numbers; in plain Python it runs uncompiled'
        ) from error
