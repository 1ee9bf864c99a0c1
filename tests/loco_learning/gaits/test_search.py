# SPDX-License-Identifier: Apache-2.0
"""Gait search: what is searched, how it is scored, on which bodies, and what is shipped."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_control.gait.oscillators import Cpg
from loco_learning.drawing import png
from loco_learning.gaits import figures as gait_figures
from loco_learning.gaits import search as gait_search
from loco_learning.gaits.search import GAITS, GaitProblem, GaitSearchParams, draw_bodies, judge
from loco_learning.runs import experiment, gait_file
from loco_learning.search import evaluations
from loco_learning.search.population import PopulationParams

SHORT = GaitSearchParams(duration=1.0)


@pytest.fixture(scope="module")
def problem():
    return GaitProblem(SHORT)


@pytest.fixture(scope="module")
def log(problem):
    """A short log; do not change it."""
    return problem.run(problem.target(problem.start), {})


@pytest.fixture(scope="module", autouse=True)
def few_checks():
    """Results are tried on few other bodies."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gait_search, "CHECKS", 2)
        yield


@pytest.fixture(scope="module")
def found(tmp_path_factory, few_checks):
    """Folder, gait and optimum of a search of two generations."""
    folder = tmp_path_factory.mktemp("search")
    options = PopulationParams(workers=0, evaluations=8, population=4, sigma=0.05)
    gait, optimum = gait_search.search(SHORT, options, folder)
    return folder, gait, optimum


# ---- what is searched


@pytest.mark.parametrize("gait", GAITS)
def test_pairs_stay_pairs_whatever_is_searched(gait):
    problem = GaitProblem(SHORT.replace(gait=gait))
    rng = np.random.default_rng(3)
    for u in rng.uniform(size=(5, 7)):
        target = problem.target(problem.low + u * (problem.high - problem.low))
        assert target.frequency == 1.0
        cpg = Cpg(target, 4, 0.01)
        for k in range(200):
            cpg.step(0.01 * k)
        one, two = ((0, 1), (2, 3)) if gait.endswith("bound") else ((0, 3), (1, 2))
        for pair in (one, two):
            assert cpg.phase[pair[0]] == pytest.approx(cpg.phase[pair[1]], abs=1e-6)
        apart = (cpg.phase[two[0]] - cpg.phase[one[0]]) % 1.0
        assert 0.25 <= apart <= 0.75
        for values in (target.amplitude, target.duty_factor, target.offset):
            assert values[0] == values[1] and values[2] == values[3]


def test_the_search_starts_in_the_middle_or_from_a_gait(problem):
    np.testing.assert_allclose(problem.start, 0.5 * (problem.low + problem.high))
    warm = GaitProblem(SHORT, {"offset_hind": -0.4})
    assert warm.start[problem.names.index("offset_hind")] == -0.4
    with pytest.raises(NameUnknownError, match="did you mean 'offset_hind'"):
        GaitProblem(SHORT, {"offset_hint": -0.4})


def test_a_robot_without_four_driven_joints_is_refused():
    with pytest.raises(ParameterError, match="4 driven joints.*'hyq' has 12"):
        GaitProblem(SHORT.replace(robot="hyq"))


# ---- how it is scored


def test_walking_is_better_than_standing_than_falling_than_exploding(log):
    ahead = dict(log.columns)
    ahead["position"] = log.position + np.linspace(0.0, 0.1, len(log))[:, None] * [1.0, 0.0, 0.0]
    still = {**ahead, "position": np.zeros_like(log.position)}
    walking = judge(dataclasses.replace(log, columns=ahead, fall=""))
    standing = judge(dataclasses.replace(log, columns=still, fall=""))
    tipped = dataclasses.replace(log, fall="pitch 0.9 rad is beyond 0.8 rad")
    late, early = judge(tipped), judge(tipped.cut(slice(0, 20)))
    gone = judge(dataclasses.replace(log, fall="the state is not finite"))
    far = judge(dataclasses.replace(log, columns={**still, "position": 1e4 * ahead["position"]}))
    values = [s.value for s in (walking, standing, late, early, gone)]
    assert values == sorted(values) and len(set(values)) == 5
    assert far.value == gone.value and far.reason.startswith("exploded: ")
    assert (walking.reason, standing.reason) == ("", "")
    assert early.reason == "fell: pitch 0.9 rad is beyond 0.8 rad"


def test_the_score_is_minus_the_mean_forward_speed(problem, log):
    score = problem(problem.start)
    assert score.value == pytest.approx(-log.distance / 1.0)
    assert score.extra == {"speed": -score.value, "falls": 0}


# ---- bodies


def test_bodies_are_drawn_around_the_nominal_one(problem):
    nominal = problem._nominal
    assert draw_bodies(nominal, 0.0, 2, 0) == [{}, {}]
    bodies = draw_bodies(nominal, 0.1, 400, 0)
    assert bodies == draw_bodies(nominal, 0.1, 400, 0) != draw_bodies(nominal, 0.1, 400, 1)
    assert {key.split(".")[0] for key in bodies[0]} == {"springs", "contacts", "masses"}
    plant = nominal.plant
    for joint, spring in plant.springs.items():
        drawn = np.array([b[f"springs.{joint}.stiffness"] for b in bodies]) / spring.stiffness
        assert drawn.mean() == pytest.approx(1.0, abs=0.03)
        assert drawn.std() == pytest.approx(0.1, abs=0.02)
    masses = [b["masses.front_body"] + b["masses.hind_body"] for b in bodies]
    assert np.mean(masses) == pytest.approx(0.95, abs=0.02)


def test_a_score_is_the_mean_over_the_bodies():
    many = GaitProblem(SHORT.replace(randomise=0.2, samples=3))
    target = many.target(many.start)
    each = [judge(many.run(target, body)).value for body in many.bodies]
    assert len(set(each)) == 3
    travelled = pickle.loads(pickle.dumps(many))
    assert travelled(many.start).value == pytest.approx(np.mean(each), abs=1e-12)


# ---- the search, and what it leaves


def test_a_search_leaves_a_gait_that_says_everything(found, tmp_path):
    folder, gait, optimum = found
    assert optimum.evaluations == gait.evaluations == 8
    assert gait.parameters == pytest.approx(optimum.named(), abs=1e-4)
    assert gait.speed == pytest.approx(-optimum.value, abs=0.02)
    assert gait.check["bodies"] == gait_search.CHECKS
    gait.save(tmp_path / "gait.yaml")
    assert gait_file.load(tmp_path / "gait.yaml") == gait
    again, _ = gait_search.search(
        SHORT, PopulationParams(workers=0, evaluations=8, population=4, sigma=0.05), folder
    )
    assert again == gait
    made = gait_figures.experiment_of(gait)
    assert made.target == gait.target and made.duration == 1.0


def test_another_body_is_another_search(found):
    folder, _, _ = found
    options = PopulationParams(workers=0, evaluations=8, population=4, sigma=0.05)
    with pytest.raises(ParameterError, match="belongs to other work: problem.randomise is"):
        gait_search.search(SHORT.replace(randomise=0.1), options, folder)


def test_pictures_are_drawn(found, tmp_path):
    folder, gait, _ = found
    chart = gait_figures.convergence([folder, folder], "two seeds")
    best, walking, *_ = chart.frames[0].layers
    assert (np.diff(best.y) >= 0.0).all() and not (walking.y > best.y).any()  # NaN: all fell
    png.write(chart, tmp_path / "convergence.png")
    assert (tmp_path / "convergence.png").stat().st_size > 5000
    gait_figures.animate(gait, tmp_path / "gait.gif", seconds=0.2)
    assert (tmp_path / "gait.gif").read_bytes()[:3] == b"GIF"


@pytest.mark.parametrize(
    ("change", "kind", "message"),
    [
        ("format: 2", ParameterError, "of kind 'gait', format 2; wanted is 'gait', format 1"),
        ("kind: model", ParameterError, "of kind 'model', format 1"),
        ("sped: 1.0", NameUnknownError, "did you mean 'speed'"),
        ("target: {amplitude: [9.0]}", ParameterError, r"target.amplitude\[0\] must be in"),
    ],
)
def test_a_wrong_gait_file_gets_one_clear_message(found, tmp_path, change, kind, message):
    path = tmp_path / "gait.yaml"
    found[1].save(path)
    key = change.split(":")[0]
    kept, skip = [], False
    for line in path.read_text().splitlines():
        skip = line.startswith(f"{key}:") or (skip and line.startswith((" ", "-")))
        if not skip:
            kept.append(line)
    path.write_text("\n".join([*kept, change]) + "\n")
    with pytest.raises(kind, match=message):
        gait_file.load(path)


def test_missing_gaits_are_named(tmp_path):
    with pytest.raises(MissingFileError, match=r"no gait file .*nowhere.yaml"):
        gait_file.load(tmp_path / "nowhere.yaml")
    with pytest.raises(NameUnknownError, match="did you mean 'bound'"):
        gait_file.load("bounde")
    (tmp_path / "half.yaml").write_text("kind: gait\nformat: 1\nname: half\n")
    with pytest.raises(ParameterError, match="lacks robot, target"):
        gait_file.load(tmp_path / "half.yaml")


# ---- what is shipped


@pytest.mark.parametrize("name", ["bound", "walk"])
def test_a_shipped_gait_carries_the_robot_for_its_whole_time(name):
    gait = gait_file.load(name)
    assert gait.duration == 15.0 and gait.target.frequency == 1.0
    made = experiment.load(f"tigrillo_{name}")
    assert made.target == gait.target
    assert made.overrides == gait_figures.experiment_of(gait).overrides
    log = gait_search.rollout(made)
    assert (log.fall, log.complete) == ("", True)
    # Not to the last digit: what the feet do is chaotic, and processors round differently.
    assert log.distance == pytest.approx(gait.distance, rel=0.3)


def test_records_of_a_search_can_be_read_without_searching(found):
    header, rows = evaluations.read(found[0])
    assert header["problem"]["gait"] == "tigrillo_bound"
    assert len(rows) == 8
