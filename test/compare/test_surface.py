"""The public surface of the folder: what other folders import is there, and only that."""

from impact_damper_ros import compare


def test_every_exported_name_is_there_and_documented():
    for name in compare.__all__:
        assert getattr(compare, name) is not None
        assert getattr(compare, name).__doc__
