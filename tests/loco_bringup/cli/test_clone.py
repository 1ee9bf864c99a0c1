# SPDX-License-Identifier: Apache-2.0
"""Commands that work on loco itself exist in a clone, and nowhere else."""

import os
import subprocess
import sys

import pytest

from loco_bringup.cli import clone, table
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


def test_commands_for_developers_exist_in_a_clone_alone(tmp_path):
    assert {"test", "gap battery", "chaos", "docs"} <= set(table.COMMANDS)
    elsewhere = (
        f"from loco_bringup.cli import clone; clone.__file__ = {str(tmp_path / 'clone.py')!r};"
        "from loco_bringup.cli import main; main.main(['{}'])"
    )
    done = [
        subprocess.run(
            [sys.executable, "-c", elsewhere.format(name)], capture_output=True, text=True
        )
        for name in ("help", "chaos")
    ]
    assert done[0].returncode == 0 and "gap next" in done[0].stdout
    assert "chaos" not in done[0].stdout and "./loco test" not in done[0].stdout
    assert done[1].returncode == 2 and done[1].stderr.count("\n") == 1


def test_processes_that_are_started_find_the_workshop_once(place, monkeypatch):
    top = place(PLACES["source"], is_clone=True)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setenv("PYTHONPATH", "/before")
    for _ in range(2):
        clone.add_workshop()
    folder = str(top / "tests" / "workshop")
    assert sys.path.count(folder) == 1
    assert os.environ["PYTHONPATH"].split(os.pathsep) == ["/before", folder]
