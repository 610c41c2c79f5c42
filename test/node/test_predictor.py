"""The process that predicts: asked, superseded, killed, ended; without ROS in it."""

import json
import os
import signal
import sys
import threading
from pathlib import Path

import pytest
from theory.observed import motion_on

from impact_damper_ros.control import Rig
from impact_damper_ros.node import prediction as module
from impact_damper_ros.node.prediction import Predictor
from impact_damper_ros.orbits import find_orbits
from impact_damper_ros.rig import RigParameters
from node.rig_client import DEADLINE_S, until

HORIZONTAL = RigParameters(gravity=0.0)
THREE = RigParameters(gravity=0.0, gap=18.0, force_frequencies=1.02)


def snapshot(rig):
    return json.dumps({'state': Rig(rig).snapshot()})


def alive(pid):
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] != 'Z'
    except (FileNotFoundError, ProcessLookupError):
        return False


class Asked:
    """A predictor with what it has said."""

    def __init__(self, **options):
        self.told = threading.Event()
        self.warnings = []
        self.predictor = Predictor(self.told.set, self.warnings.append, **options)

    @property
    def status(self):
        return self.predictor.status()

    def answer(self, course, complete=True):
        """Wait for the answer for a course."""
        until(
            lambda: (
                self.status.answer.request
                and self.status.course == course
                and (self.status.answer.complete or not complete)
            ),
            lambda: f'no answer: {self.status}',
        )
        return self.status.answer


@pytest.fixture
def start(monkeypatch):
    monkeypatch.setattr(module, 'FIRST_START_S', 0.0)
    started = []

    def start(**options):
        started.append(Asked(**options))
        return started[-1]

    yield start
    for asked in started:
        asked.predictor.close()
        assert asked.status.process == 0


def test_answers_are_those_of_the_theory_and_the_process_ends_with_its_node(start):
    asked = start()
    assert asked.status.process == 0
    asked.predictor.ask(snapshot(HORIZONTAL))
    until(lambda: asked.status.process)
    # A Ctrl-C in the terminal reaches it too, and is not for it, also while it begins.
    os.kill(asked.status.process, signal.SIGINT)
    answer = asked.answer(1)
    orbit = find_orbits(HORIZONTAL, (1, 2)).orbits[0]
    assert answer.basis == 'run ahead'
    expected = answer.expected
    assert expected.rhythm.distance(orbit) < 1e-9
    assert expected.amplitude_ratio == pytest.approx(orbit.amplitude_ratio, rel=1e-9)
    assert expected.largest_multiplier == pytest.approx(abs(orbit.multipliers[0]), rel=1e-7)
    assert (expected.stable, expected.viable) == (True, True)
    assert asked.told.is_set()
    pid = asked.status.process
    assert os.getpriority(os.PRIO_PROCESS, pid) >= os.getpriority(os.PRIO_PROCESS, 0) + 5
    os.kill(pid, signal.SIGINT)
    asked.predictor.ask(snapshot(THREE))
    assert asked.answer(2).expected.rhythm.stops == (1, 1, 2)
    assert asked.status.process == pid
    asked.predictor.close()
    assert not alive(pid)
    assert asked.warnings == []


def test_a_new_course_supersedes_the_old_one_and_nothing_piles_up(start):
    asked = start()
    asked.predictor.ask(snapshot(HORIZONTAL))
    asked.answer(1)
    before = asked.status.answer.request
    gaps = [20.0 + 0.5 * k for k in range(30)]
    # It answers none of them before all have been asked for.
    os.kill(asked.status.process, signal.SIGSTOP)
    for gap in gaps:
        asked.predictor.ask(snapshot(HORIZONTAL.replace(gap=gap)))
    # Of the old answer nothing is left, and the next one is for the last of all.
    assert asked.status.answer.request == 0
    os.kill(asked.status.process, signal.SIGCONT)
    answer = asked.answer(1 + len(gaps), complete=False)
    x_max = find_orbits(HORIZONTAL.replace(gap=gaps[-1]), (1, 2)).orbits[0].x_max
    assert answer.motions[0].rhythm.x_max == pytest.approx(x_max, rel=1e-9)
    assert answer.request == before + len(gaps)


def test_asked_again_for_what_was_measured(start):
    asked = start()
    asked.predictor.ask(snapshot(THREE))
    assert asked.answer(1).expected.rhythm.stops == (1, 1, 2)
    course = motion_on(find_orbits(THREE, (1, 2, 2)).orbits[0])
    for number in (7, 1):
        asked.predictor.ask_like(course.rhythm, course.impact, course.phase, number)
    until(lambda: asked.status.answer.basis == 'measured')
    assert asked.status.answer.expected.rhythm.stops == (1, 2, 2)
    # That for a course of which nobody knows was left out.
    assert asked.status.answer.request == 2


def test_a_killed_process_is_followed_by_another_one(start, monkeypatch):
    monkeypatch.setattr(module, 'BACK_OFF_S', 0.05)
    asked = start()
    asked.predictor.ask(snapshot(HORIZONTAL))
    first = asked.answer(1)
    pid = asked.status.process
    os.kill(pid, signal.SIGKILL)
    until(lambda: asked.status.process not in (0, pid))
    assert asked.status.restarts == 1
    assert asked.status.trouble == ''
    (warning,) = asked.warnings
    assert 'ended by signal 9; it is restarted after 0.05 s' in warning
    # The answer holds; a new course is answered by the new process.
    assert asked.status.answer == first
    asked.predictor.ask(snapshot(THREE))
    assert asked.answer(2).expected.rhythm.stops == (1, 1, 2)


def test_a_process_that_cannot_live_is_tried_ever_more_rarely(start, monkeypatch):
    monkeypatch.setattr(module, 'BACK_OFF_S', 0.02)
    asked = start(command=[sys.executable, '-c', 'raise SystemExit(3)'])
    asked.predictor.ask(snapshot(HORIZONTAL))
    until(lambda: len(asked.warnings) >= 3)
    pauses = [float(w.split('after ')[1].split()[0]) for w in asked.warnings[:3]]
    assert pauses == [0.02, 0.04, 0.08]
    assert 'with code 3' in asked.warnings[0]
    missing = start(command=['/no/such/program'])
    missing.predictor.ask(snapshot(HORIZONTAL))
    until(lambda: missing.warnings)
    assert 'cannot be started' in missing.warnings[0]
    assert missing.status.trouble


def test_what_cannot_be_computed_is_told(start):
    asked = start()
    asked.predictor.ask('{"state": {"format": 99}}')
    answer = asked.answer(1)
    assert 'ValueError: snapshot of format 99' in answer.error
    asked.predictor.ask(snapshot(HORIZONTAL))
    assert asked.answer(2).error == ''


def test_switched_off_and_on(start):
    asked = start(enabled=False)
    asked.predictor.ask(snapshot(HORIZONTAL))
    assert not asked.status.enabled
    assert asked.status.process == 0
    asked.predictor.enable(True)
    asked.answer(1)
    pid = asked.status.process
    asked.predictor.enable(False)
    until(lambda: not alive(pid))
    until(lambda: asked.status.answer.request == 0)
    assert asked.warnings == []


def test_a_stopped_process_holds_up_neither_the_requests_nor_the_end(start, monkeypatch):
    monkeypatch.setattr(module, 'END_TIMEOUT_S', 0.1)
    asked = start()
    asked.predictor.ask(snapshot(HORIZONTAL))
    asked.answer(1)
    pid = asked.status.process
    os.kill(pid, signal.SIGSTOP)
    long = json.dumps({'state': Rig(THREE).snapshot(), 'padding': 'x' * 100_000})
    asking = threading.Thread(target=lambda: [asked.predictor.ask(long) for _ in range(5)])
    asking.start()
    asking.join(DEADLINE_S)
    assert not asking.is_alive()
    asked.predictor.close()
    assert not alive(pid)
