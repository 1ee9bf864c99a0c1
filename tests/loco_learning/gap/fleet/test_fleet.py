# SPDX-License-Identifier: Apache-2.0
"""A small fleet of slides, one of which gets friction on a day: who has it, and since when."""

import json
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.fleet import contents, fleet, tasks
from loco_learning.gap.fleet.fleet import Fleet
from loco_learning.gap.fleet.params import FleetParams
from loco_learning.gap.fleet.table import Recording
from loco_learning.gap.importing import importing
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings import mapping
from loco_learning.gap.recordings.record import Record
from loco_learning.jobs.kept import Memory
from loco_sim.plant.model import Model

MODEL = Model("linear_axis")
RULES = """time: {column: t}
columns:
  - {column: q, role: q, joint: slide, unit: m}
  - {column: p, role: command_position, joint: slide, unit: m}
  - {column: v, role: command_velocity, joint: slide, unit: m/s}
"""
TORQUE, ONSET, DAYS, EACH = 2.0, 2, 3, 2
FRICTION = {"name": "coulomb_friction", "joint": "slide", "torque": TORQUE}
GAP = GapParams(effects=("coulomb_friction", "armature", "sensor_bias"))


def recorded(path, seed, effects):
    """Write a table of 4 s of a slide that follows a motion of its own."""
    rng = np.random.default_rng(seed)
    t = np.arange(1000) / 250.0
    ramp = np.clip(t / 0.2, 0.0, 1.0)
    fast, slow = rng.uniform(1.0, 3.0), rng.uniform(0.3, 0.6)
    p = ramp * (0.06 * np.sin(2 * np.pi * fast * t) + 0.08 * np.sin(2 * np.pi * slow * t))
    wanted = {"position": p[:, None], "velocity": np.gradient(p, t)[:, None]}
    empty = Record("x", t, wanted, ("slide",), {"q": p[:, None]}, ("slide",))
    coarse, fine = (Forward(MODEL, [empty])(effects, step=s)[0] for s in (1 / 8, 1 / 16))
    q = 2.0 * fine - coarse + 5e-5 * rng.standard_normal(fine.shape)
    path.parent.mkdir(parents=True, exist_ok=True)
    table = np.column_stack([t, q, p, wanted["velocity"]])
    np.savetxt(path, table, "%.7f", ",", header="t,q,p,v", comments="")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folder, recordings and setting of three slides; slide 2 has friction from `ONSET` on."""
    folder, rows = tmp_path_factory.mktemp("fleet"), []
    for robot in (1, 2, 3):
        for day in range(1, DAYS + 1):
            for run in range(EACH):
                row = Recording(f"{robot}/{day}/{run}.csv", f"slide {robot}", f"day {day}")
                effects = [FRICTION] if robot == 2 and day >= ONSET else []
                recorded(folder / row.file, 100 * robot + 10 * day + run, effects)
                rows.append(row)
    (folder / "mapping.yaml").write_text(RULES)
    read = partial(importing.load, robot=MODEL.make_robot(),
                   mapping=mapping.load(folder / "mapping.yaml"))  # fmt: skip
    return SimpleNamespace(
        folder=folder, rows=rows, setting=tasks.Setting(read, MODEL, GAP, FleetParams())
    )


def run(made, rows, journal, **options):
    """Contents of ``fleet.json`` and the rows of recordings."""
    with Memory(journal, (MODEL,), tasks.RESULTS, stays=True) as memory:
        found = fleet.find(Fleet(rows), made.folder, made.setting, memory, **options)
    return contents.contents(found, "slide", {}), contents.rows(found)


@pytest.fixture(scope="module")
def finished(made):
    return run(made, made.rows, made.folder / "fleet.jsonl")


def test_the_robot_with_the_fault_has_it_since_its_day(finished):
    result, rows = finished
    (effect,) = result["effects"]
    assert (effect["effect"], effect["place"]) == ("coulomb_friction", "slide")
    assert effect["robots"] == ["slide 2"]
    (one,) = result["robots"][1]["effects"]
    assert (one["course"], one["day"]) == ("begins", f"day {ONSET}")
    assert one["probability"] > 0.99 and one["day_probability"] > 0.9
    assert one["size"] == pytest.approx(TORQUE, rel=0.02)
    assert [day["size"] > 1.0 for day in one["days"]] == [
        day >= ONSET for day in range(1, DAYS + 1)
    ]
    assert result["unexplained"] == [] and all(row["explained"] for row in rows)
    faulty = [row["robot"] == "slide 2" and row["day"] >= f"day {ONSET}" for row in rows]
    assert [row["before"] > 2.0 for row in rows] == faulty
    assert all(row["after"] < 1.25 for row in rows)


def test_neither_order_nor_names_of_robots_matter(made, finished, tmp_path):
    result, rows = finished
    assert run(made, made.rows[::-1], tmp_path / "order.jsonl") == finished
    other = {"slide 1": "slide 2", "slide 2": "slide 3", "slide 3": "slide 1"}
    renamed = [row._replace(robot=other[row.robot]) for row in made.rows]
    again, _ = run(made, renamed, tmp_path / "names.jsonl")
    was = {other[row["robot"]]: rounded(row["effects"]) for row in result["robots"]}
    assert {row["robot"]: rounded(row["effects"]) for row in again["robots"]} == was


def rounded(value):
    """Values with six digits: sums in another order differ in the last ones."""
    if isinstance(value, dict):
        return {key: rounded(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [rounded(entry) for entry in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def test_a_fleet_without_faults_names_nothing(made, tmp_path):
    healthy = [row for row in made.rows if row.robot != "slide 2"]
    result, _ = run(made, healthy, tmp_path / "null.jsonl")
    assert result["effects"] == result["unexplained"] == []
    assert {one["verdict"] for row in result["robots"] for one in row["searches"]} == {"no gap"}


def test_a_stopped_fleet_goes_on_to_the_same_bytes(made, finished, tmp_path):
    class StopError(Exception):
        """The user has had enough."""

    def stop(share, stage):
        if stage.startswith("measuring 7"):
            raise StopError

    journal = tmp_path / "fleet.jsonl"
    with pytest.raises(StopError):
        run(made, made.rows, journal, report=stop)
    lines = journal.read_bytes().count(b"\n")
    assert json.dumps(run(made, made.rows, journal)) == json.dumps(finished)
    assert journal.read_bytes().count(b"\n") > lines
    whole = journal.read_bytes()
    run(made, made.rows, journal)
    assert journal.read_bytes() == whole, "a finished fleet computes nothing again"


def test_processes_and_a_cluster_that_loses_one_give_the_same_bytes(
    made, finished, cluster, tmp_path
):
    address, workers = cluster

    def kill(share, stage):
        if stage.startswith("measuring 3"):
            workers[0].kill()

    for name, options in (
        ("two", {"workers": 2}), ("dask", {"workers": address, "report": kill}),
    ):  # fmt: skip
        again = run(made, made.rows, tmp_path / f"{name}.jsonl", **options)
        assert json.dumps(again) == json.dumps(finished)


def test_a_recording_that_cannot_be_read_is_told_and_the_others_go_on(made, finished, tmp_path):
    bad = Recording("broken.csv", "slide 2", "day 3")
    (made.folder / bad.file).write_text("t,q\n0,no number\n")
    journal = tmp_path / "fleet.jsonl"
    journal.write_bytes((made.folder / "fleet.jsonl").read_bytes())
    result, rows = run(made, [*made.rows, bad], journal)
    (one,) = result.pop("skipped")
    assert one["file"] == bad.file and "\n" not in one["reason"]
    assert {**result, "skipped": []} == finished[0] and rows == finished[1]
    with pytest.raises(ParameterError, match="none of 1 recordings can be used; broken.csv: "):
        run(made, [bad], tmp_path / "bad.jsonl")


def test_a_fault_on_one_day_in_the_middle_is_found_by_the_second_search(made, tmp_path):
    """The loudest day is searched first; what it does not explain on another day is searched."""
    bias = {"name": "sensor_bias", "joint": "slide", "q": 0.002}
    rows = [row for row in made.rows if row.robot == "slide 2"]
    for k in range(EACH):
        recorded(made.folder / f"bias_{k}.csv", k, [bias])
        rows.append(Recording(f"bias_{k}.csv", "slide 2", "day 1b"))
    result, _ = run(made, rows, tmp_path / "two.jsonl")
    assert sorted(one["effect"] for one in result["effects"]) == ["coulomb_friction", "sensor_bias"]
    assert len(result["robots"][0]["searches"]) == 2
