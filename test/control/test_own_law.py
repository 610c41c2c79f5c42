"""Laws of one's own: the same loop, sensors and actuators; and what is wrong with some."""

import json
import math

import pytest

from control import laws
from control.controlled_rigs import IDEAL, TRIAL, amplitude_ratio, control
from impact_damper_ros import Action, GapControlParameters, LawError, OwnLaw, Rig


def follow_rig(**values):
    return Rig(TRIAL, control=control('timed', **values), law=laws.follow)


@pytest.mark.parametrize('values', [{}, {'actuator_delay': 0.3, 'actuator_speed': 20.0}])
def test_it_moves_the_stops_as_the_built_in_law_that_it_copies(values):
    """The symmetric amplitude law, but for its dead band and its search for m."""
    assert amplitude_ratio(follow_rig(**values), 100, 20) < 1.2 * IDEAL
    rig = follow_rig()
    rig.advance(200.0)
    law = control('amplitude', gap_control_stops='symmetric')
    built_in = Rig(TRIAL, control=law)
    built_in.advance(200.0)
    assert rig.stops == pytest.approx(built_in.stops, rel=0.02)
    assert rig.law == 'control.laws:follow'


def test_a_law_may_keep_the_smallest_gap():
    """Wherever m is, though round-off makes that gap a little smaller."""
    rig = Rig(TRIAL, control=control('timed', gap_min=0.3), law=laws.closest)
    rig.advance(30.0)
    assert sum(record.action is Action.COMMAND for record in rig.acts) > 10
    targets = {record.target_1 - record.target_2 for record in rig.acts}
    assert min(targets) == pytest.approx(0.3, rel=1e-12)
    assert len(targets) > 2


def test_its_memory_goes_through_snapshots():
    rig = follow_rig(actuator_speed=20.0)
    rig.advance(100.0)
    held = json.loads(json.dumps(rig.snapshot(), allow_nan=False))
    law = held['gap_control']['law']
    assert law['name'] == 'control.laws:follow'
    assert law['memory'][:3] in ([30.0, 'nan', 0.0], [31.0, 'inf', 0.0], [30.0, 'inf', 0.0])
    assert Rig.restore(held, laws.follow).snapshot() == held
    with pytest.raises(ValueError, match=r'the law control\.laws:follow, .* give the law'):
        Rig.restore(held)


def test_it_is_on_by_itself_and_can_be_switched_off():
    rig = Rig(TRIAL, law=laws.push)
    rig.advance(60.0)
    assert rig.control.active
    assert len(rig.acts) > 10
    rig.change(TRIAL, GapControlParameters())
    rig.advance(80.0)
    assert rig.stops == (10.0, -10.0)
    assert (rig.law, rig.moves_stops) == ('off', False)
    assert rig.snapshot()['gap_control']['law']['memory'] == [0.0] * 16


#: Laws that fail, what is said of them, and also where they are compiled.
FAILING = [
    (laws.fails, ('fails failed at ', 'ZeroDivisionError: by nought'), None),
    (laws.raises_late, ('raises_late failed at ',), ('raises_late failed', 'compiled=False')),
    (laws.far, ('far returned (inf, -1.0) at ',), ('far returned (inf, -1.0) at ',)),
    (laws.wide, ('wide returned (1.0, -600.0) at ',), ('NaN to leave a stop alone',)),
    (laws.crossed, ('crossed returned (-5.0, 5.0) at ', 'the first at least gap_min'), None),
    (laws.too_close, ('(5.0, 4.9995) at ', 'gap_min, 0.001 m, above the second'), None),
    (laws.passes_the_other, ('(nan, 6.0) at ', 'sent to 5 and -10 m'), ('0.001 m, above',)),
    (laws.words, ("words returned ('up', 'down') at ", 'two places'), ('cannot compile the law',)),
    (laws.nothing, ('nothing returned None at ',), ('cannot compile the law', 'two numbers')),
    (laws.beyond_floats, ('beyond_floats returned (1000', 'two places'), None),
    (laws.breaks, ('breaks returned <generator object breaks', 'two places'), None),
    (laws.exits, ('exits failed at ', 'SystemExit: 3'), None),
    (laws.talks, ('talks failed at ', 'RuntimeError: xxx', '(10002 characters)'), None),
    (laws.forgets, ('left [] in its memory at ', '16 numbers'), ("attribute 'clear'",)),
]


@pytest.mark.parametrize(('law', 'words', 'compiled'), FAILING)
def test_a_law_that_fails_is_named_with_its_value(law, words, compiled):
    """And the rig is where it was before, with its control, to go on from there."""
    rig = Rig(TRIAL, control=control('timed'), law=law)
    rig.advance(2.0)
    before = rig.snapshot()
    with pytest.raises(LawError, match=r'^the law control\.laws:') as error:
        rig.advance(50.0)
    assert all(word in str(error.value) for word in words)
    assert rig.snapshot() == before
    assert len(rig.advance(2.5)) == 0
    assert math.isfinite(rig.sample().x)
    if compiled is not None:
        numba = pytest.importorskip('numba')
        rig = Rig(TRIAL, control=control('timed'), law=numba.njit(law), compiled=True)
        with pytest.raises(LawError, match=f'law control.laws:{law.__name__}') as error:
            rig.run(50.0, record=False)
        assert all(word in str(error.value) for word in compiled)


def test_a_law_of_the_present_directory(tmp_path, monkeypatch):
    (tmp_path / 'my_own_laws.py').write_text('def hold(seen, memory):\n    return 5.0, -5.0\n')
    monkeypatch.chdir(tmp_path)
    law = OwnLaw.from_text('my_own_laws:hold')
    rig = Rig(TRIAL, law=law)
    rig.advance(30.0)
    assert (rig.law, rig.stops) == ('my_own_laws:hold', (5.0, -5.0))


def test_a_plain_law_in_compiled_code_names_the_decorator():
    pytest.importorskip('numba')
    rig = Rig(TRIAL, law=laws.follow, compiled=True)
    words = r'control\.laws:follow is plain Python, .*: decorate it with numba\.njit'
    with pytest.raises(LawError, match=words):
        rig.run(10.0)
