# SPDX-License-Identifier: Apache-2.0
"""Commands `ros2 node`, `param`, `service` and `action`."""

from __future__ import annotations

import argparse
import sys
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy import action
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from loco_control.exceptions import GraphError, ParameterError
from loco_control.reading import parse_yaml

from .client import DISCOVERY, Client
from .values import as_yaml, filled, type_of

write = sys.stdout.write
_TYPES = ("", "Boolean", "Integer", "Double", "String", "Byte", "Boolean", "Integer", "Double",
          "String")  # fmt: skip
_FIRST_ARRAY = 5


def list_nodes(client: Client, a: argparse.Namespace) -> None:
    """Print the names of the nodes."""
    client.settle()
    write("".join(f"{name}\n" for name in client.nodes()))


def info(client: Client, a: argparse.Namespace) -> None:
    """Print topics, services and actions of a node."""
    name = client.existing(a.node)
    client.settle()
    space, _, short = name.rpartition("/")
    who, node = (short, space or "/"), client.node
    rows = {
        "Subscribers": node.get_subscriber_names_and_types_by_node(*who),
        "Publishers": node.get_publisher_names_and_types_by_node(*who),
        "Service Servers": node.get_service_names_and_types_by_node(*who),
        "Service Clients": node.get_client_names_and_types_by_node(*who),
        "Action Servers": action.get_action_server_names_and_types_by_node(node, *who),
        "Action Clients": action.get_action_client_names_and_types_by_node(node, *who),
    }
    write(f"{name}\n")
    for title, endpoints in rows.items():
        write(f"  {title}:\n")
        write(
            "".join(
                f"    {n}: {', '.join(types)}\n" for n, types in sorted(endpoints) if "/_" not in n
            )
        )


def list_parameters(client: Client, a: argparse.Namespace) -> None:
    """Print the parameters of a node, or of all nodes."""
    if a.node is None:
        client.settle()
    for name in [client.existing(a.node)] if a.node else client.nodes():
        parameters = _parameters(client, name)
        listed = client.result(parameters.list_parameters([], 0), name).result.names
        write("" if a.node else f"{name}:\n")
        write("".join(f"  {parameter}\n" for parameter in sorted(listed)))


def get_parameter(client: Client, a: argparse.Namespace) -> None:
    """Print the value of a parameter.

    Raises:
        GraphError: The node has no such parameter.
    """
    name = client.existing(a.node)
    values = client.result(_parameters(client, name).get_parameters([a.parameter]), name).values
    if not values or not values[0].type:
        raise GraphError(
            f"{name} has no parameter {a.parameter}; see `loco ros2 param list {name}`"
        )
    kind = values[0].type
    value = Parameter.from_parameter_msg(_message(a.parameter, values[0])).value
    many = kind >= _FIRST_ARRAY
    write(
        f"{_TYPES[kind]} {'values are' if many else 'value is'}: {list(value) if many else value}\n"
    )


def set_parameter(client: Client, a: argparse.Namespace) -> None:
    """Set a parameter.

    Raises:
        GraphError: The node refuses the value.
        ParameterError: The value is no number, text or list of one type.
    """
    name = client.existing(a.node)
    try:
        parameter = Parameter(a.parameter, value=parse_yaml(a.value, "the value"))
    except (TypeError, ValueError):
        raise ParameterError(f"a parameter is no {a.value!r}") from None
    future = _parameters(client, name).set_parameters([parameter])
    answer = client.result(future, name).results[0]
    if not answer.successful:
        raise GraphError(f"Setting parameter failed: {answer.reason}")
    write("Set parameter successful\n")


def _parameters(client: Client, name: str) -> AsyncParameterClient:
    parameters = AsyncParameterClient(client.node, name)
    if not client.wait(parameters.services_are_ready, DISCOVERY):
        raise GraphError(f"{name} offers no parameters")
    return parameters


def _message(name: str, value: Any) -> Any:
    message = Parameter(name).to_parameter_msg()
    message.value = value
    return message


def call_service(client: Client, a: argparse.Namespace) -> None:
    """Call a service and print its answer.

    Raises:
        GraphError: The service does not exist or does not answer.
    """
    cls = type_of(a.type, "srv")
    request = filled(cls.Request, a.values)
    service = client.node.create_client(cls, a.service)
    if not service.service_is_ready():
        write("waiting for service to become available...\n")
        if not client.wait(service.service_is_ready, DISCOVERY):
            raise GraphError(f"nobody offers the service {a.service}")
    write(f"requester: making request: {request!r}\n\n")
    write(f"response:\n{client.result(service.call_async(request), a.service)!r}\n\n")


def send_goal(client: Client, a: argparse.Namespace) -> None:
    """Send a goal, and print the feedback (if requested) and the result.

    Raises:
        GraphError: The action does not exist, or the goal is refused or fails.
    """
    cls = type_of(a.type, "action")
    goal = filled(cls.Goal, a.values)
    server = action.ActionClient(client.node, cls, a.action)
    write("Waiting for an action server to become available...\n")
    sys.stdout.flush()
    if not client.wait(server.server_is_ready, DISCOVERY):
        raise GraphError(f"nobody offers the action {a.action}")
    write(f"Sending goal:\n{as_yaml(goal, 5)}\n")
    feedback = (lambda f: _write(f"Feedback:\n{as_yaml(f.feedback, 4)}\n")) if a.feedback else None
    handle = client.result(server.send_goal_async(goal, feedback_callback=feedback), a.action)
    if not handle.accepted:
        raise GraphError("Goal was rejected.")
    _write(f"Goal accepted with ID: {bytes(handle.goal_id.uuid).hex()}\n\n")
    future = handle.get_result_async()
    try:
        client.wait(future.done)
    except KeyboardInterrupt:
        write("Canceling goal...\n")
        client.result(handle.cancel_goal_async(), a.action)
        raise
    done = future.result()
    names = {getattr(GoalStatus, n): n for n in dir(GoalStatus) if n.startswith("STATUS_")}
    status = names[done.status].removeprefix("STATUS_")
    write(f"Result:\n{as_yaml(done.result, 4)}\nGoal finished with status: {status}\n")
    if done.status != GoalStatus.STATUS_SUCCEEDED:
        raise GraphError(f"the goal of {a.action} ended as {status}")


def _write(text: str) -> None:
    write(text)
    sys.stdout.flush()
