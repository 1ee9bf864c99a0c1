# SPDX-License-Identifier: Apache-2.0
"""Laws of the whole workflow on a bench: what was planted comes back, and nothing else.

The measurements are the model's own at another physics step, with noise. About 30 s: every
case is a search.
"""

import json

import numpy as np
import pytest

from loco_learning.gap import workflow
from loco_learning.gap.forward import Forward
from loco_learning.gap.params import GapParams
from loco_learning.gap.record import Record
from loco_sim.model import Model

BENCH = Model("linear_axis")
EFFECTS = ("*_friction", "joint_offset", "sensor_bias", "command_delay", "hysteresis")
QUICK = GapParams(effects=EFFECTS, most_terms=2)


def records(effects=(), noise=5e-5, seed=0, judged=1.0):
    """Three short motions of the bench, the last, as large as wanted, to judge on."""
    rng = np.random.default_rng(seed)
    t = np.arange(500) / 250.0
    ramp = np.clip(t / 0.2, 0.0, 1.0)
    motions = {
        "chirp": 0.1 * ramp * np.sin(2 * np.pi * (0.5 + t) * t),
        "slow": 0.08 * ramp * np.sin(2 * np.pi * 0.6 * t),
        "judge": judged * ramp * (0.12 * np.sin(1.8 * np.pi * t) + 0.03 * np.sin(20.0 * t)),
    }
    empty = []
    for name, command in motions.items():
        wanted = {"position": command[:, None], "velocity": np.gradient(command, t)[:, None]}
        empty.append(Record(name, t, wanted, ("slide",), {"q": wanted["position"]}, ("slide",)))
    model = Forward(BENCH, empty)
    coarse, fine = (model(effects, step=step) for step in (1 / 8, 1 / 16))
    said = [2.0 * f - c for f, c in zip(fine, coarse, strict=True)]  # no step at all
    made = [
        Record(r.name, r.t, r.command, r.driven,
               {"q": q + noise * rng.standard_normal(q.shape)}, r.joints)
        for r, q in zip(empty, said, strict=True)
    ]  # fmt: skip
    return made[:2], made[2:]


def found(effects=(), params=QUICK, **kwargs):
    fit, judge = records(effects)
    return workflow.find(BENCH, fit, judge, params, **kwargs)


def test_nothing_planted_is_no_gap():
    gap = found()
    assert (gap["verdict"], gap["names"], gap["terms"]) == ("no gap", [], [])
    assert gap["model"]["effects"] == []


@pytest.mark.parametrize(
    ("effect", "parameter", "value"),
    [("coulomb_friction", "torque", 3.0), ("sensor_bias", "q", 0.002)],
)
def test_what_was_planted_is_named_with_its_size_and_place(effect, parameter, value):
    gap = found([{"name": effect, parameter: value}])
    assert (gap["verdict"], gap["names"]) == ("named", [effect])
    (term,) = gap["terms"]
    assert term["place"] == "slide"
    assert term["parameters"][parameter]["value"] == pytest.approx(value, rel=0.1)
    assert term["parameters"][parameter]["low"] > 0.0
    assert gap["gap"]["closed"] > 0.9
    assert gap["model"]["effects"][0]["name"] == effect


def test_what_does_not_show_in_what_is_held_out_is_judged_by_all_records():
    fit, judge = records([{"name": "coulomb_friction", "torque": 3.0}], judged=0.0)
    gap = workflow.find(BENCH, fit, judge, QUICK)
    assert (gap["verdict"], gap["names"]) == ("named", ["coulomb_friction"])
    assert "likelihood of all records" in gap["terms"][0]["evidence"]


def test_same_seed_same_file_for_any_number_of_workers_and_progress_rises():
    told = []
    effects = [{"name": "viscous_friction", "damping": 20.0}]
    one = found(effects, progress=lambda share, stage, best: told.append(share))
    two = found(effects, workers=2)
    assert json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_an_exception_of_the_progress_ends_the_search():
    class StopError(Exception):
        pass

    def stop(share, stage, best):
        if share > 0.04:
            raise StopError

    with pytest.raises(StopError):
        found([{"name": "viscous_friction", "damping": 20.0}], progress=stop)


def test_one_record_is_judged_by_its_last_third():
    fit, _ = records([{"name": "viscous_friction", "damping": 20.0}])
    gap = workflow.find(BENCH, fit[:1], [], QUICK)
    assert gap["names"] == ["viscous_friction"]
