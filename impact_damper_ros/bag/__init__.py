# SPDX-License-Identifier: Apache-2.0
"""
Runs recorded as rosbag2 does, read back, and saved after a crash; without ROS.

`RunWriter` records, `RunReader` reads, `recover_run` saves the intact part. `decode` decodes a
message; the topics of a rig are in `rig_topics`. The names below are imported when they are first
used: a node that records nothing needs neither MCAP nor SQLite.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from impact_damper_ros.lazy_names import lazy_names

if TYPE_CHECKING:
    from .errors import RecordingError as RecordingError
    from .messages import (
        DiagnosticArray as DiagnosticArray,
        DiagnosticStatus as DiagnosticStatus,
        JointState as JointState,
        Message as Message,
        Parameter as Parameter,
        ParameterEvent as ParameterEvent,
        String as String,
        decode as decode,
    )
    from .recover import Recovery as Recovery, recover_run as recover_run
    from .rig_recorder import RigRecorder as RigRecorder
    from .run_reader import (
        RecordedMessage as RecordedMessage,
        RecordedTopic as RecordedTopic,
        RunReader as RunReader,
    )
    from .run_writer import RunWriter as RunWriter
    from .topics import LATCHED as LATCHED, QosProfile as QosProfile, Topic as Topic

__all__, __getattr__, __dir__ = lazy_names(__name__, __file__)
