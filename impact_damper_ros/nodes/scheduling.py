"""
Real-time scheduling of the thread that moves the rig, where the system permits it.

Under the ordinary scheduler whoever else runs may hold the thread up for some milliseconds. With a
real-time priority it is given a processor as soon as a tick is due; the lowest such priority is
enough, since ordinary threads have none. It takes a permission: root's, the capability
CAP_SYS_NICE, or a limit RTPRIO (`ulimit -r`). Without, the rig runs on as it did before.

Such a thread that never sleeps would leave others nothing of its processor. So a rig that cannot
hold its pace, or runs as fast as possible, has ordinary scheduling.
"""

from __future__ import annotations

import os

__all__ = ['ORDINARY', 'Scheduling']

ORDINARY = 'ordinary'


class Scheduling:
    """
    The scheduling of one thread.

    Parameters
    ----------
    priority : int
        Real-time priority asked for, 1 to 99; 0 for ordinary scheduling.

    Attributes
    ----------
    text : str
        What it has: ``'SCHED_FIFO 1'``, or ``'ordinary'``, with the reason if more was asked for.
    """

    def __init__(self, priority: int) -> None:
        """Change nothing yet."""
        self.text = ORDINARY
        self._priority = priority

    def take(self) -> None:
        """Give the calling thread the priority, if that is permitted."""
        if not self._priority:
            return
        try:
            # Not for what the thread may start one day
            policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
            os.sched_setscheduler(0, policy, os.sched_param(self._priority))
        except PermissionError:
            self.text = f'{ORDINARY}: no permission for SCHED_FIFO {self._priority}'
        except (AttributeError, OSError) as error:
            self.text = f'{ORDINARY}: {error}'
        else:
            self.text = f'SCHED_FIFO {self._priority}'

    def give_up(self) -> None:
        """Give the calling thread, which cannot hold its pace, ordinary scheduling for good."""
        if self.text.startswith('SCHED_FIFO'):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
            self.text = f'{ORDINARY}: the pace could not be held'
