"""An engine on its own, whose messages are kept."""

import json
import threading
import time
from collections import defaultdict
from dataclasses import replace
from typing import NamedTuple

from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from running import DEADLINE_S, until
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros import InitialConditions, RigParameters
from impact_damper_ros.bag import RunWriter
from impact_damper_ros.bag.rig_topics import (
    PAUSED_FRAME,
    RIG_TOPICS,
    recorded_topics,
    recording_notes,
)
from impact_damper_ros.node.engine import Engine
from impact_damper_ros.node.parameters import NodeParameters
from impact_damper_ros.node.publishing import TopicPublisher
from node.rig_client import stamp_ns

LIVELY = RigParameters(gap=1.0, gravity=0.0)
TYPES = {'snapshot': String, 'clock': Clock}
#: The names of the topics of a rig, which are those of its messages here.
NAMES = {key: key for key in RIG_TOPICS if key not in ('measurements', 'robot_description')}


def event_bytes(node='/rig', changed=()):
    return serialize_message(ParameterEvent(node=node, changed_parameters=list(changed)))


def change_event(before, after):
    """Return the parameter event of a change."""
    was, now = before.as_dict(), after.as_dict()
    return event_bytes(
        changed=[
            Parameter(n, value=list(v) if isinstance(v, tuple) else v).to_parameter_msg()
            for n, v in now.items()
            if v != was[n]
        ]
    )


class MadeTime:
    """
    Wall time that only sleeping and `spend` move on, and both at once.

    Each sleep takes `nap` seconds, so that other threads run.
    """

    def __init__(self, nap=0.0002):
        self.nap, self._ns, self._lock = nap, 5 * 10**9, threading.Lock()

    def monotonic_ns(self):
        return self._ns

    def monotonic(self):
        return self._ns * 1e-9

    def time_ns(self):
        return 1_800_000_000 * 10**9 + self._ns

    def sleep(self, seconds):
        self.spend(seconds)
        time.sleep(self.nap)

    def spend(self, seconds):
        with self._lock:
            self._ns += round(seconds * 1e9)


class Answer(NamedTuple):
    time_ns: int
    result: object
    error: object


def done(request):
    """Wait until a request is carried out or rejected; return its time, result and error."""
    if (error := request.exception(DEADLINE_S)) is not None:
        return Answer(0, None, error)
    return Answer(*request.result(), None)


class Bench:
    """
    An engine that is always stopped, on a made time.

    It is as fast as possible unless a factor is given.
    """

    def __init__(
        self,
        rig=LIVELY,
        initial=None,
        *,
        factor=0.0,
        rate=100.0,
        clock=True,
        inbox=None,
        wall=None,
        **more,
    ):
        self.wall = wall or MadeTime()
        self.sent, self.troubles, self.alive, self.log = [], [], True, None
        self._messages, self._read = defaultdict(list), 0
        publishers = {
            key: TopicPublisher(key, lambda data, key=key: self.sent.append((key, data)))
            for key in (*NAMES, 'measurements', 'clock')
        }
        settings = NodeParameters(
            rig=rig,
            initial=initial or InitialConditions(),
            state_rate=rate,
            real_time_factor=factor,
            publish_clock=clock,
            **more,
        )
        self.engine = Engine(
            settings,
            publishers,
            inbox=inbox,
            alive=lambda: self.alive,
            on_trouble=lambda _, text: self.troubles.append(text),
            wall=self.wall,
        )

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.engine.stop()

    def started(self):
        self.engine.start()
        return self

    # Requests

    def ask(self, name, *arguments, **named):
        return self.engine.ask(getattr(self.engine, name), *arguments, **named)

    def change(self, event=None, **values):
        """Ask for a change: `rig`, `initial`, or settings of the node."""
        before = self.engine.parameters
        after = replace(before, **values)
        return self.ask('change', after, event or change_event(before, after))

    def reset(self, initial=None):
        """Change the conditions of a reset, and reset."""
        done(self.change(initial=initial or InitialConditions()))
        return done(self.ask('reset'))

    def pause(self, paused=True):
        return done(self.ask('pause', paused))

    def record(self, place):
        """Record to a bag, which is replayed by `every_bag_is_replayed`."""
        self.log = RunWriter(place, recorded_topics(NAMES), custom=recording_notes('/rig', NAMES))
        self.ask('record_to', self.log, event_bytes())

    def recorded(self):
        """Stop, and finish the bag; return how many messages it has."""
        self.engine.stop(DEADLINE_S)
        assert not self.engine._thread.is_alive()
        assert self.engine.failure is None
        self.log.close()
        assert self.log.error is None
        return self.log.message_count

    # Its messages and state

    def messages(self, name):
        for key, data in self.sent[self._read :]:
            message = deserialize_message(data, TYPES.get(key, JointState))
            self._messages[key].append(message)
            self._read += 1
        return list(self._messages[name])

    def samples(self):
        return [m for m in self.messages('joint_states') if m.header.frame_id != PAUSED_FRAME]

    def stamps(self):
        """Return the stamps of the samples."""
        return [stamp_ns(m.header.stamp) for m in self.samples()]

    def paused(self):
        return [m for m in self.messages('joint_states') if m.header.frame_id == PAUSED_FRAME]

    def snapshots(self, *reasons):
        """Return the snapshots, or those with one of some reasons."""
        every = [json.loads(m.data) for m in self.messages('snapshot')]
        return [s for s in every if not reasons or s['reason'] in reasons]

    @property
    def status(self):
        return self.engine.status()

    def await_samples(self, count):
        """Wait for so many more samples."""
        enough = len(self.samples()) + count
        until(lambda: len(self.samples()) >= enough, lambda: str(self.engine.failure))

    def run_to(self, seconds):
        """Run to a stamp, and stop."""
        self.started()
        self.pass_by(seconds)
        self.engine.stop()

    def pass_by(self, seconds):
        """Wait until a stamp is reached."""
        until(lambda: self.engine.stamp_ns() >= seconds * 1e9 or self.engine.failure)
