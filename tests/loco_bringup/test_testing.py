# SPDX-License-Identifier: Apache-2.0
"""The harness for users' tests, and the example of its page, run as it is printed."""

import os
import re
import signal
import subprocess
import sys

import pytest
from std_msgs.msg import String

from loco_bringup.testing import Graph, claim_domain
from loco_control.exceptions import GraphError

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]


def test_the_example_of_the_page_runs_as_printed(repository, tmp_path):
    page = (repository / "docs" / "testing.md").read_text()
    blocks = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", page, re.DOTALL)
    assert [name for name, _ in blocks] == ["conftest.py", "test_my_robot.py"]
    for name, code in blocks:
        (tmp_path / name).write_text(code)
    env = {k: v for k, v in os.environ.items() if k not in ("ROS_DOMAIN_ID", "LOCO_TEST_PROCESS")}
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)],
        capture_output=True, text=True, env=env, cwd=tmp_path, timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    assert "3 passed" in done.stdout


def test_a_claimed_domain_is_nobody_elses():
    first, second = claim_domain(), claim_domain()
    assert first != second
    assert str(first) != os.environ["ROS_DOMAIN_ID"]


def test_processes_of_tests_in_the_background_hear_ctrl_c():
    """A shell starts what runs in the background with SIGINT ignored, which children inherit."""
    code = (
        "import signal, subprocess, sys; from loco_bringup.testing import isolate; isolate(); "
        "child = 'import signal; print(signal.getsignal(2) is signal.default_int_handler)'; "
        "subprocess.run([sys.executable, '-c', child])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
    )  # fmt: skip
    assert found.stdout == "True\n"


def test_what_does_not_come_is_told_with_the_logs(tmp_path):
    with Graph("hyq_trot_open", tmp_path / "g", {"duration": 600.0}) as graph:
        with pytest.raises(GraphError, match="1 messages on nowhere did not come within 0.3 s"):
            graph.expect("nowhere", type=String, timeout=0.3)
        with pytest.raises(GraphError, match="1 readers of nobody"):
            graph.publish("nobody", String(), timeout=0.3)
        with pytest.raises(GraphError, match="topic elsewhere is not in our tables"):
            graph.listen("elsewhere")
    assert graph.outcome is not None


def test_a_graph_that_cannot_start_says_why(tmp_path):
    with pytest.raises(GraphError, match="another loco run uses ROS domain"):
        with Graph("hyq_trot_open", tmp_path / "a", {"duration": 600.0}):
            with Graph("hyq_trot_open", tmp_path / "b"):
                pass


def test_topics_of_a_namespace_are_found(tmp_path):
    with Graph("tigrillo_hold", tmp_path / "g", {"duration": 600.0}, namespace="lab") as graph:
        states = graph.expect("joint_states", count=5)
        assert graph.pid("robot_sim") > 0
    assert len(states[0].name) == 8
