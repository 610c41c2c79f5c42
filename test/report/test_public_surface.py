"""What the report exports is imported on first use only."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import impact_damper_ros
from impact_damper_ros import report

ROOT = Path(impact_damper_ros.__file__).parents[1]


def test_all_names_are_there():
    for name in report.__all__:
        assert getattr(report, name).__name__ == name
    with pytest.raises(AttributeError, match='no attribute'):
        _ = report.nothing


def test_the_folder_itself_loads_nothing():
    code = (
        'import sys; import impact_damper_ros.report; print(sorted(m for m in sys.modules '
        'if m.startswith(("numpy", "matplotlib", "impact_damper_ros.compare"))))'
    )
    done = subprocess.run(
        [sys.executable, '-c', code],
        env={**os.environ, 'PYTHONPATH': str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == '[]'
