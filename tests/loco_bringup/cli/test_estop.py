# SPDX-License-Identifier: Apache-2.0
"""The emergency stop of a running graph: it holds until it is reset."""

import contextlib
import fcntl
import os
import subprocess
import sys

import numpy as np
import pytest
from std_msgs.msg import Bool

from loco_bringup.graph import shm
from loco_bringup.graph.processes import _environment
from loco_bringup.testing import Graph

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

LONG = {"duration": 120.0}


def loco(*arguments, **more):
    command = [sys.executable, "-m", "loco_bringup.cli.main", *arguments]
    return subprocess.run(
        command, capture_output=True, text=True, env=_environment(), timeout=60, **more
    )


def travel(graph, ticks):
    """How far the joint travels in the ticks that come now [rad]; its encoder steps by 5 mrad."""
    states = graph.listen("joint_states")
    states.clear()
    heard = graph.expect("joint_states", count=ticks)[-ticks:]
    return np.ptp([message.position[0] for message in heard])


def test_topic_service_and_keys_stop_and_only_a_reset_lets_go(tmp_path):
    with Graph("servo_pendulum_sine", tmp_path / "g", LONG, speed=2.0) as graph:
        assert travel(graph, 200) > 0.5
        graph.publish("estop", Bool(data=True))
        assert graph.expect_event("estop").text == "topic estop"
        travel(graph, 150)  # it comes to rest
        assert travel(graph, 100) < 0.02
        graph.publish("estop", Bool(data=False))
        assert travel(graph, 100) < 0.02  # that is no reset

        done = loco("estop", "--reset")
        assert (done.returncode, done.stdout) == (0, "/: reset; it was stopped by topic estop\n")
        graph.expect_event("estop reset")
        assert travel(graph, 200) > 0.5

        done = loco("estop")
        assert (done.returncode, done.stdout) == (0, "/: stopped: service set_estop\n")
        done = loco("estop", "--keys", input="rxr q")
        assert "/: reset; it was stopped by service set_estop\n" in done.stdout
        assert done.stdout.endswith("/: it is not stopped\n/: stopped: service set_estop\n")
        graph.expect("/diagnostics", where=_says_estop)
    assert set(graph.exit_codes.values()) == {0}


def _says_estop(array):
    return any(
        value.key == "estop" and value.value == "service set_estop"
        for status in array.status for value in status.values
    )  # fmt: skip


def test_what_the_middleware_complains_of_is_not_in_what_a_command_prints():
    """Processes that start at once fight over the ports in shared memory; one takes the next."""
    for _ in range(5):
        with contextlib.ExitStack() as held:
            for number in range(7000, 7020):
                file = held.enter_context(open(f"/dev/shm/fastrtps_port{number}_el", "a+b"))
                with contextlib.suppress(OSError):  # a reader has it
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            done = loco("estop")
        shm.clean()  # of ports that nobody had
        if "init_port" in done.stderr:  # a run that ends beside may have cleaned them away
            break
    assert done.stdout == ""
    assert "init_port fastrtps_port70" in done.stderr


def test_no_robot_is_one_clear_line():
    done = loco("estop")
    assert done.returncode == 1
    domain = os.environ["ROS_DOMAIN_ID"]
    assert done.stderr.strip().splitlines()[-1] == (
        f"loco: no robot offers the service set_estop on domain {domain}"
    )


PLANT = """
import sys, time, rclpy
from std_srvs.srv import SetBool
from loco_control.ros.parameters import sealed_node

def serve(request, response):
    print(f"{namespace} {time.monotonic()}", flush=True)
    time.sleep(float(seconds))
    response.success, response.message = True, "stopped"
    return response

namespace, seconds = sys.argv[1:]
rclpy.init(args=[])
node = sealed_node("plant", namespace=namespace)
node.create_service(SetBool, "set_estop", serve)
print("ready", flush=True)
rclpy.spin(node)
"""


def test_a_robot_that_does_not_answer_does_not_keep_the_others_from_stopping():
    """All are asked, also those discovered later; the first in the alphabet is too slow."""
    plants = [
        subprocess.Popen([sys.executable, "-c", PLANT, *arguments], env=_environment(),
                         stdout=subprocess.PIPE, text=True)
        for arguments in (("/a", "7"), ("/b", "0"))
    ]  # fmt: skip
    try:
        assert [plant.stdout.readline() for plant in plants] == ["ready\n"] * 2
        done = loco("estop")
        assert done.returncode == 1
        assert done.stdout == "/a: no answer within 5 s\n/b: stopped\n"
        slow, quick = (float(plant.stdout.readline().split()[1]) for plant in plants)
        assert abs(slow - quick) < 4.0  # before the time of the slow one is over
    finally:
        for plant in plants:
            plant.kill()
            plant.communicate()
