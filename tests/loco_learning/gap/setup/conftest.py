# SPDX-License-Identifier: Apache-2.0
"""Recordings of the machines, made once, and what is found in them as files."""

import copy

import pytest
import yaml

from loco_learning.gap.importing import importing
from loco_learning.gap.recordings import mapping
from loco_learning.gap.setup import family, mend
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from .machines import MACHINES, recordings


@pytest.fixture(scope="session")
def recorded():
    """Function that copies recordings of a machine; arguments as of `machines.recordings`."""
    return lambda name, **about: copy.deepcopy(recordings(name, **about))


def read(folder, robot="robot.yaml"):
    """Model and records of a folder."""
    model = Model(str(folder / robot))
    rules = mapping.load(folder / "mapping.yaml")
    return model, importing.load(folder, model.make_robot(), rules, judge=False)


@pytest.fixture
def judged(recorded, tmp_path):
    """Function that writes recordings with a mistake, reads them, and returns what is found."""

    def make(name, change=None, about=None, **robot):
        records = recorded(name, **(about or {}))
        for data in records:
            if change:
                change(data)
        folder = MACHINES[name].write(tmp_path / "set", records, **robot)
        return family.find_mistakes(*read(folder))

    return make


@pytest.fixture
def mended(tmp_path):
    """Function that writes the lines that mend what was found, and reads the set anew."""

    def make(findings):
        folder, changes = tmp_path / "set", mend.changes_of(findings)
        path = folder / "mapping.yaml"
        values = mend.mapping_with(yaml.safe_load(path.read_text()), changes)
        path.write_text(yaml.safe_dump(values))
        model, _ = read(folder)
        model = mend.model_mended(model, changes) or model
        model.save(folder / "model.yaml")
        model = models.load_any(folder / "model.yaml")
        return model, importing.load(folder, model.make_robot(), mapping.load(path), judge=False)

    return make
