# SPDX-License-Identifier: Apache-2.0
"""Node `robot_sim` of HyQ: `motion_command` and `trunk_torque` in, `robot_state` out."""

from __future__ import annotations

import json

from std_msgs.msg import String

from loco_control.gait.generator import GaitParams, standing_pose
from loco_control.ros.executor import entry
from loco_control.ros.messages.convert import Converter
from loco_control.ros.messages.topics import NODES
from loco_control.ros.parameters import declare
from loco_control.types import MotionCommand, RobotState, TrunkTorque

from .. import effects
from ..params import SimParams
from ..plant.simulation import Simulation
from ..robot import robot as robots
from .plant_node import CLOCKS, PlantNode, TickParams
from .tools import ToolTopics

__all__ = ["CLOCKS", "RobotSimNode", "TickParams"]


class RobotSimNode(PlantNode):
    """Node of the simulated plant with the control topics of `loco_msgs`."""

    controllers = NODES

    def __init__(self) -> None:
        super().__init__(250.0)
        seed = self.declare_parameter("seed", 0).value
        listed = json.loads(self.declare_parameter("effects", "[]").value)
        overrides = json.loads(self.declare_parameter("overrides", "{}").value)
        robot = robots.load(self.declare_parameter("robot", "hyq").value, overrides)
        origin = self.declare_parameter("standing_feet", list(GaitParams().origin)).value
        self.sim = Simulation(
            declare(self, SimParams(), "sim."),
            effects.from_list(listed),
            seed,
            1.0 / self.rate,
            robot,
            standing_pose(tuple(origin), robot.legs),
        )
        self._state_topic, self._pack = self.raw_output("robot_state"), Converter(RobotState).pack
        self._tools = ToolTopics(self, self.sim.robot, self.rate)
        self.output("robot_description").publish(String(data=self.sim.robot_description))
        self._connect()
        types = {"motion_command": MotionCommand, "trunk_torque": TrunkTorque}
        self.listen({name: Converter(cls) for name, cls in types.items()}, self._on_commands)
        self.announce_ready()

    def send(self, state: RobotState) -> None:
        """Publish the state and the topics for tools."""
        truth = self.sim.ground_truth()
        self._state_topic(self._pack(state))  # published first: controllers wait for it
        self._tools.publish(state, truth)


main = entry(RobotSimNode)  # ``ros2 run loco_sim robot_sim``

if __name__ == "__main__":
    main()
