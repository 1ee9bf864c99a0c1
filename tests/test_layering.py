# SPDX-License-Identifier: Apache-2.0
"""Imports point one way, and PyBullet, ROS and the terminal each have one place."""

from __future__ import annotations

import ast
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = {
    "loco_control": ROOT / "src/loco_control/loco_control",
    "loco_sim": ROOT / "src/loco_sim/loco_sim",
    "loco_learning": ROOT / "src/loco_learning/loco_learning",
    "loco_bringup": ROOT / "ros_ws/src/loco_bringup/loco_bringup",
    "loco": ROOT / "ros_ws/src/loco_bringup/loco",
    "loco_workshop": ROOT / "tests/workshop/loco_workshop",
}

# What each package may import besides the standard library and itself.
ALLOWED = {
    "loco_control": {"numpy", "numba", "yaml"},
    "loco_sim": {"loco_control", "numpy", "numba", "llvmlite", "scipy", "yaml", "PIL"},
    "loco_learning": {
        *("loco_control", "loco_sim"),
        *("numpy", "numba", "scipy", "cma", "distributed", "yaml", "matplotlib"),
    },
    "loco": {"loco_control", "loco_sim", "loco_learning", "loco_bringup"},
}
# ROS and the messages: only in the ros folder of a package, and anywhere in loco_bringup.
ROS = {
    *("rclpy", "loco_msgs", "ament_index_python", "builtin_interfaces", "rcl_interfaces"),
    *("rosgraph_msgs", "std_msgs", "std_srvs", "geometry_msgs", "sensor_msgs", "nav_msgs"),
    *("action_msgs", "diagnostic_msgs", "visualization_msgs", "tf2_msgs"),
}
BRINGUP = {
    *ROS,
    *("loco_control", "loco_sim", "loco_learning", "numpy", "yaml", "rich", "pytest"),
    *("numba", "mcap", "zstandard", "lz4", "mcap_ros2", "rosbags", "matplotlib", "PIL"),
    *("scipy", "jinja2", "markupsafe"),
}
WORKSHOP = BRINGUP | {"loco_bringup", "cma"}  # it measures the packages and compares with others
DOORS = {
    Path("loco_control/stance/mpc.py"): {"osqp", "scipy"},
    Path("loco_sim/world/bullet.py"): {"pybullet", "pybullet_data"},
    Path("loco_sim/world/mujoco.py"): {"mujoco"},
    Path("loco_sim/hardware/dynamixel.py"): {"dynamixel_sdk"},
    Path("loco_sim/world/mujoco_model.py"): {"mujoco"},
    Path("loco_sim/world/mjcf.py"): {"mujoco"},
    Path("loco_learning/reinforce/environment.py"): {"gymnasium"},
    Path("loco_workshop/ppo.py"): {"stable_baselines3", "torch"},
    # The blind battery must not make its robots with the code that is judged on them.
    Path("loco_workshop/battery/physics/engine.py"): {"mujoco", "llvmlite"},
    Path("loco_workshop/battery/ground/plant.py"): {"pybullet"},
    Path("loco_workshop/battery/sysid.py"): {"mujoco"},  # a rival of the search
    Path("loco_workshop/docs/site_hooks.py"): {"mkdocs"},
    Path("loco_bringup/view/rerun_scene.py"): {"rerun"},
    Path("loco_bringup/view/foxglove_server.py"): {"foxglove"},
}
# Scripts that are copied beside what we export: nothing imports them, they import nothing of ours.
HANDED_OUT = {Path("loco_sim/export/replay_mjcf.py"): {"mujoco", "numpy"}}
TERMINAL = ("loco_bringup/cli/", *(path.as_posix() for path in HANDED_OUT))  # may print
MOST_MODULES = 12  # in one folder, beside its __init__
# Modules of loco_bringup that import within functions: why. The command line imports the rest by
# its table (`cli.table.load`).
LAZY = {
    "gap/run.py": "the node calibrator uses it without the page, which loads matplotlib",
    "testing/__init__.py": "isolate() has to set the environment before NumPy and rclpy are loaded",
}


def allowed_in(path: Path) -> set[str]:
    """First names that a module may import besides the standard library.

    Args:
        path: The module; begins with the package's name.
    """
    package = path.parts[0]
    if path in HANDED_OUT:
        return HANDED_OUT[path]
    if package in ("loco_bringup", "loco_workshop"):
        legal = BRINGUP if package == "loco_bringup" else WORKSHOP
        return legal | DOORS.get(path, set()) | {package}
    ros = ROS if path.parts[1] == "ros" else set()
    return ALLOWED[package] | ros | DOORS.get(path, set()) | {package}


def names_pybullet(node: ast.AST) -> bool:
    """Whether code uses the name, wherever it comes from."""
    names = [alias.name for alias in getattr(node, "names", ()) if isinstance(alias, ast.alias)]
    names += [getattr(node, "id", ""), getattr(node, "attr", "")]
    return isinstance(node, (ast.ImportFrom, ast.Name, ast.Attribute)) and "pybullet" in names


def violations(path: Path, text: str) -> list[str]:
    """What a module does that it may not; `path` begins with the package's name."""
    found = []
    legal = allowed_in(path) | set(sys.stdlib_module_names)
    for node in ast.walk(ast.parse(text)):
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            modules = [node.module if node.level == 0 else path.parts[0]]
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "print":
            if not path.as_posix().startswith(TERMINAL):
                found.append(f"{path}:{node.lineno} prints; use logging")
        if "pybullet" not in DOORS.get(path, set()) and names_pybullet(node):
            found.append(f"{path}:{node.lineno} names pybullet")
        for module in modules:
            if module.split(".")[0] not in legal:
                found.append(f"{path}:{node.lineno} imports {module}")
    return found


@pytest.mark.parametrize("package", FOLDERS)
def test_modules_keep_to_their_layer(package):
    found = []
    for path in sorted(FOLDERS[package].rglob("*.py")):
        inside = package / path.relative_to(FOLDERS[package])
        found += violations(inside, path.read_text())
    assert found == []


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("loco_control/gait/generator.py", "import rclpy"),
        ("loco_control/gait/generator.py", "from loco_sim.world.bullet import World"),
        ("loco_control/gait/generator.py", "import scipy.linalg"),
        ("loco_control/gait/generator.py", "def f():\n    import loco_msgs.msg"),
        ("loco_control/ros/node.py", "from loco_sim import robot"),
        ("loco_sim/robot/robot.py", "import pybullet as p"),
        ("loco_sim/ros/sim_node.py", "import pybullet"),
        ("loco_sim/plant/simulation.py", "import mujoco"),
        ("loco_sim/world/bullet.py", "import mujoco"),
        ("loco_sim/plant/simulation.py", "from ..world.bullet import pybullet"),
        ("loco_sim/plant/simulation.py", "pybullet"),
        ("loco_sim/plant/simulation.py", "bullet.pybullet.stepSimulation(0)"),
        ("loco_sim/effects/catalogue/push.py", "from loco_learning import rollout"),
        ("loco_learning/runs/rollout.py", "import pybullet"),
        ("loco_learning/runs/rollout.py", "from rclpy.node import Node"),
        ("loco_bringup/graph/run.py", "import pybullet"),
        ("loco_bringup/gap/run.py", "from loco_workshop.battery import bags"),
        ("loco_learning/runs/rollout.py", "import loco_workshop.bench"),
        ("loco_workshop/battery/physics/plant.py", "import mujoco"),
        ("loco_workshop/battery/ground/trots.py", "import pybullet"),
        ("loco_learning/study/study.py", "print('done')"),
        ("loco_sim/export/replay_mjcf.py", "from . import comments"),
        ("loco_sim/export/replay_mjcf.py", "import loco_control"),
        ("loco_sim/export/mjcf.py", "import mujoco"),
    ],
)
def test_a_violation_is_found(path, text):
    assert len(violations(Path(path), text)) == 1


@pytest.mark.parametrize(
    ("path", "text"),
    [
        ("loco_control/ros/node.py", "import rclpy\nfrom loco_control.names import LEGS"),
        ("loco_sim/world/bullet.py", "import pybullet"),
        ("loco_sim/world/mujoco.py", "import mujoco"),
        ("loco_learning/runs/rollout.py", "from loco_sim.plant.simulation import Simulation"),
        ("loco_bringup/cli/main.py", "print('done')"),
        ("loco_control/gait/generator.py", "from .params import Params\nfrom . import names"),
    ],
)
def test_what_is_allowed_is_not_reported(path, text):
    assert violations(Path(path), text) == []


def imports_within_functions(text: str) -> list[int]:
    """Lines of imports that run when a function is called."""
    functions = [n for n in ast.walk(ast.parse(text)) if isinstance(n, ast.FunctionDef)]
    inner = [n for function in functions for n in ast.walk(function)]
    return sorted({n.lineno for n in inner if isinstance(n, (ast.Import, ast.ImportFrom))})


def test_imports_within_functions_are_found():
    assert imports_within_functions("import a\ndef f():\n    if a:\n        from b import c") == [4]
    assert imports_within_functions("import a\nif a:\n    import b\ndef f(): pass") == []


def test_bringup_imports_at_the_top_of_its_modules():
    folder = FOLDERS["loco_bringup"]
    lazy = {
        path.relative_to(folder).as_posix()
        for path in folder.rglob("*.py")
        if imports_within_functions(path.read_text())
    }
    assert lazy == set(LAZY)


# --- the shape of the tree ------------------------------------------------------


def modules_of(package: str) -> dict[str, Path]:
    """Full names of the modules of a package, packages by their own name."""
    found = {}
    for path in FOLDERS[package].rglob("*.py"):
        parts = [package, *path.relative_to(FOLDERS[package]).with_suffix("").parts]
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@pytest.mark.parametrize("package", FOLDERS)
def test_no_folder_holds_more_modules_than_a_head(package):
    folders = {FOLDERS[package], *(p.parent for p in FOLDERS[package].rglob("*.py"))}
    counts = {
        folder.relative_to(ROOT).as_posix(): len(
            set(folder.glob("*.py")) - {folder / "__init__.py"}
        )
        for folder in folders
    }
    assert {name: count for name, count in counts.items() if count > MOST_MODULES} == {}


def imports(name: str, path: Path, modules: dict[str, Path]) -> set[str]:
    """Modules of ours that a module imports anywhere in it, except for type checkers."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text())
    typing = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)
        for inner in ast.walk(node)
    }
    found = set()
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or id(node) in typing:
            continue
        base = node.module or ""
        if node.level:
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*above, *([base] if base else [])])
        for alias in node.names:
            whole = f"{base}.{alias.name}"
            found.add(whole if whole in modules else base)
    # A package that imports what is below it is no cycle: Python loads it first in any case.
    return {other for other in found & set(modules) if not name.startswith(other + ".")}


def cycles(graph: dict[str, set[str]]) -> list[set[str]]:
    """Sets of nodes that reach each other."""
    reach = {node: set(edges) for node, edges in graph.items()}
    for middle in graph:  # Warshall
        for node in graph:
            if middle in reach[node]:
                reach[node] |= reach[middle]
    rings = {frozenset(n for n in reach[node] if node in reach[n]) for node in graph}
    return [set(ring) for ring in rings if len(ring) > 1]


def test_cycles_are_found():
    assert cycles({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": {"a"}}) == [{"b", "c"}]


@cache
def graph() -> dict[str, set[str]]:
    """Modules of ours that each of them imports."""
    modules = {name: path for package in FOLDERS for name, path in modules_of(package).items()}
    return {name: imports(name, path, modules) for name, path in modules.items()}


def test_scripts_that_are_handed_out_are_imported_by_nothing():
    scripts = {".".join(path.with_suffix("").parts) for path in HANDED_OUT}
    assert scripts <= set(graph())
    assert {name for name, others in graph().items() if others & scripts} == set()


def test_no_import_goes_in_circles():
    assert cycles(graph()) == []
