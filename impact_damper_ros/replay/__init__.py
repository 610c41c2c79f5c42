"""Recorded runs: walked once in order, replayed bit for bit, and run with other parameters."""

from .findings import Difference, Divergence, Findings, ReplayVerdict, SampleGap
from .recorded_run import RecordedChange, RecordedRun, RigTopics
from .recorded_snapshot import RecordedSnapshot
from .replay import Replay, Tick
from .replayed_rig import Setting, Step, setting_of
from .what_if import Ending, RecordedValues, Trace, WhatIf

__all__ = [
    'Difference',
    'Divergence',
    'Ending',
    'Findings',
    'RecordedChange',
    'RecordedRun',
    'RecordedSnapshot',
    'RecordedValues',
    'Replay',
    'ReplayVerdict',
    'RigTopics',
    'SampleGap',
    'Setting',
    'Step',
    'Tick',
    'Trace',
    'WhatIf',
    'setting_of',
]
