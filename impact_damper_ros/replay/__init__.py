"""Replaying recorded runs; without ROS."""
