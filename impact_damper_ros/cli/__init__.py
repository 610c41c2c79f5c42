# SPDX-License-Identifier: Apache-2.0
"""
Console commands of the package; every one also runs as ``ros2 run impact_damper_ros NAME``.

A command imports for up to a second before it can handle a signal. An exception would then come
up anywhere in the import system, so until the command runs Ctrl-C ends the process as it ends one
that handles no signals. A standard stream that is closed (``>&-``) would be None, and its number
that of the next file: the command gets one to which nothing can be written, and of which nothing
is read. A program that only imports a command keeps its own handler and streams.
"""

import os
import signal
import sys


def _is_command() -> bool:
    """Return whether this process is one of the commands; the module of -m is found later."""
    name = os.path.basename(sys.argv[0]) if sys.argv else ''  # noqa: PTH119 - quick
    return name == '-m' or os.path.isfile(f'{__path__[0]}/{name}.py')  # noqa: PTH113


def _open_standard_streams() -> None:
    """Open those that are closed; errors are discarded without a place to print them."""
    for number, access in enumerate((os.O_RDONLY, os.O_RDONLY, os.O_WRONLY)):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, access)
    sys.stdout = sys.stdout or open(1, 'w', closefd=False)  # noqa: SIM115
    sys.stderr = sys.stderr or open(2, 'w', closefd=False)  # noqa: SIM115


if _is_command():
    _open_standard_streams()
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
