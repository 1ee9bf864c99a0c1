# SPDX-License-Identifier: Apache-2.0
"""Launch files, under a stand-in of `launch`: that package is not among the wheels of ROS.

The stand-in has the names and the behaviour that the files use: a process per node with the
arguments that launch_ros gives it, and SIGINT to all when one ends and a handler says so.
"""

import importlib.util
import signal
import subprocess
import sys
import time
import types
from dataclasses import dataclass, field, make_dataclass

import pytest
import rclpy
import yaml

from loco_bringup.bag.reader import Bag
from loco_bringup.cli.clone import root

FOLDER = root() / "ros_ws/src/loco_bringup/launch"
PATIENCE = 120.0  # [s]


LaunchDescription = make_dataclass("LaunchDescription", ["entities"])
DeclareLaunchArgument = make_dataclass(
    "DeclareLaunchArgument", ["name", "default_value", "description"]
)
OpaqueFunction = make_dataclass("OpaqueFunction", ["function"])
Shutdown = make_dataclass("Shutdown", [])
EmitEvent = make_dataclass("EmitEvent", ["event"])
RegisterEventHandler = make_dataclass("RegisterEventHandler", ["handler"])
OnProcessExit = make_dataclass("OnProcessExit", ["target_action", "on_exit"])


@dataclass
class LaunchConfiguration:
    """Value of an argument."""

    name: str

    def perform(self, context):
        return context[self.name]


@dataclass(eq=False)
class Node:
    """Process of a node."""

    package: str
    executable: str
    name: str
    namespace: str
    parameters: list
    output: str
    process: subprocess.Popen = field(default=None, init=False)

    def start(self, folder):
        files = []
        for i, each in enumerate(self.parameters):
            if isinstance(each, dict):
                file = folder / f"{self.name}_{i}.yaml"
                file.write_text(yaml.safe_dump({"/**": {"ros__parameters": each}}))
                each = str(file)
            files += ["--params-file", each]
        names = ["-r", f"__node:={self.name}"]
        names += ["-r", f"__ns:=/{self.namespace}"] if self.namespace else []
        command = [sys.executable, "-m", "loco_bringup.cli.main", "ros2", "run", self.package,
                   self.executable, "--ros-args", *names, *files]  # fmt: skip
        self.process = subprocess.Popen(command)


MODULES = {
    "launch": (LaunchDescription,),
    "launch.actions": (DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler),
    "launch.event_handlers": (OnProcessExit,),
    "launch.events": (Shutdown,),
    "launch.substitutions": (LaunchConfiguration,),
    "launch_ros": (),
    "launch_ros.actions": (Node,),
}


@pytest.fixture
def describe(monkeypatch):
    """Function that gives the entities of a launch file with arguments, as `ros2 launch` would."""
    for name, members in MODULES.items():
        module = types.ModuleType(name)
        vars(module).update({member.__name__: member for member in members})
        monkeypatch.setitem(sys.modules, name, module)

    def entities(file, **arguments):
        spec = importlib.util.spec_from_file_location("under_test", FOLDER / file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        found = module.generate_launch_description().entities
        declared = [each for each in found if isinstance(each, DeclareLaunchArgument)]
        assert all(each.description for each in declared)
        context = {each.name: each.default_value for each in declared}
        assert set(arguments) <= set(context)
        (function,) = [each for each in found if isinstance(each, OpaqueFunction)]
        return function.function({**context, **arguments})

    return entities


def run(entities, folder, until=lambda: False):
    """Exit codes by name, of all nodes; the first end whose handler says so is the end of all."""
    nodes = [each for each in entities if isinstance(each, Node)]
    handlers = [each.handler for each in entities if isinstance(each, RegisterEventHandler)]
    watched = [h.target_action for h in handlers if isinstance(h.on_exit[0].event, Shutdown)]
    try:
        for node in nodes:
            node.start(folder)
        end = time.monotonic() + PATIENCE
        while not until() and all(node.process.poll() is None for node in watched or nodes):
            assert time.monotonic() < end, "no end"
            time.sleep(0.1)
        for node in nodes:
            node.process.send_signal(signal.SIGINT)
        return {node.name: node.process.wait(20.0) for node in nodes}
    finally:
        for node in nodes:
            node.process.kill()
            node.process.wait()


@pytest.mark.ros
@pytest.mark.parametrize(
    ("experiment", "namespace"), [("hyq_trot_open", ""), ("tigrillo_bound", "left")]
)
def test_an_experiment_ends_by_itself_with_a_whole_bag(describe, tmp_path, experiment, namespace):
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"extends: {experiment}\nduration: 0.5\n")
    bag = tmp_path / "bag"
    entities = describe(
        "run.launch.py", experiment=str(mine), clock="lockstep", bag=str(bag), namespace=namespace
    )
    codes = run(entities, tmp_path)
    assert set(codes.values()) == {0}, codes
    recorded = Bag(bag)
    assert "finished" in [event.kind for event in recorded.messages("events")]
    assert recorded.metadata["experiment"]


@pytest.mark.ros
def test_the_calibrator_waits_until_it_is_stopped(describe, tmp_path):
    entities = describe("calibrator.launch.py", folders=f"[{tmp_path}]", namespace="left")
    rclpy.init()
    try:
        watcher = rclpy.create_node("watcher")
        action = ("/left/find_gap/_action/send_goal", ["loco_msgs/action/FindGap_SendGoal"])
        codes = run(entities, tmp_path, lambda: action in watcher.get_service_names_and_types())
    finally:
        rclpy.shutdown()
    assert codes == {"calibrator": 0}
