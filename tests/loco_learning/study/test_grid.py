# SPDX-License-Identifier: Apache-2.0
"""Grids: axes, repeats, cost, resuming, maps; and one clear message for a mistake."""

import time

import numba
import numpy as np
import pytest

from loco_control.exceptions import LocoError, NameUnknownError, ParameterError
from loco_learning.drawing import png
from loco_learning.drawing.chart import BOXES
from loco_learning.runs.rollout import rollout
from loco_learning.study import figures, maps
from loco_learning.study.case import run_case
from loco_learning.study.study import load, run

GAINS = "overrides.drives.*_kfe_joint"
TEXT = f"""
description: a small grid
variants:
  open: {{experiment: hyq_trot_open, learner.stand: 0.2, learner.train: 1.2}}
axes:
  kp: {{logspace: [2, 3, 4], sets: [{GAINS}.kp, {GAINS}.swing_kp]}}
  kd: {{logspace: [0, 1, 3], sets: [{GAINS}.kd, {GAINS}.swing_kd], unit: N·m·s/rad}}
seeds: [0, 5]
phase: train
metrics: [speed, power]
map:
  iso_damping: [0.1]
  legal: {{power: [0, 1e6]}}
  regions:
    soft: {{where: {{kp: [0, 300]}}, what: {{survived: [1, 1]}}}}
    none: {{where: {{kp: [1e5, null]}}, what: {{speed: [9, null]}}}}
"""


def write(folder, text=TEXT):
    path = folder / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("grid")
    made, costs = load(write(folder)), []
    results = run(made, folder / "out", 2, on_cost=costs.append)
    figures.write(made, results, folder / "out")
    return made, folder / "out", results, costs


def test_a_grid_is_every_point_once_where_nothing_is_drawn(finished):
    made, folder, results, _ = finished
    assert [r.seed for r in results] == [0] * 12  # the second seed would repeat the first
    assert [r.at["kd"] for r in results[:3]] == pytest.approx([1.0, 10**0.5, 10.0])
    drives = results[-1].experiment["overrides"]
    assert drives["drives.*_kfe_joint.kp"] == drives["drives.*_kfe_joint.swing_kp"] == 1000.0
    assert not list(folder.glob("*.part"))


def test_seeds_repeat_what_is_learned_or_drawn(tmp_path):
    for change in ("experiment: hyq_short", "experiment: hyq_trot_open, effects: "
                   "[{name: sensor_noise, q: 0.1}]"):  # fmt: skip
        text = TEXT.replace("experiment: hyq_trot_open, learner.stand: 0.2, learner.train: 1.2",
                            change)  # fmt: skip
        assert len(list(load(write(tmp_path, text)).cases())) == 24


def test_cost_is_told_once_from_cases_spread_over_the_grid(finished, tmp_path):
    made, _, results, (cost,) = finished
    assert (cost.timed, cost.missing) == (3, 9)
    assert 0.0 < cost.seconds < 60.0
    assert "9 runs to go" in str(cost) and "core-hours" in str(cost)
    some = run(made, tmp_path, 1, on_cost=lambda cost: False)
    assert [r.name for r in some] == ["open_00_02_0", "open_02_00_0", "open_03_01_0"]
    figures.write(made, some, tmp_path)  # tables of what there is


def test_what_is_compiled_in_a_case_costs_nothing(monkeypatch, finished):
    made, _, results, _ = finished
    spent = []

    def compile_and_run(experiment, seed):
        began = time.process_time()
        numba.njit(lambda x: np.sort(x).sum() + np.linalg.norm(x))(np.ones(3))
        spent.append(time.process_time() - began)

    monkeypatch.setattr("loco_learning.runs.rollout.rollout", compile_and_run)
    monkeypatch.setattr("loco_learning.study.case.reduce", lambda *_: results[0])
    told = run_case(next(made.cases()))
    assert 0.0 <= told.seconds < 0.5 * spent[0]


def test_it_goes_on_case_by_case_and_the_table_is_the_same_bytes(finished, tmp_path):
    made, folder, _, _ = finished
    for path in list(folder.glob("open_*.npz"))[:-2]:
        (tmp_path / path.name).write_bytes(path.read_bytes())
    ran = []
    results = run(made, tmp_path, 1, lambda done, total, case: ran.append(case.name))
    assert len(ran) == 2
    figures.write(made, results, tmp_path)
    for name in ("cases.npz", "cases.csv"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_a_cluster_that_loses_a_worker_writes_the_same_bytes(finished, cluster, tmp_path):
    made, folder, _, _ = finished
    address, workers = cluster

    def kill_one(done, total, case):
        if done == 2:
            workers[0].kill()

    results = run(made, tmp_path, progress=kill_one, scheduler=address)
    figures.write(made, results, tmp_path)
    assert (tmp_path / "cases.npz").read_bytes() == (folder / "cases.npz").read_bytes()


def test_the_table_reads_without_loco(finished):
    _, folder, results, _ = finished
    with np.load(folder / "cases.npz") as table:
        assert table["kp"].shape == table["power"].shape == (12,)
        assert table["power"][5] == results[5].metrics["open loop"]["power"]


def test_points_change_spaced_axes_and_keep_their_ends(tmp_path):
    made = load(write(tmp_path)).with_points(2)
    assert [axis.values for axis in made.axes] == [(100.0, 1000.0), (1.0, 10.0)]
    assert len(load(write(tmp_path)).with_points({"kd": 7}).axes[0].values) == 4
    text = TEXT.replace("{logspace: [2, 3, 4], ", "{values: [100.0, 300.0], ")
    assert load(write(tmp_path, text)).with_points(9).axes[0].values == (100.0, 300.0)


def test_maps_show_each_point_where_it_is(finished, tmp_path):
    made, _, results, _ = finished
    (sheet,) = maps.sheets(made, results)
    assert sheet.columns["power"].shape == (3, 4)
    for result in results:
        i, j = sheet.y.values.index(result.at["kd"]), sheet.x.values.index(result.at["kp"])
        assert sheet.cases[i][j] == [result.name]
        assert sheet.columns["power"][i, j] == result.metrics["open loop"]["power"]
    np.testing.assert_allclose(sheet.columns["kappa"][1], 10**0.5 / np.sqrt(sheet.x.values))
    found = maps.regions(sheet, made.map)
    assert found["soft"].where.sum() == 6 and found["soft"].share == 1.0
    assert np.isnan(found["none"].share)
    chart = maps.heat_map(sheet, "power", made.map)
    cells = [layer for layer in chart.frames[0].layers if layer.shape == BOXES]
    at = {(x + 0.5, y + 0.5): link for each in cells
          for x, y, link in zip(each.x, each.y, each.links, strict=True)}  # fmt: skip
    assert at == {(j, i): f"#case-{sheet.cases[i][j][0]}" for i in range(3) for j in range(4)}
    for each in (chart, maps.region_map(sheet, made.map)):
        png.write(each, tmp_path / "map.png")


def test_a_point_that_the_plant_refuses_is_a_failed_case_and_is_tried_again(tmp_path, monkeypatch):
    def refuse(experiment, seed):
        if experiment.overrides["drives.*_kfe_joint.kd"] > 5.0:
            raise ParameterError("too much")
        return rollout(experiment, seed)

    monkeypatch.setattr("loco_learning.runs.rollout.rollout", refuse)
    made, ran = load(write(tmp_path)).with_points(2), []
    results = run(made, tmp_path / "out", 1)
    assert [r.verdict["failed"] for r in results] == [[], ["refused"]] * 2
    assert results[1].verdict["fall"] == "too much"
    run(made, tmp_path / "out", 1, lambda done, total, case: ran.append(case.name))
    assert ran == [results[1].name, results[3].name]
    figures.write(made, results, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "kind", "message"),
    [
        (
            "logspace: [2, 3, 4]",
            "values: [[1.0]]",
            ParameterError,
            r"axes.kp must have numbers or texts, got \[1.0\]; .* sets: \[",
        ),
        ("logspace: [2, 3, 4]", "values: []", ParameterError, "axes.kp has no values: give a list"),
        ("{logspace: [2, 3, 4], ", "{", ParameterError, "axes.kp has no values: give a list"),
        ("logspace: [2, 3, 4]", "logspace: [2, 3]", ParameterError, r"\[first, last, points\]"),
        ("logspace: [2, 3, 4]", "linspace: [2, 3, 0]", ParameterError, "1 to 10,000 points, got 0"),
        ("logspace: [2, 3, 4]", "logspce: [2, 3, 4]", NameUnknownError, "did you mean 'logspace'"),
        (f"{GAINS}.kp, ", "gait.sped, ", NameUnknownError, "did you mean 'speed'"),
        (f"{GAINS}.kp, ", "overrides.drives.*_elbow.kp, ", LocoError, "elbow"),
        ("sets: [overrides", "sets: 3, unit: [overrides", ParameterError, "list of parameters"),
        ("iso_damping", "isodamping", NameUnknownError, "did you mean 'iso_damping'"),
        ("map:\n", "map:\n  x: kpp\n", NameUnknownError, "no axis of mine named 'kpp'"),
        ("power: [0, 1e6]", "power: 3", ParameterError, r"legal.power must be \[low, high\]"),
        ("legal: {power", "legal: {powr", NameUnknownError, "did you mean 'power'"),
    ],
)
def test_a_mistake_in_a_grid_gets_one_clear_message(tmp_path, old, new, kind, message):
    assert old in TEXT
    with pytest.raises(kind, match=message) as caught:
        load(write(tmp_path, TEXT.replace(old, new, 1)))
    assert "\n" not in str(caught.value)


def test_a_scheduler_that_is_not_there_is_said(tmp_path, monkeypatch):
    monkeypatch.setattr("loco_learning.jobs.cluster.CONNECT_SECONDS", 0.5)
    with pytest.raises(ParameterError, match="no dask scheduler answers at 'tcp://127.0.0.1:9'"):
        run(load(write(tmp_path)), tmp_path / "out", scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()
