# SPDX-License-Identifier: Apache-2.0
"""Node `reflex_network` of joint robots: sensors and target in, joint_command out."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError
from loco_control.ros.cpg_node import JointNode
from loco_control.ros.joint_codec import (
    FRAME,
    ImuReader,
    ImuSample,
    JointCodec,
    Joints,
    stamp_ns,
)
from loco_control.ros.parameters import declare
from loco_control.ros.spin import run_nodes
from loco_learning.joint_reflex import PHASES, JointLearnerParams, JointReflex
from loco_learning.joint_sensors import passive_joints, sensor_kinds, sensor_vector

from .saving import save_weights


class JointReflexNode(JointNode):
    """Reservoir over the sensors; passes the target through until closing begins, or for ever."""

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
        kinds = sensor_kinds(self._robot)
        self.reflex = JointReflex(params, kinds, len(driven), 1.0 / self.rate, seed)
        self._compile(len(kinds))
        self._phase, self._error = -1, 0.0
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

    def _compile(self, sensors: int) -> None:
        """One step that learns, then back to the start: the kernels are ready before a tick is."""
        params, zeros = self.reflex.params, np.zeros(len(self.driven))
        if params.enabled:
            self.reflex.step(round(params.stand * self.rate), 0.0, np.zeros(sensors), zeros, zeros)
            self.reflex.reset()

    def _step(self, joints: Joints, imu: ImuSample, target: Joints) -> None:
        tick, t = self.time(joints.time)
        learns, sensors = self.reflex.params.enabled, None
        if learns:
            state = SimpleNamespace(
                q=joints.q, angular_velocity=imu.angular_velocity, orientation=imu.orientation
            )
            sensors = sensor_vector(state, self._robot, self._passive)
        q, dq, prediction, phase, error = self.reflex.step(tick, t, sensors, target.q, target.dq)
        self._command(self._pack_command(t, q, dq))
        if learns:
            self._prediction(self._pack_prediction(t, prediction))
        self._error = error
        if phase != self._phase:
            self._enter(phase, tick, t)

    def _enter(self, phase: int, tick: int, t: float) -> None:
        self._phase = phase
        learns = self.reflex.params.enabled
        self.event("phase", PHASES[phase] if learns else "open loop", tick, t)
        # Weights are final when the test phase begins: nothing trains after it.
        if learns and PHASES[phase] == "test" and self._save_to:
            save_weights(self, self.reflex, self._save_to, tick, t)

    def diagnose(self) -> dict[str, Any]:
        """Phase and prediction error."""
        phase = PHASES[self._phase] if self._phase >= 0 else "waiting"
        return {"phase": phase, "error_rad": self._error}


def main(args: list[str] | None = None) -> None:
    """Entry point of ``ros2 run loco_learning joint_reflex``."""
    sys.exit(run_nodes([JointReflexNode], args))


if __name__ == "__main__":
    main()
