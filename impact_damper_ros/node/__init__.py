# SPDX-License-Identifier: Apache-2.0
"""
The rig as a ROS 2 node; the only part of the package that needs rclpy.

`sim_node.SimNode` is the node, `engine.Engine` the thread that moves the rig.
"""
