"""
The rigs that come with the package, by name.

They are the parameters files in config/, which ament, colcon and pip install as
share/impact_damper_ros/config below the prefix of the package.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

__all__ = ['preset_file', 'presets']

_NAME = 'impact_damper_ros'
_PACKAGE = Path(__file__).parents[1]


def _folders() -> Iterator[Path]:
    """Yield where the files may be, the likeliest first."""
    for package in dict.fromkeys((_PACKAGE, _PACKAGE.resolve())):
        # Sources, as they are: a linked installation has no share directory of its own
        if (package.parent / 'resource' / _NAME).is_file():
            yield package.parent / 'config'
        for above in package.parents:
            yield above / 'share' / _NAME / 'config'


def presets() -> dict[str, Path]:
    """Return the parameters file of each preset, by its name; none if they are not installed."""
    for folder in _folders():
        found = {path.stem: path for path in sorted(folder.glob('*.yaml'))}
        if found:
            return found
    return {}


def preset_file(path: Path) -> Path:
    """Return the parameters file of a preset, or the path as it is; an existing file wins."""
    if os.path.exists(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112 - never raise
        return path
    return presets().get(str(path), path)
