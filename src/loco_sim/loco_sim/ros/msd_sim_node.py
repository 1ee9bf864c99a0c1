# SPDX-License-Identifier: Apache-2.0
"""Node `robot_sim` of a mass-spring-damper network: link_command in, node_states out."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from rosgraph_msgs.msg import Clock

from loco_control.exceptions import LocoError
from loco_control.ros.executor import entry
from loco_control.ros.messages.joint_codec import JointCodec, Joints, stamp_ns, tick_of
from loco_control.ros.messages.msd_topics import MSD_NODES, MSD_TOPICS, RATE, link_names, node_names
from loco_control.ros.messages.topics import to_stamp
from loco_control.ros.parameters import declare

from ..msd.network import chain
from ..msd.params import MsdParams
from ..msd.simulation import Drive, MsdSimulation
from .plant_node import PlantNode


class NodeStates(NamedTuple):
    """State of a network at a tick."""

    tick: int
    t: float  # [s]
    position: np.ndarray  # [m], (nodes, axes)
    velocity: np.ndarray  # [m/s], (nodes, axes)
    acceleration: np.ndarray  # [m/s²], (nodes, axes)


class LinkCommand(NamedTuple):
    """Driven length / rest length of the links for a tick."""

    tick: int
    factor: np.ndarray  # (links,)


class MsdPlant:
    """A network with the interface that `PlantNode` needs: one integration step per tick."""

    fallen = ""  # a network cannot fall
    rejected = 0

    def __init__(self, params: MsdParams, stiffness: np.ndarray | None = None):
        network = chain(params)
        zero = np.zeros(network.count)
        stiffness = network.stiffness if stiffness is None else stiffness
        self.simulation = MsdSimulation(network, params, Drive(zero, zero, 0.0, stiffness))
        self.start = network.centre_of_mass(network.positions)[0]

    def reset(self) -> NodeStates:
        """Reset the network; its initial state."""
        self.simulation.reset()
        return self._state()

    def step(self, command: LinkCommand) -> NodeStates:
        """Advance by one tick; the new state."""
        self.rejected += not np.all(np.isfinite(command.factor))
        self.simulation.step(np.nan_to_num(command.factor, nan=1.0, posinf=1.0, neginf=1.0))
        self.simulation.check_finite()
        return self._state()

    def _state(self) -> NodeStates:
        s = self.simulation
        return NodeStates(s.tick, s.time, s.position, s.velocity, s.acceleration)

    @property
    def distance(self) -> float:
        """Distance of the centre of mass along x since the start [m]."""
        s = self.simulation
        return float(s.network.centre_of_mass(s.position)[0] - self.start)

    def close(self) -> None:
        """There are no resources to release."""


class MsdSimNode(PlantNode):
    """Plant node of a network, with standard messages."""

    table = MSD_TOPICS
    controllers = MSD_NODES

    def __init__(self) -> None:
        super().__init__(RATE)
        self.declare_parameter("seed", 0)
        params = declare(self, MsdParams(), "network.")
        stiffness = np.array(self.declare_parameter("gait.stiffness", [0.0]).value)
        network = chain(params)
        self.sim = MsdPlant(params, stiffness if len(stiffness) == network.count else None)
        self._rest_command = LinkCommand(0, np.ones(network.count))
        self._pack = JointCodec(node_names(network.nodes, network.dimension), "node_states").pack
        self._states = self.raw_output("node_states")
        self._clock_output = self.output("/clock") if self.get_namespace() == "/" else None
        self._connect()
        codec = JointCodec(link_names(network.links.tolist()), "link_command", ("position",))
        self.listen({"link_command": codec}, self._on_links, stamp_ns)
        self.announce_ready()

    def _on_links(self, command: Joints) -> None:
        self._on_commands(LinkCommand(tick_of(command.time, self.rate), command.q), None)

    def advance(self, command: LinkCommand, trunk: None) -> NodeStates:
        """One integration step."""
        try:
            return self.sim.step(command)
        except LocoError as error:
            self.event("error", str(error), self.state.tick, self.state.t)
            raise

    def safe_command(self) -> tuple[Any, Any]:
        """Command in the safe state: all links at their rest lengths."""
        return self._rest_command._replace(tick=self.state.tick), None

    def newest(self) -> int:
        """Stamp of the newest state [ns]."""
        return round(self.state.t * 1e9) if self.started else -1

    def send(self, state: NodeStates) -> None:
        """Publish the node states and the clock with the same stamp."""
        columns = (v.T.reshape(-1) for v in state[2:])
        self._states(self._pack(state.t, *columns))
        if self._clock_output:
            self._clock_output.publish(Clock(clock=to_stamp(state.t)))

    def end_text(self) -> str:
        """Message on the state at the end."""
        return f"{self.state.t:.1f} s simulated, {self.sim.distance:.2f} m forward"


main = entry(MsdSimNode)  # ``ros2 run loco_sim msd_sim``

if __name__ == "__main__":
    main()
