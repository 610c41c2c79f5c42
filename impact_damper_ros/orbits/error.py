"""What is asked of the periodic solvers, and errors in asking."""

from __future__ import annotations

from impact_damper_ros.rig import RigParameters

__all__ = ['OrbitError', 'check_forcing', 'check_stops', 'plausible_stops', 'single_harmonic']

#: Most impacts in a period for which all stop sequences are listed.
MOST_LISTED_IMPACTS = 6

_WHOLE = 1e-12


class OrbitError(ValueError):
    """A periodic motion that cannot be asked for; the text holds the remedy."""


def single_harmonic(parameters: RigParameters) -> bool:
    """Return whether the force has no other active harmonic than its first."""
    return parameters.multisine_level == 0.0 and not any(parameters.force_amplitudes[1:])


def check_forcing(parameters: RigParameters, cycles: int | None = None) -> None:
    """
    Check that the force is one harmonic, or has a period.

    Parameters
    ----------
    parameters : RigParameters
        The rig.
    cycles : int, optional
        Cycles of the first harmonic after which the whole force must repeat. If not given, the
        force must be one harmonic, as the periodic theory assumes.

    Raises
    ------
    OrbitError
        If it is not.
    """
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
    amplitude, first = parameters.force_amplitudes[0], parameters.force_frequencies[0]
    if amplitude == 0.0 or first == 0.0:
        raise OrbitError(
            f'the first harmonic of the force has amplitude {amplitude:g} N and frequency '
            f'{first:g} rad/s: periodic motion is counted in its cycles, give both different '
            'from 0'
        )
    if cycles is None:
        raise OrbitError(
            f'the force has {len(parameters.force_amplitudes)} harmonics: the impact equations '
            'are for one, give force_amplitudes, force_frequencies and force_phases one entry '
            'each, or use the shooting solver'
        )
    for force, frequency in zip(
        parameters.force_amplitudes, parameters.force_frequencies, strict=True
    ):
        turns = cycles * frequency / first
        if force != 0.0 and abs(turns - round(turns)) > _WHOLE * max(1.0, turns):
            raise OrbitError(
                f'the harmonic of {frequency:g} rad/s turns {turns:.6g} times in {cycles} cycles '
                f'of the first one, {first:g} rad/s: a periodic motion needs a whole number, '
                'give frequencies in ratios of whole numbers and as many cycles as these ask for'
            )


def check_stops(parameters: RigParameters, stops: tuple[int, ...], cycles: int) -> None:
    """
    Check a stop sequence and a number of force cycles.

    Raises
    ------
    OrbitError
        If the rig has no such stops or the numbers are not positive.
    """
    if not stops or any(stop not in (1, 2) for stop in stops):
        shown = ','.join(str(s) for s in stops)
        raise OrbitError(
            f'stop sequence {shown!r}: give the stops hit in one period, in order, each 1 (the '
            'lower) or 2, such as 1,2'
        )
    if parameters.one_sided and 2 in stops:
        raise OrbitError(
            f'stop sequence {",".join(str(s) for s in stops)}: the rig is one-sided and has no '
            'stop 2, give stop 1 only, or one_sided: false'
        )
    if cycles < 1:
        raise OrbitError(f'{cycles} force cycles: give a period of at least 1 cycle')


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
        Each sequence once, whatever impact it is counted from, beginning with stop 1; the one that
        alternates comes first. Stop 1 alone for N = 1; both stops for more, unless one-sided.

    Raises
    ------
    OrbitError
        If N is not positive, or too large to list all.
    """
    if impacts < 1:
        raise OrbitError(f'{impacts} impacts: give at least 1 in a period')
    if impacts == 1 or parameters.one_sided:
        return [(1,) * impacts]
    if impacts > MOST_LISTED_IMPACTS:
        raise OrbitError(
            f'{impacts} impacts have too many stop sequences to try all: name one, such as '
            f'{",".join("12"[i % 2] for i in range(impacts))}'
        )
    found: set[tuple[int, ...]] = set()
    for code in range(1, 2**impacts - 1):
        word = tuple(1 + (code >> i) % 2 for i in range(impacts))
        found.add(min(word[i:] + word[:i] for i in range(impacts)))
    changes = {w: sum(a != b for a, b in zip(w, w[1:] + w[:1], strict=True)) for w in found}
    return sorted(found, key=lambda word: (-changes[word], word))
