"""What README.md states of the commands is what they print."""

from pathlib import Path

import impact_damper_ros
from impact_damper_ros.commands.simulate_rig import parameter_table
from impact_damper_ros.control import GAP_CONTROL_SPECS
from impact_damper_ros.rig import INITIAL_SPECS, PARAMETER_SPECS

README = Path(impact_damper_ros.__file__).parents[1] / 'README.md'


def test_parameter_tables_are_current():
    text = README.read_text(encoding='utf-8')
    assert parameter_table(PARAMETER_SPECS, INITIAL_SPECS) in text
    assert parameter_table(GAP_CONTROL_SPECS) in text
