# SPDX-License-Identifier: Apache-2.0
"""Topics of the graph of a joint robot: standard messages, matched by equal stamps.

Every name but /diagnostics is relative, so that several robots can run side by
side, each in a namespace. /clock and /tf come from a robot without namespace only.
"""

from __future__ import annotations

from .calibration_topics import CALIBRATION_TOPICS
from .msd_topics import MSD_TOPICS
from .topics import CLOCK, COMMAND, LATCHED, LATCHED_LOG, STATE, TOPICS, Topic

JOINT_NODES = ("robot_sim", "target_generator", "reflex_network")
# Rates are for a robot at 100 ticks per second; a robot.yaml may set another rate.
RATE = 100.0


def _rows() -> tuple[Topic, ...]:
    sim, target, reflex = JOINT_NODES
    recorder = "recorder"
    return (
        Topic("joint_states", "sensor_msgs/JointState", COMMAND, RATE, sim, (target, reflex),
              "readings of the sensors of all joints; starts the tick"),
        Topic("imu/data", "sensor_msgs/Imu", COMMAND, RATE, sim, (reflex,),
              "REP-145 IMU, same stamp"),
        Topic("joint_target", "sensor_msgs/JointState", COMMAND, RATE, target, (reflex,),
              "references of the oscillators for the driven joints"),
        Topic("joint_command", "sensor_msgs/JointState", COMMAND, RATE, reflex, (sim,),
              "references of the driven joints [rad, rad/s; a torque drive: N·m as position]"),
        Topic("joint_prediction", "sensor_msgs/JointState", COMMAND, RATE, reflex, (),
              "output of the readout; not published while the learner is off"),
        Topic("ground_truth/odom", "nav_msgs/Odometry", STATE, RATE, sim, (),
              "true base pose and velocity; no controller reads it"),
        Topic("knee_adc", "std_msgs/Float64MultiArray", STATE, 0, sim, (),
              "raw counts of the Hall sensors; only robots that have some"),
        Topic("/tf", "tf2_msgs/TFMessage", STATE, 0, sim, (),
              "base in odom and every link in its parent, without a namespace only"),
        Topic("/clock", "rosgraph_msgs/Clock", CLOCK, 0, sim, (),
              "simulated time, without a namespace only"),
        Topic("robot_description", "std_msgs/String", LATCHED, 0, sim, (), "URDF text"),
        Topic("model", "std_msgs/String", LATCHED, 0, "any", (sim,),
              "text of a model.yaml, which the plant uses from the next tick on"),
        Topic("/diagnostics", "diagnostic_msgs/DiagnosticArray", STATE, 0, "any", (),
              TOPICS["/diagnostics"].doc),
        Topic("events", "loco_msgs/Event", LATCHED_LOG, 0, "any", (*JOINT_NODES, recorder),
              "ready, phase, fall, model loaded, model refused, resumed, timeout, estop, "
              "estop reset, finished, error"),
        Topic("recorder_status", "loco_msgs/RecorderStatus", LATCHED, 0, recorder, (sim,),
              TOPICS["recorder_status"].doc),
        TOPICS["heartbeat"],
        TOPICS["estop"],
    )  # fmt: skip


JOINT_TOPICS = {topic.name: topic for topic in _rows()}
TABLES = {  # topics by node set
    "hyq": TOPICS,
    "joint": JOINT_TOPICS,
    "calibration": CALIBRATION_TOPICS,
    "msd": MSD_TOPICS,
}
