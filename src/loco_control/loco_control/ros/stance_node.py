# SPDX-License-Identifier: Apache-2.0
"""Node `stance_controller`: stance estimate and trunk torques."""

from __future__ import annotations

from std_msgs.msg import String

from ..exceptions import LocoError
from ..stance.controller import StanceController, StanceParams
from ..stance.trunk import TrunkParams
from ..types import GaitTarget, MotionCommand, RobotState, Stance, TrunkTorque
from .executor import entry
from .messages.convert import Converter, blank
from .node import LocoNode
from .parameters import declare, declare_legs, on_change


class StanceControllerNode(LocoNode):
    """PSE or RSE, then the trunk controller; the estimator can change at run time."""

    def __init__(self) -> None:
        super().__init__("stance_controller")
        dt = 1.0 / self.declare_parameter("control_rate", 250.0).value
        live = frozenset({"stance.estimator"})
        stance = declare(self, StanceParams(), "stance.", live)
        trunk = declare(self, TrunkParams(), "trunk.")
        self.controller = StanceController(stance, trunk, dt, declare_legs(self))
        self.controller.step(blank(RobotState), blank(GaitTarget), blank(MotionCommand))
        self.controller.reset()
        on_change(self, {"stance.estimator": self.controller.set_estimator})
        self._stance, self._pack_stance = self.raw_output("stance"), Converter(Stance).pack
        self._torque = self.raw_output("trunk_torque")
        self._pack_torque = Converter(TrunkTorque).pack
        self.input("stance_estimator", self._on_estimator)
        self._join = self.join(
            {"robot_state": RobotState, "gait_target": GaitTarget, "motion_command": MotionCommand},
            self._step,
        )
        self.announce_ready()

    def _step(self, state: RobotState, target: GaitTarget, command: MotionCommand) -> None:
        stance, torque = self.controller.step(state, target, command)
        self._torque(self._pack_torque(torque))  # published first: the plant waits for it
        self._stance(self._pack_stance(stance))

    def _on_estimator(self, message: String) -> None:
        self.heard("stance_estimator", message.data, self._join.done + 1)
        try:
            self.controller.set_estimator(message.data)
        except LocoError as error:
            self.refuse("stance_estimator", str(error))


main = entry(StanceControllerNode)  # ``ros2 run loco_control stance_controller``

if __name__ == "__main__":
    main()
