# SPDX-License-Identifier: Apache-2.0
"""Observation of running graphs: nodes, endpoints, diagnostics, events."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from loco_control.ros.endpoints import is_named, living, low_pid, own_host
from loco_control.ros.messages.topics import topic

from ..client import GraphClient, kind_of
from . import node_set
from .process_info import node_processes

NAME = "onlooker"  # prefix of the observing node's name, followed by its pid
SILENCE_TIMEOUT = 3.0  # wall time without diagnostics after which a node counts as silent [s]
_NAMING = 2.0  # longest wait for the names of nodes whose endpoints are discovered [s]


@dataclass(frozen=True)
class Endpoint:
    """A publisher or a subscription of another process."""

    topic: str
    node: str  # with namespace, without the leading slash
    writes: bool
    type: str
    hash: str
    reliable: bool
    latched: bool
    pid: int  # 0 if unknown
    named: bool = True  # whether the name of the node is known


@dataclass(frozen=True)
class Report:
    """The newest diagnostics of a node."""

    level: int
    message: str
    values: dict[str, str]
    age: float  # wall time since its arrival [s]

    def number(self, key: str, default: float = 0.0) -> float:
        """Value of a key as a number; `default` if it is missing or not a number."""
        try:
            return float(self.values.get(key, default))
        except ValueError:
            return default


@dataclass(frozen=True)
class Occurrence:
    """An event of a graph."""

    namespace: str
    node: str
    kind: str
    text: str
    time: float  # simulated time [s]


@dataclass(frozen=True)
class View:
    """Snapshot of the observed graphs."""

    endpoints: tuple[Endpoint, ...] = ()
    reports: dict[str, Report] = field(default_factory=dict)
    events: tuple[Occurrence, ...] = ()
    processes: dict[str, int] = field(default_factory=dict)  # pids of nodes on this domain, by name
    silent: float = SILENCE_TIMEOUT  # wall time without diagnostics that counts as silence [s]

    def namespaces(self) -> list[str]:
        """Namespaces of all endpoints."""
        return sorted({e.node.rpartition("/")[0] for e in self.endpoints})

    def of(self, name: str, writes: bool) -> list[Endpoint]:
        """Writers or readers of a topic, given by its full name."""
        return [e for e in self.endpoints if e.topic == name and e.writes == writes]

    def pid(self, node: str) -> int:
        """Pid of a node; 0 if unknown."""
        pid = self.processes.get(node, 0)
        return next((e.pid for e in self.endpoints if e.node == node and e.pid), pid)


class GraphObserver(GraphClient):
    """A node that only observes graphs."""

    def __init__(self) -> None:
        super().__init__(f"{NAME}_{os.getpid()}")
        self._reports: dict[str, tuple[Any, float]] = {}
        self._events: list[Occurrence] = []
        self._heard: set[str] = set()
        row = topic("/diagnostics")
        self.node.create_subscription(row.type, row.name, self._on_report, row.qos.reader(100))

    def listen(self, seconds: float, silence_timeout: float = SILENCE_TIMEOUT) -> View:
        """Snapshot after listening for some time.

        The names of nodes arrive after their endpoints, so up to 2 s more are spent on them.

        Args:
            seconds: Wall time to listen for [s].
            silence_timeout: Wall time without diagnostics that counts as silence [s].
        """
        end = time.monotonic() + seconds
        while (remaining := end - time.monotonic()) > 0:
            self._follow_events()
            self.spin(min(0.2, remaining))
        endpoints, end = self._endpoints(), time.monotonic() + _NAMING
        while not all(e.named for e in endpoints) and time.monotonic() < end:
            self.spin(0.1)
            endpoints = self._endpoints()
        time_now = time.monotonic()
        reports = {
            name: Report(
                status.level[0],
                status.message,
                {v.key: v.value for v in status.values},
                time_now - at,
            )
            for name, (status, at) in self._reports.items()
        }
        local_nodes = _nodes_of_domain(os.environ.get("ROS_DOMAIN_ID", "0") or "0")
        return View(tuple(endpoints), reports, tuple(self._events), local_nodes, silence_timeout)

    def _on_report(self, array: Any) -> None:
        for status in array.status:
            self._reports[status.name] = (status, time.monotonic())

    def _follow_events(self) -> None:
        """Subscribe to events; they are latched, so earlier events arrive too."""
        row = topic("events")
        for name, types in self.node.get_topic_names_and_types():
            space, _, last = name.rpartition("/")
            if last != row.name or name in self._heard or "loco_msgs/msg/Event" not in types:
                continue
            self._heard.add(name)
            self.node.create_subscription(
                row.type, name, self._on_event(space.strip("/")), row.qos.reader(100)
            )

    def _on_event(self, space: str) -> Any:
        def on_event(event: Any) -> None:
            t = event.stamp.sec + event.stamp.nanosec / 1e9
            self._events.append(Occurrence(space, event.node, event.kind, event.text, t))

        return on_event

    def _endpoints(self) -> list[Endpoint]:
        node, endpoints = self.node, []
        host = own_host(node.get_subscriptions_info_by_topic("/diagnostics"))
        pids = _pids()
        for name, _ in node.get_topic_names_and_types():
            for writes, infos in (
                (True, node.get_publishers_info_by_topic(name)),
                (False, node.get_subscriptions_info_by_topic(name)),
            ):
                endpoints += [_endpoint(info, name, writes, pids) for info in living(infos, host)]
        own_name = node.get_name()
        return [e for e in endpoints if e.node.rpartition("/")[2] != own_name]


def _endpoint(info: Any, name: str, writes: bool, pids: dict[int, int]) -> Endpoint:
    return Endpoint(
        name,
        f"{info.node_namespace}/{info.node_name}".strip("/").replace("//", "/"),
        writes,
        info.topic_type,
        str(info.topic_type_hash),
        *kind_of(info.qos_profile),
        pids.get(low_pid(info), 0),
        is_named(info),
    )


def _pids() -> dict[int, int]:
    """Pids by their lower 16 bits; Python processes take precedence."""
    pids: dict[int, int] = {}
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        pid = int(path.parent.name)
        try:
            python = b"python" in path.read_bytes()
        except OSError:
            continue
        if python or pid & 0xFFFF not in pids:
            pids[pid & 0xFFFF] = pid
    return pids


def _nodes_of_domain(domain: str) -> dict[str, int]:
    """Pid of every node on a domain, by node name with namespace.

    Names come from command lines, since a stopped process does not announce its nodes over DDS.
    """
    folder = Path(node_set.__file__).parent.parent / "node_sets"
    specs = [s for file in sorted(folder.glob("*.yaml")) for s in node_set.load(str(file))]
    names = {s.cls: s.name for s in specs} | {
        "loco_bringup.record.recorder:RecorderNode": "recorder"
    }
    modules = {cls.partition(":")[0]: name for cls, name in names.items()}
    nodes = {}
    for pid, where, arguments in node_processes():
        if where != domain:
            continue
        space = next((w.partition(":=/")[2] for w in arguments if w.startswith("__ns:=/")), "")
        for argument in arguments:
            name = names.get(argument) or modules.get(argument)
            if name:
                nodes["/".join(filter(None, (space, name)))] = pid
    return nodes
