# SPDX-License-Identifier: Apache-2.0
"""Action ``find_gap`` over real DDS: mistakes, a robot that is heard, a model handed on."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from action_msgs.msg import GoalStatus
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from loco_bringup.bag.writer import BagWriter
from loco_bringup.live.calibrator import CalibratorNode
from loco_bringup.live.gap_goal import live_records
from loco_bringup.logs.rollout_bag import write_messages as write_log
from loco_control.ros.messages.calibration_topics import CALIBRATION_TOPICS
from loco_control.ros.messages.joint_topics import JOINT_TOPICS
from loco_control.ros.messages.topics import to_stamp
from loco_learning.calibration.live import Signals
from loco_learning.gap.proposals import pool
from loco_learning.gap.recordings.record import HELD_OUT
from loco_learning.runs.rollout import rollout
from loco_msgs.action import FindGap
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from .conftest import Caller

HERE = str(Path(__file__).resolve().parent)
if HERE not in sys.path:  # the child process gets our path
    sys.path.append(HERE)

import quick_gap  # noqa: E402

pytestmark = pytest.mark.ros


@pytest.fixture(scope="module")
def logs():
    """Runs of a servo pendulum."""
    chosen = [pool.choose(pool.pool(Model("servo_pendulum")), n) for n in ("steps", "preload")]
    return [rollout(e.replace(duration=2.0)) for e in chosen]


@pytest.fixture(scope="module")
def bags(logs, tmp_path_factory):
    folder, found = tmp_path_factory.mktemp("bags"), []
    for log in logs:
        writer = BagWriter(folder / log.experiment.name)
        write_log(log, writer)
        writer.close()
        found.append(str(writer.folder))
    return found


class Finding(Caller):
    """A calibrator, and a client of its action that finds gaps."""

    patience = 150.0

    def __init__(self, bench, folder):
        made = bench(
            lambda: CalibratorNode(find=quick_gap.find),
            CALIBRATION_TOPICS,
            **{"listen.patience": 1.5, "listen.skip": 0.0, "folders": f'["{folder}"]'},
        )
        self.states = made.listen("gap_search")
        super().__init__(made, FindGap, "find_gap")


@pytest.fixture
def caller(bench, tmp_path_factory):
    made = Finding(bench, tmp_path_factory.getbasetemp())
    yield made
    made.close()


def test_every_mistake_in_a_goal_is_one_clear_line(caller, tmp_path):
    link, secret = tmp_path / "link.csv", tmp_path / "secret"
    link.symlink_to("/etc/hosts")
    (tmp_path / "mapping.yaml").write_text("columns: [{column: a, joint: hinge, what: q}]")
    for name in ("secret", "secret.csv", "secret.json", "secret.mcap"):
        (tmp_path / name).write_text("Geheimnis 1\nGeheimnis 2\n")
    goals = [
        ({}, "namespace of a measured robot, or bags"),
        ({"bags": [str(tmp_path / "none")]}, "there is no recording at"),
        ({"measured": "/nobody", "robot": "pendulum"}, "nobody publishes /nobody/joint_states"),
        ({"measured": "/x", "robot": "tiger"}, "tigrillo"),
        ({"measured": "/1x", "robot": "pendulum"}, "a namespace has letters, digits and _"),
        ({"measured": "/x", "effects": ["magic"]}, "no effect named 'magic'"),
        ({"measured": "/x", "duration": float("nan")}, "duration must be in (0, 10000] s"),
        ({"bags": ["/etc/os-release"]}, "recording '/etc/os-release' is not below"),
        ({"bags": ["/etc/none"]}, "recording '/etc/none' is not below"),  # nor what there is
        ({"measured": "/x", "mapping": "/etc/hosts"}, "mapping '/etc/hosts' is not below"),
        ({"measured": "/x", "robot": "/etc/hosts"}, "robot '/etc/hosts' is not below"),
        ({"bags": [str(tmp_path / "../../../../etc/hosts")]}, "is not below"),
        ({"bags": [str(link)]}, "is not below"),
        ({"bags": [str(secret)], "mapping": str(tmp_path)}, ""),
        ({"bags": [str(tmp_path / "secret.csv")], "mapping": str(tmp_path)}, ""),
        ({"bags": [str(tmp_path / "secret.json")], "mapping": str(tmp_path)}, ""),
        ({"bags": [str(tmp_path / "secret.mcap")]}, ""),
    ]
    for goal, text in goals:
        status, result = caller.result(caller.send(**goal))
        assert status == GoalStatus.STATUS_ABORTED, goal
        assert text in result.message and "\n" not in result.message
        assert "Geheimnis" not in result.message
        caller.bench.wait(lambda message=result.message: caller.states[-1].text == message)
        assert caller.states[-1].phase == "failed"


def test_bags_are_searched_with_feedback_and_a_model_that_is_handed_on(caller, bags):
    models_sent = []
    tester = caller.bench.tester
    tester.create_subscription(
        String, "/twin/model", models_sent.append, JOINT_TOPICS["model"].qos.reader()
    )
    twin = tester.create_publisher(JointState, "/twin/joint_states", 1)
    status, result = caller.result(
        caller.send(bags=bags, robot="servo_pendulum", model="/twin", seed=1)
    )
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert (result.verdict, result.names, result.places) == (
        "named", ["coulomb_friction"], ["pivot"]
    )  # fmt: skip
    assert (result.before, result.after) == (12.0, 1.5)
    assert json.loads(result.gap_json)["verdict"] == "named"
    assert result.message.startswith("Named: coulomb friction in pivot.")
    assert models.loads(result.model_yaml).effects[0]["torque"] == 0.2
    assert [f.fraction for f in caller.feedback] == [0.1, 0.5, 0.9]
    assert {f.best for f in caller.feedback} == {"coulomb_friction"}
    caller.bench.wait(lambda: models_sent and caller.states[-1].phase == "done")
    assert models_sent[-1].data == result.model_yaml == caller.states[-1].model_yaml
    late = caller.bench.listen("gap_search")  # the last word is kept for whoever comes later
    caller.bench.wait(lambda: late and late[-1].verdict == result.verdict)
    tester.destroy_publisher(twin)


class Robot:
    """Says again what a run of a servo pendulum said."""

    def __init__(self, caller, log):
        self.log, self.tick, self._caller = log, 0, caller
        self._said = {
            name: caller.bench.tester.create_publisher(
                JointState, f"/real/{name}", JOINT_TOPICS[name].qos.writer()
            )
            for name in ("joint_states", "joint_command")
        }

    def heard(self):
        return all(p.get_subscription_count() for p in self._said.values())

    def step(self):
        row = min(self.tick, len(self.log) - 1)
        for name, angle in (("joint_states", self.log.q), ("joint_command", self.log.command)):
            message = JointState(name=["pivot"], position=[float(angle[row, 0])])
            message.velocity = [0.0] if name == "joint_command" else []
            message.header.stamp = to_stamp(0.01 * self.tick)
            self._said[name].publish(message)
        self.tick += 1
        for _ in range(8):
            self._caller.bench.executor.spin_once(timeout_sec=0.0)

    def close(self):
        for publisher in self._said.values():
            self._caller.bench.tester.destroy_publisher(publisher)


@pytest.fixture
def robot(caller, logs):
    made = Robot(caller, logs[0])
    yield made
    made.close()


def test_a_robot_is_listened_to_and_its_cause_found(caller, robot):
    handle = caller.send(measured="/real", robot="servo_pendulum", duration=1.0)
    caller.bench.wait(robot.heard)
    status, result = caller.result(handle, robot.step)
    assert status == GoalStatus.STATUS_SUCCEEDED, result.message
    assert models.loads(result.model_yaml).effects[0]["torque"] == pytest.approx(0.3)  # 3 parts
    assert caller.feedback[0].stage == "listening"


def test_cancel_while_it_listens_and_a_second_goal_meanwhile(caller, robot):
    handle = caller.send(measured="/real", robot="servo_pendulum", duration=1e4)
    caller.bench.wait(robot.heard)
    second = caller.send(measured="/real", robot="servo_pendulum")
    status, result = caller.result(second, robot.step)
    assert status == GoalStatus.STATUS_ABORTED
    assert "a search is running" in result.message
    handle.cancel_goal_async()
    status, result = caller.result(handle, robot.step)
    assert status == GoalStatus.STATUS_CANCELED
    caller.bench.wait(lambda: caller.states[-1].phase == "cancelled")


def test_what_was_heard_is_cut_in_parts_and_the_last_is_held_out(logs):
    log = logs[0]
    signals = Signals("/real", ["pivot"], ["pivot"], 100.0)
    for t, q, command in zip(log.t, log.q, log.command, strict=True):
        signals.add_state(float(t), q)
        signals.add_command(float(t), command)
    parts = live_records(signals, log.experiment.plant)
    assert [p.role == HELD_OUT for p in parts] == [False, False, True]
    assert sum(len(p.t) for p in parts) == len(log.t)
    joined = np.concatenate([p.signals["q"] for p in parts])
    np.testing.assert_allclose(joined, log.q, atol=1e-9)
