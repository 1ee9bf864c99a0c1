# SPDX-License-Identifier: Apache-2.0
"""Node `target_generator`: robot_state in, gait_target out."""

from __future__ import annotations

import sys

from geometry_msgs.msg import TwistStamped
from std_msgs.msg import Float64

from loco_control.exceptions import LocoError
from loco_control.gait import GaitParams, TargetGenerator
from loco_control.types import GaitTarget, RobotState

from .convert import Converter
from .node import LocoNode
from .parameters import declare, on_change
from .spin import run_nodes

_LIVE = ("speed", "frequency", "step_height", "duty_factor")


class TargetGeneratorNode(LocoNode):
    """RCF trot generator; speed and frequency follow parameters and topics at run time."""

    def __init__(self) -> None:
        super().__init__("target_generator")
        dt = 1.0 / self.declare_parameter("control_rate", 250.0).value
        live = frozenset(f"gait.{name}" for name in _LIVE)
        self.generator = TargetGenerator(declare(self, GaitParams(), "gait.", live), dt)
        on_change(self, {f"gait.{name}": self._setter(name) for name in _LIVE})
        self._publish = self.raw_output("gait_target")
        self._pack = Converter(GaitTarget).pack
        self.input("cmd_vel", self._on_velocity)
        self.input("gait_frequency", self._on_frequency)
        self._join = self.join({"robot_state": RobotState}, self._step)
        self.announce_ready()

    def _step(self, state: RobotState) -> None:
        self._publish(self._pack(self.generator.step(state)))

    def _setter(self, name: str):
        return lambda value: self.generator.set(**{name: value})

    def _on_velocity(self, message: TwistStamped) -> None:
        self._try("cmd_vel", speed=message.twist.linear.x)

    def _on_frequency(self, message: Float64) -> None:
        self._try("gait_frequency", frequency=message.data)

    def _try(self, topic: str, **change: float) -> None:
        self.heard(topic, *change.values(), self._join.done + 1)
        try:
            self.generator.set(**change)
        except LocoError as error:
            self.get_logger().warning(str(error))


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_control target_generator``."""
    sys.exit(run_nodes([TargetGeneratorNode], args))


if __name__ == "__main__":
    main()
