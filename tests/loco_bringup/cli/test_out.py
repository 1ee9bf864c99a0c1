# SPDX-License-Identifier: Apache-2.0
"""One rule for --out: it names a folder, or the file of a command that writes only one."""

import re
from argparse import ArgumentTypeError
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import pytest

from loco_bringup.cli.main import main, summary
from loco_bringup.cli.table import COMMANDS, call, parser
from loco_bringup.gap import next as next_experiment
from loco_bringup.hardware import terminal as servos
from loco_bringup.report import compare
from loco_bringup.report import report as reports

from ..gap.gap_result import NEXT

BAG = "tests/golden/hyq_open"
WIRING = Path("src/loco_sim/loco_sim/assets/servo_pendulum/servos.yaml").resolve()
# Commands that write a single file: their arguments, and the name of the file.
SINGLE = {
    "report": (["report", BAG, "--no-gif"], "report.html"),
    "compare": (["compare", "a", "b"], "compare.html"),
    "gap next": (["gap", "next", "results"], "next_slow_ramp.yaml"),
    "gap mapping": (["gap", "mapping", "log.csv"], "mapping.yaml"),
    "hardware simulate": (["hardware", "simulate", "servo_pendulum", WIRING],
                          "simulated_servos.yaml"),
}  # fmt: skip
# Where commands write by themselves: recordings, what is about one recording, all else.
PLACES = re.compile(r"\(default (bags/|BAG[/_]|DIR/|results/)|\(default: print")
YOURS = {"robot new": "here, by the name of the file", "docs": "site"}  # what you go on with


def actions():
    """The option --out of each command that has one."""
    parsers = {name: parser(name) for name, command in COMMANDS.items() if command.options}
    found = {name: p._option_string_actions.get("--out") for name, p in parsers.items()}
    return {name: action for name, action in found.items() if action}


def test_commands_that_write_have_it_and_the_help_says_the_rule():
    assert len(actions()) > 30 and set(SINGLE) | set(YOURS) <= set(actions())
    assert "--out is a folder, or the file if a command writes one alone." in summary()


@pytest.mark.parametrize("name", actions())
def test_it_is_a_folder_unless_a_single_file_is_written(name):
    action = actions()[name]
    assert action.type("some/folder") == Path("some/folder")
    if name in SINGLE:
        assert action.type("some/page.html") == Path("some/page.html")
        assert action.metavar == "PATH" and "or its folder" in action.help
    else:
        assert action.metavar == "DIR"
        for file in ("some/page.html", "a.yaml", "pyproject.toml"):  # the last one is there
            with pytest.raises(ArgumentTypeError, match="is the name of a file"):
                action.type(file)


@pytest.mark.parametrize("name", actions())
def test_its_default_is_said_and_is_one_of_three_places(name):
    said = actions()[name].help
    assert YOURS[name] in said if name in YOURS else PLACES.search(said)
    default = actions()[name].default
    assert default is None or f"default {default})" in said


def test_a_file_where_a_folder_is_written_is_one_line(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["run", "hyq_short", "--out", "bags/first.mcap"])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1
    assert "a folder is written, and 'bags/first.mcap' is the name of a file" in said


@pytest.fixture
def quick(monkeypatch, tmp_path):
    """Commands without their work, in an empty folder."""
    monkeypatch.setattr(reports, "page_of", lambda *given: "a page")
    monkeypatch.setattr(reports, "open_bag", lambda bag: SimpleNamespace(folder=Path("bag")))
    monkeypatch.setattr(compare, "read_runs", lambda bags: {})
    monkeypatch.setattr(compare, "page", lambda logs: "a page")
    monkeypatch.setattr(compare, "compared", lambda logs: [])
    monkeypatch.setattr(compare, "verdict", lambda logs, found: ("the same", True))
    job = SimpleNamespace(robot="servo_pendulum")
    monkeypatch.setattr(next_experiment.runner, "read_json", lambda *given: {"next": [NEXT]})
    monkeypatch.setattr(next_experiment.runner, "load_job", lambda folder: job)
    bus = MagicMock(torques={}, port="/dev/pts/7")
    monkeypatch.setattr(servos, "make_bus", lambda f, r, out, e: bus if keep(out) else None)
    monkeypatch.chdir(tmp_path)
    rows = "".join(f"{0.01 * k},{0.1 * k},{0.1 * k}\n" for k in range(20))
    Path("log.csv").write_text("t,pivot_pos,pivot_cmd\n" + rows)


def keep(path):
    path.parent.mkdir(parents=True, exist_ok=True)
    return path.write_text("a file")


@pytest.mark.parametrize("name", SINGLE)
def test_a_single_file_is_written_as_named_or_into_the_folder(name, quick):
    words, file = SINGLE[name]
    for out, wanted in (
        ("mine", f"mine/{file}"),
        (f"other/page{Path(file).suffix}", f"other/page{Path(file).suffix}"),
        ("mine", None),  # again, into the folder that is there
    ):
        if wanted is None and name == "gap mapping":
            continue  # a mapping that was corrected by hand is not replaced
        assert call(*words, "--out", out) == 0
        assert wanted is None or Path(wanted).is_file()
    if name == "compare":
        assert call(*words) == 0 and Path("results/compare.html").is_file()
