# SPDX-License-Identifier: Apache-2.0
"""Every topic of the graph, named once: type, QoS, rate, who writes and who reads.

Nodes create their publishers and subscriptions from this table, the readiness
check counts endpoints by it, the recorder subscribes to it, and
``docs/topics.md`` is printed from it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...exceptions import NameUnknownError
from .installed import profile, ros_class

# Writers keep this many messages for a reliable reader that is behind (the
# recorder): more than the plant's flow window, so lockstep loses none.
WRITER_DEPTH = 200
FAULT_DEPTH = 100  # queue length of each reader in a graph with faults


@dataclass(frozen=True)
class Qos:
    """Reliability and durability of a topic, and how many messages a reader queues."""

    reliable: bool
    latched: bool
    depth: int

    def writer(self) -> Any:
        """Profile for publishers, with a deep queue, since depth is not negotiated."""
        deep = self.reliable and not self.latched
        return profile(self.reliable, self.latched, WRITER_DEPTH if deep else self.depth)

    def reader(self, depth: int | None = None) -> Any:
        """Profile for subscriptions, with the table's depth by default."""
        return profile(self.reliable, self.latched, depth or self.depth)

    def tap(self, reliable: bool) -> Any:
        """Profile for the recorder; a deep queue, except for latched and best-effort topics."""
        if self.latched or not self.reliable:
            return self.reader()
        return profile(reliable, False, WRITER_DEPTH)


COMMAND = Qos(reliable=True, latched=False, depth=1)
STATE = Qos(reliable=True, latched=False, depth=10)
LATCHED = Qos(reliable=True, latched=True, depth=1)
LATCHED_LOG = Qos(reliable=True, latched=True, depth=100)
CLOCK = Qos(reliable=False, latched=False, depth=1)


@dataclass(frozen=True)
class Topic:
    """One row of the table.

    ``message`` names the type, ``package/Type``. ``rate`` is in simulated time [Hz], 0 for topics
    written on events. ``writer`` is ``"any"`` for topics that a user may write.
    """

    name: str
    message: str
    qos: Qos
    rate: float
    writer: str
    readers: tuple[str, ...]
    doc: str

    @property
    def paced(self) -> bool:
        """Whether a tick waits for this topic; such a topic must have exactly one writer."""
        return self.rate > 0 and self.qos.reliable

    @property
    def kind(self) -> str:
        """Full name of the type, ``package/msg/Type``."""
        return self.message.replace("/", "/msg/")

    @property
    def type(self) -> type:
        """Message class of ROS, for publishers and subscriptions.

        Raises:
            NameUnknownError: ROS is not installed.
        """
        return ros_class(self.kind)


def _rows() -> tuple[Topic, ...]:
    sim, target, reflex = "robot_sim", "target_generator", "reflex_network"
    stance, recorder = "stance_controller", "recorder"
    nodes = (sim, target, reflex, stance, recorder)
    return (
        Topic("robot_state", "loco_msgs/RobotState", COMMAND, 250, sim, (target, reflex, stance),
              "measurements of the robot; starts the tick"),
        Topic("gait_target", "loco_msgs/GaitTarget", COMMAND, 250, target, (reflex, stance),
              "joint and foot references of the RCF"),
        Topic("motion_command", "loco_msgs/MotionCommand", COMMAND, 250, reflex, (sim, stance),
              "joint references for the impedance loop [rad, rad/s]"),
        Topic("trunk_torque", "loco_msgs/TrunkTorque", COMMAND, 250, stance, (sim,),
              "feed-forward torque of the trunk controller [N·m]"),
        Topic("stance", "loco_msgs/Stance", COMMAND, 250, stance, (), "stance estimate, for tools"),
        Topic("learning_state", "loco_msgs/LearningState", COMMAND, 250, reflex, (),
              "readout, error and phase"),
        Topic("joint_states", "sensor_msgs/JointState", STATE, 50, sim, (),
              "measured joints, for tools"),
        Topic("imu/data", "sensor_msgs/Imu", STATE, 50, sim, (), "REP-145 IMU, for tools"),
        Topic("ground_truth/odom", "nav_msgs/Odometry", STATE, 250, sim, (),
              "true base pose and velocity; no controller reads it"),
        Topic("/tf", "tf2_msgs/TFMessage", STATE, 50, sim, (),
              "base in odom from ground truth, and every link in its parent"),
        Topic("/clock", "rosgraph_msgs/Clock", CLOCK, 50, sim, (), "simulated time"),
        Topic("robot_description", "std_msgs/String", LATCHED, 0, sim, (), "URDF text"),
        Topic("/diagnostics", "diagnostic_msgs/DiagnosticArray", STATE, 0, "any", (),
              "1 Hz of wall time, every node"),
        Topic("events", "loco_msgs/Event", LATCHED_LOG, 0, "any", nodes,
              "ready, phase, heard, clipped, fall, resumed, timeout, estop, estop reset, finished, "
              "error"),
        Topic("recorder_status", "loco_msgs/RecorderStatus", LATCHED, 0, recorder, (sim,),
              "progress of the recorder; lockstep waits for it"),
        Topic("cmd_vel", "geometry_msgs/TwistStamped", COMMAND, 0, "any", (target,),
              "commanded velocity of the trunk: linear.x, linear.y [m/s], angular.z [rad/s]"),
        Topic("gait_frequency", "std_msgs/Float64", COMMAND, 0, "any", (target,),
              "commanded stride frequency [Hz]"),
        Topic("stance_estimator", "std_msgs/String", COMMAND, 0, "any", (stance,), "pse or rse"),
        Topic("heartbeat", "std_msgs/Empty", STATE, 0, "any", (sim,),
              "sign of life of the operator; see the plant's parameter `heartbeat`"),
        Topic("estop", "std_msgs/Bool", STATE, 0, "any", (sim,),
              "true stops the robot until the service `set_estop` resets the stop"),
    )  # fmt: skip


TOPICS = {topic.name: topic for topic in _rows()}
# Exists only in graphs with faults, so it is not in a table.
LOST_TICK = Topic(
    "lost_tick", "std_msgs/UInt64", STATE, 0, "faults", ("robot_sim",),
    "a fault removed a message of this tick, so no command will arrive for it",
)  # fmt: skip
NODES = ("robot_sim", "target_generator", "reflex_network", "stance_controller")


def topic(name: str, table: dict[str, Topic] | None = None) -> Topic:
    """Row of a topic in a table, `TOPICS` by default.

    Raises:
        NameUnknownError: The table has no such topic.
    """
    table = TOPICS if table is None else table
    if name not in table:
        raise NameUnknownError("topic", name, table)
    return table[name]


def starts_tick(table: dict[str, Topic]) -> Topic:
    """Row of the topic with which the plant begins a tick: the first with a rate."""
    return next(row for row in table.values() if row.rate > 0)


def faulty(name: str) -> str:
    """Name of the damaged copy of a topic, written by the node `faults`."""
    return f"/faulty{name}" if name.startswith("/") else f"faulty/{name}"


def to_stamp(t: float) -> Any:
    """ROS time of a simulated time [s], rounded to nanoseconds."""
    seconds, nanoseconds = divmod(round(t * 1e9), 1_000_000_000)
    return ros_class("builtin_interfaces/msg/Time")(sec=seconds, nanosec=nanoseconds)
