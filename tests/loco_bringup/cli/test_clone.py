# SPDX-License-Identifier: Apache-2.0
"""Commands that work on loco itself run from a clone, and say so in one line elsewhere."""

import os
import sys

import pytest

from loco_bringup.cli import clone, main, table
from loco_control.exceptions import MissingFileError

PLACES = {
    "source": "ros_ws/src/loco_bringup/loco_bringup/cli",
    "pip install in .venv": ".venv/lib/python3.11/site-packages/loco_bringup/cli",
    "colcon": "ros_ws/install/loco_bringup/lib/python3.11/site-packages/loco_bringup/cli",
}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """Function that moves the module to a folder below one that may be a clone."""

    def move(folder: str, is_clone: bool):
        path = tmp_path / folder / "clone.py"
        path.parent.mkdir(parents=True)
        path.touch()
        if is_clone:
            (tmp_path / "tests" / "workshop" / clone.WORKSHOP).mkdir(parents=True)
        monkeypatch.setattr(clone, "__file__", str(path))
        return tmp_path

    return move


@pytest.mark.parametrize("name", PLACES)
def test_the_clone_is_around_what_is_installed_in_it(place, name):
    top = place(PLACES[name], is_clone=True)
    assert clone.root() == top


@pytest.mark.parametrize("name", PLACES)
def test_elsewhere_there_is_none(place, name):
    place(PLACES[name], is_clone=False)
    with pytest.raises(MissingFileError, match="runs from a clone.*start it there as `./loco`"):
        clone.root()


OF_A_CLONE = [n for n, c in table.COMMANDS.items() if c.run.startswith(f"{clone.WORKSHOP}.")]


@pytest.mark.parametrize(
    "line", ["test", "bench rls", "gap battery", "chaos", "fuzz", "mutants", "soak", "docs"]
)
def test_a_command_of_a_clone_is_one_line_elsewhere(place, capsys, line):
    place(PLACES["source"], is_clone=False)
    assert line in {*OF_A_CLONE, "bench rls"}
    with pytest.raises(SystemExit) as end:
        main.main(line.split())
    out, err = capsys.readouterr()
    assert end.value.code == 2 and out == ""
    assert err.count("\n") == 1 and "runs from a clone of the repository" in err


def test_processes_that_are_started_find_the_workshop_once(place, monkeypatch):
    top = place(PLACES["source"], is_clone=True)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv("PYTHONPATH", "/before")
    for _ in range(2):
        clone.add_workshop()
    folder = str(top / "tests" / "workshop")
    assert sys.path.count(folder) == 1
    assert os.environ["PYTHONPATH"].split(os.pathsep) == ["/before", folder]
