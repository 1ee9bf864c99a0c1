# SPDX-License-Identifier: Apache-2.0
"""Commands as our pages print them: each parses, and what it names is there."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from loco_bringup.cli.table import parse
from loco_learning.runs import experiment
from loco_learning.study import study

ROOT = Path(__file__).resolve().parents[3]
PAGES = [
    *sorted(ROOT.glob("*.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted((ROOT / "bags").rglob("*.md")),
    *sorted((ROOT / "tests").rglob("*.md")),
]
PLACEHOLDER = re.compile(r"\b[A-Z][A-Z_]+\b|…|\.\.\.|\$\w")  # NAME, bags/…, $set
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
CELL = re.compile(r"^\|.*?`(\./loco [^`]+)`", re.MULTILINE)  # first command of a row


def printed(page: Path) -> list[str]:
    """Commands of a page's blocks and tables that begin with ``./loco``, without it."""
    text = page.read_text().replace("\\\n", " ")
    commands = []
    for part in [*CELL.findall(text), *BLOCK.findall(text)]:
        for command in re.split(r"\n(?=\S)|&&", part):  # an argument may go on, indented
            words = shlex.split(command, comments=True)
            if words[:1] == ["./loco"]:
                commands.append(shlex.join(words[1:]))
    return commands


LINES = sorted({line for page in PAGES for line in printed(page) if not PLACEHOLDER.search(line)})

# Pages whose blocks of commands a test runs, as printed or with shorter runs.
RUN = {
    "docs/controller.md": "tests/ros/test_guest.py",
    "docs/hardware.md": "tests/loco_bringup/hardware/test_page.py",
    "docs/tutorial_gap.md": "tests/workshop/docs/test_tutorials.py",
    "docs/tutorial_log.md": "tests/workshop/docs/test_tutorials.py",
    "docs/tutorial_own.md": "tests/workshop/docs/test_tutorials.py",
    "docs/tutorial_walk.md": "tests/workshop/docs/test_tutorials.py",
}
# Pages whose blocks are only parsed, with the reason. Their commands have tests of their own.
LONG = "minutes to hours: searches, studies, benches or runs in real time"
NAMES = "they go on with a recording, robot or clone that the reader has"
OPEN = "they watch or steer a graph that runs, or end by Ctrl-C; tests/ros tries the commands"
NOT_RUN = {
    "CONTRIBUTING.md": "it runs the tests themselves",
    "README.md": "pip, which loco_workshop.wheel tries, and the demo, which CI runs by its test",
    "docs/calibration.md": LONG,
    "docs/control.md": LONG,
    "docs/effect_own.md": "it writes a module into the package",
    "docs/engines.md": LONG,
    "docs/export.md": NAMES,
    "docs/faults.md": LONG,
    "docs/gap.md": NAMES,
    "docs/gap_battery.md": LONG,
    "docs/gap_battery_drawn.md": LONG,
    "docs/gap_fleet.md": NAMES,
    "docs/gap_ground.md": LONG,
    "docs/gap_measured.md": LONG,
    "docs/gap_rules.md": LONG,
    "docs/gap_setup.md": LONG,
    "docs/gap_thesis.md": LONG,
    "docs/index.md": "pip, which loco_workshop.wheel tries",
    "docs/learning.md": LONG,
    "docs/live_calibration.md": LONG,
    "docs/logs.md": OPEN,
    "docs/msd.md": LONG,
    "docs/optimise.md": LONG,
    "docs/plant.md": LONG,
    "docs/realtime.md": LONG,
    "docs/reinforce.md": LONG,
    "docs/reliability.md": LONG,
    "docs/robots.md": NAMES,
    "docs/running.md": OPEN,
    "docs/safety.md": OPEN,
    "docs/studies.md": LONG,
    "docs/supervision.md": OPEN,
    "docs/thesis.md": LONG,
    "docs/tigrillo.md": LONG,
    "docs/view.md": NAMES,
}


def test_blocks_of_commands_are_run_by_a_test_or_the_reason_is_here():
    pages = {str(page.relative_to(ROOT)) for page in PAGES if BLOCK.search(page.read_text())}
    pages = {page for page in pages if page.startswith("docs/") or "/" not in page}
    assert pages == set(RUN) | set(NOT_RUN) and not set(RUN) & set(NOT_RUN)
    for page, test in RUN.items():
        assert page in (ROOT / test).read_text(), page


def test_commands_are_read_as_a_shell_would(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```sh\n./loco run a \\\n  --set 'b={\n  c: 1}'   # note\ncd x && ./loco top\n```\n"
        "`./loco gap` is\n| a | `./loco list` | `b` |\n"
    )
    assert printed(page) == ["list", "run a --set 'b={\n  c: 1}'", "top"]
    assert len(LINES) > 120


@pytest.mark.parametrize("line", LINES)
def test_a_printed_command_parses(line):
    if line.split()[0] == "colcon":
        return  # the script `loco` itself runs it; test_loco_script.py tries it
    name, options = parse(shlex.split(line))
    if name == "test":
        paths = [word for word in options if word.startswith("tests/")]
        assert [path for path in paths if not (ROOT / path).exists()] == []


def names(command: str) -> list[str]:
    """First arguments of a printed command that are no path."""
    words = [shlex.split(line) for line in LINES]
    first = {w[1] for w in words if w[0] == command and len(w) > 1}
    return sorted(n for n in first if not n.startswith("-") and "/" not in n)


def test_what_printed_commands_name_is_there():
    assert set(names("run")) <= set(experiment.names())
    assert set(names("study")) <= set(study.names())
