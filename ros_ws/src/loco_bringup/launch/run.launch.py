# SPDX-License-Identifier: Apache-2.0
"""Run an experiment of any robot with ``ros2 launch``, where ROS comes from apt packages.

ros2 launch loco_bringup run.launch.py experiment:=hyq_trot_reflex bag:=bags/my_run
ros2 launch loco_bringup run.launch.py experiment:=path/to/mine.yaml clock:=lockstep

The launch ends when the experiment ends or when a node dies.
"""

import atexit
import json
import tempfile
from pathlib import Path

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, EmitEvent, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit
from launch.events import Shutdown
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from loco_bringup.graph import node_set
from loco_bringup.outcome import describe, duration_of
from loco_learning.runs.experiment import load

ARGUMENTS = {
    "experiment": ("hyq_trot_reflex", "name or path of an experiment YAML"),
    "bag": ("", "new folder to record into; empty records nothing"),
    "clock": ("realtime", "lockstep, asap or realtime"),
    "namespace": ("", "namespace of all nodes"),
}


def nodes(context):
    """One process per node of the graph, and the recorder if `bag` is set."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    experiment = load(value["experiment"])
    specs = node_set.load(experiment.node_set)
    tick = {"clock": value["clock"], "duration": duration_of(experiment), "leave": True}
    recorder = {
        "bag": value["bag"],
        "custom_data": json.dumps(describe(experiment)),
        "control_rate": experiment.control_rate,
        "table": node_set.table_of(experiment.node_set),
    }
    run = {"recorded": bool(value["bag"]), "recorder": recorder, "weights": ""}
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", delete=False) as file:
        yaml.safe_dump(node_set.parameter_file(specs, experiment, tick, run), file)
    atexit.register(Path(file.name).unlink, missing_ok=True)
    executables = [(s.cls.split(".")[0], s.executable, s.name) for s in specs]
    if value["bag"]:
        executables.append(("loco_bringup", "recorder", "recorder"))
    started = [
        Node(package=package, executable=executable, name=name, namespace=value["namespace"],
             parameters=[file.name], output="screen")
        for package, executable, name in executables
    ]  # fmt: skip
    stop = [
        RegisterEventHandler(OnProcessExit(target_action=n, on_exit=[EmitEvent(event=Shutdown())]))
        for n in started
    ]
    return started + stop


def generate_launch_description():
    """Launch arguments and the nodes."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
