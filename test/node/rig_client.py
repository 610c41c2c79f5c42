"""What the integration tests need: the node as a process, and a plain rclpy client."""

import math
import threading
import time

import rclpy
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from running import Running, until
from std_srvs.srv import SetBool, Trigger

#: After which a request is made again whose answer may have been lost.
ASK_AGAIN_S = 1.0
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
#: Of a node, beside the one that it is met by.
SERVICES = {
    'describe_parameters': DescribeParameters,
    'get_parameters': GetParameters,
    'list_parameters': ListParameters,
    'set_parameters': SetParameters,
    'set_parameters_atomically': SetParametersAtomically,
    'pause': SetBool,
    'reset': Trigger,
    'step': Trigger,
    'step_to_impact': Trigger,
}


def stamp_ns(stamp):
    return stamp.sec * 10**9 + stamp.nanosec


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
        directory.mkdir(exist_ok=True)
        super().__init__(directory, *program, *arguments)


class RigClient:
    """A client of any number of rigs, spinning in a thread of its own."""

    def __init__(self):
        self.context = Context()
        rclpy.init(args=[], context=self.context)
        self.node = Node('test_client', context=self.context)
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients = {}
        self._spinning = True
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self):
        while self._spinning:
            self._executor.spin_once(timeout_sec=0.05)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._spinning = False
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def listen(self, kind, topic, qos=None):
        """Return a list that grows by what comes in."""
        messages = []
        self.node.create_subscription(kind, topic, messages.append, qos or QoSProfile(depth=1000))
        return messages

    def request(self, service, request):
        """Send a request to a service of a node and return its future."""
        node, _, _ = service.rpartition('/')
        if service not in self._clients:
            self._meet(node)
        return self._clients[service].call_async(request)

    def call(self, kind, service, request=None):
        """Call a service of a node and return its response."""
        future = self.request(service, request or kind.Request())
        return until(lambda: future.done() and future.result(), f'{service} did not answer')

    def _meet(self, node):
        """
        Make the clients of the services of a node, and wait until it knows them all.

        That a client has found its service does not mean that the service has found the client:
        until then an answer is lost. A client's endpoints are found in the order in which they
        were made, so once the last client has had an answer, the others will have theirs. The
        last one may be asked as often as need be.
        """
        for name, kind in SERVICES.items():
            service = f'{node}/{name}'
            self._clients[service] = self.node.create_client(kind, service)
        last = self.node.create_client(GetParameterTypes, f'{node}/get_parameter_types')
        for client in (*(self._clients[f'{node}/{name}'] for name in SERVICES), last):
            until(client.service_is_ready, f'{client.srv_name} is not there')
        futures = []
        asked = -math.inf

        def answered():
            nonlocal asked
            if time.monotonic() >= asked + ASK_AGAIN_S:
                futures.append(last.call_async(GetParameterTypes.Request()))
                asked = time.monotonic()
            return any(future.done() for future in futures)

        until(answered, f'{node} does not answer')


class RigParametersClient:
    """The parameters of one node, as `ros2 param` and `ros2 service call` reach them."""

    def __init__(self, client, node='/sim_node'):
        self._client = client
        self.node = node

    def get(self, *names):
        response = self._client.call(
            GetParameters, f'{self.node}/get_parameters', GetParameters.Request(names=names)
        )
        values = [parameter_value_to_python(value) for value in response.values]
        return values[0] if len(names) == 1 and values else values

    def names(self):
        response = self._client.call(ListParameters, f'{self.node}/list_parameters')
        return list(response.result.names)

    def describe(self, *names):
        response = self._client.call(
            DescribeParameters,
            f'{self.node}/describe_parameters',
            DescribeParameters.Request(names=names),
        )
        return response.descriptors

    def set(self, **values):
        """Set one after the other; return the reasons of the rejections, empty if accepted."""
        response = self._client.call(
            SetParameters,
            f'{self.node}/set_parameters',
            SetParameters.Request(parameters=_messages(values)),
        )
        assert all(r.reason or r.successful for r in response.results)
        reasons = ['' if result.successful else result.reason for result in response.results]
        return reasons[0] if len(values) == 1 else reasons

    def service(self, name, request):
        """Call `reset`, `pause`, `step` or `step_to_impact` of the node."""
        return self._client.call(SERVICES[name], f'{self.node}/{name}', request)

    def set_atomically(self, **values):
        """Set all or none; return the reason of the rejection, empty if accepted."""
        response = self._client.call(
            SetParametersAtomically,
            f'{self.node}/set_parameters_atomically',
            SetParametersAtomically.Request(parameters=_messages(values)),
        )
        # A change of the base that waits is accepted with a reason.
        assert response.result.reason or response.result.successful
        return '' if response.result.successful else response.result.reason

    def set_base(self, **values):
        """Set all or none; return whether that was done, and what is said of it."""
        request = SetParametersAtomically.Request(parameters=_messages(values))
        kind, name = SetParametersAtomically, f'{self.node}/set_parameters_atomically'
        result = self._client.call(kind, name, request).result
        return result.successful, result.reason


def _messages(values):
    return [
        value
        if isinstance(value, ParameterMessage)
        else Parameter(name, value=value).to_parameter_msg()
        for name, value in values.items()
    ]
