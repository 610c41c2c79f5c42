"""The modules of the package, parsed once for all tests of a process."""

import ast
from functools import cache
from pathlib import Path

import impact_damper_ros

PACKAGE = Path(impact_damper_ros.__file__).parent


@cache
def trees():
    """Return the syntax tree of each module by its path within the package."""
    paths = sorted(PACKAGE.rglob('*.py'))
    return {path.relative_to(PACKAGE): ast.parse(path.read_text('utf-8')) for path in paths}
