# SPDX-License-Identifier: Apache-2.0
"""Information on Linux processes: state, start time, CPU time, and which of them run nodes."""

from __future__ import annotations

import os
from pathlib import Path

_TICKS = os.sysconf("SC_CLK_TCK")  # units of /proc/PID/stat [1/s]
# Fields of /proc/PID/stat after the name of the command (proc(5)).
_STATE, _USER_TIME, _SYSTEM_TIME, _START = 0, 11, 12, 19


def _stat(pid: int) -> list[str]:
    """Fields of /proc/PID/stat after the name of the command; empty without such a process."""
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rpartition(")")[2].split()
    except OSError:
        return []


def state(pid: int) -> str:
    """Letter of the state of a process (R, S, T, Z ...), empty if there is no such process."""
    return "".join(_stat(pid)[:1])


def processor_time(pid: int) -> float:
    """Processor time that all threads of a process have used [s], 0 if there is no such process."""
    fields = _stat(pid)
    return (int(fields[_USER_TIME]) + int(fields[_SYSTEM_TIME])) / _TICKS if fields else 0.0


def waiting_time(pid: int) -> float:
    """Time that the main thread of a process waited for a processor [s], 0 if unknown."""
    try:
        with open(f"/proc/{pid}/schedstat") as file:
            return int(file.read().split()[1]) * 1e-9
    except (OSError, IndexError):
        return 0.0


def start_of(pid: int) -> str:
    """Start time of a process in kernel ticks; empty if it has ended.

    A process whose main thread has ended keeps its files and locks until its last thread ends.
    """
    fields = _stat(pid)
    try:
        threads = len(os.listdir(f"/proc/{pid}/task"))
    except OSError:
        return ""
    return "" if not fields or (fields[_STATE] == "Z" and threads < 2) else fields[_START]


def node_processes() -> list[tuple[int, str, list[str]]]:
    """Pid, ROS domain and command line of every process of this user that runs nodes."""
    nodes = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            arguments = path.read_bytes().decode(errors="replace").split("\0")
            if "-m" not in arguments[:3] or not _runs_nodes(arguments):
                continue
            pairs = (path.parent / "environ").read_bytes().split(b"\0")
        except OSError:
            continue
        domain = next((p[14:] for p in pairs if p.startswith(b"ROS_DOMAIN_ID=")), b"0")
        nodes.append((int(path.parent.name), domain.decode(), arguments))
    return nodes


def _runs_nodes(arguments: list[str]) -> bool:
    module = arguments[arguments.index("-m") + 1]
    return module == "loco_bringup.graph.composed" or (module[:5] == "loco_" and ".ros." in module)
