# SPDX-License-Identifier: Apache-2.0
"""
The commands as console scripts.

A command imports for up to a second before it can handle a signal. An exception would then come
up anywhere in the import system, so until the command runs Ctrl-C ends the process as it ends one
that handles no signals. This module must not import anything that takes time.
"""

from __future__ import annotations

import os
import signal
from functools import partial
from importlib import import_module
from typing import Any

__all__ = [
    'compare_run',
    'recover_run',
    'replay_run',
    'rig_page',
    'set_rig',
    'sim_node',
    'simulate_rig',
    'solve_periodic',
    'sweep_rig',
]


def _command(name: str, room: str = 'cli') -> Any:
    """Import a command and run it."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if room == 'node' and '_ARGCOMPLETE' in os.environ:
        import_module('impact_damper_ros.cli.completion').complete_node()
    return import_module(f'impact_damper_ros.{room}.{name}').main()


compare_run = partial(_command, 'compare_run')
recover_run = partial(_command, 'recover_run')
replay_run = partial(_command, 'replay_run')
rig_page = partial(_command, 'rig_page')
set_rig = partial(_command, 'set_rig')
sim_node = partial(_command, 'sim_node', 'node')
simulate_rig = partial(_command, 'simulate_rig')
solve_periodic = partial(_command, 'solve_periodic')
sweep_rig = partial(_command, 'sweep_rig')
