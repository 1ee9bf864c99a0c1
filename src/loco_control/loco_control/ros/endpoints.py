# SPDX-License-Identifier: Apache-2.0
"""Which process an endpoint belongs to, read from the id that Fast DDS gives it.

Bytes 2 to 3 of the id are of the host, 4 to 5 the low half of the process id. So a
writer can be told from one whose process was killed: DDS believes in it for 20 s more.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

_HOST, _PID = slice(2, 4), slice(4, 6)


def host_of(info: Any) -> bytes:
    """Number of the machine of an endpoint."""
    return bytes(info.endpoint_gid[_HOST])


def low_pid(info: Any) -> int:
    """Process id of an endpoint, modulo 65536."""
    return int.from_bytes(bytes(info.endpoint_gid[_PID]), "little")


def own_host(infos: Iterable[Any]) -> bytes:
    """Number of this machine, from the endpoints of a topic that this process writes.

    Empty if none of them is of this process.
    """
    mine = os.getpid() & 0xFFFF
    return next((host_of(info) for info in infos if low_pid(info) == mine), b"")


def living(infos: Iterable[Any], host: bytes) -> list[Any]:
    """Endpoints without those of dead processes of this machine.

    Args:
        infos: Of a topic, as rclpy gives them.
        host: `own_host`.
    """
    alive = {int(name) & 0xFFFF for name in os.listdir("/proc") if name.isdigit()}
    return [info for info in infos if host_of(info) != host or low_pid(info) in alive]
