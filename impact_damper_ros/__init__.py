"""A digital rig of an inclined impact damper with friction, for ROS 2."""

import sys

__version__ = '0.1.0'

# So it is while `python -m` looks for its module: signals are taken before the long imports.
if sys.argv[:1] == ['-m']:
    from impact_damper_ros.entry_points import begin_module

    begin_module()
