# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: add the code reference, and resolve links to files outside ``docs/``."""

from __future__ import annotations

import re
from typing import Any

from mkdocs.structure.files import File

# Modules of the reference, each with all its public names.
API = {
    "Find the gap, read bags, run robots": ("loco",),
    "Robots and their physics": (
        "loco_sim.robot.robot", "loco_sim.effects.base", "loco_sim.effects.identity",
        "loco_sim.plant.simulation",
    ),
    "Control": ("loco_control.params", "loco_control.exceptions", "loco_control.types"),
    "Runs and recordings": (
        "loco_learning.runs.experiment", "loco_learning.runs.log", "loco_bringup.bag.reader",
        "loco_bringup.testing",
    ),
}  # fmt: skip
BESIDE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+[^)#]+|[\w/]+\.ipynb)(?:#[^)]*)?\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the page with the code reference, which is not a file of the repository."""
    parts = ["# The code", "Public names, printed from the source."]
    for title, modules in API.items():
        parts += [f"## {title}", *(f"::: {module}" for module in modules)]
    files.append(File.generated(config, "api.md", content="\n\n".join(parts)))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Replace links to files outside ``docs/`` by their names, since the site lacks them."""
    return BESIDE.sub(lambda m: f"{m[1]} (`{m[2].replace('../', '')}`)", markdown)
