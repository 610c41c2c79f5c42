# SPDX-License-Identifier: Apache-2.0
"""Options of commands that shake a rig by a file: random lines, levels and records."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from impact_damper_ros.measured.random_motion import LINES, RandomLines, random_lines
from impact_damper_ros.measured.record import MeasuredRecord, read_records
from impact_damper_ros.measured.sweep_levels import sweep_levels

from .command_line import add_path_option, number_in, say, up_to
from .rig_options import RECORDS, GivenRig

_TABLE = 'CSV with a header, as f [Hz], level'


def add_random_options(parser: argparse.ArgumentParser) -> None:
    """Let a command shake its rig by random lines."""
    add_path_option(
        parser,
        '--base-psd',
        'move the base at random, by lines whose acceleration has this power spectral density, '
        f'in place of base_amplitudes: {_TABLE} [g^2/Hz] or [(m/s^2)^2/Hz]; the level is a '
        'straight line between points on logarithmic axes',
    )
    add_path_option(
        parser,
        '--force-psd',
        f'let a random force act on M in place of force_amplitudes: {_TABLE} [N^2/Hz]',
    )
    parser.add_argument(
        '--psd-lines',
        type=up_to(1023),
        default=LINES,
        metavar='N',
        help='number of lines of either; the signal repeats after N divided by the width of the '
        f'band in Hz [{LINES}]',
    )
    parser.add_argument(
        '--seed',
        type=number_in(0, 2**31 - 1, whole=True),
        default=1,
        metavar='N',
        help='seed of the phases of the lines [1]',
    )


def add_levels_option(parser: argparse.ArgumentParser) -> None:
    """Let a command notch a sweep."""
    add_path_option(
        parser,
        '--sweep-levels',
        'levels of a notched sweep over frequency: CSV with a header, as '
        'f [Hz], level [g] (or m/s^2, m/s, mm: the base; N: the force on M); a straight line '
        'between points on logarithmic axes, constant beyond them',
    )


def with_sweep_levels(arguments: argparse.Namespace, given: GivenRig) -> GivenRig:
    """Return a rig whose single swept line has the levels of the table of the option."""
    if arguments.sweep_levels is None:
        return given
    values, columns = sweep_levels(arguments.sweep_levels)
    rig = given.parameters
    if rig.sweep_mode == 'off':
        raise ValueError('--sweep-levels needs a sweep: give --set sweep_mode=up, too')
    say('simulate_rig', f'levels of {arguments.sweep_levels}: {columns}')
    group = 'base' if 'base_amplitudes' in values else 'force'
    for part in ('frequencies', 'phases'):
        values[f'{group}_{part}'] = getattr(rig, f'{group}_{part}')[:1]
    if group == 'base':
        values['force_amplitudes'] = (0.0,) * len(rig.force_amplitudes)
    return given.with_changes(values)


def with_random_lines(
    arguments: argparse.Namespace, given: GivenRig
) -> tuple[GivenRig, list[RandomLines]]:
    """Return a rig with the lines of the tables of the options, and the lines."""
    found: list[RandomLines] = []
    values: dict[str, Any] = {}
    tables = (arguments.base_psd, 'acceleration'), (arguments.force_psd, 'force')
    for path, quantity in tables:
        if path is not None:
            # With the same phases base and force would not be independent.
            seed = int(arguments.seed) + len(found) * 2**31
            found.append(random_lines(path, int(arguments.psd_lines), seed, quantity))
            values |= found[-1].values()
    return given.with_changes(values) if found else given, found


def add_record_options(parser: argparse.ArgumentParser) -> None:
    """Let a command shake its rig by measured records."""
    add_path_option(
        parser,
        '--force-record',
        'add a measured force on M to that of the rig: a table with the columns t [s] '
        'and force [N]; each sample is held from the middle of the interval before it to the '
        'middle of the next one',
    )
    add_path_option(
        parser,
        '--base-record',
        'move the base by a measured acceleration, held in the same way: t [s] and acceleration '
        '[m/s^2], or [g]',
    )


def shaker_files(arguments: argparse.Namespace, given: GivenRig) -> list[Path | None]:
    """Return the tables that the options and the rig name."""
    tables = [arguments.base_psd, arguments.force_psd, arguments.sweep_levels]
    return [*tables, *(Path(given.texts[name]) for name in RECORDS if name in given.texts)]


def with_records(
    arguments: argparse.Namespace, given: GivenRig
) -> tuple[GivenRig, list[MeasuredRecord]]:
    """
    Return a rig with the records of the options, and all its records.

    The run lasts as long as the longest record, if its duration is not given.
    """
    options = {n: str(path) for n in RECORDS if (path := getattr(arguments, n)) is not None}
    given = given._replace(texts={**given.texts, **options})
    found = read_records(given.texts, math.tau / given.parameters.omega)
    if arguments.duration is None and found:
        arguments.duration = max(record.duration for record in found)
    return given, found
