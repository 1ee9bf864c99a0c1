# SPDX-License-Identifier: Apache-2.0
"""The walks through the code in docs/design.md lead through files that know each other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = {
    "loco_control": ROOT / "src/loco_control",
    "loco_sim": ROOT / "src/loco_sim",
    "loco_learning": ROOT / "src/loco_learning",
    "loco_bringup": ROOT / "ros_ws/src/loco_bringup",
}
# Where a value travels by itself: over DDS into a controller, into the recorder, into a file.
JUMPS = {"loco_control/ros/messages/convert.py", "loco_bringup/record/recorder.py"}
JUMPS |= {"loco_bringup/bag/reader.py"}


def walks() -> list[list[str]]:
    """Files of each walk, in order."""
    page = (ROOT / "docs/design.md").read_text().split("## Two walks")[1].split("\n## ")[0]
    parts = re.split(r"^\*\*A ", page, flags=re.MULTILINE)[1:]
    return [re.findall(r"^\d+\. `([\w/.]+)`", part, re.MULTILINE) for part in parts]


@pytest.mark.parametrize(("walk", "most"), [(0, 20), (1, 15)])
def test_a_walk_is_short_and_each_file_knows_an_earlier_one(walk, most):
    files = walks()[walk]
    assert 10 < len(files) <= most
    texts = {name: (SOURCES[name.split("/")[0]] / name).read_text() for name in files}
    for i, name in enumerate(files[1:], 1):
        stem = Path(name).stem
        near = [
            other
            for other in files[:i]
            if re.search(rf"\b{stem}\b", texts[other])
            or re.search(rf"\b{Path(other).stem}\b", texts[name])
        ]
        assert near or name in JUMPS, f"{name} is not imported by, and imports none of, {files[:i]}"
