"""The rig as a ROS 2 node; the only part of the package that needs rclpy."""
