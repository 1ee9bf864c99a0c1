# SPDX-License-Identifier: Apache-2.0
"""Laws of the whole workflow on a bench: what was planted comes back, and nothing else.

The measurements are the model's own at another physics step, with noise. About 30 s: every
case is a search.
"""

import json

import pytest

from loco_learning.gap import workflow
from loco_learning.gap.params import GapParams

EFFECTS = ("*_friction", "joint_offset", "sensor_bias", "command_delay", "hysteresis")
QUICK = GapParams(effects=EFFECTS, most_terms=2)


@pytest.fixture
def found(slide):
    """Function that plants effects and runs the workflow."""

    def run(effects=(), params=QUICK, **kwargs):
        return workflow.find(slide.model, *slide.records(effects), params, **kwargs)

    return run


def test_nothing_planted_is_no_gap(found):
    gap = found()
    assert (gap["verdict"], gap["names"], gap["terms"]) == ("no gap", [], [])
    assert gap["model"]["effects"] == []


@pytest.mark.parametrize(
    ("effect", "parameter", "value", "unit"),
    [("coulomb_friction", "torque", 3.0, "N"), ("sensor_bias", "q", 0.002, "m")],
)
def test_what_was_planted_is_named_with_its_size_and_place(found, effect, parameter, value, unit):
    gap = found([{"name": effect, parameter: value}])
    assert (gap["verdict"], gap["names"]) == ("named", [effect])
    (term,) = gap["terms"]
    assert term["place"] == "slide"
    assert term["parameters"][parameter]["value"] == pytest.approx(value, rel=0.1)
    assert term["parameters"][parameter]["low"] > 0.0
    assert term["parameters"][parameter]["unit"] == unit
    assert gap["gap"]["closed"] > 0.9
    assert gap["model"]["effects"][0]["name"] == effect


def test_what_does_not_show_in_what_is_held_out_is_judged_by_all_records(slide):
    fit, judge = slide.records([{"name": "coulomb_friction", "torque": 3.0}], judged=0.0)
    gap = workflow.find(slide.model, fit, judge, QUICK)
    assert (gap["verdict"], gap["names"]) == ("named", ["coulomb_friction"])
    assert "likelihood of all records" in gap["terms"][0]["evidence"]


def test_same_seed_same_file_for_any_number_of_workers_and_progress_rises(found):
    told = []
    effects = [{"name": "viscous_friction", "damping": 20.0}]
    one = found(effects, progress=lambda share, stage, best: told.append(share))
    two = found(effects, workers=2)
    assert json.dumps(one, sort_keys=True) == json.dumps(two, sort_keys=True)
    assert told[0] == 0.0
    assert told[-1] == 1.0
    assert told == sorted(told)


def test_an_exception_of_the_progress_ends_the_search(found):
    class StopError(Exception):
        pass

    def stop(share, stage, best):
        if share > 0.04:
            raise StopError

    with pytest.raises(StopError):
        found([{"name": "viscous_friction", "damping": 20.0}], progress=stop)


def test_one_record_is_judged_by_its_last_third(slide):
    fit, _ = slide.records([{"name": "viscous_friction", "damping": 20.0}])
    gap = workflow.find(slide.model, fit[:1], [], QUICK)
    assert gap["names"] == ["viscous_friction"]
