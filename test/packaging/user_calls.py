"""What a user of the library writes, for type checkers: `make types`, `make release`."""

from pathlib import Path

import numpy as np

from impact_damper_ros import (
    EventKind,
    GapControlParameters,
    InitialConditions,
    LawInput,
    PeriodicOrbit,
    Rig,
    RigParameters,
    find_orbits,
    follow,
    load_parameters,
    settle,
)
from impact_damper_ros.bag import RunReader
from impact_damper_ros.compare import compare_bag
from impact_damper_ros.replay import RecordedRun, Replay, ReplayVerdict
from impact_damper_ros.sweep import Grid, find_optimum, sweep

rig = RigParameters.of_structure(
    primary_mass=5.0,
    natural_frequency=10.0,
    damping_ratio=0.02,
    mass_ratio=0.05,
    gap=0.02,
    restitution_1=0.6,
    restitution_2=0.6,
)
bench = load_parameters('bench_rig')[0]
narrow: RigParameters = bench.replace(gap=0.012)

live = Rig(bench, InitialConditions(initial_primary_position=0.001))
hits: list[float] = [one.time for one in live.advance(3.0) if one.kind is EventKind.IMPACT]
live.change(narrow, GapControlParameters(gap_control='timed'))
position: float = live.sample().x
kept: dict[str, object] = live.snapshot()
again = Rig.restore(live.snapshot())
ran = again.run(6.0, np.linspace(3.0, 6.0, 10))
times = ran.events['time']


def law(seen: LawInput, memory: object) -> tuple[float, float]:
    return seen.stop_1, -0.01 if memory else seen.stop_2


own = Rig(bench, law=law)

orbits = find_orbits(bench, (2,), cycles=1).orbits
first: PeriodicOrbit = orbits[0]
branch = follow(first, 'gap', 0.02, 0.024)
largest: float = first.x_max
motion = settle(Rig(bench))


def of_a_bag(path: Path) -> bool:
    verdict = Replay(RecordedRun(path)).run().verdict
    reader = RunReader(path)
    print(reader.topics, compare_bag(path).as_dict()['stretches'])
    return verdict is ReplayVerdict.IDENTICAL


def of_many() -> float:
    table = sweep(Grid(bench, gap=np.linspace(0.01, 0.03, 5)))
    optimum = find_optimum(table, 'x_max')
    return optimum.values[0] if optimum is not None else 0.0
