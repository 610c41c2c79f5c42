# SPDX-License-Identifier: Apache-2.0
"""
Recorded runs: walked once in order, computed again bit for bit, and run with other parameters.

Names are imported on first use: the rows of a rig need no reader of bags.
"""

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .command import Command as Command, Setting as Setting
    from .findings import (
        Difference as Difference,
        Findings as Findings,
        ReplayVerdict as ReplayVerdict,
    )
    from .replay import Replay as Replay, RunPart as RunPart
    from .run import RecordedRun as RecordedRun, Rows as Rows
    from .what_if import WhatIf as WhatIf

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
