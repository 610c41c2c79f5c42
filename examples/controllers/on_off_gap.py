# SPDX-License-Identifier: Apache-2.0
"""
On-off control of the gap by the amplitude of M.

A gap suits one amplitude. This controller has two of them: a narrow one, and a wide one for
vibrations above a threshold.
"""

import math

from impact_damper_ros.node.controller import Controller, run_controller, stops


class OnOffGap(Controller):
    """Two gaps, and a threshold of the amplitude with hysteresis."""

    def __init__(self):
        super().__init__(
            'on_off_gap', narrow=0.012, wide=0.024, threshold=0.002, hysteresis=0.2, memory=0.5
        )
        self._amplitude, self._time, self._wide = 0.0, -math.inf, False

    def command(self, time, seen):
        """Choose the gap by a peak of |X| that is forgotten within `memory` seconds."""
        x, _ = seen['primary']
        kept = math.exp((self._time - time) / self.value('memory'))
        self._amplitude, self._time = max(abs(x), kept * self._amplitude), time
        way = -1.0 if self._wide else 1.0
        limit = self.value('threshold') * (1.0 + way * self.value('hysteresis'))
        self._wide = self._amplitude > limit
        half = 0.5 * self.value('wide' if self._wide else 'narrow')
        return stops(stop_1=half, stop_2=-half)


if __name__ == '__main__':
    run_controller(OnOffGap)
