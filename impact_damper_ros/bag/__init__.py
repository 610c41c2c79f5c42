# SPDX-License-Identifier: Apache-2.0
"""
Runs recorded as rosbag2 does, read back, and saved after a crash; without ROS.

`RunWriter` records, `RunReader` reads, `recover_run` saves the intact part. `decode` takes a
message apart; the topics of a rig are in `rig_topics`. The names below are imported when they are
first used: a node that records nothing needs neither MCAP nor SQLite.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .errors import RecordingError
    from .messages import (
        DiagnosticArray,
        DiagnosticStatus,
        JointState,
        Message,
        Parameter,
        ParameterEvent,
        String,
        decode,
    )
    from .recover import Recovery, recover_run
    from .rig_recorder import RigRecorder
    from .run_reader import RecordedMessage, RecordedTopic, RunReader
    from .run_writer import RunWriter
    from .topics import LATCHED, QosProfile, Topic

__all__ = [
    'LATCHED',
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
    'decode',
    'recover_run',
]

__getattr__ = lazy_names(
    __name__,
    {
        'errors': ('RecordingError',),
        'messages': (
            *('DiagnosticArray', 'DiagnosticStatus', 'JointState', 'Message'),
            *('Parameter', 'ParameterEvent', 'String', 'decode'),
        ),
        'recover': ('Recovery', 'recover_run'),
        'rig_recorder': ('RigRecorder',),
        'run_reader': ('RecordedMessage', 'RecordedTopic', 'RunReader'),
        'run_writer': ('RunWriter',),
        'topics': ('LATCHED', 'QosProfile', 'Topic'),
    },
)
