# SPDX-License-Identifier: Apache-2.0
"""
Runs recorded as rosbag2 does, read back, and saved after a crash; without ROS.

`RunWriter` records, `RunReader` reads, `recover_run` saves the intact part. The messages are in
`messages`, the topics of a rig in `rig_topics`. The names below are imported when they are first
used: a node that records nothing needs neither MCAP nor SQLite.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .bag_file import BagSummary
    from .errors import RecordingError
    from .messages import (
        DiagnosticArray,
        DiagnosticStatus,
        JointState,
        Message,
        Parameter,
        ParameterEvent,
        String,
    )
    from .recover import Recovery, recover_run
    from .rig_recorder import RigRecorder
    from .run_reader import Decoded, RecordedMessage, RecordedTopic, RunReader
    from .run_writer import RunWriter, create_run_directory
    from .topics import LATCHED, QosProfile, Topic

__all__ = [
    'LATCHED',
    'BagSummary',
    'Decoded',
    'DiagnosticArray',
    'DiagnosticStatus',
    'JointState',
    'Message',
    'Parameter',
    'ParameterEvent',
    'QosProfile',
    'RecordedMessage',
    'RecordedTopic',
    'RecordingError',
    'Recovery',
    'RigRecorder',
    'RunReader',
    'RunWriter',
    'String',
    'Topic',
    'create_run_directory',
    'recover_run',
]

__getattr__ = lazy_names(
    __name__,
    {
        'bag_file': ('BagSummary',),
        'errors': ('RecordingError',),
        'messages': (
            *('DiagnosticArray', 'DiagnosticStatus', 'JointState', 'Message'),
            *('Parameter', 'ParameterEvent', 'String'),
        ),
        'recover': ('Recovery', 'recover_run'),
        'rig_recorder': ('RigRecorder',),
        'run_reader': ('Decoded', 'RecordedMessage', 'RecordedTopic', 'RunReader'),
        'run_writer': ('RunWriter', 'create_run_directory'),
        'topics': ('LATCHED', 'QosProfile', 'Topic'),
    },
)
