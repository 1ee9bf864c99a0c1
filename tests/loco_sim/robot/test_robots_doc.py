# SPDX-License-Identifier: Apache-2.0
"""docs/robots.md and robot_yaml.md: examples run as printed, tables name what there is."""

import dataclasses
import re
from pathlib import Path

import pytest

from loco_sim.plant import model
from loco_sim.robot import equipment, robot
from loco_sim.robot.sensors import EncoderParams, HallParams, ImuParams, SensorParams
from loco_sim.robot.servo import DRIVES
from loco_sim.robot.spring import SPRING_TYPES, SpringParams

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "robots.md").read_text() + (DOCS / "robot_yaml.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", PAGE, re.DOTALL)


def test_the_example_runs_as_printed(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "door").mkdir()
    xml, yaml, python = (
        next(text for kind, text in BLOCKS if kind == k) for k in ("xml", "yaml", "python")
    )
    (tmp_path / "door" / "door.urdf").write_text(xml)
    (tmp_path / "door" / "robot.yaml").write_text(yaml)
    exec(compile(python, "docs/robots.md", "exec"), {})


def test_the_model_loads_as_printed(tmp_path):
    text = [text for kind, text in BLOCKS if kind == "yaml"][1]
    (tmp_path / "model.yaml").write_text(text)
    assert model.load(tmp_path / "model.yaml").make_robot().name == "tigrillo"


@pytest.mark.parametrize(
    "params",
    [
        *DRIVES.values(),
        equipment.DynamicsParams,
        SpringParams,
        HallParams,
        EncoderParams,
        ImuParams,
        SensorParams,
    ],
)
def test_every_parameter_is_in_a_table(params):
    missing = [f.name for f in dataclasses.fields(params) if f"`{f.name}`" not in PAGE]
    assert [name for name in missing if f"`{name}:" not in PAGE] == []


def test_every_section_robot_and_spring_is_in_a_table():
    sections = (*equipment.BY_JOINT, *equipment.BY_LINK, *equipment.NESTED, *equipment.SCALARS)
    for name in (*sections, *robot.names(), *DRIVES):
        assert f"| `{name}` |" in PAGE
    for kind in SPRING_TYPES:
        assert f"`kind: {kind}`" in PAGE
