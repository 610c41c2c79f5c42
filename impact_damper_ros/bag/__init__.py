"""Recording runs as rosbag2 does, reading them back, and saving what a crash left; without ROS."""

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
from .run_reader import Decoded, Record, RecordedTopic, RunReader
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
    'Record',
    'RecordedTopic',
    'RecordingError',
    'Recovery',
    'RunReader',
    'RunWriter',
    'String',
    'Topic',
    'create_run_directory',
    'recover_run',
]
