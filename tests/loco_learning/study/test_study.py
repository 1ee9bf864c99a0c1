# SPDX-License-Identifier: Apache-2.0
"""Studies: reading, running in processes, resuming, tables and figures."""

import csv
import dataclasses
import io
import subprocess
import sys

import numpy as np
import pytest

from loco_control.exceptions import LocoError, MissingFileError, NameUnknownError, ParameterError
from loco_learning.drawing import png
from loco_learning.runs import experiment as experiments
from loco_learning.runs.experiment import override
from loco_learning.study import figures, study
from loco_learning.study.case import Case, run_case
from loco_learning.study.study import load, names, run
from loco_learning.study.trial import CONFIDENCE

QUICK = {"learner.train": 1.0, "learner.closing": 1.0, "learner.test": 1.0, "gait.start_time": 0.2,
         "learner.stand": 0.2}  # fmt: skip

TEXT = """
description: two estimators
variants:
  pse: {experiment: hyq_short}
  rse: {experiment: hyq_short, stance.estimator: rse, stance.estimator_start: 1.2}
seeds: [0, 3]
overrides: {effects: [{name: command_delay, delay: 0.004, start: 2.5}]}
metrics: [nrmse, speed]
figures: [nrmse_over_time, limit_cycles, foot_heights, survival, trunk]
"""


def write(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    made = load(write(folder, TEXT), overrides=QUICK)
    seen = []
    results = run(made, folder / "out", 2, lambda done, total, case: seen.append((done, total)))
    assert seen == [(1, 4), (2, 4), (3, 4), (4, 4)]
    return made, folder / "out", results


@pytest.mark.parametrize("name", names())
def test_every_study_reads(name):
    made = load(name)
    assert len(made.description) > 20
    few = made.with_points(2)
    assert len({case.name for case in few.cases()}) >= len(made.variants)


def test_the_studies_that_documents_name_are_what_they_say():
    assert {"closed_loop", "open_loop", "chapter8"} <= set(names())
    assert len(load("closed_loop").seeds) == 10
    chapter8 = load("chapter8")
    assert (list(chapter8.variants), len(chapter8.seeds)) == (["pse", "rse"], 6)
    assert load("closed_loop", seeds=(4,)).seeds == (4,)


def test_results_come_in_the_order_of_the_cases(finished):
    made, _, results = finished
    assert [r.name for r in results] == ["pse_0", "rse_0", "pse_3", "rse_3"]
    assert results[1].experiment["stance"]["estimator"] == "rse"
    for result in results:
        assert result.verdict["end"] == pytest.approx(3.196)
        assert set(result.metrics) == {"train", "closing", "test"}
        assert result.experiment["effects"][0]["name"] == "command_delay"


def test_a_study_runs_only_what_is_missing(finished, monkeypatch):
    made, folder, results = finished
    ran = []

    def run_case(case, *args):
        ran.append(case.name)
        return original(case, *args)

    original = study.run_case
    monkeypatch.setattr(study, "run_case", run_case)
    again = run(made, folder, 1)
    assert ran == []
    for one, two in zip(results, again, strict=True):
        assert one.verdict["nrmse"] == two.verdict["nrmse"]
        np.testing.assert_array_equal(one.curves["error"], two.curves["error"])
    (folder / "rse_3.npz").unlink()
    (folder / "pse_0.npz").write_text("cut off")
    redone = run(made, folder, 1)
    assert ran == ["pse_0", "rse_3"]
    for one, two in zip(results, redone, strict=True):  # and in process or not, the same bits
        np.testing.assert_array_equal(one.curves["error"], two.curves["error"])


def test_a_changed_experiment_is_run_again(finished, tmp_path):
    made, folder, results = finished
    result = results[0]
    result.save(tmp_path / "pse_0.npz")
    case = next(iter(made.cases()))
    assert study._stored(tmp_path, case) is not None
    other = study.Case("pse", 0, case.experiment.replace(control_rate=200.0))
    assert study._stored(tmp_path, other) is None
    assert study._stored(tmp_path, study.Case("pse", 9, case.experiment)) is None


def test_tables_tell_each_case_and_each_criterion(finished):
    made, _, results = finished
    table = list(csv.DictReader(io.StringIO(figures.as_csv(made, results))))
    assert [(row["variant"], row["seed"]) for row in table][:2] == [("pse", "0"), ("rse", "0")]
    assert float(table[0]["nrmse"]) == results[0].metrics["test"]["nrmse"]
    summary = figures.summary(results)
    assert [(row["variant"], row["trials"]) for row in summary] == [("pse", 2), ("rse", 2)]
    for row in summary:
        assert {"fall", "phase_slip", "freeze", "nrmse"} <= set(row)
    text = figures.markdown(made, results)
    assert "two estimators" in text
    assert text.count("| pse |") == 3  # one summary, two cases


def test_every_figure_is_drawn(finished, tmp_path):
    made, _, results = finished
    assert set(made.figures) == set(figures.FIGURES) - {"joint_traces"}  # not of HyQ
    for path in figures.write(made, results, tmp_path):
        assert path.stat().st_size > (5000 if path.suffix == ".png" else 100)


def test_figures_survive_trials_that_ended_early(finished, tmp_path):
    made, _, results = finished
    kept = ("feet_t", "feet_target", "feet", "trunk_t", "trunk_position", "trunk_angles")
    bare = [dataclasses.replace(r, curves={k: r.curves[k] for k in kept}) for r in results]
    assert f"{CONFIDENCE:.0%}".replace("%", " %") in (figures.survival.__doc__ or "")
    for draw in figures.FIGURES.values():
        chart = draw(made, bare)
        png.write(chart, tmp_path / "figure.png")
        axes = [axis for frame in chart.frames for axis in (frame.x, frame.y) if not axis.names]
        assert all(axis.label.endswith("]") for axis in axes)  # a unit, or [-]


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ("seeds: [0, 3]", ParameterError, ""),
        ("seeds: [0, 0]", ParameterError, "different whole numbers"),
        ("seeds: many", ParameterError, "different whole numbers"),
        ("seeds: [-1]", ParameterError, "different whole numbers"),
        ("seedz: [1]", NameUnknownError, "seedz.*did you mean 'seeds'"),
        ("variants: {}", ParameterError, "at least one experiment"),
        ("variants: {a: 3}", ParameterError, "variants.a must be"),
        ("variants: {a: {experiment: nope}}", NameUnknownError, "no experiment named 'nope'"),
        ("variants: {a: {experiment: gone.yaml}}", MissingFileError, "gone.yaml"),
        ("variants: {a: {experiment: msd_20}}", ParameterError, "msd_20 is of masses and springs"),
        ("metrics: [spede]", NameUnknownError, "did you mean 'speed'"),
        ("figures: [nothing]", NameUnknownError, "no figure named 'nothing'"),
        ("phase: tset", NameUnknownError, "did you mean 'test'"),
    ],
)
def test_a_mistake_in_a_study_gets_one_clear_message(tmp_path, change, kind, message):
    variants = "" if change.startswith("variants") else "variants: {a: {experiment: hyq_short}}\n"
    path = write(tmp_path, f"{variants}{change}\n")
    if not message:
        assert load(path).seeds == (0, 3)
        return
    with pytest.raises(kind, match=message) as caught:
        load(path)
    assert isinstance(caught.value, LocoError)


def test_unknown_and_missing_studies():
    with pytest.raises(NameUnknownError, match="did you mean 'chapter8'"):
        load("chapter9")
    with pytest.raises(MissingFileError, match="nowhere.yaml"):
        load("nowhere.yaml")


def test_listing_experiments_and_studies_loads_no_compiler_and_no_physics():
    code = (
        "import sys, loco_learning.study.study;"
        "print([m for m in ('numba', 'pybullet', 'matplotlib', 'scipy') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_a_study_changes_keys_of_another(tmp_path):
    held, base = load("hyq_map_held"), load("hyq_map")
    assert (held.axes, held.map, held.metrics) == (base.axes, base.map, base.metrics)
    assert list(held.variants) == ["continuous", "held"]
    robots = [v.overrides or {} for v in held.variants.values()]
    assert [r.get("drives.*.torque") for r in robots] == [None, "held"]
    write(tmp_path, TEXT)
    other = tmp_path / "other.yaml"
    other.write_text("extends: mine.yaml\nseeds: [7]\n", encoding="utf-8")
    assert load(other).seeds == (7,) and list(load(other).variants) == ["pse", "rse"]


@pytest.mark.parametrize(
    ("base", "message"),
    [("other.yaml", "extends itself"), ("[1]", "must be the name of another study")],
)
def test_a_study_that_extends_itself_or_no_study_is_refused(tmp_path, base, message):
    other = tmp_path / "other.yaml"
    other.write_text(f"extends: {base}\n", encoding="utf-8")
    with pytest.raises(ParameterError, match=message):
        load(other)


@pytest.mark.parametrize("engine", ["mujoco", "pybullet"])
def test_much_damping_of_a_trot_shakes_it_down_only_if_it_is_held(engine):
    """The trot at kp 50, kd 30, on both engines."""
    held = load("hyq_map_held")
    keys = [key for axis in held.axes for key in axis.sets]
    gains = {key: 50.0 if key.endswith("kp") else 30.0 for key in keys}
    short = {**gains, "sim.engine": engine, "learner.train": 2.0}
    cases = [Case(name, 0, override(base, short)) for name, base in held.variants.items()]
    survived = {case.variant: run_case(case, curves=False).verdict["survived"] for case in cases}
    assert survived == {"continuous": True, "held": False}


def test_variants_of_another_robot_have_its_defaults(quadruped, tmp_path):
    other = tmp_path / "other.yaml"
    robot = str(quadruped("a1"))
    other.write_text(f"extends: hyq_pushes\noverrides: {{robot: {robot}}}\n", encoding="utf-8")
    variant = load(str(other)).variants["both"]
    assert variant.gait.origin == experiments.load("hyq_trot_open", {"robot": robot}).gait.origin
    assert variant.gait.recovery == 1.0  # what the variant sets stays


@pytest.fixture(scope="module")
def pushed():
    """Pushes of 100 N·s to the side, at one phase of the stride, and their study."""
    made = load("hyq_pushes")
    point = (made.axes[0].values.index(500.0), 0)
    named = ("open", "recovery")
    bases = {name: override(made.variants[name], {"sim.engine": "mujoco"}) for name in named}
    cases = [Case(name, 0, base, made.axes, point) for name, base in bases.items()]
    return made, [run_case(case, curves=False) for case in cases]


def test_hyq_survives_a_push_only_with_push_recovery(pushed):
    assert [case.verdict["survived"] for case in pushed[1]] == [False, True]


def test_table_of_a_grid_has_shares_with_their_intervals(pushed):
    made, (fell, stood) = pushed
    copies = [dataclasses.replace(case, variant="open") for case in (fell, stood, stood)]
    (row,) = figures.survivors(made, copies)
    assert row["500"] == "2 of 3 (0.14 to 0.98)" and row["250"] == "-"
    assert row["500"] in figures.markdown(made, copies)


def test_survival_is_drawn_once_if_only_falls_count(pushed):
    made, cases = pushed
    assert len(figures.survival(made, cases).frames) == 1
    slipped = {**cases[1].verdict, "survived": False}
    other = [cases[0], dataclasses.replace(cases[1], verdict=slipped)]
    assert len(figures.survival(made, other).frames) == 2
