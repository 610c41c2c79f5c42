"""A law that ends the process which runs it, as lack of memory would."""

import math
import os
import signal
from multiprocessing import parent_process


def law(_seen, _memory):
    """Leave the stops alone; end a worker of a sweep."""
    if parent_process() is not None:
        os.kill(os.getpid(), signal.SIGKILL)
    return math.nan, math.nan
