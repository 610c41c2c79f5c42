"""A number out of its range is refused by name and value before anything is made."""

import math
from functools import partial

import pytest

from impact_damper_ros import (
    GapControlParameters,
    Rig,
    RigParameters,
    find_orbits,
    find_period,
    fit_rig,
    fit_structure,
    follow,
    orbit_near,
    plausible_stops,
    read_motion,
    ring_down,
    run,
    run_flights,
    settle,
    switch_branch,
    transmissibility,
    value_of,
    with_value,
)
from impact_damper_ros.bag import RigRecorder

LEVEL = RigParameters(gravity=0.0)
RECORDER = partial(RigRecorder, 'bag', Rig(LEVEL), {})
BEYOND = (math.nan, math.inf, -math.inf, 10**400, -(10**400))

#: What is called, the argument, and values out of its range.
RANGES = [
    (partial(RECORDER, duration=1.0), 'rate', (*BEYOND, 0.0, -1.0)),
    # Without an end it is inf.
    (partial(RECORDER, rate=9.0), 'duration', (math.nan, -math.inf, 10**400, -1.0)),
]


@pytest.mark.parametrize(('call', 'name', 'values'), RANGES)
def test_ranges(call, name, values, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for value in values:
        words = rf'{name}.* is .*[:;] (give|it must be)|{name} is empty'
        with pytest.raises(ValueError, match=words):
            call(**{name: value})
    assert list(tmp_path.iterdir()) == []


EXTERNAL = GapControlParameters(gap_control='external')

#: Calls with an argument of another kind, what is reported of it, and what to give.
KINDS = [
    (lambda: settle(LEVEL), 'rig is RigParameters', 'a Rig, such as'),
    (lambda: run(LEVEL, 3.0), 'rig is RigParameters', 'a Rig, such as'),
    (lambda: run_flights(LEVEL, 3.0), 'rig is RigParameters', 'a Rig, such as'),
    (lambda: follow(LEVEL, 'gap', 30.0, 40.0), 'orbit is RigParameters', 'a PeriodicOrbit'),
    (lambda: transmissibility(3), 'orbit is 3', 'a PeriodicOrbit'),
    (lambda: switch_branch(3, 'gap', 30.0, 40.0), 'special is 3', 'a SpecialPoint'),
    (lambda: find_orbits(3, (1, 2)), 'parameters is 3', 'RigParameters, such as'),
    (lambda: ring_down(Rig(LEVEL), 1.0), 'parameters is <Rig', 'RigParameters, such as'),
    (lambda: plausible_stops(3, 2), 'parameters is 3', 'RigParameters, such as'),
    (lambda: value_of(3, 'gap'), 'parameters is 3', 'RigParameters, such as'),
    (lambda: orbit_near(LEVEL, 3, 0.0, 1), 'impact is 3', 'an Event'),
    (lambda: find_period(3, 1e-9), 'section is 3', 'a Section'),
    (lambda: fit_rig('run.csv', LEVEL), "measured is 'run.csv'", 'a MeasuredMotion, such as'),
    (lambda: fit_structure('run.csv'), "data is 'run.csv'", 'a MeasuredMotion, such as'),
    (lambda: read_motion(3), 'path is 3', 'the path of'),
    (lambda: read_motion('run.csv', 3), 'options is 3', 'ReadingOptions'),
    (lambda: Rig(3), 'parameters is 3', 'RigParameters, such as'),
    (lambda: Rig(LEVEL, 3), 'initial is 3', 'InitialConditions'),
    (lambda: Rig(LEVEL).reset(3), 'initial is 3', 'InitialConditions'),
    (lambda: Rig(LEVEL, control=3), 'control is 3', 'GapControlParameters'),
    (lambda: Rig(LEVEL, records=[3]), 'records is 3', 'a sequence of MeasuredRecord'),
    (lambda: Rig(LEVEL).change(3), 'parameters is 3', 'RigParameters, such as'),
    (lambda: Rig(LEVEL, control=EXTERNAL).order(3), 'order is 3', 'an Order'),
]


@pytest.mark.parametrize(('call', 'given', 'wanted'), KINDS)
def test_kinds(call, given, wanted):
    with pytest.raises(TypeError) as error:
        call()
    assert given in str(error.value)
    assert f': give {wanted}' in str(error.value)


#: Calls with a number that cannot be, and its name.
NUMBERS = [
    (lambda: ring_down(LEVEL, 'x'), 'amplitude'),
    (lambda: ring_down(LEVEL, 1.0, releases=2.5), 'releases'),
    (lambda: settle(Rig(LEVEL), cycles='x'), 'cycles'),
    (lambda: plausible_stops(LEVEL, 2.5), 'impacts'),
    (lambda: with_value(LEVEL, 'gapp', 3.0), "'gapp'"),
    (lambda: follow(find_orbits(LEVEL, (1, 2))[0], 'gap', [1], 40.0), 'low'),
]


@pytest.mark.parametrize(('call', 'name'), NUMBERS)
def test_numbers(call, name):
    with pytest.raises(ValueError, match=rf'^{name} (is|cannot)'):
        call()
