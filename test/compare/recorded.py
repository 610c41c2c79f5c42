"""Stretches of simulated runs as a replay has them."""

import math

import numpy as np

from impact_damper_ros import InitialConditions, Rig
from impact_damper_ros.compare.result import Beginning
from impact_damper_ros.compare.stretches import LoggedRig, StretchBuilder
from impact_damper_ros.compare.verdict import compare_stretch

DISPLACED = InitialConditions(initial_primary_position=1.0)


def simulated(parameters, cycles, initial=DISPLACED, per_cycle=40, after=0.0):
    """
    Return the state at the start, samples and events of a run, and the state at its end.

    Before it the rig runs for some seconds under a slower force.
    """
    slower = tuple(0.9 * rate for rate in parameters.force_frequencies)
    rig = Rig(parameters.replace(force_frequencies=slower) if after else parameters, initial)
    if after:
        rig.advance(after)
        rig.change(parameters)
    rate = next(filter(None, (*parameters.force_frequencies, parameters.omega)))
    cycle = math.tau / rate
    steps = np.arange(round(cycles * per_cycle) + 1) * cycle / per_cycle
    instants = np.round((after + steps) * 1e9) / 1e9
    start = rig.snapshot()
    result = rig.run(float(instants[-1]), instants)
    return start, result.samples, result.events, rig.snapshot()


def built(rig, samples, events, at_end=None, *, part=3000, start=0.0, **options):
    """Return a stretch as it is read, part by part."""
    builder = StretchBuilder(1, Beginning.START, 'start of the bag', start, rig, **options)
    done = 0
    for begin in range(0, len(samples), part):
        some = samples[begin : begin + part]
        until = int(np.searchsorted(events['time'], some['time'][-1], side='right'))
        builder.take(some, events[done:until])
        done = until
    return builder.finish(at_end=at_end)


def replayed(parameters, cycles, initial=DISPLACED, per_cycle=40, **options):
    """Return a stretch of a run that was replayed."""
    start, samples, events, end = simulated(parameters, cycles, initial, per_cycle)
    rig = LoggedRig(parameters, state=start)
    return built(rig, samples, events, end, **options)


def compared(parameters, cycles, initial=DISPLACED, per_cycle=40):
    """Return what comes out of comparing a simulated run with theory."""
    return compare_stretch(replayed(parameters, cycles, initial, per_cycle))
