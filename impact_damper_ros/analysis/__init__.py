"""What runs of the rig show; works on arrays, without ROS."""
