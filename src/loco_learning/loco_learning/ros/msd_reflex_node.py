# SPDX-License-Identifier: Apache-2.0
"""Node `reflex_network` of a mass-spring-damper network: from accelerations to lengths."""

from __future__ import annotations

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.ros.executor import entry
from loco_control.ros.messages.joint_codec import JointCodec, Joints, stamp_ns, tick_of
from loco_control.ros.messages.msd_topics import MSD_TOPICS, RATE, link_names, node_names
from loco_control.ros.parameters import declare
from loco_sim.msd.network import chain
from loco_sim.msd.params import MsdParams

from ..networks.gait import Gait
from ..networks.reservoir import Controller, LoopParams
from ..params import PHASES
from .learning_node import LearningNode

MOVING = PHASES[1:]  # a network has no standing phase


class MsdReflexNode(LearningNode):
    """Filter, readout and mixer: trains the readout, closes the loop, and runs in closed loop."""

    table = MSD_TOPICS
    ERROR = "error"

    def __init__(self) -> None:
        super().__init__("reflex_network")
        rate = self.declare_parameter("control_rate", RATE).value
        params = declare(self, MsdParams(), "network.")
        network, loop = chain(params), declare(self, LoopParams(), "loop.")
        self._rate, self._shape = rate, (network.dimension, network.nodes)
        gait = self._read_gait(network.count)
        self.controller = Controller(gait, network.nodes, network.dimension, loop, 1.0 / rate)
        self.controller.compile()
        links = link_names(network.links.tolist())
        self._outputs_of = [
            (self.raw_output(name), JointCodec(links, name, ("position",)).pack)
            for name in ("link_command", "link_prediction", "link_target")
        ]
        codec = JointCodec(node_names(network.nodes, network.dimension), "node_states")
        self.join_by({"node_states": codec}, self._step, stamp_ns)
        self.announce_ready()

    def _read_gait(self, links: int) -> Gait:
        values = [
            np.array(self.declare_parameter(f"gait.{name}", [0.0]).value)
            for name in ("amplitude", "phase", "stiffness")
        ]
        if any(v.shape != (links,) for v in values):
            raise ParameterError(
                f"gait wants {links} amplitudes, phases and stiffnesses, got "
                f"{', '.join(str(len(v)) for v in values)}"
            )
        return Gait(*values, self.declare_parameter("gait.frequency", 1.0).value)

    def _step(self, state: Joints) -> None:
        tick = tick_of(state.time, self._rate)
        t = tick / self._rate
        phase = self.controller.phase(self.controller.tick)
        factor, prediction, target = self.controller.step(state.tau.reshape(self._shape).T)
        for (publish, pack), values in zip(
            self._outputs_of, (factor, prediction, target), strict=True
        ):
            publish(pack(t, values))
        error = float(np.sqrt(np.mean((prediction - target) ** 2)))
        self.follow(MOVING[phase], error, tick, t)


main = entry(MsdReflexNode)  # ``ros2 run loco_learning msd_reflex``

if __name__ == "__main__":
    main()
