# SPDX-License-Identifier: Apache-2.0
"""Node `reflex_network` of robots with joints: from sensors and target to joint_command."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from loco_control.exceptions import NameUnknownError
from loco_control.ros.cpg_node import JointNode
from loco_control.ros.executor import entry
from loco_control.ros.messages.joint_codec import (
    FRAME,
    ImuReader,
    ImuSample,
    JointCodec,
    Joints,
    stamp_ns,
)
from loco_control.ros.parameters import declare
from loco_control.types import MotionCommand

from ..params import OPEN, PHASES, JointLearnerParams
from ..reflex.joint_sensors import passive_joints, sensor_kinds, sensor_vector
from ..reflex.network import ReflexNetwork
from ..reflex.senses import BodySensors
from .learning_node import LearningNode


class JointReflexNode(LearningNode, JointNode):
    """Reflex network on the sensors; passes the target through until closing, or always."""

    def __init__(self) -> None:
        super().__init__("reflex_network")
        seed = self.declare_parameter("seed", 0).value
        self._save_to = self.declare_parameter("save_weights", "").value
        params = declare(self, JointLearnerParams(), "learner.")
        for name in self.driven:
            if name not in self.joints:
                raise NameUnknownError("joint to drive", name, self.joints)
        driven = np.array([self.joints.index(name) for name in self.driven], dtype=int)
        self._robot = SimpleNamespace(joints=self.joints, driven=driven)
        self._passive = passive_joints(self._robot)
        senses = BodySensors(params, sensor_kinds(self._robot), len(driven))
        self.network = ReflexNetwork(params, senses, 1.0 / self.rate, seed)
        self._compile()
        self._connect()

    def _connect(self) -> None:
        fields = ("position", "velocity")
        self._command = self.raw_output("joint_command")
        self._pack_command = JointCodec(self.driven, "joint_command", fields).pack
        self._prediction = self.raw_output("joint_prediction")
        self._pack_prediction = JointCodec(self.driven, "joint_prediction", fields[:1]).pack
        readers = {
            "joint_states": JointCodec(self.joints, "joint_states", frame=FRAME),
            "imu/data": ImuReader(),
            "joint_target": JointCodec(self.driven, "joint_target", fields),
        }
        self.join_by(readers, self._step, stamp_ns)
        self.announce_ready()

    def _compile(self) -> None:
        """Run one learning step and reset, so that kernels are compiled before the first tick."""
        params, zeros = self.network.params, np.zeros(len(self.driven))
        if params.enabled:
            tick, felt = round(params.stand * self.rate), np.zeros(len(self.network.senses.sensors))
            self.network.step(tick, 0.0, felt, MotionCommand(tick, 0.0, zeros, zeros))
            self.network.reset()

    def _step(self, joints: Joints, imu: ImuSample, target: Joints) -> None:
        tick, t = self.time(joints.time)
        learns, felt = self.network.params.enabled, None
        if learns:
            state = SimpleNamespace(
                q=joints.q, angular_velocity=imu.angular_velocity, orientation=imu.orientation
            )
            felt = sensor_vector(state, self._robot, self._passive)
        command, learning = self.network.step(
            tick, t, felt, MotionCommand(tick, t, target.q, target.dq)
        )
        self._command(self._pack_command(t, command.q, command.dq))
        if learns:
            prediction = learning.prediction[: len(self.driven)]
            self._prediction(self._pack_prediction(t, prediction))
        phase = PHASES[learning.phase] if learns else OPEN
        self.follow(phase, learning.error, tick, t, self.network)


main = entry(JointReflexNode)  # ``ros2 run loco_learning joint_reflex``

if __name__ == "__main__":
    main()
