# SPDX-License-Identifier: Apache-2.0
"""Python files beside a user's data are not executed, whatever their names."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NAMES = (
    "queue signal random json copy types socket select struct logging runpy pickle tempfile "
    "threading multiprocessing subprocess statistics os numpy ctypes yaml dataclasses"
).split()
SHORT = [f"--set=learner.{part}=0.1" for part in ("stand", "train", "closing", "test")]
RUN = ["run", "hyq_trot_reflex", *SHORT, "--out"]
CHILDREN = pytest.mark.skipif(
    sys.version_info < (3, 11), reason="Python 3.10 has no PYTHONSAFEPATH for children"
)


@pytest.mark.parametrize(
    "command",
    [
        ["--version"],
        ["list"],
        ["info", str(ROOT / "tests/golden/hyq_open")],
        [*RUN, "rollout", "--layout", "rollout"],
        pytest.param([*RUN, "graph", "--layout", "processes"], marks=[CHILDREN, pytest.mark.ros]),
    ],
    ids=lambda command: " ".join(command[:1] + command[-1:]),
)
def test_no_file_of_the_current_folder_is_executed(command, tmp_path):
    marker = tmp_path / "executed"
    for name in NAMES:
        text = f"open({str(marker)!r}, 'a').write({name!r} + chr(10))\n"
        (tmp_path / f"{name}.py").write_text(text)
    line = [str(ROOT / "loco"), *command]
    done = subprocess.run(line, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert not marker.exists(), marker.read_text()


@CHILDREN
def test_a_worker_imports_nothing_of_the_current_folder(tmp_path):
    marker = tmp_path / "executed"
    for name in NAMES:
        (tmp_path / f"{name}.py").write_text(f"open({str(marker)!r}, 'a').write({name!r})\n")
    script = tmp_path / "elsewhere" / "work.py"
    script.parent.mkdir()
    script.write_text(
        "from loco_learning.jobs.process import spawn\n"
        "if __name__ == '__main__':\n"
        "    spawn(print)[0].join()\n"
    )
    subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, check=True)
    assert not marker.exists(), marker.read_text()
