"""The processes that compute: Ctrl-C is not for them, and they do not outlive their parent."""

import logging
import os
import signal

from running import DEADLINE_S

from impact_damper_ros.sweep.execution import process_pool, without_interrupts


def test_ctrl_c_while_the_processes_begin():
    with process_pool(2) as pool:
        with without_interrupts():
            futures = [pool.submit(abs, -number) for number in range(4)]
        for pid in pool._processes:
            os.kill(pid, signal.SIGINT)
        assert [future.result(timeout=DEADLINE_S) for future in futures] == [0, 1, 2, 3]
        # Here it is heard as before
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_what_the_package_logs_is_left_to_the_parent_process(capfd):
    warn = logging.getLogger('impact_damper_ros.rig').warning
    with process_pool(2) as pool:
        pool.submit(warn, 'this takes long').result(DEADLINE_S)
    assert 'this takes long' not in capfd.readouterr().err
