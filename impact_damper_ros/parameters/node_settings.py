# SPDX-License-Identifier: Apache-2.0
"""How the node runs a rig, publishes and records it."""

from __future__ import annotations

from dataclasses import dataclass

from .parameter_spec import ParameterSpec, ParameterTable, flag, numeric, specs_of, text


@dataclass(frozen=True, kw_only=True, repr=False)
class NodeSettings(ParameterTable):
    """How the node runs a rig, publishes and records it."""

    _owner = 'the node'

    state_rate: float = numeric(
        200.0, 1.0, 2000.0, 'Hz', 'Joint states per second of rig time.', effect='start'
    )
    real_time_factor: float = numeric(
        1.0,
        0.0,
        1000.0,
        '',
        'Rig seconds per wall second; 0 runs as fast as possible.',
        least=1e-3,
        zero='as fast as possible',
    )
    publish_clock: bool = flag(
        False,
        'Publish /clock, and count stamps from 0 instead of from the system time. This '
        'also happens if real_time_factor is not 1 at the start.',
        effect='start',
    )
    real_time_priority: int = numeric(
        0,
        0,
        99,
        '',
        'Real-time priority of the thread that moves the rig, where the system permits it; '
        'the other threads have one less. 0 for ordinary scheduling.',
        effect='start',
    )
    measurement_rate: float = numeric(
        0.0,
        0.0,
        10000.0,
        'Hz',
        'Messages of the topic measurements per second of rig time; 0 for none.',
        least=1e-3,
        zero='none',
        effect='start',
    )
    measurement_latency: float = numeric(
        0.0, 0.0, 1e3, 's', 'Rig time from a measurement to its publication.'
    )
    measurement_jitter: float = numeric(
        0.0, 0.0, 1e3, 's', 'Largest additional latency, uniform at random.'
    )
    measurement_loss: float = numeric(
        0.0, 0.0, 1.0, '', 'Share of the measurements that get lost, at random.'
    )
    control_law: str = text(
        'none',
        (),
        'Control law of your own, MODULE:FUNCTION, imported from the directory in which the node '
        'starts; it replaces the law of gap_control, unless that is off. Or none.',
        effect='start',
    )
    force_record: str = text(
        'none',
        (),
        'Measured force that acts on M from the start on, and anew from each reset: the path of a '
        'table with t [s] and force [N]; or none.',
        effect='start',
    )
    base_record: str = text(
        'none',
        (),
        'Measured acceleration of the base, from the start on and anew from each reset: the path '
        'of a table with t [s] and acceleration [m/s^2], or [g]; or none.',
        effect='start',
    )
    lock_step: str = text(
        'off',
        ('off', 'stop_commands', 'force_command', 'both'),
        'Topics of the commands that an externally controlled rig waits for at each measurement; '
        'a command bears the stamp of the measurement. Stamps then count from 0, and /clock is '
        'published.',
        effect='start',
    )
    lock_step_timeout: float = numeric(
        10.0,
        1e-3,
        1e6,
        's',
        'Wall time after which the rig in lock-step continues without a command, until one comes.',
    )
    command_timeout: float = numeric(
        1.0,
        0.0,
        1e6,
        's',
        'Rig time without a command after which the stops of an external control are parked at '
        'the gap, and its force ends; 0 for never.',
    )
    force_limit: float = numeric(
        0.0,
        0.0,
        1e12,
        'N',
        'Largest force of an external control; a larger one is limited to it. 0 for no limit.',
    )
    predict_motion: bool = flag(
        True, 'Predict the periodic motion, for the diagnostics and the page.'
    )
    record: bool = flag(False, 'Record the run to MCAP.')
    bag_directory: str = text(
        'runs',
        (),
        'Directory in which each recording makes a directory; ~ is the home directory.',
        effect='next recording',
    )
    # Each file begins with a description of its topics.
    max_bag_size: int = numeric(
        0,
        0,
        10**15,
        'B',
        'Size of a file at which a recording goes on to the next one; 0 for no limit.',
        least=100_000,
        zero='no limit',
        effect='next recording',
    )
    max_bag_duration: float = numeric(
        0.0,
        0.0,
        1e9,
        's',
        'Time after which a recording goes on to the next file; 0 for no limit.',
        least=1.0,
        zero='no limit',
        effect='next recording',
    )


SETTING_SPECS: dict[str, ParameterSpec] = specs_of(NodeSettings)
