"""The processes that compute: Ctrl-C is not for them, and they do not outlive their parent."""

import os
import signal

from impact_damper_ros.sweep.execution import ProcessPool


def test_ctrl_c_while_the_processes_begin():
    with ProcessPool(2) as pool:
        futures = [pool.submit(abs, -number) for number in range(4)]
        for pid in pool._processes:
            os.kill(pid, signal.SIGINT)
        assert [future.result(timeout=60) for future in futures] == [0, 1, 2, 3]
        # Here it is heard as before
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
