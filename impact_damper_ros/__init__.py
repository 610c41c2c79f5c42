# SPDX-License-Identifier: Apache-2.0
"""A digital rig of an inclined impact damper with friction, for ROS 2."""

TYPE_CHECKING = False
if TYPE_CHECKING:
    from impact_damper_ros.control import Rig
    from impact_damper_ros.rig import RigParameters

__version__ = '0.2.0'
__all__ = ['Rig', 'RigParameters', '__version__']


def __getattr__(name: str) -> object:
    """Import what takes time at its first use; `typing`, too, would take longer than all else."""
    if name not in ('Rig', 'RigParameters'):
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    from impact_damper_ros.control import Rig
    from impact_damper_ros.rig import RigParameters

    return Rig if name == 'Rig' else RigParameters
