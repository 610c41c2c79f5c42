"""What README.md states of the commands is what they print."""

from pathlib import Path

import impact_damper_ros
from impact_damper_ros.commands.simulate_rig import parameter_table

README = Path(impact_damper_ros.__file__).parents[1] / 'README.md'


def test_parameter_table_is_current():
    assert parameter_table() in README.read_text(encoding='utf-8')
