"""The processes that compute: Ctrl-C is not for them, and they do not outlive their parent."""

import logging
import os
import signal
import time

import pytest

from impact_damper_ros.sweep.execution import ProcessPool


def test_ctrl_c_while_the_processes_begin():
    with ProcessPool(2) as pool:
        futures = [pool.submit(abs, -number) for number in range(4)]
        for pid in pool._processes:
            os.kill(pid, signal.SIGINT)
        assert [future.result(timeout=60) for future in futures] == [0, 1, 2, 3]
        # Here it is heard as before
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize('jobs', [0, 2.5, 1025])
def test_numbers_of_processes(jobs):
    with pytest.raises(ValueError, match=r'jobs is .*: give a whole number from 1 to 1024'):
        ProcessPool(jobs)


def test_what_the_processes_log_is_logged_here_once(caplog):
    warn = logging.getLogger('impact_damper_ros.rig').warning
    with ProcessPool(2) as pool:
        for text in (*8 * ['this takes long'], 'the last one'):
            pool.submit(warn, text).result(60)
        while 'the last one' not in caplog.text:
            time.sleep(0.01)
    said = [record.getMessage() for record in caplog.records]
    assert said == ['this takes long', 'the last one']
