# SPDX-License-Identifier: Apache-2.0
"""Each node of a joint robot's graph alone, over real DDS."""

import subprocess
import sys
import time

import numpy as np
import pytest
import yaml
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from loco_bringup.graph.processes import _environment
from loco_control.exceptions import GraphError
from loco_control.gait.oscillators import Cpg, CpgParams
from loco_control.ros.cpg_node import CpgNode
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import to_stamp
from loco_learning.ros.joint_reflex_node import JointReflexNode
from loco_msgs.msg import Event
from loco_sim.ros.joint_sim_node import JointSimNode
from loco_sim.ros.plant_node import START_TIMEOUT

pytestmark = pytest.mark.ros

DT = 0.01


class Plant:
    """The plant node, with a tester that answers in place of both controllers."""

    def __init__(self, bench, **parameters):
        self.b = bench(JointSimNode, JOINT_TOPICS, **parameters)
        self.robot = self.b.node.sim.robot
        self.names = [self.robot.joints[i] for i in self.robot.driven]
        self.rest = self.robot.standing[self.robot.driven]
        self.events = self.b.listen("events")
        self.states = self.b.listen("joint_states")
        self.b.listen("joint_states")  # there are two controllers
        self.imu = self.b.listen("imu/data")
        self.commands = self.b.publisher("joint_command")
        self.ready = self.b.publisher("events")
        self.pack = JointCodec(self.names, fields=("position", "velocity")).pack
        self.b.wait(lambda: self.said("ready"))
        for name in JointSimNode.controllers[1:]:
            self.ready.publish(Event(node=name, kind="ready"))
        self.b.wait(lambda: self.states)

    def said(self, kind):
        return [e.text for e in self.events if e.kind == kind]

    def tick(self, answer=None):
        """Answer the newest state and wait for the next."""
        count, t = len(self.states), stamp(self.states[-1])
        answer = self.rest if answer is None else answer
        self.commands.publish(self.pack(t, answer, 0.0 * answer))
        self.b.wait(lambda: len(self.states) > count and len(self.imu) == len(self.states))
        return np.array(self.states[-1].position)


def stamp(message):
    return message.header.stamp.sec + message.header.stamp.nanosec / 1e9


def test_states_of_all_joints_carry_one_stamp_per_tick(bench):
    plant = Plant(bench)
    for _ in range(5):
        plant.tick()
    assert [round(stamp(s) / DT) for s in plant.states] == list(range(6))
    assert [stamp(s) for s in plant.states] == [stamp(m) for m in plant.imu]
    assert plant.states[0].name == list(plant.robot.joints)


def test_a_command_that_is_not_finite_is_rejected_and_counted(bench):
    plant = Plant(bench)
    plant.tick()
    q = plant.tick(np.full(len(plant.names), np.nan))
    assert np.isfinite(q).all()
    assert plant.b.node.diagnose()["rejected_commands"] == 1
    plant.tick()
    assert plant.b.node.diagnose()["rejected_commands"] == 1


def test_a_joint_that_is_too_fast_stops_the_robot_and_commands_do_nothing_then(bench):
    plant = Plant(bench, **{"safety.overspeed": 0.1, "safety.trip_ticks": 2})
    for _ in range(40):
        plant.tick(plant.rest + 0.6)
        if plant.said("estop"):
            break
    (reason,) = plant.said("estop")
    assert "hfe_joint moves at" in reason
    assert plant.b.node.diagnose()["estop"] == reason
    for _ in range(100):
        at = plant.tick(plant.rest - 0.6)
    assert np.abs(plant.tick(plant.rest + 0.6) - at).max() < 0.02


def test_an_absurd_command_is_brought_back_into_the_range_of_the_joints(bench):
    plant = Plant(bench)
    for _ in range(30):
        q = plant.tick(np.full(len(plant.names), 100.0))
    assert np.abs(q[plant.robot.driven]).max() <= np.pi / 2 + 0.1
    counted = plant.b.node.diagnose()
    assert counted["limited_position"] == 30
    assert "estop" not in counted


def test_wrong_joint_names_are_one_clear_event(bench):
    plant = Plant(bench)
    names = ["lf_hip", *plant.names[1:]]
    for _ in range(3):
        plant.commands.publish(JointState(name=names, position=[0.0] * len(names)))
    with pytest.raises(GraphError, match="lf_hip"):
        plant.b.wait(lambda: False)
    plant.b.wait(lambda: plant.said("error"))
    assert len(plant.said("error")) == 1
    assert "lf_hip" in plant.said("error")[0] and plant.names[0] in plant.said("error")[0]
    assert len(plant.states) == 1  # nothing was driven by it


def test_joints_may_come_in_any_order(bench):
    plant = Plant(bench)
    message = JointState(name=plant.names[::-1], position=plant.rest[::-1].tolist())
    plant.commands.publish(message)
    plant.b.wait(lambda: len(plant.states) == 2)
    assert not plant.said("error")


def test_a_model_on_the_topic_becomes_the_plant_and_time_goes_on(bench):
    plant = Plant(bench)
    models, descriptions = plant.b.publisher("model"), plant.b.listen("robot_description")
    knees = np.setdiff1d(np.arange(len(plant.robot.joints)), plant.robot.driven)

    def settle():
        return [plant.tick() for _ in range(60)][-1][knees]

    soft = settle()
    overrides = {"springs.*_kfe_joint.stiffness": 60.0}
    text = yaml.safe_dump({"format": 1, "robot": "tigrillo", "overrides": overrides})
    models.publish(String(data=text))
    plant.b.wait(lambda: plant.said("model loaded"))
    assert "60" in plant.said("model loaded")[0]
    changed = settle()
    assert np.abs(changed - soft).max() > 0.05  # softer knees give way
    assert [round(stamp(s) / DT) for s in plant.states] == list(range(121))
    assert len(descriptions) == 2
    assert plant.b.node.sim.robot.springs["lf_kfe_joint"].stiffness == 60.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format: 1\nrobot: servo_pendulum", "this plant is of tigrillo"),
        ("format: 9\nrobot: tigrillo", "format 9"),
        ("robot: [", "not YAML"),
        ("nowhere/model.yaml", "is not below bags"),
        ("bags/nowhere/model.yaml", "no model at"),
    ],
)
def test_a_model_that_does_not_fit_is_refused_and_the_plant_goes_on(bench, text, message):
    plant = Plant(bench)
    before = plant.b.node.sim
    plant.b.publisher("model").publish(String(data=text))
    plant.b.wait(lambda: plant.said("model refused"))
    assert message in plant.said("model refused")[0]
    assert plant.b.node.sim is before
    plant.tick()


def test_in_realtime_a_silent_controller_means_damping(bench):
    plant = Plant(bench, clock="realtime", command_timeout=0.05)
    end = time.monotonic() + START_TIMEOUT + 0.5
    plant.b.wait(lambda: time.monotonic() > end)
    figures = plant.b.node.diagnose()
    assert figures["late_ticks"] > 5
    assert np.isfinite(plant.states[-1].position).all()
    hips = np.array(plant.states[-1].position)[plant.robot.driven]
    np.testing.assert_allclose(hips, plant.rest, atol=0.2)


def test_an_unknown_robot_ends_the_node_with_code_2():
    command = [sys.executable, "-m", "loco_sim.ros.joint_sim_node"]
    done = subprocess.run(
        [*command, "--ros-args", "-p", "robot:=tigrilo"],
        env=_environment(), capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert "tigrillo" in done.stderr
    assert "Traceback" not in done.stderr


def test_oscillators_answer_as_they_do_without_ros(bench):
    b = bench(CpgNode, JOINT_TOPICS)
    states, targets = b.publisher("joint_states"), b.listen("joint_target")
    names, count = b.node.joints, len(b.node.driven)
    pack = JointCodec(names).pack
    zeros = np.zeros(len(names))
    for tick in range(100):
        states.publish(pack(tick * DT, zeros, zeros, zeros))
        b.wait(lambda tick=tick: len(targets) == tick + 1)
    cpg = Cpg(CpgParams(), count, DT)
    expected = [cpg.step(tick * DT) for tick in range(100)]
    np.testing.assert_array_equal([t.position for t in targets], [q for q, _ in expected])
    np.testing.assert_array_equal([t.velocity for t in targets], [dq for _, dq in expected])
    assert targets[0].name == list(b.node.driven)


def test_a_reflex_that_is_off_hands_the_target_through(bench):
    b = bench(JointReflexNode, JOINT_TOPICS)
    writers = {name: b.publisher(name) for name in ("joint_states", "imu/data", "joint_target")}
    commands, predictions = b.listen("joint_command"), b.listen("joint_prediction")
    states = JointCodec(b.node.joints)
    targets = JointCodec(b.node.driven, fields=("position", "velocity"))
    zeros, rng = np.zeros(len(b.node.joints)), np.random.default_rng(1)
    imu = JOINT_TOPICS["imu/data"].type()
    for tick in range(10):
        q, dq = rng.normal(size=(2, len(b.node.driven)))
        imu.header.stamp = to_stamp(tick * DT)
        writers["joint_states"].publish(states.pack(tick * DT, zeros, zeros, zeros))
        writers["imu/data"].publish(imu)
        writers["joint_target"].publish(targets.pack(tick * DT, q, dq))
        b.wait(lambda tick=tick: len(commands) == tick + 1)
        np.testing.assert_array_equal(commands[-1].position, q)
        np.testing.assert_array_equal(commands[-1].velocity, dq)
    assert predictions == []
