# SPDX-License-Identifier: Apache-2.0
"""Process of a DDS endpoint, read from the id that Fast DDS assigns.

Bytes 2 to 3 of the id are the host, 4 to 5 the low half of the process id. This identifies
writers whose process was killed, which DDS still lists for 20 s.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

_HOST, _PID = slice(2, 4), slice(4, 6)
ANOTHER = "another graph runs on this ROS domain and namespace"
_UNNAMED = "_NODE_NAME_UNKNOWN_"  # name that rmw reports until an endpoint's node is known


def host_of(info: Any) -> bytes:
    """Identifier of the machine of an endpoint."""
    return bytes(info.endpoint_gid[_HOST])


def low_pid(info: Any) -> int:
    """Process id of an endpoint, modulo 65536."""
    return int.from_bytes(bytes(info.endpoint_gid[_PID]), "little")


def is_named(info: Any) -> bool:
    """Whether the node of an endpoint is known; for a dead process it may never be."""
    return info.node_name != _UNNAMED


def own_host(infos: Iterable[Any]) -> bytes:
    """Identifier of this machine, from the endpoints of a topic that this process writes or reads.

    Empty if none of the endpoints belongs to this process.
    """
    process_id = os.getpid() & 0xFFFF
    return next((host_of(info) for info in infos if low_pid(info) == process_id), b"")


def living(infos: Iterable[Any], host: bytes) -> list[Any]:
    """Endpoints, except those of dead processes of this machine.

    Args:
        infos: Endpoints of a topic, as rclpy gives them.
        host: `own_host`.
    """
    process_ids = {
        int(name) & 0xFFFF for name in os.listdir("/proc") if name.isdigit() and _runs(name)
    }
    return [info for info in infos if host_of(info) != host or low_pid(info) in process_ids]


def strangers(node: Any, topic: str, host: bytes) -> str:
    """Names of the writers of a topic that has more than one; "" otherwise.

    Writers of dead processes and writers whose node is not known yet are not counted.

    Args:
        node: rclpy node used for the query.
        topic: Name of the topic.
        host: `own_host`.
    """
    infos = living(node.get_publishers_info_by_topic(topic), host)
    writers = list(filter(is_named, infos))
    if len(writers) < 2:
        return ""
    who = ", ".join(f"{w.node_name} of process {low_pid(w)}" for w in writers)
    return f"{topic.rpartition('/')[2]} has {len(writers)} writers ({who})"


def _runs(pid: str) -> bool:
    """Whether a process runs; a zombie counts as ended."""
    try:
        stat = Path("/proc", pid, "stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return stat.rpartition(")")[2].split()[0] not in "ZX"
