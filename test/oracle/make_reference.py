"""
Compute the runs that `reference.json` describes anew: `python -m oracle.make_reference` in `test`.

A new run is an entry there with name, params, initial, duration, floor, and as many empty events
as it is to have. Every run is repeated with all its inputs changed by 1e-25, relative, with random
signs; the growth of these changes is the condition of each event.
"""

from __future__ import annotations

import json
import random
import time
from collections import Counter
from collections.abc import Mapping
from typing import Any

from oracle.hybrid_oracle import DEFAULTS, HybridMotion, OracleEvent
from oracle.precise_motion import mp
from oracle.reference import PATH, kept

CHANGE = mp.mpf(10) ** -25
REPEATS = 3
CHAOS = 1e9
DIGITS = 30


def changed(value: Any, rng: random.Random) -> Any:
    """Return a number, or a tuple of numbers, with a small relative change."""
    if isinstance(value, bool):
        return value
    if isinstance(value, tuple | list):
        return tuple(changed(v, rng) for v in value)
    return mp.mpf(value) * (1 + CHANGE * rng.choice((-1, 1)))


def run_changed(described: Mapping[str, Any], seed: int) -> HybridMotion:
    """Run a rig with all inputs changed; m that starts on a stop still does."""
    rng = random.Random(seed)
    params = {k: changed(v, rng) for k, v in {**DEFAULTS, **described['params']}.items()}
    initial = {k: changed(v, rng) for k, v in described['initial'].items()}
    offset = described['initial'].get('initial_damper_offset', 0.0)
    if abs(offset) == described['params'].get('gap', DEFAULTS['gap']) / 2:
        initial['initial_damper_offset'] = mp.sign(offset) * params['gap'] / 2
    return limited(described, params, initial)


def limited(
    described: Mapping[str, Any], params: Mapping[str, Any], initial: Mapping[str, Any]
) -> HybridMotion:
    """Run until enough events above the floor are there."""
    motion, end = HybridMotion(params, initial), mp.mpf(described['duration'])
    while len(chosen(motion.events, described)) < len(described['events']):
        if not all(motion.advance(end) for _ in range(10)):
            break
    return motion


def chosen(events: list[OracleEvent], described: Mapping[str, Any]) -> list[OracleEvent]:
    """Return as many events as asked for, without the impacts below the floor."""
    speeds = [abs(e.damper_velocity_before - e.primary_velocity_before) for e in events]
    mask = kept([e.kind for e in events], speeds, described['floor'])
    found = [e for e, keep in zip(events, mask, strict=True) if keep]
    return found[: len(described['events'])]


def state_of(event: OracleEvent) -> tuple[Any, ...]:
    """Return position and velocities of an event."""
    return (
        event.x,
        event.primary_velocity_before,
        event.primary_velocity_after,
        event.damper_velocity_before,
        event.damper_velocity_after,
    )


def digits(value: Any) -> str:
    """Return a number with 30 significant digits."""
    return str(mp.nstr(value, DIGITS, strip_zeros=False))


def growth(values: Any, moved: Any, scales: Any) -> Any:
    """Return how much larger than the change of the inputs that of some values is."""
    return max(abs(a - b) / (CHANGE * s) for a, b, s in zip(values, moved, scales, strict=True))


def computed(described: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry of one run."""
    motion = limited(described, described['params'], described['initial'])
    others = [run_changed(described, seed) for seed in range(REPEATS)]
    events, *lists = (chosen(one.events, described) for one in (motion, *others))
    for moved in lists:
        if [(e.kind, e.stop) for e in moved] != [(e.kind, e.stop) for e in events]:
            raise ArithmeticError(f'{described["name"]}: a change of 1e-25 changes the events')
    x_scale = max(abs(e.x) for e in events)
    v_scale = max(abs(v) for e in events for v in state_of(e)[1:])
    rows: list[list[Any]] = []
    worst, worst_state = mp.mpf(1), mp.mpf(1)
    for event, *moved in zip(events, *lists, strict=True):
        for other in moved:
            if event.time:
                worst = max(worst, growth([event.time], [other.time], [event.time]))
            scales = (x_scale, *[v_scale] * 4)
            worst_state = max(worst_state, growth(state_of(event), state_of(other), scales))
        if worst > CHAOS:
            break
        conditions = [float(mp.nstr(worst, 4)), float(mp.nstr(worst_state, 4))]
        numbers = map(digits, (event.time, *state_of(event)))
        rows.append([event.kind, event.stop, *numbers, *conditions])
    states = []
    for k in range(8):
        instant = float(rows[-1][2]) * (k + 0.437) / 8
        values, scales = motion.state(instant), (x_scale, v_scale, x_scale, v_scale)
        worst_state = max(growth(values, other.state(instant), scales) for other in others)
        condition = float(mp.nstr(max(worst_state, 1), 4))
        states.append([instant, *map(digits, values), condition])
    scales = {'x_scale': float(x_scale), 'v_scale': float(v_scale)}
    return {**described, **scales, 'events': rows, 'states': states}


def main() -> None:
    """Write the file, one event per line."""
    lines = [f'{{"digits": {DIGITS},', ' "runs": [']
    described = json.loads(PATH.read_text(encoding='utf-8'))['runs']
    for k, one in enumerate(described):
        begin = time.perf_counter()
        entry = computed(one)
        counts = dict(Counter(row[0] for row in entry['events']))
        print(f'{entry["name"]:40s} {counts}  {time.perf_counter() - begin:.1f} s')
        head = {key: value for key, value in entry.items() if key not in ('events', 'states')}
        lines.append('  ' + json.dumps(head)[:-1] + ',')
        for key in ('events', 'states'):
            rows = ',\n    '.join(json.dumps(row) for row in entry[key])
            lines.append(f'   "{key}": [\n    {rows}]' + (',' if key == 'events' else ''))
        lines.append('  }' + (',' if k < len(described) - 1 else ''))
    PATH.write_text('\n'.join([*lines, ' ]}', '']), encoding='utf-8')


if __name__ == '__main__':
    main()
