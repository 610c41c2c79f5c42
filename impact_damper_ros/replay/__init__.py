# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs: walked once in order, computed again bit for bit, and run with other parameters.

Imported on first use: the rows of a rig need no reader of bags.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .command import Command, Setting
    from .findings import Difference, Findings, ReplayVerdict
    from .replay import Part, Replay
    from .run import RecordedRun, Rows
    from .what_if import WhatIf

__all__ = [
    'Command',
    'Difference',
    'Findings',
    'Part',
    'RecordedRun',
    'Replay',
    'ReplayVerdict',
    'Rows',
    'Setting',
    'WhatIf',
]

__getattr__ = lazy_names(
    __name__,
    {
        'command': ('Command', 'Setting'),
        'findings': ('Difference', 'Findings', 'ReplayVerdict'),
        'replay': ('Part', 'Replay'),
        'run': ('RecordedRun', 'Rows'),
        'what_if': ('WhatIf',),
    },
)
