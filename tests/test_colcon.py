# SPDX-License-Identifier: Apache-2.0
"""The workspace builds with colcon, and each node starts from what it installs."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import sysconfig
import time
import zipfile
from pathlib import Path

import pytest

pytestmark = [
    pytest.mark.timeout(1200),  # the build takes 1.5 minutes on two cores, 6 on busy ones
    pytest.mark.xdist_group("colcon"),  # one build
]

PACKAGES = ["loco_bringup", "loco_control", "loco_learning", "loco_msgs", "loco_sim"]
EXECUTABLES = {
    "robot_sim": "loco_sim",
    "target_generator": "loco_control",
    "stance_controller": "loco_control",
    "reflex_network": "loco_learning",
    "calibrator": "loco_bringup",
    "recorder": "loco_bringup",
    "replayer": "loco_bringup",
    "loco": "loco_bringup",
}
NODES = ["robot_sim", "target_generator", "stance_controller", "reflex_network", "recorder",
         "calibrator"]  # fmt: skip


def tree(folder: Path) -> set[str]:
    """Every file and folder below, links included, without what Python leaves when it runs."""
    return {
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if "__pycache__" not in path.parts
    }


@pytest.fixture(scope="module")
def workspace(repository: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of src and ros_ws, built by colcon as ``./loco colcon build`` does it.

    The environment is reached through a link: what colcon generates names the interpreter,
    and cannot do so when its path has spaces.
    """
    copy = tmp_path_factory.mktemp("colcon")
    (copy / ".venv").symlink_to(sys.prefix)
    ignore = shutil.ignore_patterns("__pycache__", "build", "install", "log", "*.egg-info")
    for folder in ("src", "ros_ws"):
        shutil.copytree(repository / folder, copy / folder, symlinks=True, ignore=ignore)
    before = tree(copy / "src") | tree(copy / "ros_ws/src")
    result = subprocess.run(
        ["python", "-m", "colcon", "build"],
        cwd=copy / "ros_ws",
        env=environment(copy / ".venv"),
        capture_output=True,
        text=True,
    )
    assert result.returncode == 0, result.stdout + result.stderr
    assert tree(copy / "src") | tree(copy / "ros_ws/src") == before, "the build left files behind"
    return copy / "ros_ws"


def environment(venv: Path) -> dict[str, str]:
    """Variables that ./loco sets before it starts colcon.

    Those of coverage are dropped, too: it would trace the generators of messages, which takes as
    long again as the build, and what runs from the workspace is a copy that is not counted.
    """
    dropped = ("PYTHONPATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH")
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in dropped and not name.startswith("COVERAGE_")
    }
    path = f"{venv}/bin:{os.environ['PATH']}"
    return kept | {"VIRTUAL_ENV": str(venv), "AMENT_PREFIX_PATH": str(venv), "PATH": path}


def sourced(workspace: Path, *command: str) -> subprocess.Popen:
    """Start a command in a shell that has sourced the workspace."""
    script = f'. "{workspace}/install/setup.sh" && exec {shlex.join(command)}'
    return subprocess.Popen(
        ["sh", "-c", script],
        env=environment(workspace.parent / ".venv"),
        stdout=subprocess.PIPE,
        text=True,
    )


def test_every_package_is_installed(workspace):
    markers = "share/ament_index/resource_index/packages"
    for package in PACKAGES:
        assert (workspace / "install" / package / markers / package).is_file()


@pytest.mark.parametrize("package", PACKAGES)
def test_the_sourced_workspace_comes_before_the_environment(workspace, package):
    code = f"import {package}; print({package}.__path__[0])"
    printed, _ = sourced(workspace, "python", "-c", code).communicate(timeout=60)
    assert Path(printed.strip()).is_relative_to(workspace / "install" / package)


@pytest.mark.parametrize("executable", EXECUTABLES)
def test_executables_lie_where_ros2_run_looks(workspace, executable):
    package = EXECUTABLES[executable]
    assert os.access(workspace / "install" / package / "lib" / package / executable, os.X_OK)


@pytest.mark.ros
def test_every_node_starts_from_the_sourced_workspace(workspace, tmp_path):
    """Each in a namespace of its own, so that it stays alone; its diagnostics tell that it runs."""
    processes = []
    for node in NODES:
        path = workspace / "install" / EXECUTABLES[node] / "lib" / EXECUTABLES[node] / node
        bag = ["-p", f"bag:={tmp_path / 'bag'}"] if node == "recorder" else []
        processes.append(
            sourced(workspace, str(path), "--ros-args", "-r", f"__ns:=/{node}_alone", *bag)
        )
    try:
        assert names_in_diagnostics(set(NODES), seconds=300) == set(NODES)
    finally:
        # One after another: Fast DDS may lock up where a participant ends while others vanish.
        codes = []
        for process in processes:
            process.send_signal(signal.SIGINT)
            codes.append(process.wait(timeout=60))
    assert codes == [0] * len(NODES)


def names_in_diagnostics(wanted: set[str], seconds: float) -> set[str]:
    """Names of the nodes that report on /diagnostics, until all wanted ones have."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.signals import SignalHandlerOptions

    heard: set[str] = set()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    listener = rclpy.create_node("listener")
    listener.create_subscription(
        DiagnosticArray,
        "/diagnostics",
        lambda m: heard.update(s.name.rpartition("/")[2] for s in m.status),
        10,
    )
    end = time.monotonic() + seconds
    while not wanted <= heard and time.monotonic() < end:
        rclpy.spin_once(listener, timeout_sec=0.2)
    listener.destroy_node()
    rclpy.shutdown()
    return heard & wanted


# Prints the bytes of every message, filled with numbers and texts, and reads those of a file:
# compared as messages, since what Fast CDR leaves between fields to align them is anything.
BYTES = """
import array, itertools, sys
import numpy as np
import loco_msgs.action, loco_msgs.msg
from rclpy.serialization import deserialize_message, serialize_message

def example(value, kind, count):
    if isinstance(value, np.ndarray):
        return (np.arange(value.size) + next(count)).astype(value.dtype)
    if isinstance(value, array.array):
        return array.array(value.typecode, [next(count), next(count)])
    if isinstance(value, list) and value:
        return [example(one, kind, count) for one in value]
    if isinstance(value, list):
        return [f"text \u00e9 {next(count)}" for _ in range(3)] if "string" in kind else value
    if isinstance(value, bool):
        return next(count) % 2 == 0
    if isinstance(value, str):
        return f"text \u00e9 {next(count)}"
    return type(value)(next(count)) if isinstance(value, (int, float)) else filled(value, count)

def filled(message, count):
    for name, kind in message.get_fields_and_field_types().items():
        setattr(message, name, example(getattr(message, name), kind, count))
    return message

kinds = {n: c for n, c in vars(loco_msgs.msg).items() if hasattr(c, "get_fields_and_field_types")}
for action in (loco_msgs.action.Calibrate, loco_msgs.action.FindGap):
    kinds |= {f"{action.__name__}.{p}": getattr(action, p) for p in ("Goal", "Result", "Feedback")}
for name, kind in sorted(kinds.items()):
    print(name, serialize_message(filled(kind(), itertools.count(1))).hex())
for line in open(sys.argv[1]) if sys.argv[1:] else ():
    name, text = line.split()
    message, expected = bytes.fromhex(text), filled(kinds[name](), itertools.count(1))
    assert deserialize_message(message, kinds[name]) == expected, name
    assert len(message) == len(serialize_message(expected)), name
"""


def test_shipped_messages_are_what_a_build_gives(workspace, repository):
    """Each reads the other's bytes; generated Python, type hashes and exported symbols agree."""
    ours, theirs = workspace / "ours.txt", workspace / "theirs.txt"
    ours.write_text(shipped())
    process = sourced(workspace, "python", "-c", BYTES, str(ours))
    theirs.write_text(process.communicate(timeout=120)[0])
    assert process.returncode == 0 and theirs.read_text().count("\n") >= 17
    shipped(str(theirs))
    built, compared = workspace / "install/loco_msgs", 0
    with zipfile.ZipFile(repository / "requirements/messages.zip") as archive:
        for member in archive.namelist():
            folder, _, name = member.partition("/")
            if folder not in ("all", sysconfig.get_config_var("SOABI")) or "tf2_msgs" in name:
                continue
            path = next(built.glob(name.replace("site-packages", "lib/python3*/site-packages")))
            if path.suffix == ".so":
                copy = workspace / path.name
                copy.write_bytes(archive.read(member))
                assert symbols(copy) == symbols(path) != [], name
            else:
                assert archive.read(member) == path.read_bytes(), name
            compared += 1
    assert compared > 40


def shipped(*arguments: str) -> str:
    """What `BYTES` prints with the messages of this environment."""
    command, env = [sys.executable, "-c", BYTES, *arguments], environment(Path(sys.prefix))
    return subprocess.run(command, env=env, stdout=subprocess.PIPE, text=True, check=True).stdout


def symbols(library: Path) -> list[str]:
    """What a library offers of the messages."""
    command = ["nm", "--dynamic", "--defined-only", "--format=just-symbols", str(library)]
    text = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    return sorted(name for name in text.split() if "loco_msgs" in name)


def test_data_is_installed(workspace):
    """YAML and URDF files are found by the installed packages, not only in the source tree."""
    for package in set(PACKAGES) - {"loco_msgs"}:
        source = workspace / "src" / package / package
        installed = next((workspace / "install" / package / "lib").glob("python*/site-packages"))
        for path in source.rglob("*"):
            if path.suffix in (".yaml", ".urdf"):
                assert (installed / package / path.relative_to(source)).is_file(), path
