# SPDX-License-Identifier: Apache-2.0
"""One road to each number: what a page says of the gap follows from the curves that it shows."""

from __future__ import annotations

import json
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from loco_bringup.gap import page as pages
from loco_bringup.gap import run as runner
from loco_bringup.gap import text
from loco_bringup.gap.importing import load as read_bag
from loco_bringup.logs.rollout_bag import run_rollout
from loco_learning.gap import workflow
from loco_learning.gap.contents import gap as gap_of
from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.hypotheses import hints
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.localisation.curves import Curves, curves, load, merge
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import led
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.statistics.evidence import LIMIT
from loco_learning.runs.experiment import load as load_experiment
from loco_sim.plant.model import Model

from ...loco_learning.gap.conftest import SLIDE, records
from .gap_result import result, shown

RUBS = {"name": "coulomb_friction", "torque": 3.0}
DRAGS = {"name": "viscous_friction", "damping": 20.0}
OFF = {"name": "sensor_bias", "q": 0.002}
QUICK = GapParams(
    effects=("coulomb_friction", "viscous_friction", "sensor_bias", "joint_offset"), most_terms=2
)


def recomputed(page):
    """Gap before, after and the share that is closed, from the curves of a page alone."""
    panels = shown(page)["Gap over time"]
    counts = np.array([int(label.rpartition(", ")[2].split()[0]) for label in panels])
    power = np.array([[np.nanmean(line**2) for line in lines] for lines in panels.values()])
    before, after = np.sqrt(counts @ power / counts.sum())
    excess = counts @ np.maximum(power - 1.0, 0.0)
    return before, after, 1.0 - np.sqrt(excess[1] / excess[0]) if excess[0] > 0.0 else 0.0


def check(found, drawn: Curves):
    """The page of results says what its curves do, to the 16 bits in which it holds them."""
    page = pages.page(found, drawn)
    before, after, closed = recomputed(page)
    gap = found["gap"]
    assert (before, after) == pytest.approx((gap["before"], gap["after"]), rel=1e-3)
    assert 1.0 - closed == pytest.approx(1.0 - gap["closed"], rel=2e-3, abs=2e-3)
    assert text.number(gap["before"]) in unescape(page)
    assert (drawn.rms("before"), drawn.rms("after")) == pytest.approx(
        (gap["before"], gap["after"]), rel=1e-9
    )
    each = [channel["after"] for channel in gap["channels"]]
    np.testing.assert_allclose(drawn.floors("after"), np.array(each, dtype=float), rtol=1e-9)


def search(model, fit, held, params):
    """Contents of gap.json and the curves that were handed over with the verdict."""
    kept = []
    found = workflow.find(model, fit, held, params, keep=lambda *both: kept.append(both))
    return runner.plain(found), kept[-1][1]


@pytest.mark.parametrize(
    ("planted", "params", "verdict"),
    [
        ([RUBS], QUICK.replace(effects=("coulomb_friction", "joint_offset")), "named"),
        ([DRAGS, OFF], QUICK.replace(effects=("viscous_friction", "sensor_bias")), "named"),
        ([RUBS], QUICK.replace(effects=("joint_offset",)), "unknown"),
        ([], QUICK, "no gap"),
    ],
    ids=["named", "pair", "unknown", "nothing"],
)
def test_the_number_at_the_top_is_that_of_the_curves(planted, params, verdict):
    fit, held = records(planted)
    found, drawn = search(SLIDE, fit[:1], held, params)
    assert (found["verdict"], len(found["names"])) == (verdict, len(planted) * (verdict == "named"))
    check(found, drawn)


def test_refitted_values_and_starts_are_in_the_curves():
    """Masses and gains a little off are refitted for the verdict, and in what is shown."""
    unsure = Model(SLIDE.robot, {"uncertain.bodies.*.mass": "3%", "uncertain.drives.*.k[pd]": "3%"})
    off = {"bodies.carriage.mass": 1.03, "drives.slide.kp": 1980.0}
    fit, held = records([RUBS], overrides=off)
    found, drawn = search(unsure, fit[:1], held, QUICK.replace(effects=("coulomb_friction",)))
    assert found["names"] == ["coulomb_friction"] and drawn.rms("after") < 1.5
    check(found, drawn)


def test_one_record_is_judged_by_its_last_third_and_nothing_else():
    fit, _ = records([DRAGS])
    found, drawn = search(SLIDE, fit[:1], [], QUICK.replace(effects=("viscous_friction",)))
    first = 2 * len(drawn.records[0].t) // 3
    assert np.flatnonzero(drawn.records[0].judged)[0] == first
    start = drawn.records[0].t[first]
    assert f"(held-out from {start:.3g} s)" in pages.page(found, drawn)
    check(found, drawn)


def test_a_robot_that_is_told_torques_shows_torques():
    """Led along its motion: a row in five is compared, and these are the rows that are shown."""
    strong = Model("pendulum", {"drives.pivot.gain": 10.0})  # it goes over the top
    rng, t = np.random.default_rng(3), 0.005 * np.arange(1600)
    made = []
    for name in ("fit", "judge"):
        torque = gaussian_filter1d(rng.normal(size=len(t)), 30.0)
        told = {"torque": (0.12 * torque / torque.std())[:, None]}
        empty = Record(name, t, told, ("pivot",), {"q": np.zeros((len(t), 1))}, ("pivot",))
        rubs = [{"name": "coulomb_friction", "joint": "pivot", "torque": 0.03}]
        (said,) = Forward(Model("pendulum"), [empty])(rubs, step=0.25)
        made.append(replace(empty, signals={"q": said[:, :1]}))
    rubbing = QUICK.replace(effects=("coulomb_friction",), setup=False)  # ten times the gain
    found, drawn = search(strong, made[:1], made[1:], rubbing)
    assert found["compared"] == led.InverseDynamics.how and [c[0] for c in drawn.channels] == [
        "tau"
    ]
    known = np.isfinite(drawn.records[1].measured[:, 0])
    assert known.mean() > 0.7
    check(found, drawn)


def test_on_the_ground_pieces_are_judged_and_shown(tmp_path):
    """Pieces of a walk, with a model that rubs; no number is about what was recorded in the air."""
    run_rollout(load_experiment("tigrillo_bound", {"duration": 1.2}), tmp_path / "walk", print)
    model = Model("tigrillo")
    robot = model.make_robot()
    (walk,) = read_bag(tmp_path / "walk", robot)
    judge = replace(walk, name="judge")
    forward = Forward(model, [walk, judge], ForwardParams(ground=0.2, most=2))
    case = cases.prepare(forward, [walk], [judge])
    assert case.ground
    offered = offer(robot, case.signals, hints.find(case, robot))
    rubs = next(h for h in offered if h.effect == "viscous_friction")
    models = weigh(case, (), {}, initial=True), weigh(case, [(rubs, rubs.starts()[0])], {})
    gap, drawn = gap_of(case, *models), curves(case, *models)
    check(result("unknown", gap=gap), drawn)
    air = curves(case, models[1], models[0])
    check(result("unknown", gap=gap), merge(air, drawn))


def test_a_model_that_diverges_counts_and_is_not_drawn():
    case = cases.prepare(Forward(SLIDE, [*records()[0]]), records()[0], [])
    given = weigh(case, (), {}, initial=True)
    lost = replace(given, whole=tuple(np.where(np.isfinite(r), LIMIT, r) for r in given.whole))
    drawn = curves(case, given, lost)
    assert np.isnan(drawn.records[0].after).all()
    check(result("unknown", gap=gap_of(case, given, lost)), drawn)


def test_files_of_workers_and_of_a_search_begun_again_are_the_same(tmp_path, monkeypatch):
    fit, held = records([DRAGS])
    monkeypatch.setattr(runner, "read_records", lambda job: (SLIDE, fit[:1], held))
    cheap = {"rough": 2, "evaluations": 4, "polished": 0}  # no value is looked at
    options = {"effects": ["viscous_friction", "joint_offset"], "most_terms": 1, **cheap}
    job = runner.Job("linear_axis", ("a", "b"), options=options, workers=1)

    class KilledError(Exception):
        pass

    def kill(share, stage, best):
        if stage.startswith("weighing"):
            raise KilledError

    runner.run(job, tmp_path / "one")
    runner.run(replace(job, workers=2), tmp_path / "two")
    with pytest.raises(KilledError):
        runner.run(job, tmp_path / "again", kill)
    runner.run(job, tmp_path / "again")
    for name in ("gap.json", "gap.npz", "gap.html", "model.yaml"):
        files = {(tmp_path / run / name).read_bytes() for run in ("one", "two", "again")}
        assert len(files) == 1, name
    found = json.loads((tmp_path / "one/gap.json").read_text())
    check(found, load(tmp_path / "one/gap.npz"))
