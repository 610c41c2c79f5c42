# SPDX-License-Identifier: Apache-2.0
"""
Parameter studies: a rig run for many values of its parameters, each until its motion has settled.

A `Grid` describes the rigs, `sweep` runs them on any executor and returns a pandas table,
`find_optimum` finds its best row, `branches_of` follows its periodic motions by theory, and
`draw_sweep` draws the figures.
"""

from .best import Optimum, find_optimum
from .branches import branches_of
from .execution import WorkersError, sweep
from .figures import draw_sweep
from .grid import Grid, GridError, range_from_text
from .steady_state import Settling
from .summary import summary_of, summary_text
from .table import MEASURES, MetadataError, read_table

__all__ = [
    'MEASURES',
    'Grid',
    'GridError',
    'MetadataError',
    'Optimum',
    'Settling',
    'WorkersError',
    'branches_of',
    'draw_sweep',
    'find_optimum',
    'range_from_text',
    'read_table',
    'summary_of',
    'summary_text',
    'sweep',
]
