# SPDX-License-Identifier: Apache-2.0
"""Fuzzing targets: parsers of external input, each with valid inputs."""

from __future__ import annotations

import functools
import gzip
import importlib.util
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import LocoError, NameUnknownError

MAPPING = b"""columns:
  - {column: q, joint: hinge_joint, role: q, unit: deg}
  - {column: u, joint: hinge_joint, role: command_position, unit: rad}
time: {column: t, unit: s}
"""
TABLE = b"t,hip_q,hip_u\n" + b"".join(
    b"%.2f,%.3f,%.3f\n" % (i / 100, i % 7, i % 5) for i in range(40)
)
ECHO = b"".join(b"""header:
  stamp:
    sec: 17
    nanosec: %d0000000
name:
- hip
- knee
position:
- 0.%d
- .nan
effort: [0.1, 0.2]
---
""" % (i, i) for i in range(9))  # fmt: skip
ROWS = b"time,motor_id,position (deg),names,values\n" + b"".join(
    b"%.2f,%d,%d.5,\"['hip', 'knee']\",\"array('d', [0.%d, 1.0])\"\n"
    % (i / 100, i % 2, i % 7, i % 5)
    for i in range(40)
)
JSON = b'{"samples": [{"t": 0.0, "q": 1.0, "u": 2}, {"t": 0.1, "q": 1.5, "u": 2}]}'


class Target(NamedTuple):
    """A parser under test.

    Attributes:
        seeds: Function that returns valid inputs.
        run: Function that parses an input; its second argument is an empty folder.
        structured: ``yaml``, ``json`` or ``xml`` for inputs in these formats; else empty.
    """

    seeds: Callable[[], list[bytes]]
    run: Callable[[bytes, Path], Any]
    structured: str = ""


def target(name: str) -> Target:
    """Target by name.

    Raises:
        NameUnknownError: No target has this name.
    """
    if name not in TARGETS:
        raise NameUnknownError("target", name, TARGETS)
    return TARGETS[name]


def _files(package: str, pattern: str) -> list[bytes]:
    folder = Path(str(resources.files(package)))
    return [path.read_bytes() for path in sorted(folder.glob(pattern))]


def _file(data: bytes, folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(data)
    return path


def _experiment(data: bytes, folder: Path) -> None:
    from loco_learning.runs.experiment import load

    load(str(_file(data, folder, "mine.yaml")))


def _robot(data: bytes, folder: Path) -> None:
    from loco_sim.robot import robot

    for path in Path(str(robot.ASSETS)).glob("*/*"):
        if path.suffix in (".urdf", ".csv") and not (folder / path.name).exists():
            (folder / path.name).write_bytes(path.read_bytes())
    robot.load(_file(data, folder, "robot.yaml"))


def _model(data: bytes, folder: Path) -> None:
    from loco_sim.plant import model

    model.load(_file(data, folder, "model.yaml"))


def _model_seeds() -> list[bytes]:
    return [
        b"format: 1\nrobot: tigrillo\noverrides: {masses.front_body: 0.674, "
        b'"springs.?h_kfe_joint.stiffness": 440.6}\neffects: [{name: command_delay, delay: 0.1}]\n',
        b"format: 1\nrobot: servo_pendulum\neffects:\n"
        b"- {name: coulomb_friction, joint: '*', torque: 0.1}\n",
    ]


def _gait(data: bytes, folder: Path) -> None:
    from loco_learning.runs.gait_file import load

    load(_file(data, folder, "gait.yaml"))


def _study(data: bytes, folder: Path) -> None:
    from loco_learning.study.study import load

    load(str(_file(data, folder, "study.yaml")))


def _node_set(data: bytes, folder: Path) -> None:
    from loco_bringup.graph.node_set import load

    load(str(_file(data, folder, "nodes.yaml")))


def _mapping(data: bytes, folder: Path) -> None:
    from loco_learning.gap.recordings.mapping import load

    load(_file(data, folder, "mapping.yaml"))


def _csv(data: bytes, folder: Path) -> None:
    from loco_learning.gap.drafting.draft import of_table
    from loco_learning.gap.drafting.joints import Joints
    from loco_learning.gap.importing import tables

    of_table(tables.read(_file(data, folder, "t.csv")), Joints(("hip", "knee")))


def _json(data: bytes, folder: Path) -> None:
    from loco_learning.gap.importing import tables

    tables.read(_file(data, folder, "t.json"))


def _npz(data: bytes, folder: Path) -> None:
    from loco_learning import archive

    archive.read(_file(data, folder, "w.npz"), "weights")


def _npz_seeds() -> list[bytes]:
    import tempfile

    from loco_learning import archive

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "w.npz"
        about = {"learner": {}, "dt": 0.01, "seed": 1}
        archive.write(path, "weights", about, {"a": np.arange(6.0), "b": np.eye(3)})
        return [path.read_bytes()]


def _gz(data: bytes, folder: Path) -> None:
    from loco_learning.gap.importing import tables

    tables.read(_file(data, folder, "t.csv.gz"))


def _binary(name: str, *arguments: Any) -> Callable[..., Any]:
    """A lazily imported function of `binaries`; `arguments` are appended to those of a call."""

    def call(*given: Any) -> Any:
        from . import binaries

        return getattr(binaries, name)(*given, *arguments)

    return call


def _torch_commands(data: bytes, folder: Path) -> None:
    from . import binaries

    binaries.read_table(binaries.torch_file(data), folder, "a.pt")


def _urdf(data: bytes, folder: Path) -> None:
    from . import bodies

    bodies.build(data, folder)


def _urdf_seeds() -> list[bytes]:
    from . import bodies

    return bodies.seeds()


def _bag(data: bytes, folder: Path) -> None:
    from . import bags

    bags.read_recipe(data, folder)


def _bag_seeds() -> list[bytes]:
    from . import bags

    return bags.recipes()


def _mcap(data: bytes, folder: Path) -> None:
    from . import bags

    bags.read_file(data, folder)


def _mcap_seeds() -> list[bytes]:
    from . import bags

    return bags.files()


def _messages(data: bytes, folder: Path) -> None:
    """Read bytes as a message of each topic, with the readers of the nodes."""
    for read, finite in _readers():
        try:
            value = read(data)
        except LocoError:
            continue
        finite(data, value)


@functools.cache
def _readers() -> list[tuple[Callable, Callable]]:
    from loco_control import types
    from loco_control.names import JOINTS
    from loco_control.ros.messages.convert import Converter
    from loco_control.ros.messages.joint_codec import ImuReader, JointCodec

    classes = (types.RobotState, types.GaitTarget, types.MotionCommand, types.TrunkTorque)
    readers: list[Any] = [
        *map(Converter, classes), JointCodec(JOINTS), JointCodec(("a",)), ImuReader()
    ]  # fmt: skip
    return [(reader.read, reader.finite) for reader in readers]


def _message_seeds() -> list[bytes]:
    from rclpy.serialization import serialize_message
    from sensor_msgs.msg import Imu, JointState

    from loco_control.names import JOINTS
    from loco_msgs.msg import MotionCommand, RobotState

    names, zeros = list(JOINTS), [0.0] * len(JOINTS)
    joints = JointState(name=names, position=zeros, velocity=zeros, effort=zeros)
    samples = (RobotState(), MotionCommand(), joints, JointState(name=["a"], position=[1.0]), Imu())
    return [bytes(serialize_message(message)) for message in samples]


def _mesh(data: bytes, folder: Path) -> None:
    from . import bodies

    bodies.build_mesh(data, folder, ".stl", ".obj")


def _collada(data: bytes, folder: Path) -> None:
    from . import bodies

    bodies.build_mesh(data, folder, ".dae")


def _mesh_seeds() -> list[bytes]:
    from . import bodies

    return bodies.mesh_seeds()


def _collada_seeds() -> list[bytes]:
    from . import bodies

    return [bodies.COLLADA.encode()]


TARGETS: dict[str, Target] = {
    "experiment": Target(
        functools.partial(_files, "loco_learning", "experiments/*.yaml"), _experiment, "yaml"
    ),
    "robot": Target(functools.partial(_files, "loco_sim", "assets/*/robot.yaml"), _robot, "yaml"),
    "model": Target(_model_seeds, _model, "yaml"),
    "gait": Target(functools.partial(_files, "loco_learning", "gaits/*.yaml"), _gait, "yaml"),
    "study": Target(functools.partial(_files, "loco_learning", "studies/*.yaml"), _study, "yaml"),
    "node_set": Target(
        functools.partial(_files, "loco_bringup", "node_sets/*.yaml"), _node_set, "yaml"
    ),
    "mapping": Target(lambda: [MAPPING], _mapping, "yaml"),
    "csv": Target(lambda: [TABLE, ECHO, ROWS], _csv),
    "json": Target(lambda: [JSON], _json, "json"),
    "gz": Target(lambda: [gzip.compress(TABLE, mtime=0), gzip.compress(TABLE, 1, mtime=0)], _gz),
    "npz": Target(_npz_seeds, _npz),
    "urdf": Target(_urdf_seeds, _urdf, "xml"),
    "mesh": Target(_mesh_seeds, _mesh),
    "collada": Target(_collada_seeds, _collada, "xml"),
    "bag": Target(_bag_seeds, _bag, "json"),
    "mcap": Target(_mcap_seeds, _mcap),
    "messages": Target(_message_seeds, _messages),
    "pt": Target(_binary("torch_files"), _binary("read_table", "a.pt")),
    "pt_commands": Target(_binary("commands"), _torch_commands),
    "db3": Target(_binary("databases"), _binary("read_database")),
    "metadata": Target(_binary("metadata"), _binary("read_metadata"), "yaml"),
    "gap_json": Target(_binary("results"), _binary("read_results"), "json"),
    "job_json": Target(_binary("jobs"), _binary("read_job"), "json"),
    "journal": Target(_binary("journals"), _binary("read_journal")),
    "journal_rows": Target(_binary("journal_lines"), _binary("read_lines"), "json"),
    "weights": Target(_binary("networks"), _binary("read_network"), "json"),
}
if importlib.util.find_spec("pyarrow"):  # installed by `loco install lerobot`
    TARGETS["parquet"] = Target(_binary("parquets"), _binary("read_table", "a.parquet"))
