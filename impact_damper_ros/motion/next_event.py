# SPDX-License-Identifier: Apache-2.0
"""
The next event of a flight, or the next passage of X through zero, as far as a run is to go.

A flight is never begun anew to sample, watch or pause it. Hence the motion does not depend on the
sampling rate or on how a run is cut into pieces, to the last bit.
"""

from __future__ import annotations

from collections.abc import MutableSequence
from math import inf

from .first_event import search_on
from .flight import NO_EVENT
from .kernels import kernel
from .state import Moving, Run
from .zero_passage import search_passage

#: The instant was reached.
DONE = 0
#: The table of events is full.
FULL = 1
#: The run has reached its limit of events.
SPENT = 2
#: More events than allowed happen in a period of the fastest of spring and force.
RUNAWAY = 3
#: The search has made the steps after which it pauses.
PAUSED = 4
#: No more commands can wait.
COMMANDS_FULL = 5
#: A law of the user's own has returned invalid positions of stops.
LAW_FAILED = 6
#: A step of the stepped sine is due.
STEP_DUE = 7
#: The run goes on.
GOING = 8

_CYCLE = 6.283185307179586
#: More steps than any search takes.
ALL_STEPS = 2**62
#: Largest relative difference between an instant and the float that stands for it.
TIME_MARGIN = 1e-15
# The tolerance of the search: an event that rounds to the end of a search belongs to that search.
_NEXT = 4.440892098500626e-16


@kernel(inline=True)
def next_event(moving: Moving, until: float) -> bool:
    """Search for the event that ends the flight, up to an instant; return false to pause."""
    run = moving.run
    limit = (until - run.time) - run.time_low + _NEXT * abs(until)
    while run.kind == NO_EVENT and run.searched <= limit:
        if run.steps <= 0 and run.now < until:
            return False
        run.steps -= 1
        search_on(moving)
    return True


@kernel
def next_passage(moving: Moving, until: float) -> bool:
    """Search for the next passage of X through zero, as `next_event` does."""
    run = moving.run
    last = min(until, run.due)
    limit = (last - run.time) - run.time_low + _NEXT * abs(last)
    while True:
        if run.crossing <= run.now:
            # The passage is past: the search began in the middle of a flight.
            run.crossing_side = -run.crossing_side
            run.crossing = inf
        if run.crossing < inf or run.watched > limit:
            return True
        if run.steps <= 0 and run.now < until:
            return False
        run.steps -= 1
        search_passage(moving)


@kernel(inline=True)
def may_go_on(run: Run) -> int:
    """Return `GOING`, or why a run ends before an event that is due."""
    if run.happened >= run.most:
        return SPENT
    if run.in_period >= run.most_in_period:
        return RUNAWAY
    return GOING


@kernel(inline=True)
def count_event(moving: Moving) -> None:
    """Count an event that has been resolved, in the run and in its period."""
    constants, _, run, _, _ = moving
    run.happened += 1
    run.now = max(run.now, run.time)
    if (run.time - run.counted_from) * constants.free.fastest > _CYCLE:
        run.counted_from = run.time
        run.in_period = 0
    run.in_period += 1


@kernel(inline=True)
def count_modes(run: Run, in_mode: MutableSequence[float]) -> None:
    """Add the time since the last count to the time spent in the present mode."""
    since = (run.now - run.time) - run.time_low
    if since > run.counted:
        in_mode[run.mode] += since - run.counted
        run.counted = since
