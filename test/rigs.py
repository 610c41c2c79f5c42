"""The rigs that tests of several folders use."""

import math
from pathlib import Path
from runpy import run_path

from impact_damper_ros import RigParameters

HORIZONTAL = RigParameters(gravity=0.0)
OFF_RESONANCE = HORIZONTAL.replace(force_frequencies=(1.02,))
#: The golden motions of two impacts per cycle at 45 degrees, without and with friction
INCLINED = RigParameters(angle=math.pi / 4, gravity=1.0, force_frequencies=(1.02,))
FRICTION = INCLINED.replace(friction=0.5)
#: The last example of the paper: one stop, below m
VERTICAL = RigParameters(
    damping=0.1,
    damper_mass=0.01,
    angle=math.pi / 2,
    gravity=1.0,
    one_sided=True,
    force_amplitudes=(0.8,),
    force_frequencies=(10.0,),
)
#: The rig of config/bench_rig.yaml
BENCH = RigParameters(
    primary_mass=2.0,
    stiffness=1974.0,
    damping=1.26,
    damper_mass=0.1,
    gap=0.024,
    restitution_1=0.6,
    restitution_2=0.6,
    friction=0.02,
    force_amplitudes=(1.2,),
    force_frequencies=(31.416,),
)
#: 5 Hz, with impacts from the first second on
LIVELY = RigParameters(
    stiffness=1000.0,
    damping=0.6,
    damper_mass=0.1,
    gap=0.01,
    force_amplitudes=(10.0,),
    force_frequencies=(31.6,),
)
#: Without a force of its own: for records, or a base that moves
UNFORCED = BENCH.replace(friction=0.0, force_amplitudes=0.0, force_frequencies=1.0)
#: M is still: m moves as a free body until it touches something.
STILL = RigParameters(
    primary_mass=1e9, stiffness=1e9, damper_mass=1.0, gap=10.0, gravity=0.0, force_amplitudes=[0.0]
)
#: A structure of 5 kg, 10 Hz and 2 % with a damper, on a table at 0.2 g
TABLE = RigParameters.of_structure(
    primary_mass=5.0,
    natural_frequency=10.0,
    damping_ratio=0.02,
    mass_ratio=0.05,
    gap=0.018,
    restitution_1=0.6,
    restitution_2=0.6,
    force_amplitudes=0.0,
    base_amplitudes='0.2 g',
    base_frequencies='10 Hz',
)
#: The rig that examples/twin measures
TWIN = run_path(str(Path(__file__).parents[1] / 'examples' / 'twin' / 'measure.py'))['TRUE']
