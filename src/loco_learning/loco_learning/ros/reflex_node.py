# SPDX-License-Identifier: Apache-2.0
"""Node `reflex_network`: from robot_state and gait_target to motion_command."""

from __future__ import annotations

from loco_control.ros.executor import entry
from loco_control.ros.messages.convert import Converter, blank
from loco_control.ros.parameters import declare
from loco_control.types import GaitTarget, LearningState, MotionCommand, RobotState

from ..params import PHASES, LearnerParams
from ..reflex.network import ReflexNetwork
from ..reflex.senses import FootForces
from .learning_node import LearningNode


class ReflexNetworkNode(LearningNode):
    """ELM with FORCE readout; passes the target through until closing begins."""

    def __init__(self) -> None:
        super().__init__("reflex_network")
        dt = 1.0 / self.declare_parameter("control_rate", 250.0).value
        seed = self.declare_parameter("seed", 0).value
        self._save_to = self.declare_parameter("save_weights", "").value
        params = declare(self, LearnerParams(), "learner.")
        self.network = ReflexNetwork(params, FootForces(params), dt, seed)
        self._compile(dt)
        self._command = self.raw_output("motion_command")
        self._pack_command = Converter(MotionCommand).pack
        self._state = self.raw_output("learning_state")
        self._pack_state = Converter(LearningState).pack
        self.join({"robot_state": RobotState, "gait_target": GaitTarget}, self._step)
        self.announce_ready()

    def _compile(self, dt: float) -> None:
        """Run one learning step and reset, so that kernels are compiled before the first tick."""
        state, tick = blank(RobotState), round(self.network.params.stand / dt)
        self.network.step(tick, 0.0, state.grf[:, 2], blank(GaitTarget))
        self.network.reset()

    def _step(self, state: RobotState, target: GaitTarget) -> None:
        command, learning = self.network.step(state.tick, state.t, state.grf[:, 2], target)
        self._command(self._pack_command(command))
        self._state(self._pack_state(learning))
        phase = PHASES[learning.phase]
        self.follow(phase, learning.error, learning.tick, learning.t, self.network)


main = entry(ReflexNetworkNode)  # ``ros2 run loco_learning reflex_network``

if __name__ == "__main__":
    main()
