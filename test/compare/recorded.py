"""Stretches as a recording has them, simulated: stamps of impacts on whole nanoseconds."""

import math

import numpy as np

from impact_damper_ros.compare.recorded_stretch import ForceClock, RecordedImpacts, RecordedStates
from impact_damper_ros.compare.result import Beginning
from impact_damper_ros.compare.stretches import LoggedRig, StretchBuilder
from impact_damper_ros.compare.verdict import compare_stretch
from impact_damper_ros.control import Rig
from impact_damper_ros.rig import EventKind, InitialConditions

DISPLACED = InitialConditions(initial_primary_position=1.0)


def impact_rows(events):
    """Return impacts as they are logged."""
    hits = [e for e in events if e.kind is EventKind.IMPACT]
    return RecordedImpacts.of_events([e._replace(time=round(e.time * 1e9) / 1e9) for e in hits])


def recorded(parameters, cycles, initial=DISPLACED, per_cycle=40):
    """Return joint states, impacts and force of a run from its start."""
    rig = Rig(parameters, initial)
    cycle = math.tau / parameters.force_frequencies[0]
    samples, events = [], []
    for k in range(round(cycles * per_cycle) + 1):
        instant = round(k * cycle / per_cycle * 1e9) / 1e9
        events += rig.advance(instant)
        samples.append(rig.sample())
    clock = ForceClock(parameters, 0.0, (0.0,) * len(parameters.force_phases))
    return RecordedStates(*np.array(samples).T), impact_rows(events), clock


def metered(states, impacts, clock, *, part=3000, **options):
    """Return a stretch as it is read, part by part."""
    rig = LoggedRig(clock.parameters, clock)
    builder = StretchBuilder(1, Beginning.START, 'start of the bag', 0.0, rig, **options)
    done = 0
    for begin in range(0, len(states), part):
        some = states[begin : begin + part]
        until = int(np.searchsorted(impacts.time, some.time[-1], side='right'))
        builder.take(some, impacts[done:until])
        done = until
    return builder.finish()


def compared(parameters, cycles, initial=DISPLACED, per_cycle=40):
    """Return what comes out of comparing a simulated run with theory."""
    return compare_stretch(metered(*recorded(parameters, cycles, initial, per_cycle)))
