"""What is asked of the periodic solvers, and errors in asking."""

from __future__ import annotations

from impact_damper_ros.rig import RigParameters

__all__ = ['OrbitError', 'check_forcing', 'check_stops', 'plausible_stops']

#: Most impacts in a period for which all stop sequences are listed.
MOST_LISTED_IMPACTS = 6


class OrbitError(ValueError):
    """A periodic motion that cannot be asked for; the text holds the remedy."""


def check_forcing(parameters: RigParameters) -> None:
    """
    Check that the force is one harmonic, as the periodic theory assumes.

    Raises
    ------
    OrbitError
        If it is not.
    """
    active = [
        j
        for j, (force, frequency) in enumerate(
            zip(parameters.force_amplitudes, parameters.force_frequencies, strict=True)
        )
        if force != 0.0 and frequency != 0.0
    ]
    if parameters.force_amplitudes[0] == 0.0 or parameters.force_frequencies[0] == 0.0:
        raise OrbitError(
            f'the first harmonic of the force has amplitude {parameters.force_amplitudes[0]:g} N '
            f'and frequency {parameters.force_frequencies[0]:g} rad/s: periodic motion is counted '
            'in its cycles, give both different from 0'
        )
    if len(parameters.force_amplitudes) > 1:
        raise OrbitError(
            f'the force has {len(parameters.force_amplitudes)} harmonics ({len(active)} of them '
            'active): the periodic theory is for one, give force_amplitudes, force_frequencies '
            'and force_phases one entry each'
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
