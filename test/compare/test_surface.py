"""The public surface of the folder: what other folders import is there, and only that."""

import subprocess
import sys

from impact_damper_ros import compare


def test_every_exported_name_is_there_and_documented():
    for name in compare.__all__:
        assert getattr(compare, name) is not None
        assert getattr(compare, name).__doc__


def test_the_node_predicts_without_what_reads_bags():
    code = """
import sys
from impact_damper_ros.compare import predictions
read = {name for name in sys.modules if name.startswith(('impact_damper_ros.bag', 'mcap'))}
assert not read, read
"""
    subprocess.run([sys.executable, '-c', code], check=True)
