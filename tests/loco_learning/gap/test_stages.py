# SPDX-License-Identifier: Apache-2.0
"""What the air explains is fixed before the ground is looked at."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap import stages, workflow
from loco_learning.gap.localisation.curves import Curves
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

RUBS = {"name": "coulomb_friction", "joint": "lf_hfe_joint", "torque": 0.1}
LOAD = {"name": "payload", "mass": 0.2, "link": "front_body"}


def record(name, **overrides):
    q = np.zeros((10, 4))
    joints = tuple(f"{leg}_hfe_joint" for leg in ("lf", "rf", "lh", "rh"))
    return Record(
        name, np.arange(10) * 0.01, {"position": q}, joints, {"q": q}, joints, overrides=overrides
    )


def result(model, verdict, effects):
    return {
        **{key: [] for key in stages.LISTS},
        "verdict": verdict, "names": [e["name"] for e in effects], "evidence": f"{verdict}.",
        "probability": {"effects": {e["name"]: 0.97 for e in effects}},
        "gap": {"before": 2.0}, "terms": [{"effect": e["name"]} for e in effects],
        "model": {"robot": model.robot, "overrides": dict(model.overrides),
                  "effects": [*model.effects, *effects]},
    }  # fmt: skip


@pytest.fixture
def searched(monkeypatch):
    """Searches that were made: the model and the names of their records."""
    made = []
    found = {False: ("named", [RUBS]), True: ("named", [LOAD])}

    def search(model, records, held_out, params, report, workers, keep, memory):
        made.append((model.effects, [r.name for r in records], [r.name for r in held_out]))
        kept = result(model, *found[stages.free(model, records[0])])
        if keep:
            keep(kept, Curves((), ()))
        return kept

    monkeypatch.setattr(workflow, "search", search)
    return made, found


MORE = "named, and more is missing"
AIR = record("air", fixed_base=True, height=0.5)


def test_the_air_comes_first_and_the_ground_on_top_of_it(searched):
    made, _ = searched
    kept = []
    found = workflow.find(
        Model("tigrillo"), [record("walk"), AIR], [record("trot")],
        keep=lambda found, curves: kept.append(found),
    )  # fmt: skip
    assert made == [([], ["air"], []), ([RUBS], ["walk"], ["trot"])]
    assert found["verdict"] == "named"
    assert found["names"] == ["coulomb_friction", "payload"]
    told = [stage["probability"]["effects"] for stage in found["stages"]]
    assert told == [{"coulomb_friction": 0.97}, {"payload": 0.97}] and not found["probability"]
    assert found["model"]["effects"] == [RUBS, LOAD]
    assert [s["where"] for s in found["stages"]] == [stages.AIR, stages.GROUND]
    assert kept[-1] == found  # what is on disk first is no less than what is said in the end


def test_what_the_air_does_not_establish_is_not_taken_to_the_ground(searched):
    made, verdicts = searched
    verdicts[False] = "unknown", []
    found = workflow.find(Model("tigrillo"), [record("walk"), AIR], [])
    assert made[1][0] == []
    assert found["verdict"] == "unknown"
    assert found["names"] == ["payload"]


@pytest.mark.parametrize("name", ["walk", "air"])
def test_one_kind_of_recording_is_one_search(searched, name):
    made, _ = searched
    one = AIR if name == "air" else record("walk")
    assert "stages" not in workflow.find(Model("tigrillo"), [one], [])
    assert len(made) == 1


def test_what_the_air_names_goes_to_the_ground_although_more_is_missing(searched):
    made, verdicts = searched
    verdicts[False] = MORE, [RUBS]
    found = workflow.find(Model("tigrillo"), [record("walk"), AIR], [])
    assert made[1][0] == [RUBS] and found["verdict"] == MORE


BOTH = [
    ("no gap", "named", "named"),
    ("named", "no gap", "named"),
    ("named", "ambiguous", "ambiguous"),
    ("no gap", "no gap", "no gap"),
    ("named", "unknown", "unknown"),
    ("no gap", MORE, MORE),
    (MORE, "named", MORE),
]


@pytest.mark.parametrize(("air", "ground", "both"), BOTH)
def test_the_surest_word_is_that_of_the_less_sure(air, ground, both):
    model = Model("tigrillo")
    assert stages.merge(result(model, air, []), result(model, ground, []))["verdict"] == both
