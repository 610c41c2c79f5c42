# SPDX-License-Identifier: Apache-2.0
"""
The conditions under which an option of a command has an effect; otherwise it is refused.

A row of a table `NEEDS` is an option, and terms of which one must hold: ``--bag`` is given, or
``FILE`` (a positional argument), or ``--optimum none`` with that value; ``no --score``: the option
is not given. The single term ``only PARAMS --set`` allows no other arguments.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

#: An option, and the terms of which one must hold.
Need = tuple[str, ...]


def names_of(parser: argparse.ArgumentParser) -> dict[str, argparse.Action]:
    """Return the arguments by their options, and by the metavar of those without."""
    return {
        name: action
        for action in parser._actions
        for name in action.option_strings or [str(action.metavar)]
    }


def _is_given(names: Mapping[str, argparse.Action], given: Mapping[str, Any], term: str) -> bool:
    name, _, value = term.partition(' ')
    found = given.get(names[name].dest)
    return found is not None and value in ('', str(found))


def _refusal(option: str, terms: Sequence[str]) -> str:
    """Return why an option has no effect, and the remedy."""
    wanted = [term for term in terms if not term.startswith('no ')]
    excluded = [term[3:] for term in terms if term.startswith('no ')]
    reasons = [
        f'{word} {" or ".join(names)}'
        for word, names in (('without', wanted), ('with', excluded))
        if names
    ]
    remedy = 'leave one of them out'
    if wanted:
        remedy = f'give {"it" if len(terms) == 1 else wanted[0]}, or leave {option} out'
    return f'{option} has no effect {" and ".join(reasons)}: {remedy}'


def _refusals(
    parser: argparse.ArgumentParser, given: Mapping[str, Any], needs: Sequence[Need]
) -> Iterator[str]:
    names = names_of(parser)
    for option, *terms in needs:
        if not _is_given(names, given, option):
            continue
        if terms[0].startswith('only'):
            allowed = {names[name].dest for name in (option, *terms[0].split()[1:])}
            for other, action in names.items():
                if action.dest not in allowed and _is_given(names, given, other):
                    yield _refusal(other, [f'no {option}'])
        elif not any(
            not _is_given(names, given, term[3:])
            if term.startswith('no ')
            else _is_given(names, given, term)
            for term in terms
        ):
            yield _refusal(option, terms)


def check_needs(
    parser: argparse.ArgumentParser, given: Mapping[str, Any], needs: Sequence[Need]
) -> None:
    """End a command with an error if an option that is `given` has no effect."""
    for refusal in _refusals(parser, given, needs):
        parser.error(refusal)
