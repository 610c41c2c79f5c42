# SPDX-License-Identifier: Apache-2.0
"""
Start the rig, with the frames of its parts and, when asked, RViz, a page, or a controller.

    ros2 launch impact_damper_ros rig.launch.py use_rviz:=true record:=true
    ros2 launch impact_damper_ros rig.launch.py namespace:=left params_file:=my_rig.yaml
    ros2 launch impact_damper_ros rig.launch.py real_time_factor:=0.2 use_rviz:=true
    ros2 launch impact_damper_ros rig.launch.py page:=true
    ros2 launch impact_damper_ros rig.launch.py controller:=timed_gap measurement_rate:=100.0
"""

import shutil
import sys
from typing import Any

import yaml
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import (
    Command,
    LaunchConfiguration as Given,
    NotEqualsSubstitution,
    PathJoinSubstitution,
    PythonExpression,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackagePrefix, FindPackageShare

SHARE = FindPackageShare('impact_damper_ros')
NAMESPACE, PARAMS_FILE, CONTROLLER = Given('namespace'), Given('params_file'), Given('controller')
SIMULATED = {'use_sim_time': ParameterValue(Given('use_sim_time'), value_type=bool)}
#: The full name of the node of the rig.
RIG = PythonExpression(["'/'.join(['', *filter(None, '", NAMESPACE, "'.split('/')), 'sim_node'])"])

# Two rigs on one network would mix their parts in one tree of frames: each keeps its own, in its
# namespace. RViz is told the same, and where the description is.
OWN_FRAMES = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
OWN_DESCRIPTION = ('/robot_description', 'robot_description')
# The node publishes what is to be seen, also after a change; robot_state_publisher has the frames.
OTHER_DESCRIPTION = ('robot_description', 'robot_state_publisher/robot_description')
# Launch ends its processes on Ctrl-C, but leaves them behind when it is terminated or killed
# itself. The kernel then sends them a SIGTERM, upon which the node finishes its recording.
ENDS_WITH_LAUNCH = {'prefix': 'setpriv --pdeathsig TERM'} if shutil.which('setpriv') else {}

SWITCH = ('true', 'false')
# Arguments: default, description, and choices. Those of the node override the parameters file.
# fmt: off
OF_THE_NODE: dict[str, tuple[Any, ...]] = {
    'record': ('', 'record from the start', *SWITCH, ''),
    'bag_directory': ('', 'where recordings go'),
    'real_time_factor': ('', 'seconds of the rig per second of the clock, 0: as fast as possible'),
    'publish_clock': ('', 'publish /clock', *SWITCH, ''),
    'force_record': ('', 'measured force on M, a table'),
    'base_record': ('', 'measured acceleration of the base, a table'),
    'measurement_rate': (
        PythonExpression(["'' if '", CONTROLLER, "' == 'none' else '200.0'"]),
        'measurements, Hz; 200 where a controller is started',
    ),
    'lock_step': ('', 'commands to wait for', 'stop_commands', 'force_command', 'both', ''),
}
PATHS = ('bag_directory', 'force_record', 'base_record')
ARGUMENTS: dict[str, tuple[Any, ...]] = {
    'params_file': (
        PathJoinSubstitution([SHARE, 'config', 'bench_rig.yaml']),
        'ROS 2 parameters file with the rig',
    ),
    'namespace': ('', 'namespace of all nodes and topics'),
    'controller': (
        'none', 'one of examples/controllers', 'none', 'on_off_gap', 'timed_gap', 'skyhook',
    ),
    **OF_THE_NODE,
    'use_sim_time': (
        PythonExpression([
            "float('", Given('real_time_factor'), "' or 1) != 1.0 or '",
            Given('publish_clock'), "' == 'true' or '", Given('lock_step'), "' != ''",
        ]),
        'whether the other nodes use the time of the rig',
    ),
    'use_robot_state_publisher': ('true', 'publish the frames (tf)', *SWITCH),
    'use_rviz': ('false', 'open RViz', *SWITCH),
    'rviz_config': (
        PathJoinSubstitution([SHARE, 'rviz', 'rig.rviz']),
        'view of RViz',
    ),
    'page': ('false', 'show the rig in a browser, at http://127.0.0.1:8088/', *SWITCH),
}
# fmt: on


def program(package: str, executable: str, **options: Any) -> Node:
    """Return a program of a package, which ends with the launch."""
    words = {'package': package, 'executable': executable, 'exec_name': executable}
    return Node(**words, **options, **ENDS_WITH_LAUNCH)


def start_rig(context: LaunchContext) -> list[Node]:
    """Return the node, with the arguments that are given."""
    given = {name: Given(name).perform(context) for name in OF_THE_NODE}
    settings = {n: v if n in PATHS else yaml.safe_load(v) for n, v in given.items() if v}
    if CONTROLLER.perform(context) != 'none':
        settings['gap_control'] = 'external'
    rig = {'name': 'sim_node', 'namespace': NAMESPACE, 'output': 'screen', 'emulate_tty': True}
    parameters = [PARAMS_FILE, *([settings] if settings else [])]
    return [
        program('impact_damper_ros', 'sim_node', **rig, parameters=parameters, on_exit=Shutdown())
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what they start."""
    programs = [FindPackagePrefix('impact_damper_ros'), 'lib', 'impact_damper_ros']
    simulate_rig = PathJoinSubstitution([*programs, 'simulate_rig'])
    urdf = Command([simulate_rig, ' ', PARAMS_FILE, ' --urdf --node ', RIG])
    described = {'robot_description': ParameterValue(urdf, value_type=str)}
    recordings = PythonExpression(["'", Given('bag_directory'), "' or 'runs'"])
    script = [SHARE, '/examples/controllers/', CONTROLLER, '.py']
    space = PythonExpression(["'__ns:=/' + '", NAMESPACE, "'.strip('/')"])
    rate = ['rate:=', Given('measurement_rate')]
    arguments = [
        DeclareLaunchArgument(
            name, default_value=default, description=words, choices=choices or None
        )
        for name, (default, words, *choices) in ARGUMENTS.items()
    ]
    return LaunchDescription(
        [
            *arguments,
            # The rig last: it does not start if one of the others is not installed.
            program(
                *('robot_state_publisher', 'robot_state_publisher'),
                namespace=NAMESPACE,
                parameters=[described, SIMULATED],
                remappings=[*OWN_FRAMES, OTHER_DESCRIPTION],
                condition=IfCondition(Given('use_robot_state_publisher')),
            ),
            program(
                *('rviz2', 'rviz2'),
                namespace=NAMESPACE,
                arguments=['-d', Given('rviz_config')],
                parameters=[SIMULATED],
                remappings=[*OWN_FRAMES, OWN_DESCRIPTION],
                condition=IfCondition(Given('use_rviz')),
            ),
            program(
                *('impact_damper_ros', 'rig_page'),
                arguments=['--node', RIG, '--open', '--recordings', recordings],
                output='screen',
                condition=IfCondition(Given('page')),
            ),
            ExecuteProcess(
                name='controller',
                cmd=[sys.executable, script, '--ros-args', '-r', space, '-p', rate],
                output='screen',
                on_exit=Shutdown(),
                condition=IfCondition(NotEqualsSubstitution(CONTROLLER, 'none')),
                **ENDS_WITH_LAUNCH,
            ),
            OpaqueFunction(function=start_rig),
        ]
    )
