# SPDX-License-Identifier: Apache-2.0
"""
Start the rig, with the frames of its parts and, when asked, a picture in RViz or a page.

    ros2 launch impact_damper_ros rig.launch.py use_rviz:=true record:=true
    ros2 launch impact_damper_ros rig.launch.py namespace:=left params_file:=my_rig.yaml
    ros2 launch impact_damper_ros rig.launch.py real_time_factor:=0.2 use_rviz:=true
    ros2 launch impact_damper_ros rig.launch.py page:=true
"""

import shutil
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.some_substitutions_type import SomeSubstitutionsType
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare
from launch_ros.utilities import make_namespace_absolute, prefix_namespace

from impact_damper_ros import load_parameters
from impact_damper_ros.bag.robot_description import robot_description
from impact_damper_ros.node.parameters import NodeParameters
from impact_damper_ros.node.rviz_setup import rviz_setup
from impact_damper_ros.parameters.parameters_file import preset_file

SHARE = FindPackageShare('impact_damper_ros')
NAMESPACE = LaunchConfiguration('namespace')

# Two rigs on one network would mix their parts in one tree of frames: each keeps its own, in its
# namespace. RViz is told the same, and where the description is.
OWN_FRAMES = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
OWN_DESCRIPTION = ('/robot_description', 'robot_description')
# The node publishes what is to be seen, also after a change; robot_state_publisher has the frames.
OTHER_DESCRIPTION = ('robot_description', 'robot_state_publisher/robot_description')
#: Files that are removed when launch ends.
TEMPORARY: list[Any] = []


class StartedRig(NamedTuple):
    """The node: its name, what it is given, and what its parameters will be."""

    name: str
    given: list[Any]
    parameters: NodeParameters


def started_rig(context: LaunchContext) -> StartedRig:
    """Read the parameters file and the arguments that override it."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    # As Node makes it of the same argument.
    namespace = make_namespace_absolute(
        prefix_namespace(context.launch_configurations.get('ros_namespace'), given('namespace'))
    )
    name = f'{(namespace or "/").rstrip("/")}/sim_node'
    params_file = str(preset_file(Path(given('params_file'))))
    settings: dict[str, Any] = {}
    for switch in ('record', 'publish_clock'):
        if given(switch):
            settings[switch] = given(switch) == 'true'
    if given('bag_directory'):
        settings['bag_directory'] = given('bag_directory')
    if given('real_time_factor'):
        settings['real_time_factor'] = float(given('real_time_factor'))
    rig, initial, other = load_parameters(params_file, node=name)
    parameters = NodeParameters(rig=rig, initial=initial).changed({**other, **settings})
    return StartedRig(name, [params_file, *([settings] if settings else [])], parameters)


def ends_with_launch() -> list[SomeSubstitutionsType]:
    """
    Return the prefix of a process that is to end with this one.

    Launch ends its processes on Ctrl-C, but leaves them behind when it is terminated or killed
    itself. The kernel then sends them a SIGTERM, upon which the node finishes its recording.
    """
    own = ['setpriv --pdeathsig TERM '] if shutil.which('setpriv') else []
    return [*own, LaunchConfiguration('launch-prefix', default='')]


def start_rig(context: LaunchContext) -> list[Node]:
    """Return the node."""
    rig = started_rig(context)
    return [
        Node(
            package='impact_damper_ros',
            executable='sim_node',
            exec_name='sim_node',
            name='sim_node',
            namespace=NAMESPACE,
            parameters=rig.given,
            prefix=ends_with_launch(),
            output='screen',
            emulate_tty=True,
            on_exit=Shutdown(),
        )
    ]


def start_frames(context: LaunchContext) -> list[Node]:
    """Return the publisher of the frames."""
    rig = started_rig(context).parameters
    description = robot_description(rig.rig, rig.control.widest_gap)
    return [
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            exec_name='robot_state_publisher',
            namespace=NAMESPACE,
            parameters=[
                {
                    'robot_description': ParameterValue(description, value_type=str),
                    'use_sim_time': rig.simulated_time,
                }
            ],
            remappings=[*OWN_FRAMES, OTHER_DESCRIPTION],
            prefix=ends_with_launch(),
        )
    ]


def start_page(context: LaunchContext) -> list[Node]:
    """Return the page of the rig."""
    rig = started_rig(context)
    return [
        Node(
            package='impact_damper_ros',
            executable='rig_page',
            exec_name='rig_page',
            arguments=['--node', rig.name, '--open', '--recordings', rig.parameters.bag_directory],
            prefix=ends_with_launch(),
            output='screen',
        )
    ]


def start_rviz(context: LaunchContext) -> list[Node]:
    """Return RViz, its view fitted to the rig."""
    rig = started_rig(context).parameters
    setup = Path(PathJoinSubstitution([SHARE, 'rviz', 'rig.rviz']).perform(context))
    fitted = tempfile.NamedTemporaryFile('w', suffix='.rviz', encoding='utf-8')  # noqa: SIM115
    text = rviz_setup(setup.read_text(encoding='utf-8'), rig.rig, rig.control.widest_gap)
    fitted.write(text)
    fitted.flush()
    TEMPORARY.append(fitted)
    return [
        Node(
            package='rviz2',
            executable='rviz2',
            exec_name='rviz2',
            namespace=NAMESPACE,
            arguments=['-d', fitted.name],
            parameters=[{'use_sim_time': rig.simulated_time}],
            remappings=[*OWN_FRAMES, OWN_DESCRIPTION],
            prefix=ends_with_launch(),
        )
    ]


def argument(name: str, default: Any, description: str, *choices: str) -> DeclareLaunchArgument:
    """Declare an argument; with choices it is one of these."""
    return DeclareLaunchArgument(
        name, default_value=default, description=description, choices=choices or None
    )


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what they start."""
    switch = ('true', 'false')
    bench = PathJoinSubstitution([SHARE, 'config', 'bench_rig.yaml'])
    return LaunchDescription(
        [
            argument('params_file', bench, 'ROS 2 parameters file with the rig, or a preset'),
            argument('namespace', '', 'namespace of all nodes and topics'),
            argument(
                'record',
                '',
                'record from the start; empty: as the parameters file says',
                *switch,
                '',
            ),
            argument('bag_directory', '', 'where recordings go; empty: as the file says'),
            argument(
                'real_time_factor',
                '',
                'seconds of the rig per second of the clock, 0: as fast as possible; empty: as '
                'the parameters file says',
            ),
            argument(
                'publish_clock',
                '',
                'publish /clock, which the other nodes then follow; empty: as the parameters file '
                'says. It is published in any case if real_time_factor is not 1',
                *switch,
                '',
            ),
            argument('use_robot_state_publisher', 'true', 'publish the frames (tf)', *switch),
            argument('use_rviz', 'false', 'open RViz', *switch),
            argument(
                'page', 'false', 'show the rig in a browser, at http://127.0.0.1:8088/', *switch
            ),
            # The rig last: it does not start if one of the others is not installed.
            OpaqueFunction(
                function=start_frames,
                condition=IfCondition(LaunchConfiguration('use_robot_state_publisher')),
            ),
            OpaqueFunction(
                function=start_rviz, condition=IfCondition(LaunchConfiguration('use_rviz'))
            ),
            OpaqueFunction(
                function=start_page, condition=IfCondition(LaunchConfiguration('page'))
            ),
            OpaqueFunction(function=start_rig),
        ]
    )
