# SPDX-License-Identifier: Apache-2.0
"""A test run ends at Ctrl-C and at SIGTERM, also while rclpy is in use."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.ros

CODE = """
import time
from tests.ros.conftest import Bench
from loco_control.ros.target_node import TargetGeneratorNode

bench = Bench(TargetGeneratorNode)
try:
    print("up", flush=True)
    time.sleep(60.0)
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""


@pytest.mark.parametrize(
    ("number", "said", "code"),
    [(signal.SIGINT, "interrupted", 0), (signal.SIGTERM, "", -signal.SIGTERM)],
)
def test_a_test_with_a_node_can_be_interrupted(number, said, code):
    root = Path(__file__).resolve().parents[2]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(root), *sys.path])}
    run = subprocess.Popen(
        [sys.executable, "-c", CODE], stdout=subprocess.PIPE, text=True, env=environment
    )
    try:
        assert run.stdout.readline() == "up\n"
        run.send_signal(number)
        output, _ = run.communicate(timeout=30.0)
    finally:
        run.kill()
        run.wait()
    assert output.strip() == said
    assert run.returncode == code
