# SPDX-License-Identifier: Apache-2.0
"""No process of ours looks for others beyond this machine unless it is told to."""

import ast
import contextlib
import os
import subprocess
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import pytest

from loco_bringup.testing import servo_bus

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("discovery")]

ROOT = Path(__file__).resolve().parents[2]
SETUPS = [*ROOT.glob("src/loco_*/setup.py"), ROOT / "ros_ws/src/loco_bringup/setup.py"]
VARIABLE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
LOOPBACK = "0100007F"  # 127.0.0.1
DDS = "0100FFEF"  # 239.255.0.1, where DDS participants meet, as the kernel writes it
BAG = ROOT / "tests/golden/tigrillo_open"
GAIT = [  # a network's reflex node ends when its gait does not fit its links
    word
    for name in ("amplitude", "phase", "stiffness")
    for word in ("-p", f"gait.{name}:=[{', '.join(['1.0'] * 54)}]")
]
ARGUMENTS = {"loco": ["top"], "replayer": [str(BAG), "--loop"], "faults": []}


def executables():
    """Name and module of everything that `ros2 run` and the environment's bin folder start."""
    found = {}
    for path in SETUPS:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Constant) and " = " in str(node.value):
                name, _, target = node.value.partition(" = ")
                found[name] = target.partition(":")[0]
    return found


def memberships():
    """Devices of other machines on which somebody here has joined the group of DDS."""
    device, found = "", set()
    for line in Path("/proc/net/igmp").read_text().splitlines()[1:]:
        words = line.split()
        if line[0].isdigit():
            device = words[1]
        elif words[0] == DDS and device != "lo":
            found.add(device)
    return found


def sockets(pid):
    """Local addresses of the UDP sockets of a process, as the kernel writes them."""
    held = set()
    for fd in Path(f"/proc/{pid}/fd").iterdir():
        try:
            held.add(os.readlink(fd))
        except OSError:
            continue
    rows = [line.split() for line in Path("/proc/net/udp").read_text().splitlines()[1:]]
    return [r[1].partition(":")[0] for r in rows if f"socket:[{r[9]}]" in held]


def start(command, environment, tmp_path):
    env = {k: v for k, v in os.environ.items() if k not in (VARIABLE, "ROS_LOCALHOST_ONLY")}
    env.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None)
    return subprocess.Popen(
        [sys.executable, *command], env={**env, **environment}, cwd=tmp_path,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


def until_up(processes):
    """Wait until each process takes part in DDS."""
    end = time.monotonic() + 300.0  # beside a load a dozen processes take their time to begin
    up = set()
    while len(up) < len(processes):
        for name, process in processes.items():
            assert process.poll() is None, f"{name} ended with {process.poll()}"
            if len(sockets(process.pid)) >= 3:
                up.add(name)
        assert time.monotonic() < end, f"{set(processes) - up} did not begin"
        time.sleep(0.1)
    time.sleep(0.5)


def end(processes):
    for process in processes.values():
        process.terminate()
    for process in processes.values():
        try:
            process.wait(timeout=20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def test_no_executable_joins_a_group_of_other_machines(tmp_path):
    if memberships():
        pytest.skip("something else on this machine looks for others")
    processes, bus = {}, contextlib.ExitStack()
    try:
        for number, (name, module) in enumerate(executables().items()):
            ros = ["--ros-args", "-r", f"__ns:=/discovery_{number}"]
            if name == "driver":
                if find_spec("dynamixel_sdk") is None:
                    continue
                file = bus.enter_context(servo_bus()).file
                ros += ["-p", "clock:=realtime", "-p", f"hardware:={file}"]
            arguments = ARGUMENTS.get(name, ros + GAIT if name == "msd_reflex" else ros)
            processes[name] = start(["-m", module, *arguments], {}, tmp_path)
        assert {"loco", "recorder", "calibrator", "joint_sim", "faults"} <= set(processes)
        until_up(processes)
        assert memberships() == set()
        for name, process in processes.items():
            assert set(sockets(process.pid)) == {LOOPBACK}, name
    finally:
        end(processes)
        bus.close()


def test_leaving_the_machine_takes_one_setting(tmp_path):
    """So the test above can fail."""
    if not [line for line in Path("/proc/net/route").read_text().splitlines()[1:]]:
        pytest.skip("this machine has no network")
    command = ["-m", "loco_control.ros.target_node"]
    processes = {"target": start(command, {VARIABLE: "SUBNET"}, tmp_path)}
    try:
        until_up(processes)
        assert memberships() != set()
    finally:
        end(processes)


@pytest.mark.parametrize(
    "path", ["docker/compose.yaml", "docker/entrypoint.sh", "docker/Dockerfile"]
)
def test_containers_and_launch_files_do_not_open_the_graph(path):
    assert VARIABLE not in (ROOT / path).read_text()
