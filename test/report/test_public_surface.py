"""What the report exports is there."""

import pytest

from impact_damper_ros import report


def test_all_names_are_there():
    for name in report.__all__:
        assert getattr(report, name).__name__ == name
    with pytest.raises(AttributeError, match='no attribute'):
        _ = report.nothing
