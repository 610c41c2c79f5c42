"""
Generate `reference.json`: run `python -m oracle.make_reference` in the directory `test`.

Every run is repeated with all its inputs changed by 1e-25, relative, with random signs; the growth
of these changes is the condition of each event.
"""

from __future__ import annotations

import json
import math
import random
import time
from collections.abc import Mapping
from typing import Any

from oracle.hybrid_oracle import DEFAULTS, HybridMotion, OracleEvent
from oracle.precise_motion import mp
from oracle.reference import PATH, kept

CHANGE = mp.mpf(10) ** -25
REPEATS = 3
CHAOS = 1e9
DIGITS = 30


def rig(name: str, events: int = 40, floor: float = 0.0, **params: Any) -> dict[str, Any]:
    """Return the description of a run; names that start with initial_ are initial conditions."""
    initial = {k: params.pop(k) for k in list(params) if k.startswith('initial_')}
    duration = params.pop('duration', 400.0)
    return {
        'name': name,
        'params': params,
        'initial': initial,
        'duration': duration,
        'events': events,
        'floor': floor,
    }


VERTICAL: dict[str, Any] = {
    'angle': math.pi / 2,
    'one_sided': True,
    'gravity': 1.0,
    'damping': 0.1,
    'damper_mass': 0.01,
}
SLOPE: dict[str, Any] = {'angle': math.pi / 4, 'gravity': 1.0, 'force_frequencies': (1.02,)}
SHAKEN: dict[str, Any] = {
    **VERTICAL,
    'force_amplitudes': (0.6,),
    'force_frequencies': (1.5,),
    'gap': 8.0,
}
SMALL: dict[str, Any] = {
    'gap': 1.0,
    'damping': 0.1,
    'force_amplitudes': (0.5,),
    'force_frequencies': (0.85,),
}
# The beat of two harmonics starts from nothing: m comes to rest first and is thrown off later.
BEATING: dict[str, Any] = {
    **VERTICAL,
    'gap': 0.5,
    'force_amplitudes': (0.35, 0.35),
    'force_frequencies': (1.5, 1.51),
    'force_phases': (0.0, math.pi),
}
RIGS = [
    rig('golden, resonance', 61),
    rig('golden, inclined', 45, **SLOPE),
    rig('golden, inclined with friction', 60, **SLOPE, friction=0.5),
    rig('next to resonance', 40, force_frequencies=(1.0000001,)),
    rig('short of resonance', 40, force_frequencies=(0.95,), initial_primary_position=8.0),
    rig('friction and sticking', 60, friction=0.04, gap=10.0, gravity=9.81),
    rig('friction near the limit of motion', 60, friction=0.09, gap=4.0, damping=0.1),
    rig('inclined, negative angle', 45, angle=-0.5, gravity=1.0, friction=0.1, gap=12.0),
    rig('rest on the lower stop, 20 degrees', 60, 1e-4, angle=math.radians(20), **SMALL),
    rig(
        'rest on the upper stop, -20 degrees',
        45,
        1e-5,
        angle=-math.radians(20),
        friction=0.1,
        **SMALL,
    ),
    rig('chatter, R=0', 40, **SHAKEN, restitution_1=0.0),
    rig('chatter, R=0.3', 60, 1e-6, **SHAKEN, restitution_1=0.3),
    rig('chatter, R=0.6', 60, 1e-4, **SHAKEN, restitution_1=0.6),
    rig('chatter, R=0.9', 90, 1e-2, **BEATING, restitution_1=0.9),
    rig(
        'chatter with friction',
        60,
        1e-4,
        angle=0.6,
        gravity=1.0,
        friction=0.2,
        gap=4.0,
        damping=0.2,
        restitution_1=0.7,
        force_amplitudes=(0.5,),
        force_frequencies=(0.6,),
    ),
    rig(
        'vertical, one-sided, high frequency',
        40,
        **VERTICAL,
        gap=0.2,
        force_amplitudes=(0.8,),
        force_frequencies=(10.0,),
    ),
    rig('air force', 40, air_force=0.004, gap=20.0),
    rig('air force, inclined with friction', 45, 1e-5, **SLOPE, friction=0.3, air_force=0.01),
    rig('air force on a rig at rest', 45, 1e-5, **SHAKEN, restitution_1=0.5, air_force=0.002),
    rig('unequal restitution', 40, restitution_1=0.9, restitution_2=0.4, gap=25.0),
    rig(
        'two harmonics',
        40,
        force_amplitudes=(1.0, 0.6),
        force_frequencies=(1.0, 2.7),
        force_phases=(0.3, -1.1),
    ),
    rig(
        'five harmonics with friction',
        60,
        friction=0.03,
        gap=12.0,
        damping=0.05,
        force_amplitudes=(0.9, 0.5, 0.4, 0.3, 0.2),
        force_frequencies=(0.7, 1.0, 1.3, 2.1, 3.4),
        force_phases=(0.1, 1.2, 2.3, 3.4, 4.5),
    ),
    rig('undamped, at resonance', 40, damping=0.0, force_amplitudes=(0.2,)),
    rig('undamped, off resonance', 40, damping=0.0, force_frequencies=(1.3,), gap=4.0),
    rig('heavily damped', 40, damping=1.2, gap=1.2),
    rig('large gap', 24, gap=400.0, duration=2000.0, initial_damper_velocity=9.0),
    rig(
        'bench rig of 5 Hz',
        40,
        primary_mass=2.0,
        stiffness=2000.0,
        damping=1.5,
        damper_mass=0.1,
        gap=0.03,
        friction=0.02,
        angle=0.1,
        force_amplitudes=(10.0,),
        force_frequencies=(31.0,),
        restitution_1=0.6,
        restitution_2=0.65,
        initial_primary_position=0.002,
        initial_primary_velocity=-0.1,
        initial_damper_offset=0.01,
        initial_damper_velocity=0.2,
    ),
    rig(
        'start on a stop',
        40,
        gap=10.0,
        initial_damper_offset=5.0,
        initial_primary_velocity=3.0,
        initial_primary_position=-2.0,
        restitution_1=1.0,
    ),
    rig(
        'attractor of four impacts',
        60,
        gap=8.0,
        force_frequencies=(1.02,),
        gravity=0.0,
        initial_primary_position=1.0,
    ),
]


def changed(value: Any, rng: random.Random) -> Any:
    """Return a number, or a tuple of numbers, with a small relative change."""
    if isinstance(value, bool):
        return value
    if isinstance(value, tuple | list):
        return tuple(changed(v, rng) for v in value)
    return mp.mpf(value) * (1 + CHANGE * rng.choice((-1, 1)))


def run_changed(description: Mapping[str, Any], seed: int) -> HybridMotion:
    """Run a rig with all inputs changed."""
    rng = random.Random(seed)
    params = {k: changed(v, rng) for k, v in {**DEFAULTS, **description['params']}.items()}
    initial = {k: changed(v, rng) for k, v in description['initial'].items()}
    offset = description['initial'].get('initial_damper_offset', 0.0)
    if abs(offset) == description['params'].get('gap', DEFAULTS['gap']) / 2:
        initial['initial_damper_offset'] = mp.sign(offset) * params['gap'] / 2
    return limited(description, params, initial)


def limited(
    description: Mapping[str, Any], params: Mapping[str, Any], initial: Mapping[str, Any]
) -> HybridMotion:
    """Run until enough events above the floor are there."""
    motion, end = HybridMotion(params, initial), mp.mpf(description['duration'])
    while len(motion.events) < description['events'] and motion.advance(end):
        pass
    while len(chosen(motion.events, description['floor'])) < description['events']:
        if not all(motion.advance(end) for _ in range(10)):
            break
    return motion


def chosen(events: list[OracleEvent], floor: float) -> list[OracleEvent]:
    """Return the events without the impacts below the floor."""
    speeds = [abs(e.damper_velocity_before - e.primary_velocity_before) for e in events]
    mask = kept([e.kind for e in events], speeds, floor)
    return [e for e, keep in zip(events, mask, strict=True) if keep]


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


def reference(description: Mapping[str, Any]) -> dict[str, Any]:
    """Return the entry of one run."""
    params, initial, floor = description['params'], description['initial'], description['floor']
    motion = limited(description, params, initial)
    events = chosen(motion.events, floor)[: description['events']]
    others = [run_changed(description, seed) for seed in range(REPEATS)]
    lists = [chosen(other.events, floor)[: len(events)] for other in others]
    for changed_events in lists:
        kinds = [[(e.kind, e.stop) for e in q] for q in (events, changed_events)]
        if kinds[0] != kinds[1]:
            raise ArithmeticError(f'{description["name"]}: a change of 1e-25 changes the events')
    rows: list[list[Any]] = []
    worst, worst_state = mp.mpf(1), mp.mpf(1)
    x_scale = max(abs(e.x) for e in events)
    v_scale = max(abs(v) for e in events for v in state_of(e)[1:])
    scales = (x_scale, v_scale, v_scale, v_scale, v_scale)
    for k, event in enumerate(events):
        for moved_event in (q[k] for q in lists):
            if event.time:
                worst = max(worst, abs(moved_event.time - event.time) / (CHANGE * event.time))
            moved = zip(state_of(event), state_of(moved_event), scales, strict=True)
            worst_state = max(worst_state, *(abs(a - b) / (CHANGE * s) for a, b, s in moved))
        if worst > CHAOS:
            break
        rows.append(
            [
                event.kind,
                event.stop,
                digits(event.time),
                *map(digits, state_of(event)),
                float(mp.nstr(worst, 4)),
                float(mp.nstr(worst_state, 4)),
            ]
        )
    states = []
    end = float(rows[-1][2])
    for k in range(8):
        instant = end * (k + 0.437) / 8
        values = motion.state(instant)
        worst_state = mp.mpf(1)
        for other in others:
            moved = zip(
                values, other.state(instant), (x_scale, v_scale, x_scale, v_scale), strict=True
            )
            worst_state = max(worst_state, *(abs(a - b) / (CHANGE * s) for a, b, s in moved))
        states.append([instant, *map(digits, values), float(mp.nstr(worst_state, 4))])
    return {
        'name': description['name'],
        'params': params,
        'initial': initial,
        'duration': description['duration'],
        'floor': floor,
        'x_scale': float(x_scale),
        'v_scale': float(v_scale),
        'events': rows,
        'states': states,
    }


def main() -> None:
    """Write the file."""
    runs = []
    for description in RIGS:
        begin = time.perf_counter()
        entry = reference(description)
        count: dict[str, int] = {}
        for row in entry['events']:
            count[row[0]] = count.get(row[0], 0) + 1
        last = entry['events'][-1]
        print(
            f'{entry["name"]:40s} {count}  until {float(last[2]):.1f}  condition {last[8]:.1e}'
            f'  {time.perf_counter() - begin:.1f} s'
        )
        runs.append(entry)
    # One event per line.
    lines = [f'{{"digits": {DIGITS},', ' "runs": [']
    for k, entry in enumerate(runs):
        head = {key: value for key, value in entry.items() if key not in ('events', 'states')}
        lines.append('  ' + json.dumps(head)[:-1] + ',')
        for key in ('events', 'states'):
            rows = ',\n    '.join(json.dumps(row) for row in entry[key])
            lines.append(f'   "{key}": [\n    {rows}]' + (',' if key == 'events' else ''))
        lines.append('  }' + (',' if k < len(runs) - 1 else ''))
    text = '\n'.join([*lines, ' ]}', ''])
    json.loads(text)
    PATH.write_text(text, encoding='utf-8')


if __name__ == '__main__':
    main()
