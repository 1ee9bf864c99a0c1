# SPDX-License-Identifier: Apache-2.0
"""Random damage to files: to bytes, and to values in the structure of YAML, JSON and XML."""

from __future__ import annotations

import copy
import json
from collections.abc import Sequence
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

# Texts that often cause errors in parsers.
TOKENS = (
    b"", b"\0", b"\xff\xfe", b"nan", b".inf", b"-1", b"1e999", b"9" * 5000, b"!!float x",
    b"!!int ''", b"\t", b"#",
    b"2001-99-99", b"&a [*a]", b"*a", b"<<: 3", b"[" * 300, b"{a: " * 100, b"? [a]", b"---\n",
    b"\r\n", b'"', b"'", b",,,,", b";", b"../../x", b"/etc/hosts", b"1.0.0", b"true", b"null",
)  # fmt: skip
# Replacement values.
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e300, -1e-300, float("nan"), float("inf"), 2**70, "", "x", "../../x", "\0",
    [], [[]], [1, "a", None], {}, {"a": 1}, {"name": 3}, [{}], "9" * 400,
)  # fmt: skip


KINDS = ("any", "cut", "flip")


def damaged(
    data: bytes,
    rng: np.random.Generator,
    seeds: Sequence[bytes],
    structured: str,
    damage: str = "any",
) -> bytes:
    """A damaged copy of an input.

    Args:
        data: The input to damage.
        rng: Random generator.
        seeds: Other inputs, whose parts may be inserted.
        structured: ``yaml``, ``json`` or ``xml`` to also damage values; empty for bytes only.
        damage: ``cut`` for a truncation, ``flip`` for another value of one byte, ``any``
            for one to three of all kinds.
    """
    if damage == "cut":
        return data[: int(rng.integers(0, len(data)))]
    if damage == "flip":
        at = int(rng.integers(0, len(data)))
        return data[:at] + bytes([data[at] ^ int(rng.integers(1, 256))]) + data[at + 1 :]
    if structured and rng.random() < 0.6:
        return _structure(data, rng, structured)
    for _ in range(int(rng.integers(1, 4))):
        data = _bytes(data, rng, seeds)
    return data


def _bytes(data: bytes, rng: np.random.Generator, seeds: Sequence[bytes]) -> bytes:
    a, b = sorted(int(i) for i in rng.integers(0, len(data) + 1, 2))
    how = int(rng.integers(7))
    if how == 0:
        return data[:a]
    if how == 1:
        return data[:a] + data[b:]
    if how == 2:
        return data[:b] + data[a:]
    if how == 3:
        return data[:a] + TOKENS[int(rng.integers(len(TOKENS)))] + data[a:]
    if how == 4:
        return data[:a] + TOKENS[int(rng.integers(len(TOKENS)))] + data[b:]
    if how == 5:
        other = seeds[int(rng.integers(len(seeds)))]
        cut = int(rng.integers(0, len(other) + 1))
        return data[:a] + other[cut:]
    flipped = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        if flipped:
            flipped[int(rng.integers(len(flipped)))] ^= 1 << int(rng.integers(8))
    return bytes(flipped)


def _structure(data: bytes, rng: np.random.Generator, kind: str) -> bytes:
    if kind == "xml":
        return _elements(data, rng)
    try:
        values = yaml.safe_load(data) if kind == "yaml" else json.loads(data)
    except Exception:  # not parsable after earlier damage
        return data[: len(data) // 2]
    for _ in range(int(rng.integers(1, 4))):
        values = _replaced(values, rng)
    text = yaml.safe_dump(values) if kind == "yaml" else json.dumps(values)
    return text.encode("utf-8", "replace")


def _replaced(values: Any, rng: np.random.Generator) -> Any:
    """A copy of nested values with one of them replaced, removed or renamed."""
    new = VALUES[int(rng.integers(len(VALUES)))]
    keys = (
        list(values)
        if isinstance(values, dict)
        else range(len(values or ()))
        if isinstance(values, list)
        else ()
    )
    if not len(keys) or rng.random() < 0.15:
        return new
    key = list(keys)[int(rng.integers(len(keys)))]
    changed = dict(values) if isinstance(values, dict) else list(values)
    how = rng.random()
    if how < 0.1:
        del changed[key]
    elif how < 0.2 and isinstance(changed, dict):
        changed["x" if rng.random() < 0.5 else 3] = changed.pop(key)
    elif how < 0.3 and isinstance(changed, list):
        changed.append(changed[key])
    else:
        changed[key] = _replaced(changed[key], rng)
    return changed


def _elements(data: bytes, rng: np.random.Generator) -> bytes:
    """XML with elements moved, copied or removed, or with changed attributes."""
    try:
        root = ElementTree.fromstring(data)
    except Exception:  # not parsable after earlier damage
        return data[: len(data) // 2]
    names = sorted({e.get("name") or "x" for e in root}) + [f"{v}"[:500] for v in VALUES]
    for _ in range(int(rng.integers(1, 4))):
        parents = [(parent, child) for parent in root.iter() for child in parent]
        if not parents:
            break
        parent, child = parents[int(rng.integers(len(parents)))]
        how = rng.random()
        if how < 0.15:
            parent.remove(child)
        elif how < 0.3:
            parent.append(copy.deepcopy(child))
        elif how < 0.4:
            root.append(copy.deepcopy(child))
        elif child.attrib:
            key = sorted(child.attrib)[int(rng.integers(len(child.attrib)))]
            value = names[int(rng.integers(len(names)))]
            if how < 0.6:  # replace one number in a text of several
                tokens = child.attrib[key].split() or [""]
                tokens[int(rng.integers(len(tokens)))] = value
                value = " ".join(tokens)
            elif how < 0.65:
                child.attrib["x"] = child.attrib.pop(key)
                continue
            child.attrib[key] = value
    return ElementTree.tostring(root)
