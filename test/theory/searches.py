"""What a process of the theory may compute."""

import os
import signal
import time

from impact_damper_ros.theory.prediction import Prediction


def endless(*_):
    """Compute for ever."""
    yield Prediction()
    while True:
        pass


def crashing(*_):
    """End as by an error of a library."""
    yield Prediction()
    os.kill(os.getpid(), signal.SIGSEGV)


def waiting(*_):
    """Wait for ever."""
    yield Prediction()
    time.sleep(1000.0)


def niceness(*_):
    """Yield the niceness of the process."""
    yield os.getpriority(os.PRIO_PROCESS, 0)


def dying(*_):
    """End before anything is sent."""
    os.kill(os.getpid(), signal.SIGKILL)
    yield
