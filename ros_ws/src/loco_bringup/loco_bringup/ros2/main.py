# SPDX-License-Identifier: Apache-2.0
"""`loco ros2`: arguments and output of the original ros2 commands, based on rclpy only."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable
from typing import Any

from loco_control.exceptions import NameUnknownError

from ..cli.table import Parser
from . import nodes, topics
from .client import Client

# Start functions of the nodes for `ros2 run`, by package and executable.
EXECUTABLES = {
    ("loco_bringup", "calibrator"): "loco_bringup.live.calibrator:main",
    ("loco_bringup", "recorder"): "loco_bringup.record.recorder:main",
    ("loco_bringup", "replayer"): "loco_bringup.record.replayer:main",
    ("loco_control", "cpg"): "loco_control.ros.cpg_node:main",
    ("loco_control", "faults"): "loco_control.ros.fault_node:main",
    ("loco_control", "stance_controller"): "loco_control.ros.stance_node:main",
    ("loco_control", "target_generator"): "loco_control.ros.target_node:main",
    ("loco_learning", "joint_reflex"): "loco_learning.ros.joint_reflex_node:main",
    ("loco_learning", "msd_reflex"): "loco_learning.ros.msd_reflex_node:main",
    ("loco_learning", "reflex_network"): "loco_learning.ros.reflex_node:main",
    ("loco_sim", "driver"): "loco_sim.ros.driver_node:main",
    ("loco_sim", "joint_sim"): "loco_sim.ros.joint_sim_node:main",
    ("loco_sim", "msd_sim"): "loco_sim.ros.msd_sim_node:main",
    ("loco_sim", "robot_sim"): "loco_sim.ros.sim_node:main",
}


def run(arguments: list[str]) -> int:
    """Run one command of ``loco ros2``; returns the exit code.

    Raises:
        LocoError: An argument is wrong, or the graph lacks a named topic, node or service.
    """
    if arguments[:1] == ["run"]:
        return _start(arguments[1:])
    a = parser().parse_args(arguments)
    with Client() as client:
        a.verb(client, a)
    return 0


def _start(arguments: list[str]) -> int:
    """Run a node in this process."""
    names = {" ".join(pair) for pair in EXECUTABLES}
    target = EXECUTABLES.get(tuple(arguments[:2]))
    if target is None:
        raise NameUnknownError("executable (ros2 run PACKAGE NAME)", " ".join(arguments[:2]), names)
    module, _, function = target.partition(":")
    sys.argv = [arguments[1], *arguments[2:]]
    getattr(importlib.import_module(module), function)()
    return 0


def parser() -> Parser:
    """Parser of all commands."""
    top = Parser(
        prog="loco ros2", allow_abbrev=False,
        description="Commands of ros2 that need nothing but rclpy, in its own words, and "
        "`run PACKAGE EXECUTABLE` for the nodes of loco. Others (bag, launch, security, "
        "interface ...) come with ROS from apt; loco record, replay and info read and "
        "write bags.",
    )  # fmt: skip
    commands = top.add_subparsers(metavar="COMMAND", required=True)
    topic = _group(commands, "topic", "list, info, echo, hz, pub")
    p = _verb(topic, "list", topics.list_topics, "names of topics")
    p.add_argument("-t", "--show-types", action="store_true", help="types beside the names")
    _verb(topic, "info", topics.info, "type and number of writers and readers", "topic")
    p = _verb(topic, "echo", topics.echo, "messages as YAML", "topic")
    p.add_argument("type", nargs="?", help="type of its messages; default what its writers say")
    p.add_argument("--once", action="store_true", help="the first message alone")
    p = _verb(topic, "hz", topics.hz, "rate in wall time", "topic")
    p.add_argument("-w", "--window", type=int, default=10_000, help="messages averaged over")
    p = _verb(topic, "pub", topics.pub, "publish a message", "topic", "type")
    p.add_argument("values", nargs="?", default="{}", help="fields as YAML")
    p.add_argument("-1", "--once", action="store_true", help="once, when somebody listens")
    p.add_argument("-t", "--times", type=int, default=0, help="so many times (0: until Ctrl-C)")
    p.add_argument("-r", "--rate", type=float, default=1.0, help="messages per second")
    p.add_argument("-w", "--wait-matching-subscriptions", type=int, help="wait for so many readers")
    p.add_argument("--keep-alive", type=float, default=0.1, help="stay so long after the last [s]")
    p.add_argument("--qos-durability", choices=("volatile", "transient_local"))
    p.add_argument("--qos-reliability", choices=("reliable", "best_effort"))
    node = _group(commands, "node", "list, info")
    _verb(node, "list", nodes.list_nodes, "names of nodes")
    _verb(node, "info", nodes.info, "topics, services and actions of a node", "node")
    param = _group(commands, "param", "list, get, set")
    p = _verb(param, "list", nodes.list_parameters, "names of parameters")
    p.add_argument("node", nargs="?", help="default all nodes")
    _verb(param, "get", nodes.get_parameter, "value of a parameter", "node", "parameter")
    _verb(param, "set", nodes.set_parameter, "change a parameter", "node", "parameter", "value")
    service = _group(commands, "service", "call")
    p = _verb(service, "call", nodes.call_service, "call a service", "service", "type")
    p.add_argument("values", nargs="?", default="{}", help="fields of the request as YAML")
    action = _group(commands, "action", "send_goal")
    p = _verb(action, "send_goal", nodes.send_goal, "send a goal and wait for its end", "action",
              "type", "values")  # fmt: skip
    p.add_argument("-f", "--feedback", action="store_true", help="print feedback, too")
    return top


def _group(commands: Any, name: str, verbs: str) -> Any:
    group = commands.add_parser(name, help=verbs, allow_abbrev=False)
    return group.add_subparsers(metavar="VERB", required=True)


def _verb(
    group: Any,
    name: str,
    run: Callable[[Client, argparse.Namespace], None],
    text: str,
    *arguments: str,
) -> argparse.ArgumentParser:
    p = group.add_parser(name, help=text, description=text, allow_abbrev=False)
    p.set_defaults(verb=run)
    for argument in arguments:
        p.add_argument(argument)
    return p
