# SPDX-License-Identifier: Apache-2.0
"""
Start the rig with one of the controllers of examples/controllers.

    ros2 launch impact_damper_ros controller.launch.py controller:=timed_gap
    ros2 launch impact_damper_ros controller.launch.py controller:=skyhook lock_step:=force_command
"""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, ExecuteProcess, Shutdown
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

SHARE = FindPackageShare('impact_damper_ros')
CONTROLLERS = ('on_off_gap', 'timed_gap', 'skyhook')


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what they start."""
    bench = PathJoinSubstitution([SHARE, 'config', 'bench_rig.yaml'])
    controller = LaunchConfiguration('controller')
    script = PythonExpression(["'", controller, ".py'"])
    rate = LaunchConfiguration('measurement_rate')
    return LaunchDescription(
        [
            DeclareLaunchArgument('controller', choices=CONTROLLERS, description='which one'),
            DeclareLaunchArgument(
                'params_file', default_value=bench, description='ROS 2 parameters file of the rig'
            ),
            DeclareLaunchArgument(
                'measurement_rate', default_value='200.0', description='measurements, Hz'
            ),
            DeclareLaunchArgument(
                'lock_step',
                default_value='off',
                choices=('off', 'stop_commands', 'force_command'),
                description='wait at each measurement for the command of this topic',
            ),
            ExecuteProcess(
                cmd=['python3', PathJoinSubstitution([SHARE, 'examples', 'controllers', script])],
                output='screen',
                on_exit=Shutdown(),
            ),
            Node(
                package='impact_damper_ros',
                executable='sim_node',
                name='sim_node',
                parameters=[
                    LaunchConfiguration('params_file'),
                    {
                        'gap_control': 'external',
                        'measurement_rate': ParameterValue(rate, value_type=float),
                        'lock_step': ParameterValue(
                            LaunchConfiguration('lock_step'), value_type=str
                        ),
                    },
                ],
                output='screen',
                on_exit=Shutdown(),
            ),
        ]
    )
