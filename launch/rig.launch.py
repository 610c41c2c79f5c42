"""
Start the rig, with the frames of its parts and, when asked, a picture in RViz.

    ros2 launch impact_damper_ros rig.launch.py use_rviz:=true record:=true
    ros2 launch impact_damper_ros rig.launch.py namespace:=left params_file:=my_rig.yaml
"""

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch.conditions import IfCondition
from launch.substitutions import Command, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from impact_damper_ros.rig import load_parameters

SHARE = FindPackageShare('impact_damper_ros')

# Two rigs on one network would mix their parts in one tree of frames: each keeps its own, in its
# namespace. RViz is told the same, and where the description is.
OWN_FRAMES = [('/tf', 'tf'), ('/tf_static', 'tf_static')]
OWN_DESCRIPTION = ('/robot_description', 'robot_description')


def start_rig(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """Return the nodes, the picture drawn to the angle and gap of the parameters file."""
    params_file = LaunchConfiguration('params_file').perform(context)
    rig, _, _ = load_parameters(params_file)
    namespace = LaunchConfiguration('namespace')
    use_sim_time = ParameterValue(LaunchConfiguration('use_sim_time'), value_type=bool)

    given = {}
    if record := LaunchConfiguration('record').perform(context):
        given['record'] = record == 'true'
    if bag_directory := LaunchConfiguration('bag_directory').perform(context):
        given['bag_directory'] = bag_directory

    description = Command(
        [
            'xacro ',
            PathJoinSubstitution([SHARE, 'urdf', 'rig.urdf.xacro']),
            f' angle:={rig.angle!r} gap:={rig.gap!r}',
        ]
    )
    return [
        Node(
            package='impact_damper_ros',
            executable='sim_node',
            namespace=namespace,
            parameters=[params_file, given] if given else [params_file],
            output='screen',
            emulate_tty=True,
            on_exit=Shutdown(),
        ),
        Node(
            package='robot_state_publisher',
            executable='robot_state_publisher',
            namespace=namespace,
            parameters=[
                {
                    'robot_description': ParameterValue(description, value_type=str),
                    'use_sim_time': use_sim_time,
                }
            ],
            remappings=OWN_FRAMES,
            condition=IfCondition(LaunchConfiguration('use_robot_state_publisher')),
        ),
        Node(
            package='rviz2',
            executable='rviz2',
            namespace=namespace,
            arguments=['-d', PathJoinSubstitution([SHARE, 'rviz', 'rig.rviz'])],
            parameters=[{'use_sim_time': use_sim_time}],
            remappings=[*OWN_FRAMES, OWN_DESCRIPTION],
            condition=IfCondition(LaunchConfiguration('use_rviz')),
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    """Return the arguments and what they start."""
    switch = ['true', 'false']
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'params_file',
                default_value=PathJoinSubstitution([SHARE, 'config', 'bench_rig.yaml']),
                description='ROS 2 parameters file that describes the rig',
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
                'use_robot_state_publisher',
                default_value='true',
                choices=switch,
                description='publish the frames of the parts (tf) and the robot_description',
            ),
            DeclareLaunchArgument(
                'use_rviz', default_value='false', choices=switch, description='open RViz'
            ),
            DeclareLaunchArgument(
                'use_sim_time',
                default_value='false',
                choices=switch,
                description='let the helpers follow /clock; for a rig with publish_clock: true',
            ),
            OpaqueFunction(function=start_rig),
        ]
    )
