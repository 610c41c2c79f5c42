"""A digital rig of an inclined impact damper with friction, for ROS 2."""

__version__ = '0.1.0'
