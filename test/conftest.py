"""What every test runs under: its own ROS domain, on this machine alone."""

import os
import signal
import socket
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# 1..101: above that, the ports of a domain reach into Linux's range of ephemeral ports.
DOMAINS = 101

# Properties of random rigs: the same few ones each time, or, to look for rigs that break them,
# other ones each time: pytest --hypothesis-profile=search test/rig/test_rig.py
SEARCH = {'deadline': None, 'suppress_health_check': list(HealthCheck)}
settings.register_profile('few', max_examples=15, derandomize=True, **SEARCH)
settings.register_profile('search', max_examples=1000, print_blob=True, **SEARCH)
settings.load_profile('few')

# Kept open while the tests run; if they are killed, the kernel gives the name back.
_domain_lock: socket.socket | None = None
_log_directory: tempfile.TemporaryDirectory[str] | None = None

# Settings of the caller's shell that would change what a node is called, whom it meets, or how
# long it takes to start.
FOREIGN_SETTINGS = (
    'FASTRTPS_DEFAULT_PROFILES_FILE',
    'FASTDDS_DEFAULT_PROFILES_FILE',
    # Hundreds of processes would each compile all that they import.
    'PYTHONDONTWRITEBYTECODE',
    'RCUTILS_CONSOLE_OUTPUT_FORMAT',
    'RMW_IMPLEMENTATION',
    'ROS_DISCOVERY_SERVER',
    'ROS_LOCALHOST_ONLY',
    'ROS_NAMESPACE',
    'ROS_STATIC_PEERS',
)


def _take_domain() -> int:
    """
    Take a domain that no other run of these tests on this machine has.

    A name in the abstract socket space is the lock: like a DDS domain it is known within one
    network namespace, and it cannot outlive its process.
    """
    global _domain_lock
    for attempt in range(DOMAINS):
        domain = 1 + (os.getpid() + attempt) % DOMAINS
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            lock.bind(f'\0impact_damper_ros.test.domain.{domain}')
        except OSError:
            lock.close()
            continue
        _domain_lock = lock
        return domain
    raise pytest.UsageError(f'all {DOMAINS} ROS domains are taken by other runs of these tests')


def _isolate_ros() -> None:
    global _log_directory
    for name in FOREIGN_SETTINGS:
        os.environ.pop(name, None)
    sys.dont_write_bytecode = False
    # For small matrices a second thread of BLAS only spins, which costs processor time.
    os.environ['OPENBLAS_NUM_THREADS'] = '1'
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    os.environ['ROS_DOMAIN_ID'] = str(_take_domain())
    _log_directory = tempfile.TemporaryDirectory(prefix='ros_log_')
    os.environ['ROS_LOG_DIR'] = _log_directory.name
    if (Path(sys.prefix) / 'share' / 'ament_index').is_dir():
        os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)


def _take_interruptions() -> None:
    """
    Let the processes that tests start be interrupted, also where this one ignores Ctrl-C.

    A background job of a script inherits that SIGINT is ignored, and so would its children; of a
    handler they inherit nothing.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _check_wheels() -> None:
    """
    Refuse to start where the ROS 2 wheels would look for another venv's libraries.

    The wheels restart Python once, as it starts, with LD_LIBRARY_PATH set, and mark that in the
    environment. A process of the same venv inherits both rightly (a node started by a test is
    not restarted); one of another venv inherits a mark that does not hold for it.
    """
    if not os.environ.get('_ROS_WHEELS_BOOTSTRAP_COMPLETE'):
        return
    libraries = os.environ.get('LD_LIBRARY_PATH', '').split(os.pathsep)
    if str(Path(sys.prefix) / 'lib') not in libraries:
        raise pytest.UsageError(
            '_ROS_WHEELS_BOOTSTRAP_COMPLETE was inherited from a Python of another environment; '
            'run: env -u _ROS_WHEELS_BOOTSTRAP_COMPLETE -u LD_LIBRARY_PATH python -m pytest'
        )


_check_wheels()
_take_interruptions()
_isolate_ros()


def pytest_unconfigure() -> None:
    """Give back what this run had for itself."""
    if _domain_lock is not None:
        _domain_lock.close()
    if _log_directory is not None:
        _log_directory.cleanup()
