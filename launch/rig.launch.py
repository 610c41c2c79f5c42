"""
Start the rig, with the frames of its parts and, when asked, a picture in RViz or a page.

    ros2 launch impact_damper_ros rig.launch.py use_rviz:=true record:=true
    ros2 launch impact_damper_ros rig.launch.py namespace:=left params_file:=my_rig.yaml
    ros2 launch impact_damper_ros rig.launch.py real_time_factor:=0.2 use_rviz:=true
    ros2 launch impact_damper_ros rig.launch.py page:=true

Nothing is started unless all of it can be.
"""

import os
import shutil
import tempfile
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, RegisterEventHandler, Shutdown
from launch.event_handlers import OnShutdown
from launch.some_substitutions_type import SomeSubstitutionsType
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch.substitutions.substitution_failure import SubstitutionFailure
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import ExecutableInPackage, FindPackageShare
from launch_ros.utilities import make_namespace_absolute, prefix_namespace

from impact_damper_ros.control import GAP_CONTROL_SPECS, GapControlParameters
from impact_damper_ros.rig import load_parameters
from impact_damper_ros.rig.description import robot_description, rviz_setup
from impact_damper_ros.rig.parameters_file import preset_file

SHARE = FindPackageShare('impact_damper_ros')

# Two rigs on one network would mix their parts in one tree of frames: each keeps its own, in its
# namespace. RViz is told the same, and where the description is.
OWN_FRAMES = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
OWN_DESCRIPTION = ('/robot_description', 'robot_description')
# The node publishes what is to be seen, also after a change; robot_state_publisher has the frames.
OTHER_DESCRIPTION = ('robot_description', 'robot_state_publisher/robot_description')


def ends_with_launch() -> list[SomeSubstitutionsType]:
    """
    Return the prefix of a process that is to end with this one.

    Launch ends its processes on Ctrl-C, but leaves them behind when it is terminated or killed
    itself. The kernel then sends them a SIGTERM, upon which the node finishes its recording.
    """
    own = ['setpriv --pdeathsig TERM '] if shutil.which('setpriv') else []
    return [*own, LaunchConfiguration('launch-prefix', default='')]


def check_executables(context: LaunchContext, packages: list[tuple[str, str]]) -> None:
    """
    Make sure that all is there, before anything is started.

    Raises
    ------
    RuntimeError
        If a package is missing; what was started by then would be left behind.
    """
    for package, remedy in packages:
        executable = 'sim_node' if package == 'impact_damper_ros' else package
        try:
            ExecutableInPackage(executable, package).perform(context)
        except (PackageNotFoundError, SubstitutionFailure):
            name = f'ros-{os.environ.get("ROS_DISTRO", "jazzy")}-{package.replace("_", "-")}'
            raise RuntimeError(
                f'nothing was started, {package} is not installed: apt install {name}{remedy}'
            ) from None


def rviz_file(text: str) -> tuple[str, LaunchDescriptionEntity]:
    """Write a set-up of RViz; return its path, and what removes it in the end."""
    descriptor, path = tempfile.mkstemp(prefix='impact_damper_', suffix='.rviz')
    with os.fdopen(descriptor, 'w', encoding='utf-8') as stream:
        stream.write(text)

    def remove(_event: object, _context: LaunchContext) -> None:
        Path(path).unlink(missing_ok=True)

    return path, RegisterEventHandler(OnShutdown(on_shutdown=remove))


def start_rig(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the nodes, the picture drawn to the rig that the node will be."""

    def given(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    # As Node makes it of the same argument.
    namespace = make_namespace_absolute(
        prefix_namespace(context.launch_configurations.get('ros_namespace'), given('namespace'))
    )
    namespace = '/' if namespace is None else namespace
    name = f'{namespace.rstrip("/")}/sim_node'
    params_file = str(preset_file(Path(given('params_file'))))
    rig, _, other = load_parameters(params_file, node=name)
    control = GapControlParameters(**{k: v for k, v in other.items() if k in GAP_CONTROL_SPECS})

    settings: dict[str, bool | float | str] = {}
    if given('record'):
        settings['record'] = given('record') == 'true'
    if given('bag_directory'):
        settings['bag_directory'] = given('bag_directory')
    if given('real_time_factor'):
        settings['real_time_factor'] = factor_of(given('real_time_factor'))
    if given('use_sim_time'):
        settings['publish_clock'] = given('use_sim_time') == 'true'
    now = {**other, **settings}
    use_sim_time = now.get('publish_clock', False) is True
    if now.get('real_time_factor', 1.0) != 1.0:
        # The node publishes the clock in any case.
        if given('use_sim_time') == 'false':
            raise ValueError(
                f'use_sim_time is false and real_time_factor {now["real_time_factor"]}: the rig '
                'is then not in wall time; leave use_sim_time out, or give real_time_factor:=1.0'
            )
        use_sim_time = True

    publish_frames = given('use_robot_state_publisher') == 'true'
    use_rviz = given('use_rviz') == 'true'
    packages = [('impact_damper_ros', '')]
    if publish_frames:
        remedy = ', or give use_robot_state_publisher:=false'
        packages.append(('robot_state_publisher', remedy))
    if use_rviz:
        packages.append(('rviz2', ', or leave use_rviz:=true out'))
    check_executables(context, packages)

    started: list[LaunchDescriptionEntity] = [
        Node(
            package='impact_damper_ros',
            executable='sim_node',
            exec_name='sim_node',
            name='sim_node',
            namespace=given('namespace'),
            parameters=[params_file, settings] if settings else [params_file],
            prefix=ends_with_launch(),
            output='screen',
            emulate_tty=True,
            on_exit=Shutdown(),
        )
    ]
    if publish_frames:
        description = robot_description(rig, control.widest_gap)
        started.append(
            Node(
                package='robot_state_publisher',
                executable='robot_state_publisher',
                exec_name='robot_state_publisher',
                namespace=given('namespace'),
                parameters=[
                    {
                        'robot_description': ParameterValue(description, value_type=str),
                        'use_sim_time': use_sim_time,
                    }
                ],
                remappings=[*OWN_FRAMES, OTHER_DESCRIPTION],
                prefix=ends_with_launch(),
            )
        )
    if given('page') == 'true':
        started.append(
            Node(
                package='impact_damper_ros',
                executable='rig_page',
                exec_name='rig_page',
                arguments=[
                    *('--node', name, '--open'),
                    *('--recordings', str(now.get('bag_directory', 'runs'))),
                ],
                prefix=ends_with_launch(),
                output='screen',
            )
        )
    if use_rviz:
        setup = Path(PathJoinSubstitution([SHARE, 'rviz', 'rig.rviz']).perform(context))
        text = rviz_setup(setup.read_text(encoding='utf-8'), rig, control.widest_gap)
        path, removal = rviz_file(text)
        started += [
            removal,
            Node(
                package='rviz2',
                executable='rviz2',
                exec_name='rviz2',
                namespace=given('namespace'),
                arguments=['-d', path],
                parameters=[{'use_sim_time': use_sim_time}],
                remappings=[*OWN_FRAMES, OWN_DESCRIPTION],
                prefix=ends_with_launch(),
            ),
        ]
    return started


def factor_of(text: str) -> float:
    """Return a real-time factor; whether it is in range, the node says."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(
            f'real_time_factor is {text!r}: give a number, such as 0.2; 0 is as fast as possible'
        ) from None


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what they start."""
    switch = ['true', 'false']
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([SHARE, 'config', 'bench_rig.yaml']),
                description='ROS 2 parameters file with the rig, or the name of a preset',
            ),
            DeclareLaunchArgument(
                'namespace', default_value='', description='namespace of all nodes and topics'
            ),
            DeclareLaunchArgument(
                'record',
                default_value='',
                choices=[*switch, ''],
                description='record from the start; empty: as the parameters file says',
            ),
            DeclareLaunchArgument(
                'bag_directory',
                default_value='',
                description='where recordings go; empty: as the parameters file says',
            ),
            DeclareLaunchArgument(
                'real_time_factor',
                default_value='',
                description='seconds of the rig per second of the clock, 0: as fast as possible; '
                'empty: as the parameters file says',
            ),
            DeclareLaunchArgument(
                'use_robot_state_publisher',
                default_value='true',
                choices=switch,
                description='publish the frames of the parts (tf)',
            ),
            DeclareLaunchArgument(
                'use_rviz', default_value='false', choices=switch, description='open RViz'
            ),
            DeclareLaunchArgument(
                'page',
                default_value='false',
                choices=switch,
                description='show the rig in a browser, at http://127.0.0.1:8088/',
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='',
                choices=[*switch, ''],
                description='publish /clock, and let the other nodes follow it; empty: if the '
                'parameters file or real_time_factor has the rig publish it',
            ),
            OpaqueFunction(function=start_rig),
        ]
    )
