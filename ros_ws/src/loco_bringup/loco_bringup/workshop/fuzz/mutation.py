# SPDX-License-Identifier: Apache-2.0
"""Damage to files and texts: bytes of any kind, and values of YAML and JSON in their structure."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import yaml

# Texts that parsers stumble over.
TOKENS = (
    b"", b"\0", b"\xff\xfe", b"nan", b".inf", b"-1", b"1e999", b"9" * 5000, b"!!float x",
    b"!!int ''", b"\t", b"#",
    b"2001-99-99", b"&a [*a]", b"*a", b"<<: 3", b"[" * 300, b"{a: " * 100, b"? [a]", b"---\n",
    b"\r\n", b'"', b"'", b",,,,", b";", b"../../x", b"/etc/hosts", b"1.0.0", b"true", b"null",
)  # fmt: skip
# Values in the place of others.
VALUES: tuple[Any, ...] = (
    None, True, -1, 0, 1e300, -1e-300, float("nan"), float("inf"), 2**70, "", "x", "../../x", "\0",
    [], [[]], [1, "a", None], {}, {"a": 1}, {"name": 3}, [{}], "9" * 400,
)  # fmt: skip


def damaged(
    data: bytes, rng: np.random.Generator, seeds: Sequence[bytes], structured: str
) -> bytes:
    """One input made of another.

    Args:
        data: The input to damage.
        rng: Source of all choices.
        seeds: Other inputs, of which parts may be taken.
        structured: ``yaml`` or ``json`` to damage values, too; empty for bytes alone.
    """
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
    try:
        values = yaml.safe_load(data) if kind == "yaml" else json.loads(data)
    except Exception:  # it was damaged before
        return data[: len(data) // 2]
    for _ in range(int(rng.integers(1, 4))):
        values = _replaced(values, rng)
    text = yaml.safe_dump(values) if kind == "yaml" else json.dumps(values)
    return text.encode("utf-8", "replace")


def _replaced(values: Any, rng: np.random.Generator) -> Any:
    """The values with one of them, somewhere, replaced, removed or renamed."""
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
    copy = dict(values) if isinstance(values, dict) else list(values)
    how = rng.random()
    if how < 0.1:
        del copy[key]
    elif how < 0.2 and isinstance(copy, dict):
        copy["x" if rng.random() < 0.5 else 3] = copy.pop(key)
    elif how < 0.3 and isinstance(copy, list):
        copy.append(copy[key])
    else:
        copy[key] = _replaced(copy[key], rng)
    return copy
