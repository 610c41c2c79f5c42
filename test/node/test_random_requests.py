"""Random requests over DDS: what ROS shows, the rig, and the recorded events always agree."""

import math
import random

from hypothesis import settings
from rcl_interfaces.msg import Parameter as ParameterMessage, ParameterEvent, ParameterValue
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile

from impact_damper_ros.bag import RunReader
from impact_damper_ros.bag.messages import PARAMETER_EVENT, decode
from impact_damper_ros.parameters.all_parameters import ALL_SPECS
from node.rig_client import LIVELY

#: How many; with --hypothesis-profile=search the second.
FEW, MANY = 30, 2000
#: Numbers that no rig of these runs away from.
MODEST = {
    'gap': (0.004, 0.02),
    'stiffness': (500.0, 2000.0),
    'damping': (0.1, 70.0),
    'restitution_1': (0.0, 0.9),
    'restitution_2': (0.0, 0.9),
    'friction': (0.0, 0.3),
    'angle': (-0.3, 0.3),
    'force_amplitudes': (-20.0, 20.0),
    'force_frequencies': (0.0, 60.0),
    'force_phases': (-3.0, 3.0),
    'base_amplitudes': (-1.0, 1.0),
    'base_frequencies': (0.0, 60.0),
    'base_phases': (-3.0, 3.0),
    'gap_min': (0.001, 0.02),
    'gap_max': (0.002, 0.04),
    'initial_damper_offset': (-0.01, 0.01),
    'gap_control_gain': (0.5, 1.5),
}
OTHERS = {
    'record': (True, False),
    'gap_control': ('off', 'amplitude', 'timed'),
    'one_sided': (True, False),
    'base_quantity': ('displacement', 'velocity', 'acceleration'),
    'real_time_factor': (4.0, 8),
    'gap': ('12 mm', 1, '0.o12', True, [0.01], -1.0, math.nan, 1e10, None),
    'friction': (0, '0.25', 'rough', None),
    'force_phases': (0.5, '[0.1, 0.2]', [], ['a'], None),
    'use_sim_time': (False, True, ''),
    # Fixed, one by the node and one by rclpy: the present value, and others
    'state_rate': (200.0, 200, 100.0, 'fast'),
    'start_type_description_service': (True, False, 1),
    'lock_step': ('off', 'both'),
    'stifness': (1.0,),
    'mass_ratio': (0.05,),
}


def drawn(draw):
    """Return a name and a value, good or bad."""
    if draw.random() < 0.3:
        name = draw.choice(list(OTHERS))
        return name, draw.choice(OTHERS[name])
    name = draw.choice(list(MODEST))
    count = draw.randint(1, 3) if ALL_SPECS[name].kind == 'double_array' else 0
    values = [draw.uniform(*MODEST[name]) for _ in range(count or 1)]
    return name, values if count else values[0]


def message(name, value):
    if value is None:
        return ParameterMessage(name=name, value=ParameterValue())
    return Parameter(name, value=value).to_parameter_msg()


def plain(value):
    return list(value) if hasattr(value, '__len__') and not isinstance(value, str) else value


def shown(rig):
    names = rig.parameters.names()
    return dict(zip(names, map(plain, rig.parameters.get(*names)), strict=True))


def of_the_rig(rig):
    """Return the parameters of the last snapshot."""
    state = rig.snapshots()[-1]
    held = {**state['state']['parameters'], **state['initial']}
    return held | state['state']['gap_control']['parameters']


def ask(rig, kind, given):
    """Make a request; return whether each value was taken."""
    parameters = [message(*pair) for pair in given.items()]
    if kind == 'atomic':
        answer = rig.parameters.service('set_parameters_atomically', parameters=parameters)
        results = [answer.result] * len(given)
    else:
        results = rig.parameters.service('set_parameters', parameters=parameters).results
    assert all(result.successful or result.reason for result in results)
    return dict(zip(given, (result.successful for result in results), strict=True))


def test_parameters_rig_and_events_agree_after_random_requests(start):
    draw = random.Random(7)
    count = FEW if settings.default.max_examples < 100 else MANY
    rig = start(record=True, **{**LIVELY, 'real_time_factor': 4.0})
    published = rig.client.listen(ParameterEvent, '/parameter_events', QoSProfile(depth=1000))
    rig.until(lambda: rig.snapshots())
    now, taken = shown(rig), 0
    followed = dict(now)
    for _ in range(count):
        kind = draw.choice(('single', 'list', 'atomic'))
        given = dict(drawn(draw) for _ in range(1 if kind == 'single' else draw.randint(1, 6)))
        before, now, snapshots = now, None, len(rig.snapshots('change'))
        accepted = ask(rig, kind, given)
        now = shown(rig)
        assert now.keys() == before.keys()
        if not any(accepted.values()):
            assert now == before, given
            assert len(rig.snapshots('change')) == snapshots
        for name, value in given.items():
            if accepted[name] and name in ALL_SPECS:
                assert now[name] == plain(ALL_SPECS[name].check(value)), given
                taken += now[name] != before[name]
            elif (
                not accepted[name] and ALL_SPECS.get(name, ALL_SPECS['gap']).kind != 'double_array'
            ):
                assert now.get(name) == before.get(name), given
        rig.until(lambda now=now: of_the_rig(rig).items() <= now.items(), lambda g=given: str(g))
        own = [event for event in published if event.node == rig.name]
        for event in own:
            for one in event.changed_parameters:
                followed[one.name] = plain(parameter_value_to_python(one.value))
        published.clear()
        if own:
            assert followed == now, given
    assert taken > count // 3
    rig.change(record=True)
    rig.change(record=False)
    rig.stop()
    # The recordings, one after the other, end with the same values.
    recorded = {}
    for bag in rig.bags():
        for one in RunReader(bag):
            if one.topic == '/parameter_events':
                event = decode(PARAMETER_EVENT, one.content)
                each = (*event.new_parameters, *event.changed_parameters)
                recorded |= {p.name: plain(p.value) for p in each}
    assert recorded == {**now, 'record': False}
