"""What a law adds to the controller: its name, its state, and what the numbers of that are."""

import json
from dataclasses import asdict, fields
from math import nan

import pytest

from control.controlled_rigs import TRIAL, control
from impact_damper_ros.control import GapControlParameters, Rig
from impact_damper_ros.control.controller import (
    LAW_NUMBERS,
    LAW_STATES,
    PARTS,
    Control,
    forget_all,
    initial_state,
)
from impact_damper_ros.control.state import as_stored, read_stored
from impact_damper_ros.rig import GAP_CONTROL_SPECS, RigParameters


def start():
    return Control.of(GapControlParameters(), RigParameters(gap=4.0))


def test_the_controller_has_every_law_that_the_parameter_names():
    assert tuple(LAW_NUMBERS) == GAP_CONTROL_SPECS['gap_control'].choices
    assert LAW_NUMBERS['off'] == 0
    assert set(LAW_STATES) <= set(LAW_NUMBERS)
    assert set(LAW_STATES.values()) <= set(PARTS)
    assert set(PARTS) <= set(start().states())


def test_the_kind_of_every_number_is_known():
    """Rigs nearby differ in these; whole numbers and the energies spent do not count."""
    known = {'energies', 'missed'}
    for name, part in initial_state().items():
        if name in PARTS:
            numbers = {n for n, v in part.items() if v is None or isinstance(v, float | list)}
            assert numbers - known <= set(PARTS[name].KINDS)
            assert set(PARTS[name].KINDS) <= set(part)


@pytest.mark.parametrize('part', PARTS.values())
def test_lists_name_fields_in_a_row(part):
    names = [field.name for field in fields(part)]
    for listed in getattr(part, 'LISTS', {}).values():
        first = names.index(listed[0])
        assert tuple(names[first : first + len(listed)]) == listed


def test_the_state_goes_through_json():
    control = start()
    control.controller.sample_index, control.controller.roused = 3, True
    control.observer.time = 1.0
    for k, name in enumerate(('x', 'x_rate', 'y', 'y_rate', 'stop_1', 'stop_2')):
        setattr(control.observer, name, 2.0 + k)
    text = json.dumps(control.as_dict(), allow_nan=False)
    stored = json.loads(text)
    assert stored['observer']['last'] == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    assert stored['observer']['crossed'] is None
    assert stored['observer']['hit_1'] == stored['timing']['places'] == []
    again = start().restored(stored)
    assert json.dumps(again.as_dict()) == text
    # NaN stands for the same in both
    assert repr(again.states()) == repr(control.states())
    assert list(stored) == [
        'sample_index',
        'trigger_index',
        'observer',
        'search',
        'timing',
        'timed',
        'actuators',
        'roused',
        'returning',
    ]


def test_what_is_forgotten_is_as_at_the_start():
    rig = Rig(TRIAL, control=control('timed'))
    rig.advance(100.0)
    there = rig._control.copied()
    assert repr(there.states()) != repr(start().states())
    forget_all(there)
    # How far the tables are written is nothing to forget.
    there.controller.recorded = there.controller.room = 0
    for name, part in there.states().items():
        if name != 'actuators':
            assert repr(part) == repr(type(part)())


def test_a_state_of_another_shape_is_refused():
    part = as_stored(PARTS['search']())
    with pytest.raises(TypeError, match='missed has 3 entries, not 2'):
        read_stored(PARTS['search'], {**part, 'missed': [0, 0, 0]})
    with pytest.raises(TypeError, match='lost'):
        read_stored(PARTS['search'], {**part, 'lost': 1})
    assert read_stored(PARTS['timing'], {'places': [1.0, 2.0]}).place_2 == 2.0
    assert repr(read_stored(PARTS['timing'], {}).place_1) == repr(nan)
    assert asdict(read_stored(PARTS['timed'], {})) == asdict(PARTS['timed']())
