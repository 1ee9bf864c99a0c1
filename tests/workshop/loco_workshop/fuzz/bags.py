# SPDX-License-Identifier: Apache-2.0
"""Fuzzing targets for bags: files are built from JSON recipes and read by every reader of loco.

Damaged bytes rarely get past the checksums. A recipe contains names, texts, stamps and messages
to damage, and the file built from it has correct checksums.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import CompressionType, Writer

from loco_bringup.bag.copy import extract
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.cli.bags import show_bag
from loco_bringup.gap import importing
from loco_bringup.logs.export import FORMATS, export
from loco_bringup.record.order import Order
from loco_control.exceptions import LocoError, ParameterError
from loco_control.ros.messages.definitions import definition
from loco_control.ros.messages.joint_codec import JointCodec
from loco_sim.robot import robot as robots

_PACKED = {"": CompressionType.NONE, "lz4": CompressionType.LZ4, "zstd": CompressionType.ZSTD}
_ROOM = 100  # size of a message whose text in the recipe is not base64 [bytes]


def recipes() -> list[bytes]:
    """Recipes of valid bags."""
    joints = "sensor_msgs/msg/JointState"
    qos = "- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: volatile\n"
    states = _channel("/joint_states", joints, qos, joint_states())
    command = {**states, "topic": "/joint_command"}
    text = _channel("/robot_description", "std_msgs/msg/String", "[]", [_string("<robot/>")])
    about = {
        "metadata": {"loco": {"seed": "1", "versions": '{"loco": "1"}'}},
        "channels": [states, command, text],
    }
    files = {"experiment.yaml": "name: sample\noverrides: {height: 0.5}\n", "weights.npz": "none"}
    packed = [json.dumps({"compression": how, "files": files, **about}) for how in _PACKED]
    return [recipe.encode() for recipe in packed]


def files() -> list[bytes]:
    """Bytes of valid bags, with and without checksums, compressed and uncompressed."""
    return [made(recipe, sums) for recipe in recipes() for sums in (True, False)]


def _channel(topic: str, kind: str, qos: str, data: list[bytes]) -> dict[str, Any]:
    rows = [
        {"time": k * 10_000_000, "publish": k * 10_000_000, "data": base64.b64encode(d).decode()}
        for k, d in enumerate(data)
    ]
    schema = {"name": kind, "encoding": "ros2msg", "text": definition(kind)}
    return {"topic": topic, "encoding": "cdr", "schema": schema, "messages": rows,
            "metadata": {"offered_qos_profiles": qos}}  # fmt: skip


def joint_states() -> list[bytes]:
    """Serialised JointState messages of a swinging joint."""
    codec = JointCodec(("pivot",))
    turns = 0.1 * np.arange(60)[:, None]
    rows = zip(np.sin(turns), 10.0 * np.cos(turns), strict=True)
    return [codec.pack(0.01 * k, q, dq, q) for k, (q, dq) in enumerate(rows)]


def _string(text: str) -> bytes:
    data = text.encode() + b"\0"
    return b"\x00\x01\x00\x00" + len(data).to_bytes(4, "little") + data


def made(recipe: bytes, sums: bool = True) -> bytes:
    """Bytes of the bag described by a recipe.

    Raises:
        ParameterError: The recipe is invalid.
    """
    out = io.BytesIO()
    try:
        values = json.loads(recipe)
        writer = Writer(out, chunk_size=600, compression=_PACKED[values["compression"]],
                        enable_crcs=sums, enable_data_crcs=sums)  # fmt: skip
        writer.start("ros2", "fuzz")
        for channel in values["channels"]:
            _write(writer, channel)
        for name, text in values.get("files", {}).items():
            writer.add_attachment(0, 0, name, "text/yaml", text.encode())
        for name, entries in values.get("metadata", {}).items():
            writer.add_metadata(name, entries)
        writer.finish()
    except Exception as error:  # damage that the writer of the other library does not accept
        raise ParameterError(f"no recipe of a bag: {type(error).__name__}") from None
    return out.getvalue()


def _write(writer: Writer, channel: dict[str, Any]) -> None:
    schema = channel["schema"]
    kind = writer.register_schema(schema["name"], schema["encoding"], schema["text"].encode())
    number = writer.register_channel(
        channel["topic"], channel["encoding"], kind, channel["metadata"]
    )
    for sequence, row in enumerate(channel["messages"]):
        try:
            data = base64.b64decode(row["data"])
        except ValueError:
            data = row["data"].encode()[:_ROOM]
        writer.add_message(number, row["time"], data, row["publish"], sequence)


def silence() -> contextlib.redirect_stdout[io.StringIO]:
    """Context that suppresses printed output."""
    return contextlib.redirect_stdout(io.StringIO())


def read_recipe(recipe: bytes, folder: Path) -> None:
    """Build the bag of a recipe and read it."""
    read_file(made(recipe), folder)


def read_file(data: bytes, folder: Path) -> None:
    """Read a bag with every reader; the first `LocoError` is raised at the end.

    Raises:
        AssertionError: A file was written despite an error, or outside the folder.
    """
    place = folder / "bag"
    place.mkdir()
    (place / "bag_0.mcap").write_bytes(data)
    robot, mapping = robots.load("servo_pendulum"), folder / "mapping.yaml"
    mapping.write_text(MAPPED)
    errors = []
    operations = {
        "show": lambda out: show_bag(place, True, True),
        "info": lambda out: show_bag(place),
        "recover": lambda out: recover(place, out),
        "order": lambda out: list(Order(bag := Bag(place), list(bag.topics))),
        "extract": lambda out: extract(place, out, list(Bag(place).topics)),
        "gap": lambda out: importing.load(place, robot),
        "mapped": lambda out: importing.load(place, robot, mapping),
        **{f"export {form}": lambda out, form=form: export(place, out, form) for form in FORMATS},
    }
    for name, operation in operations.items():
        out = folder / "out"
        try:
            with silence():
                operation(out)
        except LocoError as error:
            errors.append(error)
            if out.exists():
                raise AssertionError(f"{name} leaves {out} after: {error}") from error
        strangers = {path.name for path in folder.iterdir()} - {"bag", "out", mapping.name}
        if strangers or len(list(place.iterdir())) > 1:
            raise AssertionError(f"{name} writes outside its folder: {strangers}")
        shutil.rmtree(out, ignore_errors=True)
    if errors:
        raise next((error for error in errors if "\n" in str(error)), errors[0])


MAPPED = """columns:
  - {topic: /joint_states, column: 'position[0]', joint: pivot, role: q, unit: rad}
  - {topic: /joint_command, column: 'position[0]', joint: pivot, role: command_position}
"""
