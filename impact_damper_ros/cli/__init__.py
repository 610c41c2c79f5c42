# SPDX-License-Identifier: Apache-2.0
"""
Console commands of the package; every one also runs as ``ros2 run impact_damper_ros NAME``.

A command imports for up to a second before it can handle a signal. An exception in that time could
be raised anywhere in the import system: until the command runs, Ctrl-C ends the process at once. A
program that only imports a command keeps its own handler and streams.
"""

import os
import signal
import sys


def _is_command() -> bool:
    """Return whether this process is one of the commands; the module of -m is found later."""
    name = os.path.basename(sys.argv[0]) if sys.argv else ''  # noqa: PTH119 - quick
    return name == '-m' or os.path.isfile(f'{__path__[0]}/{name}.py')  # noqa: PTH113


def _accept_surroundings() -> None:
    """Print any character in any terminal, draw into files, and use one thread for matrices."""
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.reconfigure(errors='backslashreplace')  # type: ignore[union-attr]
    # The backend of a notebook cannot be used by a command that the notebook starts.
    os.environ['MPLBACKEND'] = 'agg'
    # For small matrices further threads only wait, which costs processor time.
    for library in ('OMP', 'OPENBLAS', 'MKL'):
        os.environ.setdefault(f'{library}_NUM_THREADS', '1')


if _is_command():
    _accept_surroundings()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
