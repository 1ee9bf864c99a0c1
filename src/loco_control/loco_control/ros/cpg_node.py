# SPDX-License-Identifier: Apache-2.0
"""Node `target_generator` of joint robots: joint_states in, joint_target out."""

from __future__ import annotations

from ..gait.oscillators import Cpg, CpgParams
from ..names import LEGS, joint_name
from .executor import entry
from .messages.joint_codec import FRAME, JointCodec, Joints, stamp_ns, tick_of
from .messages.joint_topics import JOINT_TOPICS
from .node import LocoNode
from .parameters import declare


class JointNode(LocoNode):
    """Base of the controllers of a joint robot: names of the joints, ticks by message stamps.

    Attributes:
        joints: All joints, in array order.
        driven: Joints that have drives.
    """

    table = JOINT_TOPICS

    def __init__(self, name: str):
        super().__init__(name)
        self.rate = self.declare_parameter("control_rate", 100.0).value
        tigrillo = [joint_name(leg, kind) for leg in LEGS for kind in ("hfe", "kfe")]
        self.joints = tuple(self.declare_parameter("joints", tigrillo).value)
        driven = self.declare_parameter("driven", tigrillo[::2]).value
        self.driven = tuple(name for name in driven if name)  # [""] is ROS's empty list

    def time(self, time_ns: int) -> tuple[int, float]:
        """Tick and simulated time [s] of a stamp [ns], computed as in the plant."""
        tick = tick_of(time_ns, self.rate)
        return tick, tick * (1.0 / self.rate)


class CpgNode(JointNode):
    """Node of the oscillators that drive the joints."""

    def __init__(self) -> None:
        super().__init__("target_generator")
        self.cpg = Cpg(declare(self, CpgParams(), "target."), len(self.driven), 1.0 / self.rate)
        self._publish = self.raw_output("joint_target")
        self._pack = JointCodec(self.driven, "joint_target", ("position", "velocity")).pack
        self.join_by({"joint_states": JointCodec(self.joints, frame=FRAME)}, self._step, stamp_ns)
        self.announce_ready()

    def _step(self, state: Joints) -> None:
        _, t = self.time(state.time)
        self._publish(self._pack(t, *self.cpg.step(t)))


main = entry(CpgNode)  # ``ros2 run loco_control cpg``

if __name__ == "__main__":
    main()
