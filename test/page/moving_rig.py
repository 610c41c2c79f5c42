"""The motion of a rig from rest, as the messages of its node would have it."""

from impact_damper_ros import Rig
from impact_damper_ros.motion.event import table_of_events
from impact_damper_ros.page.motion import ForcePhase, MotionHistory, Stretch
from impact_damper_ros.replay.rows import samples_as_rows
from impact_damper_ros.rig.snapshot import Snapshot

RATE = 200.0


def force_phase(rig):
    return ForcePhase(Snapshot.from_dict(rig.snapshot()))


def motion_of(parameters, seconds, rate=RATE):
    """Return the motion of a rig from rest."""
    rig = Rig(parameters)
    stretch = Stretch(0, 0, parameters, force_phase(rig))
    events, samples = [], []
    for k in range(round(seconds * rate) + 1):
        events += rig.advance(k / rate)
        samples.append(rig.sample())
    motion = MotionHistory(100_000, 10_000)
    motion.add_samples(stretch.sample_rows(samples_as_rows(samples)))
    motion.add_impacts(stretch.impact_rows(table_of_events(events)))
    return motion
