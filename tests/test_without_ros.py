# SPDX-License-Identifier: Apache-2.0
"""What `pip install .` promises without ROS: commands that read and simulate, and `import loco`.

Each test starts a Python in which the packages of ROS cannot be imported.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from loco_sim.engines import installed

ROOT = Path(__file__).resolve().parent.parent
NOTEBOOK = ROOT / "docs/csv_to_gap.ipynb"
BAG = ROOT / "tests/golden/hyq_open"
WITHOUT_ROS = (
    "gap", "gap next", "gap experiments", "calibrate", "run --layout rollout", "robot",
    "robot new", "list", "info", "report", "recover", "export", "extract", "study", "optimise",
    "reinforce", "reinforce contest", "reproduce",
)  # fmt: skip
BLOCKER = """
import sys

class Blocker:
    def find_spec(self, name, path=None, target=None):
        first = name.partition(".")[0]
        if first in ("rclpy", "ament_index_python") or first.endswith(
            ("_msgs", "_srvs", "_interfaces", "rosidl_runtime_py")
        ):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Blocker())
"""


def start(script: str, folder: Path, **options) -> subprocess.CompletedProcess:
    """Run a script in a Python without ROS."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        [sys.executable, "-c", BLOCKER + script], cwd=folder, env=environment, text=True,
        capture_output=True, timeout=250, check=False, **options,
    )  # fmt: skip


def test_the_blocker_blocks(tmp_path):
    done = start("import sensor_msgs.msg", tmp_path)
    assert done.returncode == 1 and "No module named 'sensor_msgs'" in done.stderr


def test_commands_without_nodes_import_no_ros(tmp_path):
    script = f"""
from loco_bringup.cli import table
for name in {WITHOUT_ROS}:
    table.load(table.COMMANDS[name].run)
import loco
assert not [name for name in sys.modules if name.partition(".")[0] in ("rclpy", "loco_msgs")]
"""
    done = start(script, tmp_path)
    assert done.returncode == 0, done.stderr


def test_bags_are_made_and_read(tmp_path):
    script = f"""
from loco_bringup.cli.table import call
assert call("info", "{BAG}") == 0
assert call("export", "{BAG}", "--out", "exported") == 0
rollout = "run", "servo_pendulum_sine", "--layout", "rollout", "--set", "duration=0.5"
assert call(*rollout, "--out", "made") == 0
assert call("export", "made", "--format", "csv", "--out", "made/exported") == 0
import loco
bag = loco.load_bag("made")
assert bag.topics["/joint_states"].type == "sensor_msgs/msg/JointState"
assert bag.messages("joint_states")[7].header.stamp.nanosec == 70_000_000
assert len(bag.records("joint_states")) == 50
"""
    done = start(script, tmp_path)
    assert done.returncode == 0, done.stderr
    names = {path.name for path in (tmp_path / "exported").iterdir()}
    assert {"robot_state.npz", "trunk_torque.npz"} <= names
    rows = (tmp_path / "made/exported/joint_states.csv").read_text().splitlines()
    assert rows[0].startswith("log_time,header.stamp.sec") and len(rows) == 51


@pytest.mark.parametrize("command", ["run hyq_short", "replay bag", "top"])
def test_commands_of_the_graph_say_what_is_missing(command, tmp_path):
    done = start(f"from loco_bringup.cli.main import main\nmain({command.split()})", tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith("loco: rclpy is not installed; this command speaks ROS 2")
    assert done.stderr.count("\n") == 1


def words(notebook_outputs) -> list[str]:
    """What the cells of a notebook say, without numbers and pictures."""
    texts = ["".join(one.get("text") or one["data"].get("text/html") or one["data"]["text/plain"])
             for cell in notebook_outputs for one in cell]  # fmt: skip
    return [re.sub(r"[-+.\d]+|<img [^>]+>", "", text) for text in texts]


def test_the_notebook_leads_from_csv_to_the_name_of_the_gap(tmp_path):
    notebook = json.loads(NOTEBOOK.read_text())
    script = f"""
import json
from loco_workshop.docs import notebook
print(json.dumps(notebook.outputs(json.load(open({str(NOTEBOOK)!r}, encoding="utf-8")))))
"""
    done = start(script, tmp_path)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout.splitlines()[-1])
    # A search with MuJoCo ends a hair elsewhere, and does not exclude Stribeck's law.
    exact = "pybullet" in installed()
    named = "coulomb friction in pivot." if exact else "friction in pivot, by what law"
    (result,) = (one["data"] for cell in said for one in cell if "data" in one)
    assert f"<pre>Named: {named}" in "".join(result["text/html"])
    assert '<img alt="The largest gap' in "".join(result["text/html"])
    name, place, parameter, value, low, high = said[-2][0]["text"][0].split()
    assert (name, place, parameter) == ("coulomb_friction", "pivot", "torque")
    assert float(low) <= 0.15 <= float(high) and float(high) - float(low) < 0.1 * 0.15
    page = tmp_path / "results/gap_middle/gap.html"
    assert page.read_text().startswith("<!")
    stored = [cell["outputs"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    if exact:
        assert words(stored) == words(said)
