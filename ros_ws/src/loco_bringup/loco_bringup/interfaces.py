# SPDX-License-Identifier: Apache-2.0
"""Message definitions and hashes, read from the installed interface packages."""

from __future__ import annotations

import json
import os
import sys
from functools import cache
from pathlib import Path

from loco_control.exceptions import NameUnknownError

_SEPARATOR = "=" * 80
_BUILTIN = {
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16",
    "int32", "uint32", "int64", "uint64", "string", "wstring",
}  # fmt: skip


def type_name(cls: type) -> str:
    """Full name of a message class, e.g. ``loco_msgs/msg/RobotState``."""
    return f"{cls.__module__.split('.')[0]}/msg/{cls.__name__}"


@cache
def definition(name: str) -> str:
    """Text of a message and of all it contains, as MCAP's ``ros2msg`` schema wants it.

    Args:
        name: Full name, ``package/msg/Type``.

    Raises:
        NameUnknownError: The package or the message is not installed.
    """
    package = name.split("/")[0]
    texts, queue, seen = [], [name], {name}
    while queue:
        current = queue.pop(0)
        text = _file(current, "msg").read_text()
        head = "" if current == name else f"{_SEPARATOR}\nMSG: {current.replace('/msg/', '/')}\n"
        texts.append(head + text)
        for inner in _nested(text, current.split("/")[0] or package):
            if inner not in seen:
                seen.add(inner)
                queue.append(inner)
    return "\n".join(texts)


@cache
def type_hash(name: str) -> str:
    """RIHS01 hash of a message, as DDS endpoints announce it."""
    described = json.loads(_file(name, "json").read_text())
    return next(h["hash_string"] for h in described["type_hashes"] if h["type_name"] == name)


def _file(name: str, suffix: str) -> Path:
    package, _, short = name.partition("/msg/")
    # Wheels install into the environment's prefix, which no ament path names.
    prefixes = [
        *filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)),
        sys.prefix,
    ]
    folders = [Path(prefix) / "share" / package / "msg" for prefix in prefixes]
    folder = next((f for f in folders if f.is_dir()), None)
    if folder is None:
        raise NameUnknownError("installed message package", package, _packages(prefixes))
    path = folder / f"{short}.{suffix}"
    if not path.is_file():
        known = [p.stem for p in folder.glob(f"*.{suffix}")]
        raise NameUnknownError(f"message in {package}", short, known)
    return path


def _packages(prefixes: list[str]) -> list[str]:
    return [p.parent.name for prefix in prefixes for p in Path(prefix).glob("share/*/msg")]


def _nested(text: str, package: str) -> list[str]:
    names = []
    for line in text.splitlines():
        kind = line.split("#")[0].split()
        if not kind:
            continue
        base = kind[0].split("[")[0].split("<")[0]
        if base in _BUILTIN:
            continue
        names.append(f"{package}/msg/{base}" if "/" not in base else base.replace("/", "/msg/"))
    return names
