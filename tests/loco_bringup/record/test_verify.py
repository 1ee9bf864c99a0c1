# SPDX-License-Identifier: Apache-2.0
"""Golden bags: live controllers answer as recorded; a changed constant is found and located.

Each test starts processes and waits for discovery, which takes a few seconds.
"""

import json
from pathlib import Path

import pytest
import rclpy
import yaml
from geometry_msgs.msg import TwistStamped
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Float64, String

from loco_bringup.bag.copy import extract
from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.logs.rollout_bag import write_log
from loco_bringup.outcome import processor
from loco_bringup.record.verify import verify
from loco_control.exceptions import BagError, GraphError, NameUnknownError, ParameterError
from loco_learning.runs.experiment import from_values, load
from loco_learning.runs.rollout import rollout
from loco_sim.engines import ENGINES

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("verify")]

GOLDEN = Path(__file__).resolve().parents[2] / "golden"
NAMES = sorted(path.name for path in GOLDEN.iterdir() if path.is_dir())
PLANTS = [name for name in NAMES if name.endswith(ENGINES)]


def tolerance(name):
    """Equal bytes where the bag was made; other processors round otherwise."""
    return 0.0 if Bag(GOLDEN / name).metadata["processor"] == processor() else 1e-9


def test_the_golden_bags_are_there_and_small():
    assert {"hyq_open", "hyq_reflex", "tigrillo_open", "tigrillo_reflex"} <= set(NAMES)
    assert len(PLANTS) == 4
    size = sum(p.stat().st_size for name in NAMES for p in (GOLDEN / name).iterdir())
    assert size < 2_000_000


@pytest.mark.parametrize("name", NAMES)
def test_controllers_answer_as_they_did(name):
    verdict = verify(GOLDEN / name, tolerance=tolerance(name))
    assert [str(d) for d in verdict.first] == [] and verdict.trouble == ""
    assert verdict.identical
    topics = Bag(GOLDEN / name).topics
    for topic, count in verdict.compared.items():
        assert count == topics["/" + topic].count == verdict.ticks


@pytest.mark.parametrize("name", PLANTS)
def test_plants_say_what_they_said(name, tmp_path):
    """Sensors too: the run again, on the engine that it named, byte for byte."""
    if tolerance(name):
        pytest.skip("contacts amplify the last bits, in which processors differ")
    golden = Bag(GOLDEN / name)
    experiment = from_values(golden.yaml("experiment.yaml"))
    write_log(rollout(experiment), tmp_path / "again")
    again = Bag(tmp_path / "again")
    for topic in golden.topics:
        assert again.raw(topic)[1] == golden.raw(topic)[1], topic


def test_each_controller_in_its_process_answers_the_same():
    verdict = verify(GOLDEN / "hyq_open", "processes", tolerance=tolerance("hyq_open"))
    assert verdict.identical


@pytest.mark.parametrize(
    ("name", "change", "topic", "field"),
    [
        ("hyq_open", {"gait.step_height": 0.1001}, "gait_target", "q["),
        ("tigrillo_reflex", {"learner.regularisation": 5.1}, "joint_prediction", "position["),
    ],
)
def test_a_changed_parameter_is_caught_and_located(name, change, topic, field):
    verdict = verify(GOLDEN / name, overrides=change)
    assert not verdict.identical
    first = verdict.first[0]
    assert first.topic == topic and first.field.startswith(field)
    assert first.recorded != first.live and first.tick >= 0
    assert set(json.loads(json.dumps(verdict.to_dict()))["different"]) == set(verdict.different)


CHANGED = '''
from loco_control.ros.stance_node import StanceControllerNode


class ChangedNode(StanceControllerNode):
    """A stance controller with another constant in its code."""

    def __init__(self):
        super().__init__()
        step = self.controller.step

        def changed(state, target, command):
            stance, torque = step(state, target, command)
            if state.tick >= 40:
                torque.tau[5] *= 1.0 + 1e-12
            return stance, torque

        self.controller.step = changed
'''


def test_a_changed_constant_in_the_code_is_caught_and_located(tmp_path, monkeypatch):
    (tmp_path / "changed_stance.py").write_text(CHANGED)
    nodes = {"nodes": [
        {"name": "target_generator", "class": "loco_control.ros.target_node:TargetGeneratorNode",
         "parameters": ["gait"]},
        {"name": "reflex_network", "class": "loco_learning.ros.reflex_node:ReflexNetworkNode",
         "parameters": ["learner", "seed", "weights"]},
        {"name": "stance_controller", "class": "changed_stance:ChangedNode",
         "parameters": ["stance", "trunk"]},
    ]}  # fmt: skip
    (tmp_path / "nodes.yaml").write_text(yaml.safe_dump(nodes))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    verdict = verify(GOLDEN / "hyq_open", nodes=str(tmp_path / "nodes.yaml"))
    assert set(verdict.different) == {"trunk_torque"}
    first = verdict.first[0]
    assert (first.topic, first.field) == ("trunk_torque", "tau[5]")
    assert first.tick >= 40
    assert first.live == pytest.approx(first.recorded, rel=1e-9)


class Person:
    """Says something to a run now and then."""

    def __init__(self):
        self._context = rclpy.Context()
        rclpy.init(context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("person", context=self._context)
        kinds = {"cmd_vel": TwistStamped, "gait_frequency": Float64, "stance_estimator": String}
        self._outputs = {n: self._node.create_publisher(k, n, 10) for n, k in kinds.items()}
        self._say = {name: output.publish for name, output in self._outputs.items()}
        self._said = 0

    def __call__(self, progress):
        # The reader and the recorder must have been found, or there is nothing to verify.
        found = all(o.get_subscription_count() >= 2 for o in self._outputs.values())
        if found and progress.sim_time > 0.4 + 0.15 * self._said:
            self._said += 1
            speed = TwistStamped()
            speed.twist.linear.x = 0.05 * self._said
            self._say["cmd_vel"](speed)
            self._say["gait_frequency"](Float64(data=1.5 + 0.1 * self._said))
            self._say["stance_estimator"](String(data="rse" if self._said % 2 else "pse"))

    def close(self):
        self._node.destroy_node()
        self._context.try_shutdown()


def test_what_people_said_is_said_again_at_its_tick(tmp_path):
    short = {"gait.start_time": 0.2, "learner.train": 0.6, "learner.closing": 0.2}
    experiment = load("hyq_short", {**short, "learner.test": 0.5})
    person = Person()
    try:
        runner.run(experiment, tmp_path / "bag", speed=0.25, on_progress=person)
    finally:
        person.close()
    bag = Bag(tmp_path / "bag")
    heard = [e for e in bag.messages("events") if e.kind == "heard"]
    # A node may miss what is said while it is being found; what it heard is what counts.
    assert {e.text.split()[0] for e in heard} == {"cmd_vel", "gait_frequency", "stance_estimator"}
    said = {str(m.data) for m in bag.messages("gait_frequency")}
    assert {e.text.split()[1] for e in heard if e.text.startswith("gait_frequency")} <= said
    verdict = verify(tmp_path / "bag")
    assert [str(d) for d in verdict.first] == [] and verdict.identical


def test_a_node_that_dies_is_named_with_its_last_words(tmp_path, monkeypatch):
    (tmp_path / "dying.py").write_text(
        "class Dying:\n    def __init__(self):\n        raise SystemExit('out of order')\n"
    )
    node = {"name": "target_generator", "class": "dying:Dying"}
    (tmp_path / "nodes.yaml").write_text(yaml.safe_dump({"nodes": [node]}))
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(GraphError, match="out of order"):
        verify(GOLDEN / "hyq_open", nodes=str(tmp_path / "nodes.yaml"))


def test_bags_that_cannot_be_verified_say_why(tmp_path):
    with pytest.raises(ParameterError, match="composed, processes"):
        verify(GOLDEN / "hyq_open", layout="rollout")
    with pytest.raises(ParameterError, match="tolerance"):
        verify(GOLDEN / "hyq_open", tolerance=-1.0)
    with pytest.raises(NameUnknownError, match="step_height"):
        verify(GOLDEN / "hyq_open", overrides={"gait.step_heigth": 0.1})
    thin = extract(GOLDEN / "hyq_open", tmp_path / "thin", ["robot_state:2", "motion_command"])
    with pytest.raises(BagError, match="tick 1 is missing"):
        verify(thin)
    blind = extract(GOLDEN / "hyq_open", tmp_path / "blind", ["motion_command"])
    with pytest.raises(BagError, match="has no robot_state"):
        verify(blind)
    mute = extract(GOLDEN / "hyq_open", tmp_path / "mute", ["robot_state"])
    with pytest.raises(BagError, match="no answers to compare"):
        verify(mute)
