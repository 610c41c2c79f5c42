# SPDX-License-Identifier: Apache-2.0
"""Skyhook damping: a force on M against its velocity in the laboratory."""

from geometry_msgs.msg import WrenchStamped

from impact_damper_ros.node.controller import Controller, run_controller


class Skyhook(Controller):
    """A dashpot between M and the sky."""

    def __init__(self):
        super().__init__('skyhook', 'force_command', WrenchStamped, damping=10.0)

    def command(self, _time, seen):
        """Return the force of the dashpot."""
        _, velocity = seen['primary']
        command = WrenchStamped()
        command.wrench.force.x = -self.value('damping') * velocity
        return command


if __name__ == '__main__':
    run_controller(Skyhook)
