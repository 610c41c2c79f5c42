"""What a law adds to the controller: its name, its state, and what the numbers of that are."""

import json
from dataclasses import asdict

from impact_damper_ros.control.controller import LAWS, Controller
from impact_damper_ros.rig import GAP_CONTROL_SPECS


def test_the_controller_has_every_law_that_the_parameter_names():
    assert ('off', *LAWS) == GAP_CONTROL_SPECS['gap_control'].choices
    assert set(LAWS.values()) <= set(Controller().parts())


def test_the_kind_of_every_number_is_known():
    """Rigs nearby differ in these; whole numbers and the energies spent do not count."""
    known = {'energies', 'missed'}
    for part in Controller().parts().values():
        numbers = {n for n, value in asdict(part).items() if isinstance(value, float | list)}
        assert numbers - known <= set(part.KINDS)
        assert set(part.KINDS) <= set(asdict(part))


def test_the_state_goes_through_json():
    controller = Controller(sample_index=3, roused=True)
    controller.actuators.settle(2.0)
    controller.observer.last = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]
    stored = json.loads(json.dumps(controller.as_dict()))
    assert Controller.from_dict(stored) == controller
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
