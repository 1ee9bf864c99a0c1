# SPDX-License-Identifier: Apache-2.0
"""Plant nodes with standard messages: joint_command in, joint_states and imu/data out."""

from __future__ import annotations

from std_msgs.msg import Float64MultiArray, String

from loco_control.ros.messages.codec import Codec
from loco_control.ros.messages.joint_codec import JointCodec, Joints, stamp_ns, tick_of
from loco_control.ros.messages.joint_topics import JOINT_NODES, JOINT_TOPICS
from loco_control.types import GroundTruth, RobotState

from ..plant.joint_commands import JointCommands
from .encoders import encoders
from .plant_node import PlantNode

EACH_TICK = ("joint_states", "imu/data", "ground_truth/odom")  # controllers wait for the first two
GLOBAL_TOPICS = ("/tf", "/clock")  # omitted in a namespace: would collide with other robots


class JointPlantNode(PlantNode):
    """Base of plant nodes of joint robots, simulated or real: their messages.

    A subclass creates `sim`, then calls `_open`.
    """

    table = JOINT_TOPICS
    controllers = JOINT_NODES

    def _open(self) -> None:
        """Create outputs, then inputs, and announce the node."""
        names = [*EACH_TICK, *(GLOBAL_TOPICS if self.get_namespace() == "/" else ())]
        self._outputs_by_topic = {name: self.raw_output(name) for name in names}
        self._encode()
        self._description = self.output("robot_description")
        self._description.publish(String(data=self.sim.robot_description))
        counts = self.sim.adc()
        self._adc = self.raw_output("knee_adc") if len(counts) else None
        if self._adc:
            codec = Codec(Float64MultiArray(data=[0.0] * len(counts)))
            self._adc_record = codec.record()
        self._connect()
        self._hear()
        self.announce_ready()

    def _encode(self) -> None:
        """Recreate the encoders, since a model may have other links for the same joints."""
        by_topic = encoders(self.sim.robot)
        self._rows = [(publish, by_topic[name]) for name, publish in self._outputs_by_topic.items()]
        self._commands_of = JointCommands(self.sim.robot)

    def _hear(self) -> None:
        robot = self.sim.robot
        driven = [robot.joints[i] for i in robot.driven]
        codec = JointCodec(driven, "joint_command", ("position", "velocity"))
        self.listen({"joint_command": codec}, self._on_joints, stamp_ns)

    def _on_joints(self, command: Joints) -> None:
        tick = tick_of(command.time, self.rate)
        self._on_commands(*self._commands_of(tick, tick / self.rate, command.q, command.dq))

    def newest(self) -> int:
        """Stamp of the newest state [ns]."""
        return round(self.state.t * 1e9) if self.started else -1

    def send(self, state: RobotState) -> None:
        """Publish sensor readings and ground truth with the same stamp."""
        self._publish_rows(state, self.sim.ground_truth())

    def _publish_rows(self, state: RobotState, truth: GroundTruth) -> None:
        for publish, encode in self._rows:
            publish(encode(state, truth))
        if self._adc:
            self._adc_record["data"] = self.sim.adc()
            self._adc(self._adc_record.tobytes())
