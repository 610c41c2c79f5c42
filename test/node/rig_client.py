"""What the integration tests need: the node as a process, and a plain rclpy client."""

import json
import signal
import threading
import time
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import DescribeParameters, SetParameters
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import Running, until
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from impact_damper_ros.bag import RunReader
from impact_damper_ros.bag.rig_topics import PAUSED_FRAME
from impact_damper_ros.node import rig_client
from impact_damper_ros.node.raw_subscription import Polled

#: A small rig at its resonance of 5 Hz, whose damper rattles within the first second.
LIVELY = {
    'primary_mass': 1.0,
    'stiffness': 1000.0,
    'damping': 0.6,
    'damper_mass': 0.1,
    'gap': 0.01,
    'force_amplitudes': '[10.0]',
    'force_frequencies': '[31.6]',
}

#: The last message before one has joined, and all after it.
LATCHED = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
#: Those that other programs use, too; the last one stays the last.
SERVICES = {
    'describe_parameters': DescribeParameters,
    'set_parameters': SetParameters,
    **rig_client.SERVICES,
}


def stamp_ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


def children(process):
    """Return the processes that a process has started."""
    paths = Path(f'/proc/{process}/task').glob('*/children')
    return [int(number) for path in paths for number in path.read_text().split()]


class SimProcess(Running):
    """
    One `sim_node`.

    Parameters
    ----------
    directory : Path
        Where it runs, and where its output is kept.
    remaps : sequence of str
        Given as `-r from:=to`.
    code : str, optional
        A program to run instead of the module.
    parameters_file : Path or list of Path, optional
        Given as `--params-file`.
    **parameters : object
        Given as `-p name:=value`.
    """

    def __init__(self, directory, remaps=(), code=None, parameters_file=None, **parameters):
        program = ['-c', code] if code else ['-m', 'impact_damper_ros.node.sim_node']
        arguments = ['--ros-args']
        for remap in remaps:
            arguments += ['-r', remap]
        files = parameters_file if isinstance(parameters_file, list) else [parameters_file]
        for file in filter(None, files):
            arguments += ['--params-file', str(file)]
        # The theory would compute beside all tests; those of it ask for it.
        for name, value in {'predict_motion': False, **parameters}.items():
            text = str(value).lower() if isinstance(value, bool) else str(value)
            arguments += ['-p', f'{name}:={text}']
        self.directory = directory
        directory.mkdir(exist_ok=True)
        super().__init__(directory, *program, *arguments)


class RigClient:
    """A client of any number of rigs, which a thread of its own polls, with a pause in s."""

    def __init__(self, pause=0.005):
        self._pause = pause
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.node = Node('test_client', context=self.context)
        self._rigs, self._listened = {}, []
        self._lock, self._running = threading.Lock(), True
        self._thread = threading.Thread(target=self._poll)
        self._thread.start()

    def _poll(self):
        while self._running:
            for subscription, messages in list(self._listened):
                take, kind = subscription.handle.take_message, subscription.msg_type
                while (taken := take(kind, False)) is not None:
                    messages.append(taken[0])
            with self._lock:
                for rig in self._rigs.values():
                    rig.poll()
            time.sleep(self._pause)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._running = False
        self._thread.join()
        self.node.destroy_node()
        self.context.try_shutdown()

    def listen(self, kind, topic, qos=None):
        """Return a list that grows by what comes in."""
        messages, qos = [], qos or QoSProfile(depth=1000)
        subscription = self.node.create_subscription(
            kind, topic, messages.append, qos, callback_group=Polled()
        )
        self._listened.append((subscription, messages))
        return messages

    def ask(self, node, service, **fields):
        """Ask a service of a node, once that answers; return the future of the answer."""
        with self._lock:
            if node not in self._rigs:
                self._rigs[node] = rig_client.RigClient(self.node, node, SERVICES)
                self._rigs[node].ask(rig_client.LAST, names=[])
        rig = self._rigs[node]
        until(lambda: rig.answers, f'{node} does not answer')
        with self._lock:
            return rig.ask(service, **fields)


class RigParametersClient:
    """The parameters of one node, as `ros2 param` and `ros2 service call` reach them."""

    def __init__(self, client, node='/sim_node'):
        self._client = client
        self.node = node

    def service(self, name, **fields):
        """Call a service of the node."""
        future = self._client.ask(self.node, name, **fields)
        return until(lambda: future.done() and future.result(), f'{name} was not answered')

    def get(self, *names):
        response = self.service('get_parameters', names=names)
        values = [parameter_value_to_python(value) for value in response.values]
        return values[0] if len(names) == 1 and values else values

    def names(self):
        return list(self.service('list_parameters').result.names)

    def describe(self, *names):
        return self.service('describe_parameters', names=names).descriptors

    def set(self, **values):
        """Set one after the other; return the reasons of the rejections, empty if accepted."""
        results = self.service('set_parameters', parameters=_messages(values)).results
        reasons = list(map(_reason, results))
        return reasons[0] if len(values) == 1 else reasons

    def set_atomically(self, **values):
        """Set all or none; return the reason of a rejection, empty if accepted."""
        return _reason(self.request(**values))

    def request(self, **values):
        """Set all or none; return the answer, which may say what waits."""
        return self.service('set_parameters_atomically', parameters=_messages(values)).result


def _reason(result):
    assert result.reason or result.successful
    return '' if result.successful else result.reason


def _messages(values):
    return [
        value
        if isinstance(value, ParameterMessage)
        else Parameter(name, value=value).to_parameter_msg()
        for name, value in values.items()
    ]


class Report(NamedTuple):
    """What a node reports of one of its tasks."""

    level: bytes
    message: str
    values: dict[str, str]


class LiveRig:
    """A node, and what is heard of it; a topic is subscribed to when it is first looked at."""

    def __init__(self, client, process, space='', node='sim_node'):
        self.client, self.process, self.space = client, process, space
        self.name = f'{space}/{node}'
        self.parameters = RigParametersClient(client, self.name)
        self._decoded = {'snapshots': [], 'reports': []}

    def listen(self, kind, topic, qos=None):
        return self.client.listen(kind, f'{self.space}/{topic}', qos)

    @cached_property
    def states(self):
        return self.listen(JointState, 'joint_states')

    @cached_property
    def impacts(self):
        return self.listen(JointState, 'impacts')

    @cached_property
    def acts(self):
        return self.listen(JointState, 'gap_control')

    @cached_property
    def _snapshots(self):
        return self.listen(String, 'snapshot', LATCHED)

    @cached_property
    def _reports(self):
        return self.client.listen(DiagnosticArray, '/diagnostics')

    def _each(self, name, messages, decode):
        """Return messages decoded, each once."""
        known = self._decoded[name]
        known += map(decode, messages[len(known) :])
        return known

    def snapshots(self, *reasons):
        """Return the snapshots that have come, or those with one of some reasons."""
        every = self._each('snapshots', self._snapshots, lambda message: json.loads(message.data))
        return [one for one in every if not reasons or one['reason'] in reasons]

    def reports(self, *tasks):
        """Return the reports of the node that have all of these tasks, each a `Report` by task."""
        every = self._each('reports', self._reports, self._report_of)
        return [report for report in every if report and all(task in report for task in tasks)]

    def _report_of(self, array):
        prefix = f'{self.name[1:]}: '
        return {
            status.name.removeprefix(prefix): Report(
                status.level, status.message, {v.key: v.value for v in status.values}
            )
            for status in array.status
            if status.name.startswith(prefix)
        }

    def report(self, task):
        """Return the last report on a task."""
        return ([Report(b'', '', {})] + [report[task] for report in self.reports(task)])[-1]

    def await_report(self, *tasks, holds=lambda *_: True):
        """Wait for reports on tasks, still to come, for which something holds; return them."""
        seen = len(self.reports(*tasks))

        def found():
            nonlocal seen
            for report in self.reports(*tasks)[seen:]:
                seen += 1
                of_tasks = [report[task] for task in tasks]
                if holds(*of_tasks):
                    return of_tasks
            return None

        found = self.until(found, lambda: str([self.report(task) for task in tasks]))
        return found[0] if len(tasks) == 1 else found

    def until(self, condition, what=''):
        """Wait for a condition while the node runs, and return its value."""

        def holds():
            value = condition()
            assert value or self.process.running(), self.process.output
            return value

        return until(holds, what or (lambda: self.process.output))

    def await_states(self, count=1):
        """Wait for so many more joint states."""
        enough = len(self.states) + count
        self.until(lambda: len(self.states) >= enough)

    @property
    def stands_still(self):
        """Whether its last joint states are those of a paused or held rig."""
        return bool(self.states) and self.states[-1].header.frame_id == PAUSED_FRAME

    def change(self, **values):
        """Set parameters, all at once."""
        assert self.parameters.set_atomically(**values) == '', values

    def call(self, name, **values):
        """Call `reset`, `pause`, `step` or `step_to_impact`; return success and message."""
        answer = self.parameters.service(name, **values)
        return answer.success, answer.message

    def pause(self, data=True):
        """Pause it, or resume, and wait until that is heard."""
        assert self.call('pause', data=data)[0]
        self.until(lambda: self.stands_still is data)

    def reset(self):
        """Reset it, and return the snapshot that shows that."""
        count = len(self.snapshots('reset'))
        assert self.call('reset')[0]
        return self.until(lambda: self.snapshots('reset')[count:])[0]

    def bags(self):
        """Return what it has recorded, the oldest first."""
        return sorted((self.process.directory / 'runs').iterdir())

    def bag(self):
        """Return its one recording, which must be whole."""
        (bag,) = self.bags()
        reader = RunReader(bag)
        assert (reader.complete, reader.unusable) == (True, 0)
        return bag

    def stop(self, number=signal.SIGINT):
        """End it by a signal."""
        self.process.send(number)
        self.ended()

    def ended(self):
        """Wait for its end, and see that it reports no error."""
        assert self.process.wait() == 0, self.process.output
        for words in ('Traceback', 'a callback failed'):
            assert words not in self.process.output, self.process.output
