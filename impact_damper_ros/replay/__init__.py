"""Recorded runs: walked once in order, replayed bit for bit, and run with other parameters."""

from .findings import Difference, Findings, ReplayVerdict
from .recorded_run import RecordedRun
from .replay import Replay, Tick
from .what_if import WhatIf

__all__ = ['Difference', 'Findings', 'RecordedRun', 'Replay', 'ReplayVerdict', 'Tick', 'WhatIf']
