# SPDX-License-Identifier: Apache-2.0
"""Another machine on the network: it sees nothing and stops nothing, unless SUBNET lets it."""

import contextlib
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import pytest
from tests.ros.machines import BAIT, Unavailable, attack, bait, environment, two_machines, ways

from loco_bringup.bag.reader import Bag
from loco_control.ros import IGNORE_OWN, LOOPBACK, OPEN, PROFILE, RANGE, settle_network

HERE = "0100007F"  # 127.0.0.1, as the kernel writes it
WAYS = ("multicast", "static peers", "static peers alone", "initial peers")
LOCO = ("-m", "loco_bringup.cli.main")
RUN = ("run", "tigrillo_hold", "--speed", "1", "--set", "duration=3000")


@pytest.fixture
def machines():
    with contextlib.ExitStack() as stack:
        try:
            pair = stack.enter_context(two_machines())
        except Unavailable as error:
            pytest.skip(str(error))
        yield pair


@contextlib.contextmanager
def graph(machine, folder, *options, env, code=130):
    """A robot that holds its posture, from its first ticks on, until Ctrl-C if `code` is 130."""
    process = machine.start(
        sys.executable, *LOCO, *RUN, *options, "--out", str(folder), env=environment(**env),
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        end = time.monotonic() + 200
        while not any(p.stat().st_size > 100_000 for p in folder.glob("*.mcap")):
            assert process.poll() is None, process.stderr.read()
            assert time.monotonic() < end
            time.sleep(0.2)
        yield process
    finally:
        if code == 130:
            process.send_signal(signal.SIGINT)
        out = process.communicate(timeout=200)[1]
    assert process.returncode == code, out


def events(folder):
    return [event.kind for event in Bag(folder).messages("/events")]


@pytest.mark.parametrize("layout", ["composed", "processes"])
def test_by_default_another_machine_sees_reads_and_stops_nothing(machines, tmp_path, layout):
    robot, other = machines
    told = {"ROS_STATIC_PEERS": "10.213.7.2"} if layout == "processes" else {}
    with graph(robot, tmp_path / "run", "--layout", layout, env=told) as process:
        assert robot.bound() == {HERE}
        visible = bait(robot)
        try:
            with ThreadPoolExecutor() as strangers:  # all at once, as each only looks and waits
                results = strangers.map(partial(attack, other, until=BAIT), ways(tmp_path).values())
            for name, result in zip(WAYS, results, strict=True):
                assert result == {"topics": [], "read": 0, "stops": 0}, name
        finally:
            visible.kill()
            visible.wait()
        assert process.poll() is None
    kinds = events(tmp_path / "run")
    assert "started" in kinds and "estop" not in kinds


@pytest.mark.parametrize("way", WAYS)
def test_subnet_opens_the_graph(machines, tmp_path, way):
    """So the test above can fail; what SECURITY.md says of an open graph holds, too."""
    robot, other = machines
    with graph(robot, tmp_path / "run", env={RANGE: "SUBNET"}, code=3):
        assert robot.bound() - {HERE}
        result = attack(other, ways(tmp_path)[way], "stopped")
        assert {"/model", "/diagnostics", "/events"} <= set(result["topics"])
    assert "estop" in events(tmp_path / "run")


# ---- what the environment is told, without a network

OWN = "/home/me/mine.xml"


@pytest.mark.parametrize(
    ("given", "scope", "profile", "words"),
    [
        ({}, "SYSTEM_DEFAULT", LOOPBACK, []),
        ({RANGE: ""}, "SYSTEM_DEFAULT", LOOPBACK, []),
        ({RANGE: "LOCALHOST"}, "SYSTEM_DEFAULT", LOOPBACK, []),
        ({RANGE: "OFF"}, "OFF", LOOPBACK, []),
        ({RANGE: "subnet"}, "SYSTEM_DEFAULT", LOOPBACK, [f"{RANGE}=subnet is ignored"]),
        ({RANGE: "SUBNET"}, "SUBNET", OPEN, []),
        ({RANGE: "SUBNET", PROFILE: LOOPBACK}, "SUBNET", OPEN, []),
        ({RANGE: "LOCALHOST", PROFILE: OPEN}, "SYSTEM_DEFAULT", LOOPBACK, []),
        ({RANGE: "SUBNET", "ROS_LOCALHOST_ONLY": "1"}, "SYSTEM_DEFAULT", LOOPBACK,
         ["in spite of SUBNET"]),
        ({PROFILE: f"/copy{LOOPBACK[LOOPBACK.index('/loco_control/ros'):]}"},
         "SYSTEM_DEFAULT", LOOPBACK, []),
        ({PROFILE: OWN}, "LOCALHOST", OWN, ["mine.xml: that profile decides"]),
        ({PROFILE: OWN, RANGE: "SUBNET"}, "SUBNET", OWN, ["mine.xml: that profile decides"]),
        ({"RMW_IMPLEMENTATION": "rmw_other"}, "LOCALHOST", None, ["rmw_other: it decides"]),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, "SYSTEM_DEFAULT", LOOPBACK, []),
    ],
)  # fmt: skip
def test_what_a_process_is_told_of_the_network(given, scope, profile, words):
    env = dict(given)
    lines = settle_network(env)
    assert (env[RANGE], env.get(PROFILE), env[IGNORE_OWN]) == (scope, profile, "false")
    assert "ROS_LOCALHOST_ONLY" not in env
    assert len(lines) == len(words) and all(map(str.__contains__, lines, words))
    assert env["SKIP_DEFAULT_XML_FILE"] == "1"
    again = dict(env)
    assert settle_network(again) == [line for line in lines if "decide" in line]
    assert again == env  # a child of the process is told the same


@pytest.mark.parametrize(
    "name", ["ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "FASTDDS_ENVIRONMENT_FILE"]
)
def test_variables_that_reach_for_other_machines_count_with_subnet_alone(name):
    env = {name: "10.213.7.2"}
    assert settle_network(env) == [
        f"{name} is ignored; the graph stays on this machine unless {RANGE} is SUBNET"
    ]
    assert name not in env
    env = {name: "10.213.7.2", RANGE: "SUBNET"}
    assert settle_network(env) == [] and env[name] == "10.213.7.2"


@pytest.mark.parametrize(
    "name", ["ROS_DISCOVERY_SERVER", "FASTDDS_BUILTIN_TRANSPORTS", "ROS_LOCALHOST_ONLY", ""]
)
def test_no_variable_but_subnet_and_no_profile_of_the_folder_binds_another_address(tmp_path, name):
    planted = Path(OPEN).read_text().replace('"loco"', '"planted"')
    (tmp_path / "DEFAULT_FASTRTPS_PROFILES.xml").write_text(planted)
    values = {"ROS_DISCOVERY_SERVER": "10.213.7.2:11811", "ROS_LOCALHOST_ONLY": "1"}
    env = environment(**({name: values.get(name, "LARGE_DATA")} if name else {}))
    done = subprocess.run(
        [sys.executable, "-c", OWN_SOCKETS], env=env, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.stdout.split() == [HERE], done.stderr


OWN_SOCKETS = """
import os, loco_control.ros, rclpy
rclpy.init()
node = rclpy.create_node("alone")
held = set()
for fd in os.listdir("/proc/self/fd"):
    try:
        held.add(os.readlink(f"/proc/self/fd/{fd}"))
    except OSError:
        pass
rows = [l.split() for k in ("udp", "udp6", "tcp", "tcp6") for l in open(f"/proc/net/{k}")]
print(*{r[1].partition(":")[0] for r in rows if f"socket:[{r[9]}]" in held})
"""
