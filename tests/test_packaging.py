# SPDX-License-Identifier: Apache-2.0
"""What is written in several files agrees: versions, links, messages, requirements, data."""

from __future__ import annotations

import argparse
import ast
import dataclasses
import fnmatch
import inspect
import math
import os
import re
import runpy
import shutil
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ElementTree
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from loco_bringup.cli.options import install
from loco_control import types
from loco_control.ros.messages.joint_topics import TABLES

ROOT = Path(__file__).resolve().parent.parent
PYTHON_PACKAGES = {
    "loco_control": ROOT / "src/loco_control",
    "loco_sim": ROOT / "src/loco_sim",
    "loco_learning": ROOT / "src/loco_learning",
    "loco_bringup": ROOT / "ros_ws/src/loco_bringup",
}
MESSAGES = ROOT / "src/loco_msgs/msg"

# The messages that are only for people and tools, and the type that only the simulator has.
WITHOUT_TYPE = {"CalibrationState", "Event", "Gap", "GapSearch", "RecorderStatus"}
WITHOUT_MESSAGE = {"GroundTruth"}


def read(path: str) -> str:
    return (ROOT / path).read_text()


def match(pattern: str, text: str) -> str:
    found = re.search(pattern, text, re.MULTILINE)
    assert found, f"no {pattern!r}"
    return found[1]


# --- versions and links ---------------------------------------------------------


def test_versions_agree():
    versions = {"pyproject.toml": match(r'^version = "(.+)"', read("pyproject.toml"))}
    for folder in [*PYTHON_PACKAGES.values(), MESSAGES.parent]:
        manifest = folder / "package.xml"
        versions[str(manifest)] = ElementTree.parse(manifest).findtext("version")
    for name, folder in PYTHON_PACKAGES.items():
        setup = (folder / "setup.py").read_text()
        versions[f"{name}/setup.py"] = match(r'version="(.+)"', setup)
        init = (folder / name / "__init__.py").read_text()
        if "__version__" in init:
            versions[f"{name}/__init__.py"] = match(r'__version__ = "(.+)"', init)
    versions["CITATION.cff"] = match(r"^version: (.+)$", read("CITATION.cff"))
    assert len(set(versions.values())) == 1, versions


@pytest.mark.parametrize("package", ["loco_control", "loco_sim", "loco_learning", "loco_msgs"])
def test_the_workspace_links_to_the_packages(package):
    link = ROOT / "ros_ws/src" / package
    assert link.is_symlink()
    assert str(link.readlink()) == f"../../src/{package}"
    assert (link / "package.xml").is_file()


def test_every_package_of_ours_is_in_the_workspace():
    ours = {path.parent.name for path in (ROOT / "src").glob("loco_*/package.xml")}
    linked = {path.parent.name for path in (ROOT / "ros_ws/src").glob("*/package.xml")}
    assert linked == ours | {"loco_bringup"}


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_marker_and_script_folder_are_those_of_ros2_run(package):
    folder = PYTHON_PACKAGES[package]
    assert (folder / "resource" / package).read_text() == ""
    assert (folder / "setup.cfg").read_text().count(f"$base/lib/{package}\n") == 2


# --- what setup.py and package.xml promise ----------------------------------------


def setup_arguments(package: str) -> dict[str, ast.expr]:
    """Keyword arguments of setup() in the setup.py of a package."""
    tree = ast.parse((PYTHON_PACKAGES[package] / "setup.py").read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    call = next(call for call in calls if getattr(call.func, "id", "") == "setup")
    return {keyword.arg: keyword.value for keyword in call.keywords}


def entry_points(package: str) -> list[str]:
    return ast.literal_eval(setup_arguments(package)["entry_points"])["console_scripts"]


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_every_executable_has_its_function(package):
    for entry in entry_points(package):
        module, function = entry.split(" = ")[1].split(":")
        path = PYTHON_PACKAGES[package] / (module.replace(".", "/") + ".py")
        assert path.is_file(), f"{entry}: no such module"
        body = ast.parse(path.read_text()).body
        names = {n.name for n in body if isinstance(n, ast.FunctionDef)}
        names |= {t.id for n in body if isinstance(n, ast.Assign) for t in n.targets
                  if isinstance(t, ast.Name)}  # fmt: skip
        assert function in names, entry


def imported_packages(package: str) -> set[str]:
    """First names of everything that the modules of a package import."""
    names = set()
    for path in (PYTHON_PACKAGES[package] / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module.split(".")[0])
    if package == "loco_control":  # its tables name the messages of the topics
        names |= {t.message.partition("/")[0] for table in TABLES.values() for t in table.values()}
        names.add("builtin_interfaces")
    return names - {package} - set(sys.stdlib_module_names)


# Names in package.xml of what is imported under another name. What rosdep does not know
# is installed by pip, from requirements/runtime.in.
ROSDEP = {
    "PIL": "python3-pil",
    "jinja2": "python3-jinja2",
    "markupsafe": "python3-markupsafe",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
    "yaml": "python3-yaml",
}
ONLY_PIP = {
    "dynamixel_sdk",
    *("gymnasium", "stable_baselines3", "torch"),
    "mujoco",
    "mkdocs",
    "osqp",
    "rerun",
    "foxglove",
    *("cma", "distributed", "llvmlite", "lz4", "mcap", "mcap_ros2", "numba", "pybullet"),
    *("pybullet_data", "rosbags", "zstandard"),  # lz4 and zstandard come with mcap
}


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_package_xml_names_what_is_imported(package):
    manifest = ElementTree.parse(PYTHON_PACKAGES[package] / "package.xml").getroot()
    named = {element.text for element in manifest.findall("exec_depend")}
    imported = {ROSDEP.get(name, name) for name in imported_packages(package) - ONLY_PIP}
    assert imported - named == set(), "imported, but not in package.xml"
    launch = {"launch", "launch_ros"} if package == "loco_bringup" else set()
    assert named - imported - launch == set(), "in package.xml, but not imported"


@pytest.mark.parametrize("package", PYTHON_PACKAGES)
def test_data_files_are_installed(package):
    """Everything that is not Python has a kind listed in pyproject.toml and setup.py."""
    listed = re.findall(r'"\*\*/(\*\.\w+)"', read("pyproject.toml"))
    setup = (PYTHON_PACKAGES[package] / "setup.py").read_text()
    kinds = re.search(r"for kind in (\(.*?\))", setup, re.DOTALL)
    assert [f"*.{kind}" for kind in ast.literal_eval(kinds[1])] == listed
    for path in (PYTHON_PACKAGES[package] / package).rglob("*"):
        if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts:
            assert any(fnmatch.fnmatch(path.name, kind) for kind in listed), path


# --- requirements -------------------------------------------------------------------


def named_requirements(file: str) -> set[str]:
    lines = [line.split("#")[0].strip() for line in read(file).splitlines()]
    return {re.split(r"[\[<>=~ ;]", line)[0].lower() for line in lines if line}


def locked_requirements() -> list[str]:
    """Blocks of the lock files, one requirement with its hashes each."""
    text = "".join(read(f"requirements/{name}.txt") for name in ("lock", "build", "tools", "rl"))
    text = re.sub(r"^ *#.*\n", "", text, flags=re.MULTILINE)
    return re.split(r"\n(?=\S)", text.strip())


def test_every_locked_requirement_has_a_version_and_a_hash():
    for block in locked_requirements():
        assert re.match(r"[a-z0-9-]+==\S+ ", block), block.splitlines()[0]
        assert "--hash=sha256:" in block, block.splitlines()[0]


FILES = [f"{name}.in" for name in "runtime ros cluster build test colcon docs rl".split()]


@pytest.mark.parametrize("file", FILES)
def test_every_named_requirement_is_locked(file):
    locked = {block.split("==")[0] for block in locked_requirements()}
    assert named_requirements(f"requirements/{file}") - locked == set()


def test_parts_of_a_lock_file_are_all_of_it_and_share_no_package():
    """What pips install side by side: every block once, packages of one family together."""
    install = runpy.run_path(str(ROOT / "requirements/install.py"))
    text = read("requirements/lock.txt")
    parts = install["split"](text)
    assert sorted("".join(parts)) == sorted(text[text.index("\n", text.index("#    ")) + 1 :])
    places = [{n for n, p in enumerate(parts) if re.search(rf"(?m)^{name}", p)}
              for name in ("mujoco", "numpy", "mcap")]  # fmt: skip
    assert all(len(place) == 1 for place in places)


INSTALLER = """#!/bin/sh
name=${0##*/}
echo "$name $*" >>"$CALLS"
case "$name $*" in
*" config list") echo "$CONFIG" ;;
"uv "*) exit "$UV" ;;
*"part2.txt") exit "$PIP" ;;
esac
"""


@pytest.mark.parametrize(
    ("config", "uv", "pip", "code", "uvs", "parts"),
    [
        ("global.timeout='9'", 0, 0, 0, 1, 0),
        ("global.timeout='9'", 2, 0, 0, 1, 4),  # uv fails: pips
        ("global.timeout='9'", 2, 1, 1, 1, 4),
        ("global.index-url='file:///mine'", 0, 0, 0, 0, 4),  # which uv would not ask
        (":env:.proxy='here'", 0, 0, 0, 0, 4),
    ],
)
def test_uv_installs_and_pips_where_it_cannot(
    tmp_path, monkeypatch, config, uv, pip, code, uvs, parts
):
    for name in ("python", "uv"):
        (tmp_path / name).write_text(INSTALLER)
        (tmp_path / name).chmod(0o755)
    told = {"CALLS": tmp_path / "calls", "CONFIG": config, "UV": uv, "PIP": pip}
    for name, value in told.items():
        monkeypatch.setenv(name, str(value))
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    install = runpy.run_path(str(ROOT / "requirements/install.py"))
    assert install["main"](ROOT / "requirements/lock.txt") == code
    calls = (tmp_path / "calls").read_text().splitlines()
    ways = [call for call in calls if call.endswith("lock.txt --no-progress")]
    assert len(ways) == uvs and all(f"--python {tmp_path}/python" in way for way in ways)
    pips = [call for call in calls if re.search(r"part\d\.txt$", call)]
    assert len(pips) == parts
    assert all("--require-hashes --no-deps" in call for call in ways + pips)


def test_no_package_index_is_named():
    """Where packages come from is the user's pip configuration, never ours."""
    option = re.compile(r"--(extra-)?index-url|--find-links|--trusted-host|https?://")
    files = [*ROOT.glob("requirements/*.[!z]*"), *ROOT.glob("docker/*"), ROOT / ".ci/run"]
    files += [ROOT / "loco"]
    files += [ROOT / "pyproject.toml", ROOT / "pixi.toml"]
    for path in files:
        assert not option.search(path.read_text().replace("--no-emit-index-url", "")), path


def test_pixi_asks_for_what_the_requirements_ask_for():
    """It cannot be solved here: versions of ROS, and what wheels and our messages do not bring."""
    pixi = pytest.importorskip("tomllib").loads(read("pixi.toml"))  # of Python 3.11
    asked = pixi["dependencies"]
    pin = re.compile(r"^ros-(?:jazzy-)?([\w-]+)(?:\[\w+\])?==(.+)$", re.MULTILINE)
    pins = pin.findall(read("requirements/ros.in"))
    wanted = {f"ros-jazzy-{name}": f">={version},<{int(version[0]) + 1}" for name, version in pins}
    assert len(wanted) == 2 and wanted.items() <= asked.items()
    lines = [line.split("#")[0] for line in read("requirements/runtime.in").splitlines()]
    wheels = [Requirement(line) for line in lines if line.strip()]
    python = {"python_version": asked["python"].removesuffix(".*")}
    assert {r.name for r in wheels if r.marker and not r.marker.evaluate(python)} <= asked.keys()
    manifest = ElementTree.parse(MESSAGES.parent / "package.xml")
    names = [element.text or "" for element in manifest.iter("buildtool_depend")]
    names += [folder.name for folder in ROOT.glob("src/*_msgs") if folder.name != "loco_msgs"]
    assert {f"ros-jazzy-{name.replace('_', '-')}" for name in names} <= asked.keys()
    assert pixi["pypi-dependencies"] == {"loco-gap": {"path": ".", "editable": True}}


# --- messages -----------------------------------------------------------------------


def message_fields(path: Path) -> dict[str, str]:
    """Field names of a .msg file and their types."""
    lines = [line.split("#")[0].split() for line in path.read_text().splitlines()]
    return {line[1]: line[0] for line in lines if line}


def dataclass_fields(cls: type) -> dict[str, str]:
    """Fields of a dataclass with the message type that carries each.

    The length of an array is the shape its comment ends with: ``# force [N], (4, 3)``.
    """
    expected = {}
    scalars = {"int": ("uint64", "uint8"), "float": ("float64",), "bool": ("bool",)}
    for line in inspect.getsource(cls).splitlines():
        found = re.match(r"    (\w+): ([\w.]+)(.*)", line)
        if not found:
            continue
        name, kind, comment = found.groups()
        if kind == "np.ndarray":
            shape = re.findall(r"\(([\d, ]+)\)", comment)[-1]
            length = math.prod(int(n) for n in shape.split(",") if n.strip())
            element = "bool" if "bool" in comment or name == "stance" else "float64"
            expected[name] = (f"{element}[{length}]",)
        else:
            expected[name] = scalars[kind]
    assert list(expected) == [field.name for field in dataclasses.fields(cls)]
    return expected


def types_of_ours() -> dict[str, type]:
    return {n: c for n, c in vars(types).items() if dataclasses.is_dataclass(c)}


def test_every_message_has_a_type_and_every_type_a_message():
    messages = {path.stem for path in MESSAGES.glob("*.msg")}
    assert messages - WITHOUT_TYPE == set(types_of_ours()) - WITHOUT_MESSAGE


@pytest.mark.parametrize("name", sorted(set(types_of_ours()) - WITHOUT_MESSAGE))
def test_message_and_type_have_the_same_fields(name):
    message = message_fields(MESSAGES / f"{name}.msg")
    fields = dataclass_fields(types_of_ours()[name])
    assert message.pop("stamp") == "builtin_interfaces/Time"  # travels as stamp, is t in Python
    assert fields.pop("t") == ("float64",)
    assert set(message) == set(fields)
    for field, legal in fields.items():
        assert message[field] in legal, field


@pytest.mark.parametrize("path", sorted(MESSAGES.glob("*.msg")), ids=lambda path: path.stem)
def test_every_message_carries_tick_and_stamp_first(path):
    fields = message_fields(path)
    assert list(fields.items())[:2] == [("stamp", "builtin_interfaces/Time"), ("tick", "uint64")]


@pytest.mark.parametrize("package", ["loco_msgs", "tf2_msgs"])
def test_every_message_is_built(package):
    listed = re.findall(r"(?:msg|action)/\w+\.\w+", read(f"src/{package}/CMakeLists.txt"))
    folder = ROOT / "src" / package
    files = [*folder.glob("msg/*"), *folder.glob("action/*")]
    there = sorted(path.relative_to(folder).as_posix() for path in files)
    assert sorted(listed) == there


# --- messages that are shipped in compiled form -----------------------------------------

SHIPPED = runpy.run_path(str(ROOT / "requirements/messages.py"))


def test_shipped_messages_are_of_these_sources_and_for_every_python():
    """Else `requirements/README.md` says how they are made anew."""
    with zipfile.ZipFile(SHIPPED["SHIPPED"]) as archive:
        assert archive.read("key").decode() == SHIPPED["key"](), "made from other messages"
        folders = {name.partition("/")[0] for name in archive.namelist()} - {"key", "all"}
    assert folders == {f"cpython-3{minor}-x86_64-linux-gnu" for minor in range(10, 14)}


@pytest.fixture
def checkout(tmp_path) -> Path:
    """A copy of what the shipped messages are compared with."""
    for package in ("loco_msgs", "tf2_msgs"):
        shutil.copytree(ROOT / "src" / package, tmp_path / "src" / package)
    (tmp_path / "requirements").mkdir()
    for name in ("messages.zip", "lock.txt", "build.txt"):
        shutil.copy(ROOT / "requirements" / name, tmp_path / "requirements")
    return tmp_path


def misfit(checkout: Path) -> str:
    return SHIPPED["check"](checkout / "requirements/messages.zip", checkout)


def append(path: Path, text: str) -> None:
    path.write_text(path.read_text() + text)


def test_other_messages_or_generators_are_told_from_those_of_the_archive(checkout, monkeypatch):
    monkeypatch.delenv("LOCO_COMPILE", raising=False)
    before = misfit(checkout)
    (checkout / "src/loco_msgs/msg/Gap.msg~").write_text("what an editor left")
    assert misfit(checkout) == before and "other messages" not in before
    for name in ("src/loco_msgs/msg/Gap.msg", "src/tf2_msgs/CMakeLists.txt"):
        append(checkout / name, "\n")
        assert "made from other messages" in misfit(checkout), name
        shutil.copy(ROOT / name, checkout / name)
    lock = checkout / "requirements/build.txt"
    lock.write_text(re.sub(r"(?m)^(ros-ament-cmake==).+", r"\g<1>9.9", lock.read_text()))
    assert "by other generators" in misfit(checkout)


def test_an_archive_that_is_missing_or_damaged_is_told(checkout, monkeypatch):
    monkeypatch.delenv("LOCO_COMPILE", raising=False)
    archive = checkout / "requirements/messages.zip"
    archive.write_bytes(archive.read_bytes()[:1000])
    assert "missing or damaged" in misfit(checkout)
    archive.unlink()
    assert "missing or damaged" in misfit(checkout)


def test_another_platform_and_a_wish_to_build_are_told(checkout, monkeypatch):
    monkeypatch.setenv("LOCO_COMPILE", "1")
    assert misfit(checkout) == "LOCO_COMPILE is set"
    monkeypatch.delenv("LOCO_COMPILE")
    monkeypatch.setattr(sysconfig, "get_config_var", lambda name: "cpython-311-aarch64-linux-gnu")
    assert misfit(checkout) == "messages.zip has none for cpython-311-aarch64-linux-gnu"


def test_shipped_messages_are_installed_in_place_of_others(tmp_path):
    """What is written is what this environment holds, where its messages are shipped ones."""
    prefix, site = tmp_path, tmp_path / "lib/python3/site-packages"
    stale = site / "loco_msgs/msg/_removed.py"
    for path in (stale, prefix / "lib/libloco_msgs__removed.so"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    SHIPPED["install"](prefix, site)
    assert not stale.exists() and not (prefix / "lib/libloco_msgs__removed.so").exists()
    written = [p for p in tmp_path.rglob("*") if p.is_file() and not p.is_relative_to(site)]
    assert (prefix / "share/loco_msgs/msg/Gap.msg").read_text() == read("src/loco_msgs/msg/Gap.msg")
    assert (prefix / "share/ament_index/resource_index/packages/tf2_msgs") in written
    ours = Path(sys.prefix) == ROOT / ".venv" and not SHIPPED["check"]()
    for path in written if ours else []:
        there = Path(sys.prefix) / path.relative_to(prefix)
        assert there.read_bytes() == path.read_bytes(), there


def test_installed_messages_are_those_of_the_source():
    """The messages that were built have the fields of the files: nobody runs old ones."""
    import loco_msgs.msg

    for path in MESSAGES.glob("*.msg"):
        built = getattr(loco_msgs.msg, path.stem).get_fields_and_field_types()
        assert list(built) == list(message_fields(path)), path.stem


@pytest.mark.parametrize("name", ["Calibrate", "FindGap"])
def test_installed_action_is_that_of_the_source(name):
    import loco_msgs.action

    text = (MESSAGES.parent / f"action/{name}.action").read_text()
    action = getattr(loco_msgs.action, name)
    parts = [action.Goal, action.Result, action.Feedback]
    for part, lines in zip(parts, text.split("---\n"), strict=True):
        named = [line.split("#")[0].split() for line in lines.splitlines()]
        assert list(part.get_fields_and_field_types()) == [line[1] for line in named if line]


def test_tf_message_is_the_one_of_every_other_installation():
    """Same name and same definition, so the same type hash: /tf can be read by anybody."""
    from tf2_msgs.msg import TFMessage

    assert TFMessage.get_fields_and_field_types() == {
        "transforms": "sequence<geometry_msgs/TransformStamped>"
    }


@pytest.mark.xdist_group("itself")
def test_tests_of_a_group_stay_together(request):
    """They share runs that take minutes; pytest 9.2 keeps the groups from pytest-xdist 3.8."""
    if not getattr(request.config.option, "loadgroup", False):
        pytest.skip("one process, or tests are spread one by one")
    assert request.node.nodeid.endswith("@itself")


SHARED = """
import os, pathlib, pytest

@pytest.mark.parametrize("n", [1, "a@b", pytest.param(3, marks=pytest.mark.xdist_group("g"))])
def test_it(n):
    where = "group" if n == 3 else __file__
    with open(pathlib.Path(__file__).with_name("ran.txt"), "a") as file:
        print(where, os.getpid(), file=file)
"""


def test_tests_of_a_file_share_their_worker_unless_they_are_in_a_group(tmp_path):
    """Where they were spread one by one, each worker made the fixtures of a file."""
    (tmp_path / "conftest.py").write_text("from tests.conftest import pytest_xdist_make_scheduler")
    for name in "abcd":
        (tmp_path / f"test_{name}.py").write_text(SHARED)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-n", "2", "--dist", "loadgroup", str(tmp_path)],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True, text=True,
    )  # fmt: skip
    assert "12 passed" in done.stdout, done.stdout + done.stderr
    ran = {tuple(line.split()) for line in (tmp_path / "ran.txt").read_text().splitlines()}
    assert len(ran) == 5 and len({process for _, process in ran}) == 2


def test_the_help_of_install_names_every_extra():
    text = (ROOT / "pyproject.toml").read_text()
    extras = set(re.findall(r"^optional-dependencies\.(\w+) ", text, re.MULTILINE))
    parser = argparse.ArgumentParser()
    install.install(parser)
    named = re.split(r", | or ", parser._positionals._group_actions[-1].help)
    assert set(named) == extras and len(extras) > 10
