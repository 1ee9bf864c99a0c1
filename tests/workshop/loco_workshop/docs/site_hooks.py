# SPDX-License-Identifier: Apache-2.0
"""Hooks of mkdocs: code reference, notebook, flowcharts, links to files outside ``docs/``."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

from loco_workshop.docs.flowchart import svg

# Pages of the reference: title and modules, each with all its public names.
API = {
    "api_loco.md": ("Code: gaps, bags, robots from Python", ("loco",)),
    "api_robots.md": ("Code: robots and their physics", (
        "loco_sim.robot.robot", "loco_sim.effects.base", "loco_sim.effects.identity",
        "loco_sim.plant.simulation",
    )),
    "api_control.md": ("Code: control", (
        "loco_control.params", "loco_control.exceptions", "loco_control.types",
    )),
    "api_runs.md": ("Code: runs and recordings", (
        "loco_learning.runs.experiment", "loco_learning.runs.log", "loco_bringup.bag.reader",
        "loco_bringup.testing",
    )),
}  # fmt: skip
NOTEBOOK = "csv_to_gap.ipynb"
BESIDE = re.compile(r"\[([^\]]+)\]\(((?:\.\./)+[^)#]+)(?:#[^)]*)?\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages with the code reference and the notebook, which are no pages of ``docs/``."""
    for name, (title, modules) in API.items():
        parts = [f"# {title}", "Public names, generated from the source."]
        parts += [f"::: {module}" for module in modules]
        files.append(File.generated(config, name, content="\n\n".join(parts)))
    text = notebook(json.loads((Path(config.docs_dir) / NOTEBOOK).read_text()))
    files.append(File.generated(config, NOTEBOOK.replace(".ipynb", ".md"), content=text))
    return files


def notebook(content: dict[str, Any]) -> str:
    """Markdown of a notebook: its text, code, and stored outputs as HTML, text or PNG pictures."""
    parts = []
    for cell in content["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {"text/plain": output.get("text", "")})
            if "text/html" in data:
                parts.append("".join(data["text/html"]))
            elif "image/png" in data:
                picture = "".join(data["image/png"]).replace("\n", "")
                parts.append(f"![output](data:image/png;base64,{picture})")
            elif text := "".join(data.get("text/plain", "")):
                parts.append(f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Draw flowcharts, link the notebook, and name files outside ``docs/`` instead of linking."""
    markdown = re.sub(r"```mermaid\n(.*?)```", lambda m: svg(m[1]), markdown, flags=re.S)
    markdown = markdown.replace(f"({NOTEBOOK})", f"({NOTEBOOK.replace('.ipynb', '.md')})")
    return BESIDE.sub(lambda m: f"{m[1]} (`{m[2].replace('../', '')}`)", markdown)
