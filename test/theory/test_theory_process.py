"""The processes of the theory: asked, superseded, killed, switched off; without ROS in them."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rigs import HORIZONTAL, OFF_RESONANCE
from running import Running, alive, until

from impact_damper_ros import Rig, find_orbits
from impact_damper_ros.theory.background import BackgroundCall
from impact_damper_ros.theory.theory_process import TheoryProcess
from theory import searches
from theory.observed import motion_on

THREE = OFF_RESONANCE.replace(gap=18.0)


def state_of(rig):
    return Rig(rig).snapshot()


def poll_until(process, condition):
    """Poll until a condition holds."""

    def holds():
        value = condition()
        if not value:
            process.poll()
        return value

    until(holds, lambda: vars(process))


def answer(process):
    poll_until(process, lambda: process.done)
    return process.prediction


@pytest.fixture
def start():
    started = []

    def begin(**options):
        started.append(TheoryProcess(**options))
        return started[-1]

    yield begin
    for process in started:
        pid = process.process
        process.close()
        assert process.process == 0
        assert not pid or not alive(pid)


def test_all_that_is_asked_is_answered(start):
    process = start()
    process.enable(False)
    process.ask(state_of(HORIZONTAL))
    assert (process.poll(), process.process) == (False, 0)
    assert 'switched off' in json.loads(process.document)['theory_failed']['text']
    process.enable(True)
    poll_until(process, lambda: process.process)
    pid = process.process
    found = answer(process)
    orbit = find_orbits(HORIZONTAL, (1, 2)).orbits[0]
    assert (found.basis, found.complete, found.error) == ('run ahead', True, '')
    assert found.expected.distance(orbit) < 1e-9
    assert found.expected.multipliers == pytest.approx(orbit.multipliers, rel=1e-7)
    poll_until(process, lambda: not process.process)
    assert not alive(pid)
    # No document was asked for.
    assert json.loads(process.document)['orbit'] is None
    process.want_documents(True)
    # What is known stays until as much is known again.
    poll_until(process, lambda: '"gap_curve": {' in process.document)
    assert process.prediction.expected.distance(found.expected) < 1e-9
    answer(process)
    document = json.loads(process.document)
    assert document['gap_curve']['done']
    assert document['gap_curve']['optimum']['gap'] == pytest.approx(58.3, rel=0.02)
    assert document['orbit']['x_max_ratio'] == pytest.approx(0.104644, abs=1e-6)
    # Switched off and on, they are not made again.
    for wanted in (False, True):
        process.want_documents(wanted)
        assert process.done
    assert json.loads(process.document) == document
    process.ask({'format': 99, 'time': 0.0})
    assert 'FormatError: snapshot of format 99' in answer(process).error
    failed = json.loads(process.document)['theory_failed']
    assert 'snapshot of format 99' in failed['text']
    process.want_documents(False)
    process.ask(state_of(THREE))
    assert (process.course, process.prediction) == (3, None)
    assert answer(process).expected.stops == (1, 1, 2)
    assert json.loads(process.document)['gap_curve'] is None
    process.ask_like(motion_on(find_orbits(THREE, (1, 2, 2)).orbits[0]))
    found = answer(process)
    assert (found.basis, found.expected.stops, process.course) == ('measured', (1, 2, 2), 3)
    process.enable(False)
    assert (process.process, process.prediction) == (0, None)


def test_only_the_newest_rig_is_answered(start):
    """Each request ends the process of the one before, even if that is stopped."""
    process = start(documents=True)
    process.ask(state_of(HORIZONTAL.replace(gap=8.0)))
    poll_until(process, lambda: process.prediction is not None)
    first = process.process
    os.kill(first, signal.SIGSTOP)
    gaps = [20.0 + 0.5 * k for k in range(30)]
    for gap in gaps:
        process.ask(state_of(HORIZONTAL.replace(gap=gap)) | {'padding': 'x' * 100_000})
    assert process.prediction is None
    assert not alive(first)
    poll_until(process, lambda: process.prediction is not None)
    x_max = find_orbits(HORIZONTAL.replace(gap=gaps[-1]), (1, 2)).orbits[0].x_max
    assert process.prediction.orbits[0].x_max == pytest.approx(x_max, rel=1e-9)
    document = json.loads(process.document)
    assert document['gap_curve'] is None or document['gap_curve']['gap'] == gaps[-1]


def test_a_killed_process_is_one_failed_request(start):
    process = start(compute=searches.waiting)
    process.ask(state_of(HORIZONTAL))
    poll_until(process, lambda: process.prediction is not None)
    # Ctrl-C in the terminal is not for it
    os.kill(process.process, signal.SIGINT)
    time.sleep(0.1)
    assert alive(process.process)
    os.kill(process.process, signal.SIGKILL)
    assert answer(process).error == 'the process has ended by signal 9'
    assert 'signal 9' in json.loads(process.document)['theory_failed']['text']
    process.ask(state_of(THREE))
    poll_until(process, lambda: process.prediction is not None)
    assert process.prediction.error == ''


def test_a_process_that_crashes(start):
    process = start(compute=searches.crashing)
    process.ask(state_of(HORIZONTAL))
    assert answer(process).error == 'the process has ended by signal 11'


def test_a_search_that_does_not_end():
    call = BackgroundCall(searches.endless, patience=0.2)

    def ended():
        call.poll()
        return call.end

    until(ended)
    assert call.end == 'not finished within 0.2 s of computing'
    call.close()


ALONE = """
import multiprocessing, sys, time
from impact_damper_ros.theory.background import BackgroundCall
sys.path.insert(0, sys.argv[1])
from theory import searches
if sys.argv[2]:
    multiprocessing.set_executable(sys.argv[2])
call = BackgroundCall(searches.waiting)
while not (call.end or call.poll()):
    time.sleep(0.01)
print(call.end or call.number, flush=True)
time.sleep(1000.0)
"""


def of_a_program(directory, executable):
    """Return a program that starts a process."""
    return Running(directory, '-c', ALONE, str(Path(__file__).parents[1]), executable)


def test_no_process_outlives_its_program(tmp_path):
    with of_a_program(tmp_path, '') as program:
        pid = int(program.until(lambda: re.search(r'^(\d+)\n', program.output, re.MULTILINE))[1])
        assert alive(pid)
    until(lambda: not alive(pid))


def test_a_process_that_cannot_be_started(tmp_path):
    with of_a_program(tmp_path, '/no/such/program') as program:
        # Beside warnings of multiprocessing, whose own process cannot be started either
        program.until(lambda: 'the process cannot be started: ' in program.output)


PRIORITY = """
import multiprocessing, os, sys, time
from impact_damper_ros.theory.background import BackgroundCall
sys.path.insert(0, sys.argv[1])
from theory import searches
if sys.argv[2]:
    other = multiprocessing.get_context('forkserver').Process(target=os.getpid)
    other.start()
    other.join()
call = BackgroundCall(searches.niceness)
found = []
while not (found or call.end):
    found += call.poll()
    time.sleep(0.01)
print(found[0] - os.getpriority(os.PRIO_PROCESS, 0) if found else call.end)
"""


@pytest.mark.parametrize('served', ['', 'served'], ids=['first', 'with the server of another'])
def test_a_process_has_a_low_priority(served):
    """Also where another part of the program has started the server, at ordinary priority."""
    program = [sys.executable, '-c', PRIORITY, str(Path(__file__).parents[1]), served]
    done = subprocess.run(program, stdout=subprocess.PIPE, text=True, check=True)
    own = os.getpriority(os.PRIO_PROCESS, 0)
    assert int(done.stdout) == min(10, 19 - own)
