# SPDX-License-Identifier: Apache-2.0
"""Plants that a judge has to see through."""

from __future__ import annotations

from loco_sim.ros.sim_node import RobotSimNode


class Announces(RobotSimNode):
    """Announces the time-out and goes on with the last command."""

    def safe_command(self):
        return self._commands or super().safe_command()


class Silent(RobotSimNode):
    """Goes on with the last command and announces nothing."""

    def event(self, kind, *more):
        if kind != "timeout":
            super().event(kind, *more)

    def safe_command(self):
        return self._commands or super().safe_command()


class Limp(RobotSimNode):
    """Announces the time-out and holds the pose of the last command without any velocity."""

    def safe_command(self):
        command, trunk = super().safe_command()
        command.q = command.q if self._commands is None else self._commands[0].q
        return command, trunk
