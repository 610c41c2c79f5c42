"""Events of simulators and of long runs in a form in which they can be compared."""

from impact_damper_ros.rig.long_run import EVENT_TYPE


def rows(events):
    """Return events of the simulator as the table of a long run has them, without the mode."""
    names = [name for name in EVENT_TYPE.names if name != 'mode']
    return [tuple(getattr(event, name) for name in names) for event in events]


def without_mode(table):
    """Return the events of a long run, without the mode."""
    return [tuple(row)[:-1] for row in table.tolist()]
