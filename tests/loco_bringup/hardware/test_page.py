# SPDX-License-Identifier: Apache-2.0
"""The commands of docs/hardware.md, one after the other as a reader gives them."""

import os
import re
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip("dynamixel_sdk")

ROOT = Path(__file__).resolve().parents[3]
LOCO = [sys.executable, "-m", "loco_bringup.cli.main"]

pytestmark = pytest.mark.ros


def printed():
    """Commands of the page, without ``./loco`` in front, up to those that want ros2_control.

    ``./loco install`` is left out: `test_loco_script.py` runs it, and it downloads.
    """
    text = (ROOT / "docs/hardware.md").read_text().replace("\\\n", " ")
    text, _, rest = text.partition("\n## Controllers of ros2_control\n")
    assert rest
    blocks = "".join(re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    lines = [shlex.split(line, comments=True) for line in blocks.splitlines()]
    return [words[1:] for words in lines if words[0] == "./loco" and words[1] != "install"]


def test_commands_lead_from_a_simulated_bus_to_a_recording_that_can_be_searched(tmp_path):
    serve, *commands = printed()
    assert serve[:2] == ["hardware", "simulate"] and commands[-1][:2] == ["gap", "check"]
    (tmp_path / "src").symlink_to(ROOT / "src")
    wiring = tmp_path / "servos.yaml"
    with open(tmp_path / "log", "w") as log:
        bus = subprocess.Popen([*LOCO, *serve], cwd=tmp_path, stdout=log, stderr=log)
    try:
        while not wiring.exists() or not wiring.read_text():
            assert bus.poll() is None, (tmp_path / "log").read_text()
            time.sleep(0.1)
        # A machine that runs tests may leave the bus without time.
        wiring.write_text(wiring.read_text().replace("bus:", "bus:\n  missing: 200", 1))
        for words in commands:
            short = ["--set", "duration=2.0"] if "servo_pendulum_sine" in words else []
            call = [*LOCO, *words, *short]
            done = subprocess.run(
                call, cwd=tmp_path, env=os.environ, capture_output=True, text=True
            )
            assert done.returncode == 0, (words, done.stdout, done.stderr)
    finally:
        bus.terminate()
        bus.wait()
    assert "usable" in done.stdout
