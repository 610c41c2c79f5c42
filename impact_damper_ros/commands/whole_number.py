"""Whole numbers on the command line, such as the number of processes."""

from __future__ import annotations

import argparse
from collections.abc import Callable

__all__ = ['add_jobs_option', 'up_to']


def up_to(largest: int) -> Callable[[str], int]:
    """Return what reads a number from 1 to the largest one, for `argparse`."""

    def read(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            value = 0
        if not 1 <= value <= largest:
            raise argparse.ArgumentTypeError(f'{text!r}: give a whole number from 1 to {largest}')
        return value

    return read


def add_jobs_option(parser: argparse.ArgumentParser) -> None:
    """Let a command take ``--jobs``."""
    parser.add_argument('--jobs', type=up_to(64), default=2, metavar='N', help='processes [2]')
