"""
Real-time scheduling of the thread that moves the rig, where the system permits it.

Under the ordinary scheduler whoever else runs may hold the thread up for some milliseconds. With a
real-time priority it is given a processor as soon as a tick is due; the lowest ones are enough,
since ordinary threads have none. They take a permission: root's, the capability CAP_SYS_NICE, or a
limit RTPRIO (`ulimit -r`). Without, the rig runs on as it did before.

The other threads of the node, the executor, the writer of a recording and those that speak with
the process that predicts, have a priority too, one less: if one of them lost its processor to
another program while it holds the interpreter's lock, the rig would wait for that program. What
they do takes little time.

The interpreter's lock knows no priorities: a thread that wants it asks for it after the switch
interval, whoever it is. A short one would let the others interrupt the rig all the time, which
costs both sides more than they have to do; with a long one the rig would wait for it. So it is
short only while the rig sleeps, see `sleep_first_in_line`.

A thread that never sleeps would leave others nothing of its processor. So a rig that cannot hold
its pace has ordinary scheduling until it has held it for some time, and one that runs as fast as
possible has it for good.
"""

from __future__ import annotations

import os
import sys
import time

__all__ = [
    'ORDINARY',
    'SWITCH_INTERVAL_S',
    'WAKING_INTERVAL_S',
    'Scheduling',
    'priority_of_others',
    'sleep_first_in_line',
]

ORDINARY = 'ordinary'
#: The interpreter's switch interval, and the same while the rig sleeps.
SWITCH_INTERVAL_S = 2e-4
WAKING_INTERVAL_S = 2e-5


def sleep_first_in_line(seconds: float) -> None:
    """
    Sleep, and get the interpreter back at once when that is over.

    For one thread of the process. Another one that has the lock then is asked for it some
    microseconds later, while it has to wait for the switch interval itself if it wants it back.
    """
    sys.setswitchinterval(WAKING_INTERVAL_S)
    time.sleep(seconds)
    sys.setswitchinterval(SWITCH_INTERVAL_S)


def priority_of_others(priority: int) -> int:
    """Return the priority of the other threads, beside that of the thread that moves the rig."""
    return max(1, priority - 1) if priority else 0


class Scheduling:
    """
    The scheduling of one thread.

    Parameters
    ----------
    priority : int
        Real-time priority asked for, 1 to 99; 0 for ordinary scheduling.
    inherited : bool, optional
        Whether threads and processes that the thread starts have it, too.

    Attributes
    ----------
    text : str
        What it has: ``'SCHED_FIFO 1'``, or ``'ordinary'``, with the reason if more was asked for.
    given_up : bool
        Whether it has ordinary scheduling until it holds its pace again.
    """

    def __init__(self, priority: int, *, inherited: bool = True) -> None:
        """Change nothing yet."""
        self.text = ORDINARY
        self.given_up = False
        self._inherited = inherited
        self._priority = priority

    def take(self) -> None:
        """Give the calling thread the priority, if that is permitted."""
        self.given_up = False
        if not self._priority:
            return
        try:
            policy = os.SCHED_FIFO | (0 if self._inherited else os.SCHED_RESET_ON_FORK)
            os.sched_setscheduler(0, policy, os.sched_param(self._priority))
        except PermissionError:
            self.text = f'{ORDINARY}: no permission for SCHED_FIFO {self._priority}'
        except (AttributeError, OSError) as error:
            self.text = f'{ORDINARY}: {error}'
        else:
            self.text = f'SCHED_FIFO {self._priority}'

    def give_up(self) -> None:
        """Give the calling thread ordinary scheduling until `take`: it cannot hold its pace."""
        if self.text.startswith('SCHED_FIFO'):
            self.given_up = True
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            self.text = f'{ORDINARY}: the pace could not be held'
