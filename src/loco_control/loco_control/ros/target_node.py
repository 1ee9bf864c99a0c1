# SPDX-License-Identifier: Apache-2.0
"""Node `target_generator`: robot_state in, gait_target out."""

from __future__ import annotations

from typing import Any

from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Float64

from ..exceptions import LocoError
from ..gait.generator import LIVE, TWIST, GaitParams, TargetGenerator
from ..types import GaitTarget, RobotState
from .executor import entry
from .messages.convert import Converter
from .node import LocoNode
from .parameters import declare, declare_legs, on_change


class TargetGeneratorNode(LocoNode):
    """RCF trot generator; speed and frequency follow parameters and topics at run time."""

    def __init__(self) -> None:
        super().__init__("target_generator")
        dt = 1.0 / self.declare_parameter("control_rate", 250.0).value
        live = frozenset(f"gait.{name}" for name in LIVE)
        gait = declare(self, GaitParams(), "gait.", live)
        self.generator = generator = TargetGenerator(gait, dt, declare_legs(self))
        setters = {name: lambda value, name=name: generator.set(**{name: value}) for name in LIVE}
        on_change(self, {f"gait.{name}": setter for name, setter in setters.items()})
        self._clipped = ""  # difference between the last `cmd_vel` and the followed velocity
        self._publish = self.raw_output("gait_target")
        self._pack = Converter(GaitTarget).pack
        self.input("cmd_vel", self._on_velocity)
        self.input("gait_frequency", self._on_frequency)
        self._join = self.join({"robot_state": RobotState}, self._step)
        self.announce_ready()

    def _step(self, state: RobotState) -> None:
        self._publish(self._pack(self.generator.step(state)))

    def _on_velocity(self, message: TwistStamped) -> None:
        linear, angular = message.twist.linear, message.twist.angular
        requested = (linear.x, linear.y, angular.z)
        self.heard("cmd_vel", " ".join(map(str, requested)), self._join.done + 1)
        try:
            followed = self.generator.follow(*requested)
        except LocoError as error:
            self.refuse("cmd_vel", str(error))
            return
        clipped = tuple(followed.values()) != requested
        self._clipped = _difference(requested, followed) if clipped else ""
        if clipped:
            self.get_logger().warning(f"cmd_vel: {self._clipped}")
            self.event("clipped", f"cmd_vel: {self._clipped}", self._join.done + 1)

    def _on_frequency(self, message: Float64) -> None:
        self.heard("gait_frequency", message.data, self._join.done + 1)
        try:
            self.generator.set(frequency=message.data)
        except LocoError as error:
            self.refuse("gait_frequency", str(error))

    def diagnose(self) -> dict[str, Any]:
        """Note on the reduction of the last velocity command, for /diagnostics."""
        return {"cmd_vel_clipped": self._clipped} if self._clipped else {}


def _difference(requested: tuple[float, ...], followed: dict[str, float]) -> str:
    """Sentence on the difference between the requested and the followed velocity."""
    pairs = zip(TWIST, requested, followed.values(), strict=True)
    cut = [f"{name} {value:.3g} is cut to {limited:.3g}" for name, value, limited in pairs if value]
    return f"{', '.join(cut)}: out of range, or of reach of the legs"


main = entry(TargetGeneratorNode)  # ``ros2 run loco_control target_generator``

if __name__ == "__main__":
    main()
