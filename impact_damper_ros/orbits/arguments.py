# SPDX-License-Identifier: Apache-2.0
"""Arguments of the periodic solvers: admissible forces and stop sequences, and the error."""

from __future__ import annotations

from collections.abc import Sequence

from impact_damper_ros.motion.state import NUMBERS
from impact_damper_ros.parameters.parameter_spec import whole_number
from impact_damper_ros.parameters.quoting import plural, quote
from impact_damper_ros.parameters.rig_parameters import PARAMETER_SPECS, RigParameters, check_rig

from .flights import Machine, machine_of

#: Most impacts in a period for which all stop sequences are listed.
MOST_LISTED_IMPACTS = 6

_WHOLE = 1e-12
#: Least frequency of the force, over the natural one.
_SLOWEST = 1e-6
#: Longest period of a force that is named as the remedy, in cycles.
_MOST_NAMED = 65


#: Parameters of a rig that do not enter the equations: they must have their defaults.
UNKNOWN = tuple(
    name
    for name in PARAMETER_SPECS
    if name not in (*NUMBERS, 'one_sided', 'restitution_speed')
    and not name.startswith(('force_', 'base_', 'multisine_', 'sweep_'))
)
_DEFAULT = RigParameters()


class OrbitError(ValueError):
    """
    A request for a periodic motion that no rig can have; the message names the remedy.

    Examples
    --------
    >>> from impact_damper_ros import RigParameters, find_orbits
    >>> try:
    ...     find_orbits(RigParameters(force_amplitudes=[0.0]), (1, 2))
    ... except OrbitError as error:
    ...     print(str(error).partition(':')[0])
    no force acts, and the base is at rest
    """


def single_harmonic(parameters: RigParameters) -> bool:
    """Return whether the force has no other active harmonic than its first."""
    return not any(parameters.harmonics[0][1:])


def check_forcing(parameters: RigParameters, cycles: int | None = None) -> None:
    """
    Raise `OrbitError` if the force does not have the requested period.

    A parameter that does not enter the equations raises it, too.

    The force must repeat after `cycles` cycles of its first harmonic; without `cycles` it must be
    one harmonic, as the periodic theory assumes.
    """
    for name in UNKNOWN:
        value = getattr(parameters, name)
        if value != getattr(_DEFAULT, name):
            raise OrbitError(
                f'{name} is {value}: the periodic theory does not cover it, give '
                f'{getattr(_DEFAULT, name)}'
            )
    amplitude, first = parameters.first_harmonic[0], parameters.first_harmonic[1]
    if 0.0 < first < _SLOWEST * parameters.omega:
        raise OrbitError(
            f'the first harmonic of the force has a frequency of {first:g} rad/s, '
            f'{parameters.frequency_ratio:.3g} of the natural one: motion so slow is no '
            f'vibration, give at least {_SLOWEST * parameters.omega:.3g} rad/s'
        )
    if parameters.periodic_force:
        return
    lasting = 'periodic motion repeats with the first harmonic of the force'
    if parameters.multisine_level > 0.0:
        raise OrbitError(
            f'multisine_level is {parameters.multisine_level:g} N: {lasting}, give 0, which '
            'switches the multisine off'
        )
    if parameters.sweep_mode != 'off':
        raise OrbitError(
            f'sweep_mode is {parameters.sweep_mode!r}: {lasting}, give off, and the frequency '
            'asked for in force_frequencies'
        )
    if not any(parameters.harmonics[0]):
        raise OrbitError(
            'no force acts, and the base is at rest: periodic motion repeats with one of them, '
            'give force_amplitudes or base_amplitudes'
        )
    if amplitude == 0.0 or first == 0.0:
        raise OrbitError(
            f'the first harmonic of the force has amplitude {amplitude:g} N and frequency '
            f'{first:g} rad/s: periodic motion is counted in its cycles, give both different '
            'from 0'
        )
    if cycles is None:
        raise OrbitError(
            f'the force has {len(parameters.harmonics[0])} harmonics: the impact equations are '
            'for one, give one entry in the arrays of force or base, or use find_orbits'
        )
    for force, frequency in zip(*parameters.harmonics[:2], strict=True):
        turns = frequency / first
        if force != 0.0 and not _whole(cycles * turns):
            period = next((k for k in range(1, _MOST_NAMED) if _whole(k * turns)), 0)
            raise OrbitError(
                f'the harmonic of {frequency:g} rad/s turns {cycles * turns:.6g} times '
                f'in {plural(cycles, "cycle")} of the first one, {first:g} rad/s: a periodic '
                'motion needs a whole number, give '
                + (f'a multiple of {period} cycles' if period else 'frequencies in such ratios')
            )


def _whole(turns: float) -> bool:
    return abs(turns - round(turns)) <= _WHOLE * max(1.0, turns)


def repeats_after(parameters: RigParameters, cycles: int) -> bool:
    """Return whether the force repeats after a number of cycles of its first harmonic."""
    try:
        check_forcing(parameters, cycles)
    except OrbitError:
        return False
    return True


def period_of_force(parameters: RigParameters, longest: int) -> int:
    """Return the period of the force in cycles of its first harmonic; or raise `OrbitError`."""
    for cycles in range(1, longest):
        if repeats_after(parameters, cycles):
            return cycles
    check_forcing(parameters, longest)
    return longest


def check_stops(parameters: RigParameters, stops: Sequence[int]) -> tuple[int, ...]:
    """Return a stop sequence; raise `OrbitError` if a rig cannot have it."""
    try:
        sequence = tuple(stops)
        odd = not sequence or bool(set(sequence) - {1, 2})
    except TypeError:
        sequence, odd = (), True
    text = ','.join(map(str, sequence)) or quote(stops)
    if odd:
        raise OrbitError(
            f'stop sequence {text}: give the stops hit in one period, in order, each 1 '
            '(the lower) or 2, such as 1,2'
        )
    if parameters.one_sided and 2 in stops:
        raise OrbitError(
            f'stop sequence {text}: the rig is one-sided and has no stop 2, give stop 1 only, or '
            'one_sided: false'
        )
    return sequence


def pressed_to(machine: Machine, stop: int) -> bool:
    """Return whether weight, friction or air can press m to a stop, on average of a period."""
    constants = machine.constants
    weight = constants.slope if stop == 1 else -constants.slope
    return weight - constants.air + constants.grip > 0.0


def symmetric(machine: Machine) -> bool:
    """Return whether the mirror image of each motion, half a cycle later, is another one."""
    constants, lines = machine
    own = lines[: constants.harmonics]
    turns = [line.frequency / own[0].frequency for line in own if line.force != 0.0]
    return (
        not constants.one_sided
        and constants.slope == 0.0
        and constants.restitution_1 == constants.restitution_2
        and all(turn % 2.0 == 1.0 for turn in turns)
    )


def first_turn(stops: tuple[int, ...]) -> tuple[int, ...]:
    """Return the turn of a stop sequence that comes first in lexical order."""
    return min(stops[i:] + stops[:i] for i in range(len(stops)))


def mirrored_stops(stops: tuple[int, ...]) -> tuple[int, ...]:
    """Return the stops that the mirror image of a motion hits."""
    return tuple(3 - stop for stop in stops)


def plausible_stops(parameters: RigParameters, impacts: int) -> list[tuple[int, ...]]:
    """
    List the stop sequences of N impacts in a period.

    Parameters
    ----------
    parameters : RigParameters
        The rig: a one-sided one has stop 1 only.
    impacts : int
        Impacts N in one period.

    Returns
    -------
    list of tuple of int
        Each sequence once, whatever impact it is counted from, beginning with stop 1 if that is
        hit; the alternating one comes first. Sequences on one stop come last, if weight or
        friction can press m to the stop as much as impacts and air drive it away; (1,) if there is
        none.

    Raises
    ------
    TypeError
        If the rig is no `RigParameters`.
    OrbitError
        If N is too large to list all.

    Examples
    --------
    >>> plausible_stops(RigParameters(gravity=0.0), 3)
    [(1, 1, 2), (1, 2, 2)]
    """
    check_rig('parameters', parameters)
    impacts = whole_number('impacts', impacts, 1, 2**31)
    if parameters.one_sided:
        return [(1,) * impacts]
    if impacts > MOST_LISTED_IMPACTS:
        raise OrbitError(
            f'{impacts} impacts have too many stop sequences to try all: name one, such as '
            f'{",".join("12"[i % 2] for i in range(impacts))}'
        )
    words = {(stop,) * impacts for stop in (1, 2) if pressed_to(machine_of(parameters), stop)}
    for code in range(1, 2**impacts - 1):
        word = tuple(1 + (code >> i) % 2 for i in range(impacts))
        words.add(first_turn(word))
    changes = {w: sum(a != b for a, b in zip(w, w[1:] + w[:1], strict=True)) for w in words}
    return sorted(words, key=lambda word: (-changes[word], word)) or [(1,)]
