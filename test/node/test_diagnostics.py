"""The levels and words of the reports."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import deserialize_message

from impact_damper_ros import Action, ControlAct, GapControlParameters
from impact_damper_ros.bag.messages import encode
from impact_damper_ros.node.diagnostics import Diagnostics
from impact_damper_ros.node.engine_state import EngineStatus
from impact_damper_ros.node.external_control import ControllerStatus
from impact_damper_ros.node.motion_report import MotionReport
from impact_damper_ros.node.pacing import PacingCounts
from impact_damper_ros.node.recording import RecordingStatus

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
START = EngineStatus(0, False, 'FREE', 0, 0, PacingCounts(0, 0, 0, 0, 0))


def second(**changes):
    """Return the engine's status one second on, with some things otherwise."""
    pacing = PacingCounts(
        ticks=changes.pop('ticks', 200),
        overruns=changes.pop('overruns', 0),
        slips=changes.pop('slips', 0),
        slipped_ns=changes.pop('slipped_ns', 0),
        worst_lateness_ns=1_500_000,
    )
    return START._replace(time_ns=10**9, impacts=3, pacing=pacing)._replace(**changes)


def received(array):
    """Return a report as a subscriber gets it."""
    return deserialize_message(encode(array), DiagnosticArray)


TASKS = ('pacing', 'rig', 'recording', 'gap control', 'controller', 'network')


def report(engine, recording=None, factor=1.0):
    """Return the statuses of a report by task, with the values of each in a dictionary."""
    now = [1.0]
    diagnostics = Diagnostics('/lab/rig', 200.0, factor, lambda: now[0])
    now[0] = 2.0
    array = received(diagnostics.report(1_500_000_000, engine, recording or RecordingStatus()))
    assert (array.header.stamp.sec, array.header.stamp.nanosec) == (1, 500_000_000)
    assert [s.name for s in array.status] == [f'lab/rig: {task}' for task in TASKS]
    return {
        task: (s.level, s.message, {v.key: v.value for v in s.values})
        for task, s in zip(TASKS, array.status, strict=True)
    }


@pytest.mark.parametrize(
    ('engine', 'factor', 'level', 'words'),
    [
        (second(), 1.0, OK, 'holds 200 Hz'),
        (second(overruns=2), 1.0, WARN, '2 of 200 ticks late'),
        (second(overruns=9, slips=1, slipped_ns=400_000_000), 1.0, ERROR, '0.400 s of wall time'),
        (second(ticks=0, time_ns=0), 1.0, OK, 'no tick for 1.0 s'),
        (second(ticks=0, time_ns=0, paused=True), 1.0, OK, 'paused'),
        (second(ticks=4000, time_ns=20 * 10**9), 0.0, OK, '20 times as fast'),
        (second(ticks=400), 2.0, OK, 'holds 400 Hz'),
    ],
)
def test_pacing(engine, factor, level, words):
    found, message, values = report(engine, factor=factor)['pacing']
    assert (found, words in message) == (level, True)
    assert float(values['Actual frequency (Hz)']) == engine.pacing.ticks
    assert values['Events in window'] == str(engine.pacing.ticks)
    asked = f'{200 * factor:g}' if factor else ''
    assert values['Target frequency (Hz)'] == asked
    assert values['Overruns'] == str(engine.pacing.overruns)
    assert values['Worst lateness since the last report [ms]'] == '1.500'


@pytest.mark.parametrize(
    ('measured', 'control', 'rates'),
    [
        (0.0, {}, 'state_rate'),
        (100.0, {'gap_control_rate': 1e5}, 'state_rate'),
        (1e4, {}, 'measurement_rate (10000 Hz) and state_rate'),
        (
            1e4,
            {'gap_control': 'external', 'gap_control_rate': 1e5},
            'gap_control_rate (100000 Hz) and measurement_rate (10000 Hz) and state_rate',
        ),
    ],
)
def test_a_rig_that_is_late_names_the_rates_to_lower(measured, control, rates):
    engine = second(slips=1, slipped_ns=10**9, control=GapControlParameters(**control))
    diagnostics = Diagnostics('/rig', 200.0, 1.0, measurement_rate=measured)
    message = diagnostics.report(0, engine, RecordingStatus()).status[0].message
    assert f'of wall time; lower {rates}, or give a lower real_time_factor' in message


def test_counts_are_totals_and_differences_are_since_the_last_report():
    now = [0.0]
    diagnostics = Diagnostics('/rig', 200.0, 1.0, lambda: now[0])
    seen = []
    for overruns in (3, 3, 5):
        now[0] += 1.0
        status = diagnostics.report(0, second(overruns=overruns), RecordingStatus()).status[0]
        values = dict(status.values)
        seen.append((values['Overruns'], values['Overruns since the last report']))
    assert seen == [('3', '3'), ('3', '0'), ('5', '2')]


@pytest.mark.parametrize(
    ('rate', 'factor', 'changes', 'silent'),
    [
        # Five seconds and five ticks
        (200.0, 1.0, {}, [6.0, 60.0]),
        (0.1, 1.0, {}, [60.0]),
        (0.1, 2.0, {}, [30.0, 60.0]),
        (200.0, 0.0, {}, [6.0, 60.0]),
        (200.0, 1.0, {'paused': True}, []),
        (200.0, 0.0, {'controller': ControllerStatus(awaited='stop_commands')}, []),
    ],
)
def test_a_rig_without_a_tick_is_an_error_at_any_pace(rate, factor, changes, silent):
    now = [0.0]
    diagnostics = Diagnostics('/rig', rate, factor, lambda: now[0])
    errors = []
    for time in (1.0, 4.0, 6.0, 30.0, 60.0):
        now[0] = time
        engine = second(ticks=0, time_ns=0, **changes)
        status = diagnostics.report(0, engine, RecordingStatus()).status[0]
        errors += [time] * (status.level == 2)
        assert (f'no tick for {time:.1f} s' in status.message) != bool(changes)
    assert errors == [time for time in (6.0, 30.0, 60.0) if silent and time >= silent[0]]
    now[0] = 61.0
    assert diagnostics.report(0, second(), RecordingStatus()).status[0].level == 0


def test_rig():
    level, message, values = report(second(mode='REST_1'))['rig']
    assert (level, message) == (OK, 'rest 1')
    assert (values['Impacts'], values['Time [s]']) == ('3', '1.000')
    assert report(second(paused=True))['rig'][1] == 'paused, free'


def test_gap_control():
    level, message, values = report(second())['gap control']
    assert (level, message) == (OK, 'off')
    assert set(values.values()) == {'off', 'independent', '', '0'}
    act = ControlAct(0.9, Action.ARRIVED, 8.5, -7.5, 2.25, 0.0, 0.0, 1.0, 0.5, 0.25)
    law = GapControlParameters(gap_control='timed')
    _, message, values = report(second(control=law, commands=12, last_act=act))['gap control']
    assert (message, values['Commands']) == ('timed', '12')
    assert values['Stop 1 to Y [m]'] == '8.5'
    assert values['Amplitude of X [m]'] == '2.25'
    assert values['Energy spent on stop 2 [J]'] == '0.25'


def test_the_motion_goes_with_the_rest_or_alone():
    diagnostics = Diagnostics('/lab/rig', 200.0, 1.0)
    motion = [
        MotionReport('measured motion', False, 'transient', {'Settled': False}),
        MotionReport('predicted motion', True, 'unstable', {'Stable': False}),
    ]
    whole = received(diagnostics.report(0, second(), RecordingStatus(), motion))
    alone = received(diagnostics.motion_report(2_000_000_001, motion))
    assert (alone.header.stamp.sec, alone.header.stamp.nanosec) == (2, 1)
    assert whole.status[6:] == alone.status
    assert [s.name for s in alone.status] == [
        'lab/rig: measured motion',
        'lab/rig: predicted motion',
    ]
    assert [s.level for s in alone.status] == [OK, WARN]
    assert [(v.key, v.value) for v in alone.status[1].values] == [('Stable', 'False')]


@pytest.mark.parametrize(
    ('recording', 'level', 'words'),
    [
        (RecordingStatus(), OK, 'off'),
        (RecordingStatus(path='a.mcap', messages=5, size=100), OK, 'recording'),
        (RecordingStatus(path='a.mcap', dropped=7), WARN, '7 messages dropped'),
        (RecordingStatus(error='the disk is full'), ERROR, 'the disk is full'),
    ],
)
def test_recording(recording, level, words):
    found, message, values = report(second(), recording)['recording']
    assert (found, words in message) == (level, True)
    shown = [values[key] for key in ('File', 'Messages', 'Bytes')]
    assert shown == [recording.path, str(recording.messages), str(recording.size)]


@pytest.mark.parametrize(
    ('controller', 'level', 'words'),
    [
        (ControllerStatus(), OK, 'no commands'),
        (ControllerStatus(accepted=9, age_ns=5_000_000), OK, 'carried out'),
        (ControllerStatus(refused=2, reason='it is late'), WARN, '2 commands refused: it is late'),
        (ControllerStatus(age_ns=2_500_000_000, parked=True), WARN, 'no command for 2.5'),
        (ControllerStatus(missed=1), WARN, 'the rig continues without it'),
    ],
)
def test_controller(controller, level, words):
    found, message, values = report(second(controller=controller))['controller']
    assert (found, words in message) == (level, True)
    assert values['Commands refused'] == str(controller.refused)
    assert values['Stops parked'] == str(controller.parked)


@pytest.mark.parametrize(('ticks', 'paused'), [(0, False), (0, True), (200, False)])
def test_a_rig_in_lock_step_says_for_what_it_waits(ticks, paused):
    controller = ControllerStatus(accepted=9, age_ns=0, awaited='force_command, stop_commands')
    engine = second(ticks=ticks, time_ns=ticks * 5_000_000, paused=paused, controller=controller)
    statuses = report(engine)
    waits = ticks == 0 and not paused
    assert ('stands still: lock-step waits for a command' in statuses['pacing'][1]) == waits
    level, message, _ = statuses['controller']
    words = 'lock-step waits for a command on force_command, stop_commands'
    assert (message == words) == (level == WARN) == waits
