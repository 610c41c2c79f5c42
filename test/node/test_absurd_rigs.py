"""Absurd rigs over DDS: the node answers, says what keeps it, and ends with a whole bag."""

import re

from diagnostic_msgs.msg import DiagnosticStatus

from impact_damper_ros.node.pacing import CATCH_UP_NS
from node.rig_client import LIVELY, stamp_ns

ENDLESS = {
    'gap': 1e-9,
    'gravity': 0.0,
    'restitution_1': 1.0,
    'restitution_2': 1.0,
    'initial_damper_velocity': 1e9,
}
#: Bounces of 0.1 pm on an elastic stop: 1e8 impacts per second.
HAMMERING = {
    'angle': 1.5708,
    'gravity': 1e4,
    'one_sided': True,
    'restitution_1': 1.0,
    'initial_damper_offset': 0.005 - 1.25e-13,
}
#: Rigs that are held: elastic stops 1 nm apart, weight or compressed air that presses m to one.
HELD = {
    'endless': ENDLESS,
    'endless, slower': {**ENDLESS, 'initial_damper_velocity': 1e6},
    'endless, under control': {**ENDLESS, 'gap_control': 'timed', 'gap_control_rate': 1000.0},
    'hammering': HAMMERING,
    'chatter': {**HAMMERING, 'restitution_1': 0.9999999},
    'air': {'air_force': 1e9, 'restitution_1': 1.0, 'restitution_2': 1.0},
}
CALM = {
    'angle': 0.0,
    'gap': 0.01,
    'gravity': 9.81,
    'air_force': 0.0,
    'one_sided': False,
    'restitution_1': 0.5,
    'restitution_2': 0.5,
    'gap_control': 'off',
    'initial_damper_offset': 0.0,
    'initial_damper_velocity': 0.0,
}
#: The node on a machine that stops it at random places, for longer than a slice of its search.
STALLS = """
import random, sys, time
rng, lost = random.Random(7), 0
monotonic_ns, thread_time_ns, time_ns = time.monotonic_ns, time.thread_time_ns, time.time_ns

def stalled(clock):
    global lost
    lost += rng.randrange(2 * 10**7, 4 * 10**7) if rng.random() < 0.02 else 0
    return clock() + lost

time.monotonic_ns = lambda: stalled(monotonic_ns)
time.thread_time_ns = lambda: stalled(thread_time_ns)
time.time_ns = lambda: time_ns() + lost
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


def test_held_rigs_say_so_and_are_replayed_wherever_the_machine_stalls(start):
    """The state in which each is held, and made calmer, does not depend on the stalls."""
    rig = start(code=STALLS, record=True, **LIVELY)
    assert not rig.snapshots()
    rig.await_states(20)

    def reset_to(values, *, held):
        rig.change(**values)
        assert rig.call('reset')[0]
        rig.until(lambda: rig.stands_still is held, lambda: f'{values} {rig.process.output}')

    for values in (*HELD.values(), HAMMERING):
        rig.change(**CALM)
        rig.until(lambda: rig.states and not rig.stands_still)
        reset_to(values, held=True)
    # A change that is no remedy: it tries again.
    rig.change(damper_mass=0.11)
    held = rig.await_report('rig', holds=lambda report: report.message.startswith('held: '))
    assert held.level == DiagnosticStatus.ERROR
    assert held.message.startswith('held: the rig had ')
    assert 'make the stops less elastic or the gap wider' in held.message
    assert held.message.endswith('it waits for a changed parameter or ~/reset')
    assert (held.values['Held'], int(held.values['Events']) > 2500) == ('True', True)
    # Harmless initial conditions are a remedy.
    reset_to({'initial_damper_offset': 0.0}, held=False)
    rig.await_report('rig', holds=lambda report: report.level == DiagnosticStatus.OK)
    rig.until(lambda: len(rig.snapshots('reset')) == len(HELD) + 2)
    rig.stop()
    assert rig.bag()


#: The node on a machine whose system clock is set by so many seconds as the file `set_by` says.
CLOCK = """
import sys, time
from pathlib import Path
time_ns, set_by = time.time_ns, Path('set_by')
time.time_ns = lambda: time_ns() + 10**9 * int(set_by.read_text() if set_by.exists() else 0)
time.time = lambda: time.time_ns() * 1e-9
from impact_damper_ros.node import sim_node
sys.exit(sim_node.main())
"""


def test_stamps_follow_the_steps_of_the_system_clock(start):
    """As after a slip; stamps of a bag only increase, so they go back once it has ended."""
    rig = start(code=CLOCK, record=True, **LIVELY)
    rig.await_states(20)

    def set_clock(seconds):
        new = rig.process.directory / 'new'
        new.write_text(f'{seconds}')
        new.rename(new.with_name('set_by'))

    def ahead(stamp):
        """Return by how much a stamp is ahead of this clock, s."""
        return (stamp - rig.client.node.get_clock().now().nanoseconds) * 1e-9

    def follow(seconds):
        """Wait until joint states, and the snapshot of the step, are by the clock of the node."""

        def followed():
            # At the end of a pause, one snapshot may report both slip and resumption.
            moved = [s['stamp_offset_ns'] + s['time_ns'] for s in rig.snapshots('slip', 'resume')]
            last = stamp_ns(rig.states[-1].header.stamp)
            return (
                moved
                and abs(ahead(moved[-1]) - seconds) < 60.0
                and abs(ahead(last) - seconds) < CATCH_UP_NS * 1e-9
            )

        rig.until(followed)

    # That it was late a moment ago is no reason to be silent about the clock.
    set_clock(1)
    rig.until(lambda: 'they are moved on' in rig.process.output)
    rig.pause()
    set_clock(3600)
    rig.until(lambda: ahead(stamp_ns(rig.states[-1].header.stamp)) > 3500)
    rig.pause(False)
    rig.await_states(100)
    follow(3600)
    set_clock(0)
    rig.await_states(100)
    assert ahead(stamp_ns(rig.states[-1].header.stamp)) > 3500
    rig.change(record=False)
    follow(0)
    words = re.compile(r'were \d+\.\d+ s ahead of .* moved back')
    rig.until(lambda: words.search(rig.process.output))
    rig.await_states(100)
    follow(0)
    rig.stop()
    assert rig.bag()
