"""The thread of the theory: asked, superseded, switched off; without ROS in it."""

import json
import threading

import pytest
from rigs import HORIZONTAL, OFF_RESONANCE
from running import until

from impact_damper_ros import Rig, find_orbits
from impact_damper_ros.theory.theory_thread import TheoryThread
from theory.observed import motion_on

THREE = OFF_RESONANCE.replace(gap=18.0)


def state_of(rig):
    return Rig(rig).snapshot()


def answer(theory):
    until(lambda: theory.done)
    return theory.prediction


@pytest.fixture
def theory():
    thread = TheoryThread()
    yield thread
    thread.close()
    until(lambda: not thread._thread.is_alive())


def test_all_that_is_asked_is_answered(theory):
    theory.enable(False)
    theory.ask(state_of(HORIZONTAL))
    assert theory.done
    assert 'switched off' in json.loads(theory.document)['theory_failed']['text']
    theory.enable(True)
    found = answer(theory)
    orbit = find_orbits(HORIZONTAL, (1, 2)).orbits[0]
    assert (found.basis, found.complete, found.error) == ('run ahead', True, '')
    assert found.expected.distance(orbit) < 1e-9
    assert found.expected.multipliers == pytest.approx(orbit.multipliers, rel=1e-7)
    # No document was asked for.
    assert json.loads(theory.document)['orbit'] is None
    theory.want_documents(True)
    answer(theory)
    document = json.loads(theory.document)
    assert document['orbit']['complete']
    assert document['gap_curve']['optimum']['gap'] == pytest.approx(58.3, rel=0.02)
    assert document['orbit']['x_max_ratio'] == pytest.approx(0.104644, abs=1e-6)
    # Switched off and on, they are not made again.
    for wanted in (False, True):
        theory.want_documents(wanted)
        assert theory.done
    assert json.loads(theory.document) == document
    theory.ask({'format': 99, 'time': 0.0})
    assert 'FormatError: snapshot of format 99' in answer(theory).error
    failed = json.loads(theory.document)['theory_failed']
    assert 'snapshot of format 99' in failed['text']
    theory.want_documents(False)
    theory.ask(state_of(THREE))
    assert theory.rigs_requested == 3
    assert answer(theory).expected.stops == (1, 1, 2)
    theory.ask_like(motion_on(find_orbits(THREE, (1, 2, 2)).orbits[0]))
    found = answer(theory)
    assert (found.basis, found.expected.stops, theory.rigs_requested) == ('measured', (1, 2, 2), 3)
    theory.enable(False)
    assert (theory.done, theory.prediction) == (True, None)


def test_while_a_knob_is_turned_each_answer_is_of_the_newest_rig():
    """The other motions are looked for only once nothing else is asked."""
    answered, gaps, more = [], [20.0 + 0.5 * k for k in range(12)], threading.Event()

    def look():
        answered.append((theory.prediction, json.loads(theory.document)))
        more.set()

    theory = TheoryThread(look)
    theory.want_documents(True)
    for gap in gaps:
        more.clear()
        theory.ask(state_of(HORIZONTAL.replace(gap=gap)))
        # Two at once: the first of them may not be answered at all.
        theory.ask(state_of(HORIZONTAL.replace(gap=gap + 0.1)))
        assert more.wait(60.0)
    assert answer(theory).expected.parameters.gap == gaps[-1] + 0.1
    theory.close()
    shown = [document['gap_curve']['gap'] for _, document in answered]
    assert shown == sorted(shown)
    assert shown[-1] == gaps[-1] + 0.1
    for prediction, document in answered:
        orbit = prediction.expected
        assert document['gap_curve']['gap'] == orbit.parameters.gap
        assert document['orbit']['x_max'] == pytest.approx(orbit.x_max, rel=1e-12)
        assert document['orbit']['complete'] == prediction.complete
