# SPDX-License-Identifier: Apache-2.0
"""The wheel holds all that a search needs, and says for which Python it is."""

import json
import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from loco_bringup.gap import text as texts
from loco_workshop import wheel

DATA = (".yaml", ".urdf", ".csv", ".html", ".j2", ".css", ".js", ".svg", ".json", ".rviz", ".txt")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    return wheel.build(tmp_path_factory.mktemp("wheel"))


def test_modules_and_data_of_all_packages_are_in_it(built):
    with zipfile.ZipFile(built) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    wanted = set()
    for folder in (
        "src/loco_control",
        "src/loco_sim",
        "src/loco_learning",
        "ros_ws/src/loco_bringup",
    ):
        for package in Path(wheel.ROOT, folder).glob("loco*"):
            files = (p for p in package.rglob("*") if p.suffix in (".py", *DATA))
            wanted |= {str(p.relative_to(package.parent)) for p in files}
    assert wanted - held == set() and len(wanted) > 500
    assert {name for name in held if name.endswith(".py")} == {w for w in wanted if w[-3:] == ".py"}


@pytest.mark.timeout(900)  # it compiles everything, beside load
def test_a_table_and_a_urdf_get_their_page_from_the_wheel_alone(built, tmp_path):
    """What it requires is taken from this environment, loco from the wheel."""
    environment = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", environment], check=True)
    (site,) = environment.glob("lib/python3*/site-packages")
    required = next(p for p in sys.path if p.endswith("site-packages"))
    (site / "required.pth").write_text(f"{required}\n")  # whose own .pth files are not read
    pip = [sys.executable, "-m", "pip", "--python", environment / "bin/python", "install", "-q"]
    subprocess.run([*pip, "--no-deps", "--no-index", "--no-compile", built], check=True)
    effects = ("--effects", "payload")
    result, _ = wheel.search(environment / "bin/loco", tmp_path / "search", *effects, rows=400)
    assert result["verdict"] in (*texts.NAMED, "unknown")
    job = json.loads((tmp_path / "search/results/job.json").read_text())
    assert str(tmp_path) not in json.dumps(job)
    code = "import loco_bringup; print(loco_bringup.__file__)"
    said = subprocess.run([environment / "bin/python", "-I", "-c", code], capture_output=True,
                          text=True, check=True).stdout  # fmt: skip
    assert said.startswith(str(site))


def test_the_versions_of_python_that_it_names_are_those_that_were_tried():
    text = (wheel.ROOT / "pyproject.toml").read_text()
    low, high = map(int, re.search(r'requires-python = ">=3\.(\d+),<3\.(\d+)"', text).groups())
    named = re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', text)
    tried = re.findall(r"^\| 3\.(\d+)\.\d+ \|", (wheel.ROOT / "docs/results.md").read_text(), re.M)
    assert list(map(int, named)) == list(map(int, tried)) == list(range(low, high))
