# SPDX-License-Identifier: Apache-2.0
"""Checks of `loco doctor` without the graph: environment, messages, other domains."""

from __future__ import annotations

import importlib.util
import os
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from ..graph import shm
from ..graph.process_info import node_processes

RANGES = ("LOCALHOST", "SUBNET", "SYSTEM_DEFAULT")
DOMAINS = range(102)  # above, the ports of Fast DDS overlap with ephemeral ports of the system
_LOW = 64e6  # free shared memory below which runs can fail [bytes]
_PACKAGES = ("loco_msgs", "tf2_msgs")


@dataclass(frozen=True)
class Finding:
    """One problem that keeps a graph from running.

    ``fault`` is its short name; ``grave`` is false if the condition may be intended.
    """

    fault: str
    text: str
    remedy: str
    grave: bool = True


def check_environment(env: Mapping[str, str]) -> list[Finding]:
    """ROS environment variables that prevent communication."""
    domain, rmw = env.get("ROS_DOMAIN_ID", "0"), env.get("RMW_IMPLEMENTATION", "")
    scope = env.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    distribution = env.get("ROS_DISTRO", "jazzy")
    rows = (
        (not domain.isdigit() or int(domain) not in DOMAINS, "domain",
         f"ROS_DOMAIN_ID is {domain!r}", "set it to a number in 0 … 101"),
        (scope not in RANGES, "discovery range",
         f"ROS_AUTOMATIC_DISCOVERY_RANGE is {scope!r}: nodes do not find each other",
         f"set it to one of {', '.join(RANGES)}"),
        (rmw and not _has_library(rmw), "middleware",
         f"RMW_IMPLEMENTATION is {rmw!r}, which is not installed here",
         "unset RMW_IMPLEMENTATION"),
        (distribution != "jazzy", "environment",
         f"a ROS installation of {distribution} is sourced; ours is of jazzy",
         "start loco from a shell without it, or by ./loco"),
    )  # fmt: skip
    return [Finding(*finding) for wrong, *finding in rows if wrong]


def _has_library(rmw: str) -> bool:
    folders = [
        Path(sys.prefix) / "lib",
        *map(Path, os.environ.get("LD_LIBRARY_PATH", "").split(":")),
    ]
    return any((folder / f"lib{rmw}.so").is_file() for folder in folders)


def check_messages(
    sources: Path | None = None, prefix: Path = Path(sys.prefix), path: list[str] | None = None
) -> list[Finding]:
    """Check that message packages are installed and match the definitions of this clone.

    Args:
        sources: Folder with the source packages; default that of the clone, if there is one.
        prefix: Folder into which packages are installed.
        path: Folders in which Python looks for packages, default `sys.path`.
    """
    findings = []
    sources = sources or Path(__file__).resolve().parents[5] / "src"
    for package in _PACKAGES:
        if not _importable(package, path):
            text = f"the message package {package} is not built"
            findings.append(Finding("messages not built", text, "run ./loco, which builds it"))
            continue
        old = [
            file.name
            for file in sorted((sources / package).glob("msg/*.msg"))
            if not (twin := prefix / "share" / package / "msg" / file.name).is_file()
            or twin.read_bytes() != file.read_bytes()
        ]
        if old:
            text = f"{package} was built from other definitions of {', '.join(old)}"
            findings.append(
                Finding("messages mismatched", text, "run ./loco, which builds it anew")
            )
    return findings


def _importable(package: str, path: list[str] | None) -> bool:
    if path is None:
        return importlib.util.find_spec(package) is not None
    return any((Path(folder) / package / "__init__.py").is_file() for folder in path)


def check_shared_memory(folder: Path = shm.SHM) -> list[Finding]:
    """Free space in shared memory, and stale files of killed processes."""
    findings, leftovers = [], shm.leftovers(folder)
    size = sum(path.stat().st_size for path in leftovers if path.exists())
    free = shutil.disk_usage(folder).free
    if free < _LOW:
        text = f"{folder} has {free / 1e6:.0f} MB left; messages between processes need it"
        findings.append(Finding("shared memory full", text, "loco doctor --clean, or enlarge it"))
    if leftovers:
        text = f"killed processes left {len(leftovers)} files, {size / 1e6:.0f} MB, in {folder}"
        findings.append(Finding("shared memory left", text, "loco doctor --clean", grave=False))
    return findings


def check_elsewhere(env: Mapping[str, str]) -> list[Finding]:
    """Graphs of this user on other domains; reported only if no graph is on this domain."""
    own_domain, counts = env.get("ROS_DOMAIN_ID", "0") or "0", {}
    for pid, domain, _ in node_processes():
        if domain == own_domain:
            return []
        counts.setdefault(domain, []).append(pid)
    return [
        Finding(
            "other domain",
            f"a graph runs on ROS domain {domain} (processes {', '.join(map(str, sorted(pids)))}), "
            f"and this shell looks at domain {own_domain}",
            f"set ROS_DOMAIN_ID={domain} to look there",
            grave=False,
        )
        for domain, pids in sorted(counts.items())
    ]
