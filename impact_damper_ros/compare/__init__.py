"""Recorded runs compared with the periodic theory; without ROS."""
