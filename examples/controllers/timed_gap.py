# SPDX-License-Identifier: Apache-2.0
"""
The timed law of the package as a controller of its own.

It sees the rig by `measurements` alone, and has the law and its observer from the library. A
passage of X through zero is interpolated between two samples, and a command goes out at the sample
nearest to the instant for which the law asks.
"""

from impact_damper_ros import GapControlParameters, RigParameters
from impact_damper_ros.control.controller import control_of, is_ignored, take_passage, take_sample
from impact_damper_ros.control.state import Measurement
from impact_damper_ros.node.controller import Controller, run_controller, stops


class TimedGap(Controller):
    """A stop is closed to meet m where X passes through zero."""

    def __init__(self):
        super().__init__(
            'timed_gap',
            # Those of the bench rig
            damper_mass=0.1,
            primary_mass=2.0,
            restitution=0.6,
            gap=0.024,
            gap_min=0.004,
            gap_max=0.3,
            rate=200.0,
            speed=3.0,
            delay=0.004,
        )
        # What the law knows of the rig
        rig = RigParameters(
            restitution_1=self.value('restitution'),
            restitution_2=self.value('restitution'),
            **{name: self.value(name) for name in ('damper_mass', 'primary_mass', 'gap')},
        )
        law = GapControlParameters(
            gap_control='timed',
            gap_control_rate=self.value('rate'),
            gap_min=self.value('gap_min'),
            gap_max=self.value('gap_max'),
            actuator_speed=self.value('speed'),
            actuator_delay=self.value('delay'),
        )
        self._law, self._before = control_of(law, rig), None

    def command(self, time, seen):
        """Show the law the sample, and return what it wants done about now."""
        law, period = self._law, 1.0 / self.value('rate')
        x, y = seen['primary'], seen['damper']
        sample = Measurement(time, *x, *y, seen['stop_1'][0], seen['stop_2'][0])
        before, self._before = self._before, sample
        law.controller.sample_index = round(time / period)
        if before is not None and before.x * sample.x < 0.0:
            share = before.x / (before.x - sample.x)
            pairs = zip(before, sample, strict=True)
            passage = Measurement(*(a + share * (b - a) for a, b in pairs))._replace(x=0.0)
            if not is_ignored(law, passage.time):
                take_passage(law, passage, sample.x > 0.0)
        take_sample(law, sample)
        places = {}
        due = time + self.value('delay') + 0.5 * period
        while law.actuators.waiting and law.waiting[0].time <= due:
            order = law.waiting[0]
            wanted = {'stop_1': order.stop_1, 'stop_2': order.stop_2}
            places |= {name: place for name, place in wanted.items() if place == place}
            law.actuators.first = (law.actuators.first + 1) % len(law.commands)
            law.actuators.waiting -= 1
        return stops(**places)


if __name__ == '__main__':
    run_controller(TimedGap)
