# SPDX-License-Identifier: Apache-2.0
"""Node `reflex_network`: robot_state and gait_target in, motion_command out."""

from __future__ import annotations

import sys
from typing import Any

from loco_control.ros.convert import Converter, blank
from loco_control.ros.node import LocoNode
from loco_control.ros.parameters import declare
from loco_control.ros.spin import run_nodes
from loco_control.types import GaitTarget, LearningState, MotionCommand, RobotState
from loco_learning.reflex import PHASES, LearnerParams, ReflexNetwork

from .saving import save_weights


class ReflexNetworkNode(LocoNode):
    """ELM with FORCE readout; passes the target through until closing begins."""

    def __init__(self) -> None:
        super().__init__("reflex_network")
        dt = 1.0 / self.declare_parameter("control_rate", 250.0).value
        seed = self.declare_parameter("seed", 0).value
        self._save_to = self.declare_parameter("save_weights", "").value
        self.network = ReflexNetwork(declare(self, LearnerParams(), "learner."), dt, seed)
        self._compile(dt)
        self._phase = -1
        self._error = 0.0
        self._command, self._pack_command = (
            self.raw_output("motion_command"),
            Converter(MotionCommand).pack,
        )
        self._state, self._pack_state = (
            self.raw_output("learning_state"),
            Converter(LearningState).pack,
        )
        self.join({"robot_state": RobotState, "gait_target": GaitTarget}, self._step)
        self.announce_ready()

    def _compile(self, dt: float) -> None:
        """One step that learns, then back to the start: the kernels are ready before a tick is."""
        state = blank(RobotState)
        state.tick = round(self.network.params.stand / dt)
        self.network.step(state, blank(GaitTarget))
        self.network.reset()

    def _step(self, state: RobotState, target: GaitTarget) -> None:
        command, learning = self.network.step(state, target)
        self._command(self._pack_command(command))
        self._state(self._pack_state(learning))
        self._error = learning.error
        if learning.phase != self._phase:
            self._enter(learning)

    def _enter(self, learning: LearningState) -> None:
        self._phase = learning.phase
        self.event("phase", PHASES[learning.phase], learning.tick, learning.t)
        # Weights are final when the test phase begins: nothing trains after it.
        if PHASES[learning.phase] == "test" and self._save_to:
            save_weights(self, self.network, self._save_to, learning.tick, learning.t)

    def diagnose(self) -> dict[str, Any]:
        """Phase and prediction error."""
        phase = PHASES[self._phase] if self._phase >= 0 else "waiting"
        return {"phase": phase, "error_rad": self._error}


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_learning reflex_network``."""
    sys.exit(run_nodes([ReflexNetworkNode], args))


if __name__ == "__main__":
    main()
