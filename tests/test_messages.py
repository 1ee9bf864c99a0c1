# SPDX-License-Identifier: Apache-2.0
"""Where values of others are refused, they are cut in the message, whatever they are."""

from __future__ import annotations

import json

import pytest
import yaml

from loco_bringup import settings
from loco_bringup.bag.reader import Bag
from loco_bringup.cli.table import parse
from loco_bringup.gap import importing
from loco_bringup.gap import run as gap
from loco_bringup.graph import node_set
from loco_control import params, reading
from loco_control.exceptions import MOST, LocoError
from loco_learning import archive
from loco_learning.gap.importing import tables
from loco_learning.gap.recordings import mapping
from loco_learning.params import LearnerParams
from loco_learning.runs import gait_file
from loco_learning.runs.experiment import load as load_experiment
from loco_learning.study import study
from loco_sim import effects
from loco_sim.plant import model
from loco_sim.robot import robot

VALUES = {
    "text": "y" * 3000,
    "words": "y z " * 900,
    "lines": "y\nz\n" * 900,
    "list": list(range(2000)),
    "mapping": {f"k{i}": i for i in range(900)},
    "number": 10**3000,
}


def written(folder, name, values):
    path = folder / name
    path.write_text(json.dumps(values) if name.endswith("json") else yaml.safe_dump(values))
    return path


SITES = {
    "a parameter": lambda v, d: params.from_dict(LearnerParams, {"neurons": v}),
    "a choice": lambda v, d: params.from_dict(LearnerParams, {"activation": v}),
    "a key": lambda v, d: params.from_dict(LearnerParams, {str(v)[:4000]: 1}),
    "a mapping": lambda v, d: params.from_dict(LearnerParams, v if v != VALUES["mapping"] else [v]),
    "an effect": lambda v, d: effects.base.from_list([{"name": v}]),
    "an experiment": lambda v, d: load_experiment(str(v)[:4000]),
    "a value of one": lambda v, d: load_experiment("hyq_short", {"gait.speed": v}),
    "a key of one": lambda v, d: load_experiment("hyq_short", {str(v)[:4000]: 1}),
    "a robot": lambda v, d: robot.load(str(v)[:4000]),
    "a robot file": lambda v, d: robot.load(written(d, "robot.yaml", {"urdf": v, "joints": v})),
    "a model": lambda v, d: model.load(written(d, "m.yaml", {"format": 1, "robot": v})),
    "a model or robot": lambda v, d: model.load_any(str(v)[:4000]),
    "a gait": lambda v, d: gait_file.load(written(d, "g.yaml", {"format": v, "kind": "gait"})),
    "a study": lambda v, d: study.load(str(written(d, "s.yaml", {"variants": v, "name": v}))),
    "a node set": lambda v, d: node_set.load(str(written(d, "n.yaml", {"nodes": v}))),
    "a mapping file": lambda v, d: mapping.load(written(d, "map.yaml", {"columns": v})),
    "a role": lambda v, d: mapping.loads(yaml.safe_dump({"columns": [{"column": "a", "role": v}]})),
    "a table": lambda v, d: tables.read(written(d, "t.json", {"a": [v]})).column(str(v)[:4000]),
    "a recording": lambda v, d: importing.load(str(v)[:4000], robot.load("servo_pendulum")),
    "a bag": lambda v, d: Bag(d / str(v)[:4000]),
    "a job": lambda v, d: gap.load_job(written(d, "job.json", {"format": 1, "robot": [v]}).parent),
    "a setting": lambda v, d: settings.values_of("--set", [str(v)[:4000]], "a=1"),
    "an option": lambda v, d: parse(["gap", "--" + str(v)[:4000]]),
    "a number of a command": lambda v, d: parse(["gap", "a", "--workers", f"n{str(v)[:4000]}"]),
    "a command": lambda v, d: parse([str(v)[:4000]]),
    "a name": lambda v, d: reading.within(d, str(v)[:4000]),
    "a path of a peer": lambda v, d: reading.allowed(str(v)[:4000], ["/nowhere"]),
    "an archive": lambda v, d: archive.read(d / str(v)[:4000], "weights"),
    "YAML": lambda v, d: reading.parse_yaml(f"{{a: {str(v)[:4000]}", "s"),
}


@pytest.mark.parametrize("site", SITES)
def test_what_is_refused_is_cut(site, tmp_path):
    refused = 0
    for kind, value in VALUES.items():
        folder = tmp_path / kind
        folder.mkdir()
        if kind == "number" and site not in ("a parameter", "a choice", "a value of one"):
            value = str(value)
        try:
            SITES[site](value, folder)
        except LocoError as error:
            refused += 1
            text = str(error)
            assert max(map(len, text.split())) <= MOST + 60, text  # a path around it
            assert len(text) < 2001 and "\n" not in text, text
    assert refused >= 3
