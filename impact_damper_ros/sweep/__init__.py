"""
Parameter studies: a rig run for many values of its parameters, each until its motion has settled.

A `SweepPlan` is the grid of rigs, `run_sweep` runs them on any executor and keeps the rows in a
`Journal`, `write_table` makes the table of it, and `SweepTable` reads that again.
"""

from .execution import (
    DaskWorkers,
    Here,
    LocalWorkers,
    SweepExecutor,
    Workers,
    WorkersError,
    run_sweep,
)
from .figures import draw_sweep
from .journal import Journal, JournalError, journal_path
from .optimum import Best, Optimum, find_optimum
from .plan import Axis, AxisError, Follow, SweepPlan, axis_from_text
from .summary import summary_of, summary_text
from .table import MEASURES, MetadataError, SweepTable, write_table

__all__ = [
    'MEASURES',
    'Axis',
    'AxisError',
    'Best',
    'DaskWorkers',
    'Follow',
    'Here',
    'Journal',
    'JournalError',
    'LocalWorkers',
    'MetadataError',
    'Optimum',
    'SweepExecutor',
    'SweepPlan',
    'SweepTable',
    'Workers',
    'WorkersError',
    'axis_from_text',
    'draw_sweep',
    'find_optimum',
    'journal_path',
    'run_sweep',
    'summary_of',
    'summary_text',
    'write_table',
]
