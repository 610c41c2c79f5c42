"""What the library cannot work with is refused by the name of the argument, whatever it is."""

import inspect
import itertools
import math
import re
from functools import partial
from pathlib import Path

import pytest

from impact_damper_ros.bag import (
    QosProfile,
    RigRecorder,
    RunReader,
    RunWriter,
    Topic,
    create_run_directory,
    recover_run,
)
from impact_damper_ros.compare import ForceClock, compare_bag, predicted_curve, predictions
from impact_damper_ros.control import Rig
from impact_damper_ros.orbits import (
    Continuation,
    ImpactEquations,
    continue_orbit,
    find_orbits,
    grow_branch,
    optimal_gap,
    orbit_near,
    plausible_stops,
    switch_branch,
    value_of,
)
from impact_damper_ros.replay import RecordedRun, Replay, WhatIf
from impact_damper_ros.report import (
    WhatIfReport,
    comparison_text,
    findings_json,
    findings_text,
    report_page,
    write_report,
)
from impact_damper_ros.rig import InitialConditions, RigParameters
from impact_damper_ros.sweep import (
    Axis,
    DaskWorkers,
    Journal,
    SweepPlan,
    SweepTable,
    axis_from_text,
    draw_sweep,
    find_optimum,
    journal_path,
    run_sweep,
    summary_of,
    summary_text,
    write_table,
)

LEVEL = RigParameters(gravity=0.0)
START = InitialConditions()
ORBIT = find_orbits(LEVEL, (1, 2)).orbits[0]
CLOCK = ForceClock(LEVEL, 0.0, (0.0,))
TOPICS = [Topic('/text', 'std_msgs/msg/String')]
RIG = Rig(LEVEL)
ALONG = {'along': Continuation('gap', 30.0, 40.0)}

NOTHING = (None, object(), 1j)
NUMBERS = (*NOTHING, 'x', [], {}, [None], math.nan, math.inf, -math.inf, 10**400)
KINDS = (*NOTHING, 'x', 5, math.nan, [], {}, itertools.repeat(1), int)
PATHS = (*NOTHING, 5, math.nan, [], b'x', 'a\0')
TEXTS = (*NOTHING, 5, math.nan, [], b'x')

#: What is called, with what else it takes, the argument, and what that cannot be.
CALLS = [
    (RunReader, {}, 'path', PATHS),
    (RunWriter, {'topics': TOPICS}, 'directory', PATHS),
    (RunWriter, {'directory': 'bag'}, 'topics', (*NOTHING, 5, math.nan, [None], 'x', [1])),
    *(
        (RunWriter, {'directory': 'bag', 'topics': TOPICS}, name, [v for v in NUMBERS if v])
        for name in ('flush_period', 'sync_period', 'queue_limit', 'max_size', 'max_duration')
    ),
    (RunWriter, {'directory': 'bag', 'topics': TOPICS}, 'custom', (5, 'x', {1: 'x'}, {'x': 1})),
    (Topic, {'type': 'std_msgs/msg/String'}, 'name', TEXTS),
    (Topic, {'name': '/text'}, 'type', TEXTS),
    (Topic, {'name': '/text', 'type': 'std_msgs/msg/String'}, 'qos', KINDS),
    (QosProfile, {}, 'depth', (*NUMBERS, 0, -1, 2.5, 2**31)),
    (QosProfile, {}, 'reliability', KINDS),
    (create_run_directory, {}, 'parent', PATHS),
    (create_run_directory, {'parent': 'runs'}, 'when', [v for v in NUMBERS if v is not None]),
    (recover_run, {}, 'source', PATHS),
    (recover_run, {'source': 'bag'}, 'output', [v for v in PATHS if v is not None]),
    (partial(RigRecorder, 'bag'), {'parameters': {}, 'rate': 9.0, 'duration': 1.0}, 'rig', KINDS),
    (partial(RigRecorder, 'bag', RIG), {'rate': 9.0, 'duration': 1.0}, 'parameters', NUMBERS[:5]),
    (partial(RigRecorder, 'bag', RIG, {}), {'duration': 1.0}, 'rate', NUMBERS),
    (partial(RigRecorder, 'bag', RIG, {}), {'rate': 9.0}, 'duration', NUMBERS),
    (partial(RigRecorder, 'bag', RIG, {}, 9.0, 1.0), {}, 'node', TEXTS),
    (compare_bag, {}, 'path', PATHS),
    (compare_bag, {'path': 'bag'}, 'node', TEXTS[1:]),
    (compare_bag, {'path': 'bag'}, 'parameters', KINDS[1:]),
    (compare_bag, {'path': 'bag'}, 'progress', NUMBERS),
    (predictions, {}, 'rig', (LEVEL, *KINDS)),
    (predictions, {'rig': RIG}, 'measured', KINDS[1:]),
    (ForceClock, {'time': 0.0, 'angles': (0.0,)}, 'parameters', KINDS),
    (ForceClock, {'parameters': LEVEL, 'angles': (0.0,)}, 'time', NUMBERS),
    (ForceClock, {'parameters': LEVEL, 'time': 0.0}, 'angles', (*NUMBERS, (math.nan,))),
    (predicted_curve, {'orbit': ORBIT, 'period': None, 'time': 0.0}, 'clock', KINDS),
    (predicted_curve, {'clock': CLOCK, 'period': None, 'time': 0.0}, 'orbit', KINDS),
    (predicted_curve, {'clock': CLOCK, 'orbit': ORBIT, 'time': 0.0}, 'period', KINDS[1:]),
    (predicted_curve, {'clock': CLOCK, 'orbit': ORBIT, 'period': None}, 'time', NUMBERS),
    (find_orbits, {'stops': (1, 2)}, 'parameters', KINDS),
    (ImpactEquations, {'stops': (1, 2), 'cycles': 1}, 'parameters', KINDS),
    (continue_orbit, ALONG, 'orbit', KINDS),
    (grow_branch, ALONG, 'orbit', KINDS),
    (switch_branch, ALONG, 'special', KINDS),
    (optimal_gap, {}, 'rig', KINDS),
    (optimal_gap, {'rig': LEVEL}, 'stops', KINDS),
    (plausible_stops, {'impacts': 2}, 'parameters', KINDS),
    (value_of, {'name': 'gap'}, 'parameters', KINDS),
    (orbit_near, {'impact': None, 'phase': 0.0, 'cycles': 1}, 'parameters', KINDS),
    (orbit_near, {'parameters': LEVEL, 'phase': 0.0, 'cycles': 1}, 'impact', KINDS),
    (RecordedRun, {}, 'path', PATHS),
    (RecordedRun, {'path': 'bag'}, 'node', TEXTS[1:]),
    (RecordedRun, {'path': 'bag'}, 'purpose', TEXTS),
    (Replay, {}, 'recorded', KINDS),
    (WhatIf, {'initial': None, 'held': {}}, 'start', KINDS),
    (WhatIfReport, {'held': {}, 'held_initial': {}, 'drawn': False}, 'replay', KINDS),
    (comparison_text, {}, 'comparison', KINDS),
    (report_page, {}, 'comparison', KINDS),
    (write_report, {'directory': 'report'}, 'comparison', KINDS),
    (findings_text, {'recorded': None}, 'findings', KINDS),
    (findings_json, {'recorded': None}, 'findings', KINDS),
    (Axis, {'values': (1.0, 2.0)}, 'parameters', (*KINDS, [None])),
    (Axis, {'parameters': axis_from_text('gap=1:2:2', LEVEL).parameters}, 'values', NUMBERS),
    (axis_from_text, {'text': 'gap=1:2:2'}, 'rig', KINDS),
    *(
        (partial(SweepPlan, LEVEL, START, (axis_from_text('gap=1:2:2', LEVEL),)), {}, name, KINDS)
        for name in ('follow', 'settling', 'control')
    ),
    (partial(SweepPlan, LEVEL, START), {}, 'axes', KINDS),
    (partial(SweepPlan, LEVEL), {'axes': ()}, 'initial', KINDS),
    (SweepPlan, {'initial': START, 'axes': ()}, 'parameters', KINDS),
    (Journal, {'inputs': {}}, 'path', PATHS),
    (Journal, {'path': Path('journal')}, 'inputs', KINDS[:3]),
    (SweepTable, {}, 'path', PATHS),
    (journal_path, {}, 'output', PATHS),
    (run_sweep, {'journal': None, 'executor': None}, 'plan', KINDS),
    (write_table, {'journal': None, 'path': 'a.csv'}, 'plan', KINDS),
    (find_optimum, {'measure': 'x_max'}, 'table', KINDS),
    (draw_sweep, {'measure': 'x_max', 'optimum': None, 'path': 'a.png'}, 'table', KINDS),
    (summary_of, {'optimum': None}, 'table', KINDS),
    (summary_text, {'path': Path('a.csv')}, 'summary', KINDS),
    (DaskWorkers, {}, 'address', TEXTS),
]


def identity(call):
    function, _, name, _ = call
    while isinstance(function, partial):
        function = function.func
    return f'{function.__name__}-{name}'


def outcome(function, **arguments):
    """Call a function, and go through what it yields."""
    made = function(**arguments)
    if inspect.isgenerator(made):
        list(made)


@pytest.mark.parametrize('call', CALLS, ids=identity)
def test_what_is_no_such_argument(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    function, others, name, values = call
    for value in values:
        with pytest.raises((TypeError, ValueError)) as refused:
            outcome(function, **others, **{name: value})
        # By name and value, or as what it is of its kind
        singular = name.removesuffix('s')
        words = rf'{singular}|sequence|definition|axis|nothing is varied|gives? '
        assert re.search(words, str(refused.value)), (value, refused.value)
        assert not re.match(r"'\w+' object|unsupported operand", str(refused.value)), value
    assert list(tmp_path.iterdir()) == []
