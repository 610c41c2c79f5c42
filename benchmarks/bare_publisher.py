"""
A bare rclpy publisher of the rig's joint states: what the node is compared with.

It publishes the same message with the same quality of service at the same rate, and computes
nothing. `thread` paces by a thread with absolute deadlines on the monotonic clock, `timer` by an
rclpy timer, as most people would write it. `bytes` is `thread` without the serialisation: it
fills stamp and one number into bytes that it has, which is the least that a publisher can do.
`first` is `bytes` with the real-time priority that the node takes, where it is permitted: what it
is late by is the machine's doing.

    python benchmarks/bare_publisher.py thread 1000
"""

from __future__ import annotations

import contextlib
import os
import struct
import sys
import threading
import time
from collections.abc import Callable

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

JOINTS = ('primary', 'damper', 'stop_1', 'stop_2', 'incline', 'base', 'relative')
STAMP, NUMBER = struct.Struct('<iI'), struct.Struct('<d')
# Found again in the serialised message
MARK = 1.2345
#: That of the node, if nothing else is asked for
PRIORITY = 2


class BarePublisher(Node):
    """
    Publish joint states.

    Parameters
    ----------
    pace : {'thread', 'timer', 'bytes', 'first'}
        What paces it, whether it serialises, and how it is scheduled.
    rate : float
        Messages per second.
    """

    def __init__(self, pace: str, rate: float) -> None:
        """Advertise, and begin to publish."""
        super().__init__('bare_publisher')
        self.out = self.create_publisher(JointState, 'joint_states', QoSProfile(depth=100))
        self.message = JointState(name=list(JOINTS))
        self.message.position = [MARK, 0.2, 0.3, 0.4, 0.5, 0.0, MARK]
        self.message.velocity = [0.1, 0.3, 0.1, 0.1, 0.0, 0.0, 0.1]
        self.buffer = bytearray(serialize_message(self.message))
        self.first = self.buffer.index(NUMBER.pack(MARK))
        self.period_ns = round(1e9 / rate)
        self.going = True
        if pace == 'timer':
            self.create_timer(self.period_ns * 1e-9, self.publish)
        else:
            publish = self.publish if pace == 'thread' else self.publish_bytes
            priority = PRIORITY if pace == 'first' else 0
            threading.Thread(target=self.pace, args=(publish, priority), daemon=True).start()

    def publish_bytes(self) -> None:
        """Publish one message that is serialised but for its stamp and first position."""
        stamp_ns = time.time_ns()
        STAMP.pack_into(self.buffer, 4, *divmod(stamp_ns, 10**9))
        NUMBER.pack_into(self.buffer, self.first, stamp_ns % 10**9 * 1e-9)
        self.out.publish(bytes(self.buffer))

    def publish(self) -> None:
        """Publish one message with fresh values."""
        stamp_ns = time.time_ns()
        stamp = self.message.header.stamp
        stamp.sec, stamp.nanosec = divmod(stamp_ns, 10**9)
        x = stamp.nanosec * 1e-9
        self.message.position = [x, 0.2, x + 0.1, x - 0.1, 0.5]
        self.message.velocity = [x, 0.3, x, x, 0.0]
        self.out.publish(self.message)

    def pace(self, publish: Callable[[], None], priority: int) -> None:
        """Publish at absolute deadlines."""
        if priority:
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        deadline_ns = time.monotonic_ns()
        while self.going:
            deadline_ns += self.period_ns
            if (left_ns := deadline_ns - time.monotonic_ns()) > 0:
                time.sleep(left_ns * 1e-9)
            try:
                publish()
            except Exception:
                if self.context.ok():
                    raise
                return


def main() -> int:
    """Publish until told to end."""
    pace, rate = sys.argv[1], float(sys.argv[2])
    if pace not in ('thread', 'timer', 'bytes', 'first'):
        raise SystemExit(f'unknown pace {pace!r}: thread, timer, bytes or first')
    rclpy.init()
    node = BarePublisher(pace, rate)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.going = False
        rclpy.try_shutdown()
    return 0


if __name__ == '__main__':
    sys.exit(main())
