"""How a command that reads a bag ends: its exit status, and what it says of errors."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable

from impact_damper_ros.commands.command_line import say
from impact_damper_ros.commands.outputs import in_words
from impact_damper_ros.recording import RecordingError

__all__ = ['outcome']


def outcome(command: str, work: Callable[[], int]) -> int:
    """
    Do the work of a command.

    Parameters
    ----------
    command : str
        Its name, for messages.
    work : callable
        Does the work and returns the exit status.

    Returns
    -------
    int
        That exit status; 1 if something cannot be written, 2 if the bag or an argument cannot be
        used, 130 on Ctrl-C.
    """
    try:
        return work()
    except (RecordingError, ValueError) as error:
        say(command, error)
        return 2
    except KeyboardInterrupt:
        print(f'{command}: interrupted', file=sys.stderr)
        return 130
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        say(command, in_words(error))
        return 1
