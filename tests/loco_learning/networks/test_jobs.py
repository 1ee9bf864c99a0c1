# SPDX-License-Identifier: Apache-2.0
"""Chapter 6 on a small scale: jobs, resuming, verdicts, page."""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_learning.networks import jobs as msd_jobs
from loco_learning.networks import page as msd_page
from loco_learning.networks.jobs import PLANS, Curves
from loco_learning.networks.reservoir import LOOPS
from loco_learning.networks.results import knee, load, roughness
from loco_learning.thesis import chapter6, registry

TINY = msd_jobs.Plan(
    nodes=(3, 5, 6, 8, 20),
    repetitions=1,
    disturbed=(2, 2),
    budget=(0, 20),
    omega_nodes=(5, 10),
    frequencies=(0.5, 2.0, 6.0),
    omega_repetitions=1,
    omega_evaluations=20,
    powers=(500.0, 5e3, 2e4),
    power_frequencies=(3.0,),
    power_repetitions=1,
    power_evaluations=20,
    loop_repetitions=1,
    noises=(1e-4, 1e-2, 1.0),
    regularisations=(0.01, 1.0),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tiny plan, run in this process."""
    patch = pytest.MonkeyPatch()
    short = LOOPS["thesis"].replace(train=12.0, closing=1.0, test=10.0)
    patch.setitem(LOOPS, "thesis", short)
    folder = tmp_path_factory.mktemp("msd")
    told = []
    msd_jobs.run(TINY, "thesis", folder, 1, "", lambda *state: told.append(state))
    total = (5 + 1) + 6 + 3 + 5 + 2 * 2 * 2 + 2
    assert told[-1][:2] == (total, total)
    yield folder
    patch.undo()


def test_a_second_run_finds_everything_done(folder):
    told = []
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    msd_jobs.run(TINY, "thesis", folder, 1, "", lambda *state: told.append(state))
    assert told == []
    assert before == {path: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_a_lost_or_foreign_file_is_made_again_with_the_same_numbers(folder):
    old = load(TINY, "thesis", folder)
    (folder / "omega_5_0_0.npz").unlink()
    (folder / "loop_6_0.npz").write_bytes((folder / "loop_5_0.npz").read_bytes())
    told = []
    msd_jobs.run(TINY, "thesis", folder, 1, "", lambda *state: told.append(state[2]))
    assert sorted(told) == ["loop_6_0", "omega_5_0_0"]
    new = load(TINY, "thesis", folder)
    assert new.omega[5, 0, 0].best == old.omega[5, 0, 0].best
    np.testing.assert_array_equal(new.loops[6, 0].arrays["error"], old.loops[6, 0].arrays["error"])


def test_every_claim_of_a_small_plan_is_open_and_says_how_many_runs_it_lacks(folder):
    """Two repetitions at most; only what is counted or solved has a verdict."""
    evidence = SimpleNamespace(other=lambda name: load(TINY, "thesis", folder))
    assert registry.MEASURES["score_grows"] is chapter6.score_grows
    for claim in registry.claims():
        if not claim.number.startswith("6."):
            continue
        verdict = registry.judge(claim, evidence)
        assert any(c.isdigit() for c in verdict.text), verdict
        if claim.holds:
            assert verdict.verdict == registry.HOLDS
        else:
            assert verdict.verdict == registry.OPEN
            assert f"of {claim.runs} runs" in verdict.reason or "rising" in verdict.reason


def test_disturbed_loops_are_of_several_gaits_and_draws(folder):
    results = load(TINY, "thesis", folder)
    assert set(results.alphas) == {(a, g, d) for a in (0.01, 1.0) for g in (0, 1) for d in (0, 1)}
    paths = [results.alphas[1.0, 0, draw].arrays["distance"] for draw in (0, 1)]
    assert not np.array_equal(*paths)
    assert set(results.noise) == {0, 1}
    assert results.noise[0].arrays["distance"].shape == (3, 10)


def test_all_figures_are_drawn_and_all_searches_listed(folder, tmp_path):
    drawn = msd_page.write(load(TINY, "thesis", folder), tmp_path)
    assert list(drawn) == list(msd_page.CAPTIONS)
    for number in msd_page.CAPTIONS:
        file = f"figure_{number.replace('.', '_')}.png"
        assert (tmp_path / file).stat().st_size > 3000
    rows = (tmp_path / "gaits.csv").read_text().splitlines()
    assert len(rows) == 1 + 6 + 6 + 3


def test_two_processes_give_the_same_files(folder, tmp_path):
    small = dataclasses.replace(
        TINY, nodes=(5, 6), omega_nodes=(), powers=(), loop_repetitions=0, regularisations=(),
        noises=(),
    )  # fmt: skip
    msd_jobs.run(small, "thesis", tmp_path, 2)
    one, two = (load(small, "thesis", place) for place in (folder, tmp_path))
    assert one.gaits[6, 0].best == two.gaits[6, 0].best


def test_a_plan_takes_the_same_jobs_from_another_one_and_runs_the_others(folder, tmp_path):
    """A change of the loops keeps the gaits, one of the searches keeps nothing."""
    for changes, kept in (({"loop": {"train": 6.0}}, True), ({"search": {"sigma": 0.3}}, False)):
        p = dataclasses.replace(
            TINY, nodes=(5,), disturbed=(0, 0), omega_nodes=(), powers=(), noises=(), **changes
        )
        ran, place = [], tmp_path / str(kept)
        msd_jobs.run(p, "thesis", place, 1, "", lambda *s, ran=ran: ran.append(s[2]),
                     finished=folder)  # fmt: skip
        assert ran == (["loop_5_0"] if kept else ["nodes_5_0", "loop_5_0"])
        assert kept == (
            (place / "nodes_5_0.npz").read_bytes() == (folder / "nodes_5_0.npz").read_bytes()
        )
        assert load(p, "thesis", place).loops[5, 0].values["closing"] == (6.0 if kept else 12.0)


def test_plans_are_named_and_the_full_one_is_that_of_the_thesis():
    with pytest.raises(NameUnknownError, match="full, loops, medium, quick"):
        msd_jobs.plan("fast")
    with pytest.raises(NameUnknownError, match="'sizes'.*nodes"):
        msd_jobs.plan("full", sizes=(3,))
    assert msd_jobs.plan("full", budget=(1, 2)).budget == (1, 2)
    full = msd_jobs.plan("full")
    assert full.nodes == tuple(range(3, 27))
    assert full.omega_repetitions == full.power_repetitions == 5
    assert full.repetitions == full.loop_repetitions == 10 and full.disturbed == (10, 10)


def test_the_page_of_chapter_6_has_the_numbers_of_jobs():
    page = (Path(__file__).parents[3] / "docs/msd.md").read_text()
    for name in ("quick", "medium", "full"):
        plan = PLANS[name]
        searches = len(msd_jobs.gait_jobs(plan, "thesis"))
        loops = sum(job.loop is not None for job in msd_jobs.later_jobs(plan, "thesis"))
        option = "`--quick`" if name == "quick" else f"`--plan {name}`"
        row = next(line for line in page.splitlines() if line.startswith(f"| {option} |"))
        cells = [cell.strip() for cell in row.strip("|").split("|")]
        assert (int(cells[1].split(",")[0]), int(cells[2])) == (searches, loops), name


def test_measures_of_known_curves():
    noise = np.logspace(-6, 0, 61)
    distance = np.where(noise < 0.03, 10.0, 2.0)[:, None]
    assert knee(Curves({}, {"noise": noise, "distance": distance})) == pytest.approx(0.02, rel=0.6)
    t = np.arange(0.0, 10.0, 0.02)
    circle = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    turning = Curves({"period": 1.0}, {"t": t, "cycle": circle})
    assert roughness(turning) < 1e-9
    still = Curves({"period": 1.0}, {"t": t, "cycle": 0.0 * circle})
    assert roughness(still) == np.inf
    noisy = circle + np.random.default_rng(0).normal(size=circle.shape)
    assert roughness(Curves({"period": 1.0}, {"t": t, "cycle": noisy})) > 0.5
