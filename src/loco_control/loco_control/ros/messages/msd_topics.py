# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph of a mass-spring-damper network: standard messages with equal stamps."""

from __future__ import annotations

from dataclasses import replace

from .topics import COMMAND, TOPICS, Topic

MSD_NODES = ("robot_sim", "reflex_network")
RATE = 200.0  # one tick per integration step of 5 ms


def _rows() -> tuple[Topic, ...]:
    sim, reflex = MSD_NODES
    state = "position [m], velocity [m/s] and, as effort, acceleration [m/s²] of the nodes along "
    state += "each axis; starts the tick"
    events = "ready, phase, finished, error"
    return (
        Topic("node_states", "sensor_msgs/JointState", COMMAND, RATE, sim, (reflex,), state),
        Topic("link_command", "sensor_msgs/JointState", COMMAND, RATE, reflex, (sim,),
              "commanded lengths of the links over their rest lengths [-], as position"),
        Topic("link_prediction", "sensor_msgs/JointState", COMMAND, RATE, reflex, (),
              "output of the readout, in the units of link_command"),
        Topic("link_target", "sensor_msgs/JointState", COMMAND, RATE, reflex, (),
              "output of the oscillators (open loop), in the units of link_command"),
        replace(TOPICS["/clock"], rate=0, writer=sim, readers=()),
        replace(TOPICS["/diagnostics"], readers=()),
        replace(TOPICS["events"], readers=(*MSD_NODES, "recorder"), doc=events),
        replace(TOPICS["recorder_status"], writer="recorder", readers=(sim,)),
        TOPICS["heartbeat"],
        TOPICS["estop"],
    )  # fmt: skip


MSD_TOPICS = {topic.name: topic for topic in _rows()}


def node_names(nodes: int, axes: int) -> list[str]:
    """Names of the rows of node_states, (nodes * axes): all x coordinates first."""
    return [f"node_{i}_{axis}" for axis in ("xz" if axes == 2 else "xyz") for i in range(nodes)]


def link_names(links: list[tuple[int, int]]) -> list[str]:
    """Names of the links, from their end nodes."""
    return [f"link_{i}_{j}" for i, j in links]
